"""An exponential Runge-Kutta scheme: the linear part of a system exactly, the force by fourth-order stages.

With the state y = (q, q', x), its linear part L and what else drives it, N = (load - f(q, q', tau), u''), ::

    y' = L y + G N,     y(t + h) = e^{hL} y + integral_0^h e^{(h-s)L} G N(t + s) ds

N is interpolated between the stages of a step, the integrals are those of the functions phi_k, ::

    phi_k(z) = integral_0^1 e^{(1-s) z} s^{k-1} / (k-1)! ds,     phi_1(z) = (e^z - 1) / z

so that a lag state, however fast it decays, asks for no short steps. Each stage is linear in the state and the N of the
stages before it: one matrix, formed once per parameter point, times what is known so far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import casadi as ca
import numpy as np
from scipy.linalg import expm

from hbnlp.core.checks import whole_number
from hbnlp.core.native import bound
from hbnlp.core.types import Array
from hbnlp.integration.first_order import FirstOrderForm, Propagator, Window

RESOLVED = 0.75
"""|h s| of the fastest eigenvalue of the structure, its lag states held, where the steps are chosen. Measured on the
paper's wing: with up to 2.2, at its largest tension, the scheme holds; from 2.6 on it may not."""
FEWEST_STEPS = 256
"""Steps a period that are chosen at least: 1e-8 to 2e-6 of the wing's state a period."""
MIDDLE, END = 0.5, 1.0


@final
@dataclass(frozen=True, kw_only=True)
class ExponentialRungeKutta4:
    """The exponential Runge-Kutta scheme of Krogstad, of fourth order, with fixed steps.

    Exact for linear systems under a constant load. For systems with lag states that decay much faster than the
    structure moves: the steps of `RungeKutta4` are bound by the fastest of them, these by the force alone.

    Parameters
    ----------
    steps_per_period : int, optional
        Steps in one period of the forcing. By default as many as keep ``|h s| <= 0.75`` for every eigenvalue of the
        structure (its lag states held; linearised about rest and about the initial state), and at least 256.

    Notes
    -----
    The error of a signal falls as the fourth power of the step. Too long a step for a force that stiffens shows as a
    state that is not finite. As for `RungeKutta4`, corners of the force lower the order.

    References
    ----------
    Krogstad (2005), Generalized integrating factor methods for stiff PDEs, J. Comput. Phys. 203, 72-88,
    doi:10.1016/j.jcp.2004.08.006 (ETDRK4-B). Hochbruck and Ostermann (2010), Exponential integrators, Acta Numer. 19,
    209-286, doi:10.1017/S0962492910000048.
    """

    steps_per_period: int | None = None

    def __post_init__(self) -> None:
        if self.steps_per_period is not None:
            advice = ", or None to have it chosen"
            whole_number("steps_per_period", self.steps_per_period, least=4, most=10_000_000, advice=advice)

    def propagator(self, form: FirstOrderForm, packed: Array, state: Array, periods: int) -> Propagator:
        """Return the scheme at one parameter point; steps that are not given are chosen for it and ``state``."""
        steps = self.steps_per_period
        if steps is None:
            fastest = 2.0 * np.pi * float(np.abs(form.eigenvalues(packed, state, lags=False)).max())
            steps = max(FEWEST_STEPS, int(np.ceil(fastest / RESOLVED)))
        return _FixedSteps(form, packed, int(steps), periods)


class _FixedSteps:
    """Four products of a matrix and what is known so far a step, and four evaluations of N, on the same memory."""

    def __init__(self, form: FirstOrderForm, packed: Array, steps: int, periods: int) -> None:
        self._n_steps, self._step = steps * periods, 2.0 * np.pi / steps
        self._too_long = (
            "the state is not finite any more; the system diverges, or the step is too long where its force stiffens: "
            f"try steps_per_period={2 * steps}, or Adaptive()"
        )
        driven = form.compiled("driven", lambda: _driven(form))
        n_state, n_moving, n_driven = form.system.n_state, 2 * form.system.n_dof, driven.size1_out(0)
        linear, input_matrix = form.linear_part(packed)
        first, second, third, last = _stages(self._step * linear, self._step * input_matrix)
        self._known = np.zeros(n_state + 4 * n_driven)
        self._stage, self._tau = np.zeros(n_moving), np.zeros(1)
        known = [self._known[: n_state + count * n_driven] for count in range(1, 5)]
        values = np.ascontiguousarray(packed[: len(form.system.parameters.names)])

        def evaluating(at: Array, stage: int) -> Callable[[], None]:
            return bound(driven, [at, self._tau, values], [known[stage][-n_driven:]])

        # where N depends on the displacements and velocities only, a stage needs no more of the state
        self._begin = evaluating(self._known[:n_moving], 0)
        self._stages = [
            (np.ascontiguousarray(matrix[:n_moving]), known[i], place, evaluating(self._stage, i + 1))
            for i, (matrix, place) in enumerate(((first, MIDDLE), (second, MIDDLE), (third, END)))
        ]
        self._last = last
        self._state = self._known[:n_state]

    def __call__(self, state: Array) -> Window:
        states = np.empty((self._n_steps + 1, state.size))
        states[0] = self._state[:] = state
        step, tau, stage, dot = self._step, self._tau, self._stage, np.dot
        with np.errstate(invalid="ignore", over="ignore"):
            for i in range(self._n_steps):
                tau[0] = i * step
                self._begin()
                for matrix, known, place, evaluate in self._stages:
                    dot(matrix, known, out=stage)
                    tau[0] = (i + place) * step
                    evaluate()
                self._state[:] = dot(self._last, self._known, out=states[i + 1])
        if not np.all(np.isfinite(states[-1])):  # what is not finite stays so
            good = int(np.argmin(np.isfinite(states).all(axis=1)))
            return Window(states[:good], self._step, good * self._step, self._too_long)
        return Window(states, self._step)


def _driven(form: FirstOrderForm) -> ca.Function:
    """Return the CasADi function ((q, q'), tau, parameter values) -> N = (load - f, u'')."""
    system = form.system
    moving, tau, p = ca.MX.sym("moving", 2 * system.n_dof), ca.MX.sym("tau"), ca.MX.sym("p", system.p.numel())
    load, _ = system.excitation(tau, p)
    if system.is_nonlinear:
        q, v = ca.vertsplit(moving, system.n_dof)
        load -= system.compiled_force.value(q, v, tau, p)
    _, motion = system.motion_derivatives
    motion = ca.Function("motion", [system.tau, system.p], [motion])(tau, p)
    return ca.Function("driven", [moving, tau, p], [ca.densify(ca.vertcat(load, motion))]).expand()


def _stages(linear: Array, input_matrix: Array) -> list[Array]:
    """Return the matrices of the three inner stages and of the step, from h L (n, n) and h G (n, k).

    Each takes the state and N at the beginning and at the stages so far, one under the other (Krogstad's tableau).
    """
    half, (half_1, half_2, _) = _phi_products(linear / 2.0, input_matrix)
    whole, (phi_1, phi_2, phi_3) = _phi_products(linear, input_matrix)
    middle = 2.0 * phi_2 - 4.0 * phi_3
    return [
        np.hstack([half, half_1 / 2.0]),
        np.hstack([half, half_1 / 2.0 - half_2, half_2]),
        np.hstack([whole, phi_1 - 2.0 * phi_2, np.zeros_like(phi_1), 2.0 * phi_2]),
        np.hstack([whole, phi_1 - 3.0 * phi_2 + 4.0 * phi_3, middle, middle, 4.0 * phi_3 - phi_2]),
    ]


def _phi_products(exponent: Array, right: Array) -> tuple[Array, list[Array]]:
    """Return e^Z (n, n) and [phi_1(Z) R, phi_2(Z) R, phi_3(Z) R], each (n, k).

    They stand side by side in the exponential of one larger matrix: Al-Mohy and Higham (2011), SIAM J. Sci. Comput. 33,
    488-511, theorem 2.1, doi:10.1137/100788860.
    """
    n, k = right.shape
    larger = np.zeros((n + 3 * k, n + 3 * k))
    larger[:n, : n + k] = np.hstack([exponent, right])
    larger[n : n + 2 * k, n + k :] = np.eye(2 * k)
    exponential: Array = expm(larger)[:n]
    products = [exponential[:, n + i * k : n + (i + 1) * k] for i in range(3)]
    return exponential[:, :n], products
