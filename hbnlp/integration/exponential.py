"""An exponential Runge-Kutta scheme: the linear part of a system exactly, the force by fourth-order stages.

With the state y = (q, q', x), its linear part L and what else drives it, N = (load - f(q, q', tau), u''), ::

    y' = L y + G N,     y(t + h) = e^{hL} y + integral_0^h e^{(h-s)L} G N(t + s) ds

N is interpolated between the stages of a step, the integrals are those of the functions phi_k, ::

    phi_k(z) = integral_0^1 e^{(1-s) z} s^{k-1} / (k-1)! ds,     phi_1(z) = (e^z - 1) / z

so that a lag state that decays fast asks for no short steps. Each stage is linear in the state and the N of the
stages before it: one matrix, formed once per parameter point, times what is known so far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import casadi as ca
import numpy as np
from scipy.linalg import expm

from hbnlp.core.native import bound
from hbnlp.core.types import Array
from hbnlp.integration.first_order import FirstOrderForm, Propagator, Window
from hbnlp.integration.fixed_steps import broken_off, check_steps

RESOLVED = 0.75
"""|h s| of the fastest eigenvalue of the structure, its lag states held, with which the choice of steps begins.
Measured on the paper's wing: with up to 2.2, at its largest tension, the scheme holds; from 2.6 on it may not."""
FEWEST_STEPS = 256
"""Steps a period with which it begins at least."""
ACCURATE = 1e-5
"""Error of the state over a window, relative to its size, from which on chosen steps are halved."""
MOST_HALVINGS = 4
ORDER = 4
CHUNK = 256
"""Steps after which the state is looked at."""
SAME_PLACE = 0.01
"""Relative: a state that ceases to be finite so near one place with steps of either length does so by itself."""
MIDDLE, END = 0.5, 1.0


@final
@dataclass(frozen=True, kw_only=True)
class ExponentialRungeKutta4:
    """The exponential Runge-Kutta scheme of Krogstad, of fourth order, with fixed steps.

    Exact for linear systems under a constant load. For systems with lag states that decay much faster than the
    structure moves: the fastest of them binds the steps of `RungeKutta4`, the structure and the force alone bind these.

    Parameters
    ----------
    steps_per_period : int, optional
        Steps in one period of the forcing. By default they are chosen: at least 256, and as many as keep ``|h s| <=
        0.75`` for every eigenvalue of the structure (its lag states held; of the linear part, and linearised about rest
        and the initial state). In the first, second, fourth, ... window they are looked at, by half as many: where the
        state's error is above 1e-5 of its size they are doubled, up to four times; ``message`` says so where that does
        not do.

    Notes
    -----
    The error of a signal falls as the fourth power of the step; where lag states are much faster than that, more
    slowly once it is small, theirs as the third power or less. Too long a step for a force that stiffens, or that
    cancels the linear stiffness, shows in a state that is not finite, or in one that hangs on the steps. As for
    `RungeKutta4`, corners of the force lower the order. Lag states may decay up to some 1e8 times as fast as the load
    varies before rounding shows.

    References
    ----------
    Krogstad (2005), Generalized integrating factor methods for stiff PDEs, J. Comput. Phys. 203, 72-88,
    doi:10.1016/j.jcp.2004.08.006 (ETDRK4-B). Hochbruck and Ostermann (2010), Exponential integrators, Acta Numer. 19,
    209-286, doi:10.1017/S0962492910000048.
    """

    steps_per_period: int | None = None

    def __post_init__(self) -> None:
        check_steps(self.steps_per_period)

    def propagator(self, form: FirstOrderForm, packed: Array, state: Array, periods: int) -> Propagator:
        """Return the scheme at one parameter point; steps that are not given are chosen for it and ``state``."""
        if self.steps_per_period is not None:
            return _FixedSteps(form, packed, int(self.steps_per_period), periods)
        return _ChosenSteps(form, packed, first_steps(form, packed, state), periods)


def first_steps(form: FirstOrderForm, packed: Array, state: Array) -> int:
    """Return the steps a period, an even number, with which their choice begins."""
    moving = 2 * form.system.n_dof
    linear, _ = form.linear_part(packed)
    found = (np.linalg.eigvals(linear[:moving, :moving]), form.eigenvalues(packed, state, lags=False))
    fastest = 2.0 * np.pi * max(float(np.abs(each).max()) for each in found)
    return max(FEWEST_STEPS, 2 * int(np.ceil(fastest / RESOLVED / 2.0)))


class _ChosenSteps:
    """As many steps as are accurate, looked at in the first, second, fourth, ... window."""

    def __init__(self, form: FirstOrderForm, packed: Array, fewest: int, periods: int) -> None:
        self._form, self._packed, self._periods = form, packed, periods
        self._fewest = self._steps = fewest
        self._made: dict[int, _FixedSteps] = {}
        self._windows = 0
        self._left = ""

    def __call__(self, state: Array) -> Window:
        self._windows += 1
        if self._windows & (self._windows - 1):  # no power of two
            return self._window(self._steps, state)._replace(remark=self._left)
        return self._looked_at(state)

    def _looked_at(self, state: Array) -> Window:
        """Return a window of steps that are accurate, as far as that is found."""
        coarse, self._left = self._window(self._steps // 2, state), ""
        while True:
            window = self._window(self._steps, state)
            error = self._apart(coarse, window) / (2.0**ORDER - 1.0)
            if error <= ACCURATE:
                if 2.0**ORDER * error <= ACCURATE and self._steps // 2 >= self._fewest:
                    self._steps //= 2
                return window
            if self._steps >= 2**MOST_HALVINGS * self._fewest or _ends_alike(coarse, window):
                self._left = f"{self._steps} steps a period leave an estimated error of {error:.1e} of the state"
                return window if window.failed_at is not None else window._replace(remark=self._left)
            coarse, self._steps = window, 2 * self._steps

    def _window(self, steps: int, state: Array) -> Window:
        if steps not in self._made:
            self._made[steps] = _FixedSteps(self._form, self._packed, steps, self._periods)
        return self._made[steps](state)

    def _apart(self, one: Window, other: Window) -> float:
        """Return the largest difference of the states at the end, relative to the size of their kind."""
        if one.failed_at is not None or other.failed_at is not None:
            return np.inf
        sizes = self._form.sizes(np.vstack([one.states, other.states]))
        return float((np.abs(one.states[-1] - other.states[-1]) / sizes).max())


def _ends_alike(one: Window, other: Window) -> bool:
    """Return whether two windows break off at about the same place: the system diverges, however short the steps."""
    if one.failed_at is None or other.failed_at is None:
        return False
    return abs(one.failed_at - other.failed_at) <= SAME_PLACE * other.failed_at


class _FixedSteps:
    """Four products of a matrix and what is known so far a step, and four evaluations of N, on the same memory."""

    def __init__(self, form: FirstOrderForm, packed: Array, steps: int, periods: int) -> None:
        self._steps, self._n_steps, self._step = steps, steps * periods, 2.0 * np.pi / steps
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
        for first in range(0, self._n_steps, CHUNK):
            last = min(first + CHUNK, self._n_steps)
            with np.errstate(invalid="ignore", over="ignore"):
                for i in range(first, last):
                    tau[0] = i * step
                    self._begin()
                    for matrix, known, place, evaluate in self._stages:
                        dot(matrix, known, out=stage)
                        tau[0] = (i + place) * step
                        evaluate()
                    self._state[:] = dot(self._last, self._known, out=states[i + 1])
            broken = broken_off(states, first, last, self._steps)
            if broken is not None:
                return broken
        return Window(states, step)


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
    sizes = np.abs(right).max(axis=0, initial=0.0)
    sizes[sizes == 0.0] = 1.0  # in whatever units: the larger matrix is to be no larger than Z for them
    larger = np.zeros((n + 3 * k, n + 3 * k))
    larger[:n, : n + k] = np.hstack([exponent, right / sizes])
    larger[n : n + 2 * k, n + k :] = np.eye(2 * k)
    exponential: Array = expm(larger)[:n]
    products = [exponential[:, n + i * k : n + (i + 1) * k] * sizes for i in range(3)]
    return exponential[:, :n], products
