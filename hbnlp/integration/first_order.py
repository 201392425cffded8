"""The first-order form of a system, compiled: what every time integrator works on.

The state is y = (q, q', x) and the independent variable the phase tau = omega t, so that what is compiled once serves
every frequency::

    omega dy/dtau = ( q',  a,  A x + B a + B_u u'' ),     a = M^-1 (-K q - D q' + L_x x + load(tau) - f(q, q', tau))

M is factorised once per parameter point, with numpy; M^-1 [-K, -D, L_x] and M^-1 enter the compiled function as
parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import NamedTuple, Protocol, final, runtime_checkable

import casadi as ca
import numpy as np

from hbnlp.core.kept import Kept, by_one_thread
from hbnlp.core.types import Array
from hbnlp.systems.system import System

FEW_INSTRUCTIONS = 400
"""Up to this size a rate is faster as scalar instructions (SX), beyond it with dense matrix products (MX): measured."""


class Window(NamedTuple):
    """What an integrator made of one window (one or more periods of the forcing).

    ``states`` is (n_steps + 1, n_state) from the window's beginning to its end, or fewer rows where it broke off; then
    ``failed_at`` is the phase tau where it did, and ``reason`` says why. A ``remark`` becomes part of the message.
    """

    states: Array
    step: float
    failed_at: float | None = None
    reason: str = ""
    remark: str = ""


Propagator = Callable[[Array], Window]
"""Takes the state at tau = 0 through one window."""


@runtime_checkable
class Method(Protocol):
    """What `integrate` and `march` ask of an integration method."""

    def propagator(self, form: FirstOrderForm, packed: Array, state: Array, periods: int) -> Propagator:
        """Return the integrator at one parameter point; ``state`` is typical of those it will meet."""
        ...


@final
class FirstOrderForm:
    """The compiled first-order form of a system; what methods compile from it is kept with it.

    Attributes
    ----------
    is_small : bool
        Whether a rate is quicker in scalar instructions than with matrices.
    rate : casadi.Function
        (y, tau, packed) -> dy/dtau, with ``packed`` from `pack`.
    acceleration : casadi.Function
        (y, tau, packed) -> q''.
    jacobian : casadi.Function
        (y, tau, packed) -> the derivative of the rate by y.
    """

    @by_one_thread
    def __init__(self, system: System) -> None:
        self.system = system
        n, size, n_p = system.n_dof, system.n_state, len(system.parameters.names)
        self.n_packed = n_p + n * size + n * n
        y, tau, packed = ca.MX.sym("y", size), ca.MX.sym("tau"), ca.MX.sym("packed", self.n_packed)
        p, gain, inverse = ca.vertsplit(packed, [0, n_p, n_p + n * size, self.n_packed])
        q, v, x = ca.vertsplit(y, [0, n, 2 * n, size])
        load, drive = system.excitation(tau, p)
        if system.is_nonlinear:
            load -= system.compiled_force.value(q, v, tau, p)
        a = ca.reshape(gain, n, size) @ y + ca.reshape(inverse, n, n) @ load
        dx = ca.sparsify(ca.DM(system.lag_state)) @ x + ca.sparsify(ca.DM(system.lag_input)) @ a + drive
        rate = ca.densify(ca.vertcat(v, a, dx)) / p[system.parameters.index("omega")]
        matrices = ca.Function("rate", [y, tau, packed], [rate])
        scalars = matrices.expand()
        self.is_small = scalars.n_instructions() <= FEW_INSTRUCTIONS
        self.rate = scalars if self.is_small else matrices
        self.acceleration = ca.Function("acceleration", [y, tau, packed], [ca.densify(a)])
        self.jacobian = ca.Function("jacobian", [y, tau, packed], [ca.densify(ca.jacobian(rate, y))])
        self._kept: Kept[ca.Function] = Kept(8)

    def pack(self, values: Array) -> Array:
        """Return parameter values, ``M^-1 [-K, -D, L_x]`` and ``M^-1`` as one vector (n_packed,)."""
        mass, damping, stiffness, lag_output = self.system.state_matrices(values)
        inverse = np.linalg.inv(mass)
        gain = inverse @ np.hstack([-stiffness, -damping, lag_output])
        return np.concatenate([values, gain.ravel(order="F"), inverse.ravel(order="F")])

    def linear_part(self, packed: Array) -> tuple[Array, Array]:
        """Return L (n_state, n_state) and G (n_state, n + n_inputs) of ``dy/dtau = L y + G (load - f, u'')``."""
        system, n, size = self.system, self.system.n_dof, self.system.n_state
        p, gain, inverse = np.split(packed, [len(system.parameters.names), -n * n])
        of_acceleration = np.vstack([np.zeros((n, n)), np.eye(n), system.lag_input])
        linear = of_acceleration @ gain.reshape(size, n).T
        linear[:n, n : 2 * n] = np.eye(n)
        linear[2 * n :, 2 * n :] += system.lag_state
        of_motion = np.vstack([np.zeros((2 * n, system.n_inputs)), system.lag_motion])
        right = np.hstack([of_acceleration @ inverse.reshape(n, n).T, of_motion])
        omega = p[system.parameters.index("omega")]
        return linear / omega, right / omega

    def eigenvalues(self, packed: Array, state: Array, *, lags: bool = True) -> Array:
        """Return the eigenvalues, by phase, about rest and about ``state`` at tau = 0 (where they are finite).

        Without ``lags`` they are those of the displacements and velocities, the lag states held.
        """
        count = state.size if lags else 2 * self.system.n_dof
        matrices = [self.jacobian(y, 0.0, packed).full()[:count, :count] for y in (np.zeros_like(state), state)]
        found = [np.linalg.eigvals(matrix) for matrix in matrices if np.all(np.isfinite(matrix))]
        return np.concatenate(found) if found else np.zeros(1)

    def sizes(self, states: Array) -> Array:
        """Return the largest displacement, velocity or lag state of states (count, n_state) for each entry; 1 for 0."""
        n = self.system.n_dof
        sizes, largest = np.ones(self.system.n_state), np.abs(states).max(axis=0)
        for block in (slice(0, n), slice(n, 2 * n), slice(2 * n, None)):
            sizes[block] = largest[block].max(initial=0.0) or 1.0
        return sizes

    def compiled(self, key: Hashable, build: Callable[[], ca.Function]) -> ca.Function:
        """Return what ``build`` returned when it was first asked for under this key."""
        return self._kept.get(key, build)
