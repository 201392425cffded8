"""The classical Runge-Kutta scheme with fixed steps, compiled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import casadi as ca
import numpy as np

from hbnlp.core.native import bound
from hbnlp.core.types import Array
from hbnlp.integration.first_order import FirstOrderForm, Propagator, Window
from hbnlp.integration.fixed_steps import broken_off, check_steps

HALF_DISC = 2.61
"""|h lambda| below this, in the left half plane, lies in the stability region of RK4: the region ends at 2.785 on the
real axis, at 2.828 on the imaginary one, and at 2.6156 in between."""
RESOLVED = 1.0
"""|h lambda| of the fastest eigenvalue where `RungeKutta4` chooses the steps: leaves room for a stiffening force."""
FEWEST_STEPS = 256
"""Steps a period that `RungeKutta4` chooses at least: a phase error of 2e-8 a period at the forcing frequency."""
CHUNK = 64
"""Steps in one call of the compiled function."""


@final
@dataclass(frozen=True, kw_only=True)
class RungeKutta4:
    """The classical fourth-order Runge-Kutta scheme with fixed steps.

    Parameters
    ----------
    steps_per_period : int, optional
        Steps in one period of the forcing. By default as many as keep ``|h lambda| <= 1`` for every eigenvalue of the
        system (linearised about rest and about the initial state), and at least 256. A given number is checked against
        the stability limit, ``|1 + z + z^2/2 + z^3/6 + z^4/24| <= 1`` with ``z = h lambda``.

    Notes
    -----
    The error of a signal falls as the fourth power of the step. A mode of eigenvalue ``i s`` is damped by a relative
    ``(h s)^6 / 144`` a step.

    A corner of the force needs no rounding, but lowers the order: 256 steps leave 5e-5 of a contact's first harmonic,
    1024 some 1e-6; of dry friction 4e-4 and 1e-4. `Adaptive` keeps its tolerances at a kink. Where a step of the force
    holds the motion fast (sticking), it changes sign at every step of either scheme: round it.
    """

    steps_per_period: int | None = None

    def __post_init__(self) -> None:
        check_steps(self.steps_per_period)

    def propagator(self, form: FirstOrderForm, packed: Array, state: Array, periods: int) -> Propagator:
        """Return the scheme at one parameter point.

        Raises
        ------
        ValueError
            If the step is beyond the stability limit; the message names the number of steps that would do.
        """
        eigenvalues = form.eigenvalues(packed, state)
        steps = self.steps_per_period
        if steps is None:
            steps = chosen_steps(eigenvalues)
        else:
            _check_stability(int(steps), eigenvalues)
        return _FixedSteps(form, packed, int(steps), periods)


def chosen_steps(eigenvalues: Array) -> int:
    """Return the steps a period that resolve these eigenvalues, by phase: a multiple of `CHUNK`."""
    fastest = 2.0 * np.pi * float(np.abs(eigenvalues).max())
    return CHUNK * int(np.ceil(max(FEWEST_STEPS, fastest / RESOLVED) / CHUNK))


def _check_stability(steps: int, eigenvalues: Array) -> None:
    z = 2.0 * np.pi / steps * eigenvalues
    growth = np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))
    if np.all(np.where(z.real <= 0.0, growth <= 1.0 + 1e-12, np.abs(z) < HALF_DISC)):
        return
    enough = int(np.ceil(2.0 * np.pi * np.abs(eigenvalues).max() / HALF_DISC))
    raise ValueError(
        f"steps_per_period = {steps} is beyond the stability limit of RK4: |h lambda| = {np.abs(z).max():.3g} for the "
        f"fastest eigenvalue, and about 2.8 is the most (2.785 for real ones, 2.828 for imaginary ones); "
        f"take steps_per_period >= {enough}, None (automatic), or Adaptive()"
    )


class _FixedSteps:
    """`CHUNK` steps of RK4 a call, on numpy memory and without copies."""

    def __init__(self, form: FirstOrderForm, packed: Array, steps: int, periods: int) -> None:
        self._steps, self._n_steps = steps, steps * periods
        self._step = 2.0 * np.pi / steps
        self._tau = np.zeros(CHUNK)
        self._h = np.zeros(CHUNK)
        self._start = np.zeros(form.system.n_state)
        self._path = np.zeros((CHUNK, form.system.n_state))
        chunk = form.compiled("rk4", lambda: _chunk(form))
        self._run = bound(chunk, [self._start, self._tau, self._h, np.ascontiguousarray(packed)], [self._path])

    def __call__(self, state: Array) -> Window:
        states = np.empty((self._n_steps + 1, state.size))
        states[0] = state
        for first in range(0, self._n_steps, CHUNK):
            count = min(CHUNK, self._n_steps - first)
            self._start[:] = states[first]
            self._tau[:] = self._step * (first + np.arange(CHUNK))
            self._h[:] = np.where(np.arange(CHUNK) < count, self._step, 0.0)
            self._run()
            states[first + 1 : first + 1 + count] = self._path[:count]
            broken = broken_off(states, first, first + count, self._steps)
            if broken is not None:
                return broken
        return Window(states, self._step)


def _chunk(form: FirstOrderForm) -> ca.Function:
    """Return the CasADi function (state, phases, steps, packed) -> the states after each of `CHUNK` steps."""
    rate = form.rate
    symbol = ca.SX if rate.is_a("SXFunction") else ca.MX
    y, tau, h, p = (symbol.sym(*s) for s in (("y", form.system.n_state), ("tau",), ("h",), ("p", form.n_packed)))
    k1 = rate(y, tau, p)
    k2 = rate(y + h / 2 * k1, tau + h / 2, p)
    k3 = rate(y + h / 2 * k2, tau + h / 2, p)
    k4 = rate(y + h * k3, tau + h, p)
    step = ca.Function("step", [y, tau, h, p], [y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    # mapaccum and fold would copy the packed matrices for every step
    start, taus, hs = ca.MX.sym("start", form.system.n_state), ca.MX.sym("taus", CHUNK), ca.MX.sym("hs", CHUNK)
    packed = ca.MX.sym("packed", form.n_packed)
    state, path = start, []
    for tau_k, h_k in zip(ca.vertsplit(taus), ca.vertsplit(hs), strict=True):
        state = step(state, tau_k, h_k, packed)
        path.append(state)
    return ca.Function("chunk", [start, taus, hs, packed], [ca.horzcat(*path)])
