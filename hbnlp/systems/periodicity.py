"""Whether force, forcing and motion are functions of their own symbols, differentiable, and periodic in the phase."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from hbnlp.core.types import Array
from hbnlp.systems.called import check_derivatives
from hbnlp.systems.expressions import check_symbols
from hbnlp.systems.parameters import OMEGA, ParameterSet

IRRATIONAL = float(np.sqrt(np.pi))
"""What omega is while periodicity is tested: with a whole number in front of tau, anything would be periodic."""
PHASES = 16
"""Where periodicity is tested."""
LONGEST_PERIOD = 12
"""Up to so many periods are tried for what is not periodic in one, to say so."""


def check_signals(
    parameters: ParameterSet, force: ca.SX, forcing: ca.SX, motion: ca.SX, symbols: tuple[ca.SX, ca.SX, ca.SX, ca.SX]
) -> None:
    """Raise a ValueError for a force, forcing or motion of other symbols than its own, or not periodic."""
    q, v, tau, p = symbols
    rng, defaults = np.random.default_rng(7), parameters.ordered(parameters.defaults)
    known = np.isfinite(defaults) & (defaults != 0.0)
    typical = [*rng.uniform(-1.0, 1.0, (2, q.numel())), np.where(known, defaults, 1.0)]
    phased = _Phased(tau, [q, v, p], typical, parameters.index(OMEGA))
    check_symbols("nonlinear_force", force, [tau, q, v, p])
    check_symbols("forcing", forcing, [tau, p])
    check_symbols("motion", motion, [tau, p])
    for what, expression in (("nonlinear_force", force), ("forcing", forcing), ("motion", motion)):
        check_derivatives(what, expression)
        _check_periodicity(what, expression, phased)


class _Phased(NamedTuple):
    """The phase, the other symbols of an expression with typical values, and the place of omega among the last."""

    tau: ca.SX
    others: list[ca.SX]
    typical: list[Array]
    omega: int


def _check_periodicity(what: str, expression: ca.SX, of: _Phased) -> None:
    """Raise a ValueError unless an expression is 2 pi-periodic in tau, whatever omega is."""
    if not ca.depends_on(expression, of.tau):
        return
    # what depends on tau is seen in the derivative, however small it is beside the rest; a step in the value alone
    signals = ca.vertcat(ca.densify(expression), ca.densify(ca.jacobian(expression, of.tau)))
    function = ca.Function("signals", [of.tau, *of.others], [signals])
    size = expression.numel()

    def repeats(omega: float, periods: int = 1) -> bool:
        at = [*of.typical[:-1], of.typical[-1].copy()]
        at[-1][of.omega] = omega
        phases = np.random.default_rng(11).uniform(0.0, 2.0 * np.pi, PHASES)
        now, later = (
            np.hstack([function(phase + lapse, *at).full() for phase in phases])
            for lapse in (0.0, 2.0 * np.pi * periods)
        )
        scale = np.max(np.abs(now), axis=1)
        scale[size:] = np.maximum(scale[size:], 1e-6 * scale[:size])
        return not bool(np.any(np.abs(later - now) > 1e-8 * scale[:, None]))

    if repeats(IRRATIONAL):
        return
    if ca.depends_on(expression, of.others[-1][of.omega]) and repeats(1.0):
        advice = "tau = omega t holds omega already: write cos(tau) for cos(omega t)"
    else:
        longer = next((k for k in range(2, LONGEST_PERIOD + 1) if repeats(IRRATIONAL, k)), None)
        advice = "write it with sines and cosines of whole multiples of tau, or of fmod(tau, 2 pi)"
        if longer is not None:
            advice = (
                f"it repeats itself after {longer} periods: let omega be the frequency of the whole, 1/{longer} of "
                f"what it was, and write tau for tau / {longer} and {longer} tau for tau"
            )
    raise ValueError(f"{what} is not 2 pi-periodic in tau = omega t; {advice}")
