"""Fourier coefficients of a system's own signals, forcing and motion, at parameter values and as expressions of them.

Sums and products of sines and cosines have a highest harmonic, and equidistant samples are exact. All other signals are
put on panels between their switches (`quadrature`), anew at each parameter point, as their parameters may make them
steep; what they are wrong by is known, and an error where it is more than the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from hbnlp.core.errors import SamplingError
from hbnlp.core.kept import built_once, by_one_thread
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import FourierBasis, basis_derivatives, n_coefficients
from hbnlp.systems.chunks import in_chunks, of_columns
from hbnlp.systems.parameters import ParameterSet
from hbnlp.systems.quadrature import Breaks, Resolved, resolve
from hbnlp.systems.slopes import slope_along
from hbnlp.systems.spectrum import spectra
from hbnlp.systems.switch_points import SwitchPoints
from hbnlp.systems.system import System

ALIASING_TOL = 1e-9
"""Nothing that is sampled may be wrong by more than this, relative to its size, for want of samples."""


class PeriodicSignals:
    """Signals (k,) of the phase tau and the parameters, with their harmonics.

    Parameters
    ----------
    what : str
        For messages: "forcing".
    expression : casadi.SX
    tau, p : casadi.SX
        Its symbols.
    parameters : ParameterSet
        What p holds.

    Attributes
    ----------
    highest : int or None
        The highest harmonic; None where there is none that could be told.
    """

    def __init__(self, what: str, expression: ca.SX, tau: ca.SX, p: ca.SX, parameters: ParameterSet) -> None:
        self._what, self._parameters = what, parameters
        self._expression, self._tau, self._p = ca.densify(expression), tau, p
        self._value = ca.Function("signals", [tau, p], [self._expression])
        orders = [each.highest if each is not None else None for each in spectra(self._value, 0)[0]]
        known = [order for order in orders if order is not None]
        self.highest = max(known, default=0) if len(known) == len(orders) else None
        self._matters = np.array([ca.depends_on(self._expression, p[i]) for i in range(p.numel())], dtype=bool)
        self._latest: tuple[bytes, Resolved] | None = None

    def coefficients(self, values: Array, n_harmonics: int) -> Array:
        """Return the coefficients (k, 2H+1) at parameter values.

        Raises
        ------
        ValueError
            If the signals are not periodic there (a parameter multiplies tau).
        SamplingError
            If they are not smooth enough between their switches.
        """
        if self.highest is not None:
            basis = self._equidistant(n_harmonics)
            return basis.projected(self._sampled(basis.theta, values))
        resolved = self._resolved(values, n_harmonics)
        return np.asarray(resolved.samples @ resolved.rule.projection(n_harmonics).T)

    def slope(self, values: Array, index: int, n_harmonics: int) -> Array:
        """Return the derivatives (k, 2H+1) of the coefficients by one parameter, which may move the switches, too."""
        direction = (np.arange(values.size) == index).astype(float)
        if self.highest is not None:
            basis = self._equidistant(n_harmonics)
            still = np.zeros((1, basis.n_samples))
            return basis.projected(in_chunks(self._along, basis.theta[None, :], still, values, direction))
        rule, samples, _ = self._resolved(values, n_harmonics)
        nodes, weights = rule.moved(self._switch_points.along(rule.breaks, values, index))
        along = in_chunks(self._along, rule.theta[None, :], nodes[None, :], values, direction)
        projection = rule.projection(n_harmonics)
        turned = basis_derivatives(rule.theta, n_harmonics) * (rule.weights / np.pi * nodes)[:, None]
        turned[:, 0] = 0.0
        relative = np.divide(weights, rule.weights)
        return np.asarray((along + samples * relative) @ projection.T + samples @ turned)

    def symbolic(self, p: ca.MX, n_harmonics: int) -> ca.MX:
        """Return the coefficients (k, 2H+1) as an expression of the parameters.

        The samples are those that are exact, or twice those that the default values of the parameters take; switches
        that the parameters move are solved for.
        """
        if self.highest is not None:
            basis = self._equidistant(n_harmonics)
            samples = self._value.map(basis.n_samples)(ca.DM(basis.theta[None, :]), ca.repmat(p, 1, basis.n_samples))
            return samples @ ca.DM(basis.projection.T)
        typical = self._parameters.ordered(self._parameters.defaults)
        typical = np.where(np.isfinite(typical), typical, 1.0)
        breaks = self._switch_points.at(typical)
        resolved = resolve(lambda theta: self._sampled(theta, typical), breaks, n_harmonics)
        if not resolved.error <= ALIASING_TOL:
            raise ValueError(
                f"{self._what} is singular at the default values of the parameters (1 where there is none), at which a "
                "program takes its samples; give parameters typical values"
            )
        rule = resolved.rule.halved()
        count = rule.theta.size
        phases, basis_at = ca.MX(ca.DM(rule.theta[None, :])), ca.MX(ca.DM(rule.projection(n_harmonics)))
        if self._switch_points.move:
            phases, basis_at = self._switch_points.moving(rule, p, n_harmonics)
        return self._value.map(count)(phases, ca.repmat(p, 1, count)) @ basis_at.T

    def integrals(self, values: Array, kernel: Callable[[Array], ComplexArray]) -> ComplexArray:
        """Return the integrals (r, k) over 0 <= tau < 2 pi of the signals times ``kernel``, (n,) -> (r, n)."""
        self._check_period(values)

        def products(theta: Array) -> Array:
            complex_rows = kernel(np.mod(theta, 2.0 * np.pi))[:, None] * self._sampled(theta, values)
            return np.concatenate([complex_rows.real, complex_rows.imag]).reshape(-1, theta.size)

        phases, of = self._switch_points.at(values)
        order = np.argsort(np.append(phases, 2.0 * np.pi))
        breaks = Breaks(np.append(phases, 2.0 * np.pi)[order], np.append(of, -1)[order])
        rule, samples, error = resolve(products, breaks, 0)
        self._check_error(error)
        real, imaginary = (samples @ rule.weights).reshape(2, -1, self._expression.numel())
        return np.asarray(real + 1j * imaginary)

    def _equidistant(self, n_harmonics: int) -> FourierBasis:
        assert self.highest is not None
        least = max(128, 8 * n_coefficients(n_harmonics))
        return FourierBasis(n_harmonics, max(least, n_harmonics + self.highest + 1))

    def _sampled(self, theta: Array, values: Array) -> Array:
        return in_chunks(self._in_chunk, theta[None, :], values)

    def _resolved(self, values: Array, n_harmonics: int) -> Resolved:
        """Return the signals on panels; what was asked for last is kept."""
        key = values[self._matters].tobytes() + n_harmonics.to_bytes(8, "little")
        latest = self._latest
        if latest is not None and latest[0] == key:
            return latest[1]
        self._check_period(values)
        breaks = self._switch_points.at(values)
        resolved = resolve(lambda theta: self._sampled(theta, values), breaks, n_harmonics)
        self._check_error(resolved.error)
        self._latest = (key, resolved)
        return resolved

    def _check_error(self, error: float) -> None:
        if error > ALIASING_TOL:
            raise SamplingError(
                f"the harmonics of {self._what} are known to {error:.1e} only, {ALIASING_TOL:.0e} is needed: it is "
                "singular, or so steep that its own values are rounded; smooth it"
            )

    def _check_period(self, values: Array) -> None:
        """Raise a ValueError where a parameter multiplies the phase by a number that is not whole."""
        phases = np.random.default_rng(11).uniform(0.0, 2.0 * np.pi, 16)
        now, later = np.hsplit(self._sampled(np.concatenate([phases, phases + 2.0 * np.pi]), values), 2)
        if np.any(np.abs(later - now) > 1e-6 * np.max(np.abs(now), axis=1, keepdims=True)):
            at = ", ".join(
                f"{name} = {value:g}" for name, value in self._parameters.as_dict(values).items() if name != "omega"
            )
            raise ValueError(
                f"{self._what} is not 2 pi-periodic in tau = omega t at {at}: a parameter that multiplies tau has to "
                "be a whole number"
            )

    @built_once
    def _switch_points(self) -> SwitchPoints:
        return SwitchPoints(self._what, self._expression, self._tau, self._p)

    @built_once
    def _in_chunk(self) -> ca.Function:
        return of_columns(self._value, [1])

    @built_once
    def _along(self) -> ca.Function:
        """(tau, dtau, p, dp) -> the derivative of the signals along (dtau, dp), a chunk at once."""
        ahead, direction = ca.SX.sym("ahead"), ca.SX.sym("direction", self._p.numel())
        slope = slope_along(self._expression, self._p, direction, self._tau, ahead)
        function = ca.Function("signals_along", [self._tau, ahead, self._p, direction], [slope])
        return of_columns(function, [2, 3])


@by_one_thread
def excitation_signals(system: System) -> tuple[PeriodicSignals, PeriodicSignals]:
    """Return the forcing and the prescribed motion of a system with their harmonics."""
    of = (system.tau, system.p, system.parameters)
    return PeriodicSignals("forcing", system.forcing, *of), PeriodicSignals("motion", system.motion, *of)
