"""Walls: what the flow solver needs of a body in each step, whatever kind of body it is."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from hbnlp.core.types import Array
from hbnlp.dns.bodies import MovingPoints, Points
from hbnlp.dns.grid import Grid
from hbnlp.dns.kernels import Coupling, Window, point_coupling
from hbnlp.dns.mapping import Metric
from hbnlp.dns.nested import NestedSolver
from hbnlp.dns.projection import Factor, WindowTransform, body_matrix, window_matrix

_CLOSER = (
    "points of the body are closer together than the grid resolves: space them 1 to 2 cells apart, or refine the grid"
)


class Wall(ABC):
    """A body as constraints on the flow.

    In a step to ``time`` the solver calls `prepare`, then once or more `respond` with the slip that is left without the
    new force, then `accept`.
    """

    transform: WindowTransform
    coupling: Coupling

    @abstractmethod
    def prepare(self, time: float) -> None:
        """Place the constraints for a step that ends at ``time``."""

    @abstractmethod
    def respond(self, velocities: Array) -> Array:
        """Forces on the fluid at the constraints, given the velocities there without them; shape (constraints,)."""

    def metric(self) -> Metric | None:
        """Metric of the map at the end of the step, as known so far; None without a map."""
        return None

    def accept(self) -> None:  # noqa: B027
        """Keep the result of the last `respond` as the state at the end of the step."""

    def state(self) -> dict[str, Array]:
        """Arrays that a restart needs."""
        return {}

    def restore(self, arrays: dict[str, Array], time: float) -> None:  # noqa: B027
        """Set the state at ``time`` from arrays of `state`; an empty dict starts this body afresh then."""

    @abstractmethod
    def force(self, reaction: Array) -> Array:
        """Force of the fluid on the body in frame axes, shape (2,), from the forces on the fluid."""

    @abstractmethod
    def outline(self, time: float) -> Array:
        """Points of the body in frame axes for pictures, shape (n, 2)."""


def _point_force(reaction: Array) -> Array:
    return np.asarray(-reaction.reshape(2, -1).sum(axis=1))


class FixedWall(Wall):
    """Points that rest in the frame."""

    def __init__(self, grid: Grid, nested: NestedSolver, dt: float, body: Points) -> None:
        window = Window.around(grid, body.positions)
        self.body = body
        self.transform = WindowTransform(nested, window)
        self.coupling = point_coupling(grid, body.positions, window)
        self._factor = Factor(body_matrix(self.transform, self.coupling, dt, grid.spacing), _CLOSER)

    def prepare(self, time: float) -> None:
        """Nothing to do: the points rest."""

    def respond(self, velocities: Array) -> Array:
        """Forces that stop the fluid at the points."""
        return self._factor.solve(-velocities)

    def force(self, reaction: Array) -> Array:
        """Sum of the point forces."""
        return _point_force(reaction)

    def outline(self, time: float) -> Array:
        """The points, closed if the body is."""
        del time
        points = self.body.positions
        return np.vstack([points, points[:1]]) if self.body.closed else points


class MovingWall(Wall):
    """Points that move in the grid.

    The body matrix is formed anew in each step from the tabulated response of the fluid. The forces act on the fluid on
    both sides. For a closed body the load is corrected by the momentum of the fluid inside, which the points determine:
    the integral of u over the inside is that of x (u . n) along the surface.
    """

    def __init__(self, grid: Grid, nested: NestedSolver, dt: float, body: MovingPoints) -> None:
        self._grid, self._dt = grid, dt
        self.body = body
        corners = np.column_stack([np.asarray(side, dtype=float) for side in body.reach])
        self._window = Window.around(grid, corners)
        self.transform = WindowTransform(nested, self._window)
        self._response = window_matrix(self.transform) * (dt / grid.spacing**2)
        self._momentum_rate = np.zeros(2)
        self.prepare(dt)

    def prepare(self, time: float) -> None:
        """Move the points and factorise their matrix."""
        positions, velocities = self._evaluate(time)
        self.coupling = point_coupling(self._grid, positions, self._window)
        touched = np.unique(self.coupling.matrix.indices)
        matrix = self.coupling.matrix[:, touched]
        half = np.asarray(matrix @ self._response[np.ix_(touched, touched)])
        self._factor = Factor(np.ascontiguousarray(np.asarray(matrix @ half.T).T), _CLOSER)
        self._target = velocities.T.ravel()
        if self.body.closed:
            before = _enclosed_momentum(*self._evaluate(time - self._dt))
            self._momentum_rate = (_enclosed_momentum(positions, velocities) - before) / self._dt

    def respond(self, velocities: Array) -> Array:
        """Forces that carry the fluid along with the points."""
        return self._factor.solve(self._target - velocities)

    def force(self, reaction: Array) -> Array:
        """Sum of the point forces, without the inertia of the fluid inside a closed body."""
        return _point_force(reaction) + self._momentum_rate

    def outline(self, time: float) -> Array:
        """The points, closed if the body is."""
        points = self._evaluate(time)[0]
        return np.vstack([points, points[:1]]) if self.body.closed else points

    def _evaluate(self, time: float) -> tuple[Array, Array]:
        positions, velocities = (np.asarray(part, dtype=float) for part in self.body.motion(time))
        if positions.shape != velocities.shape or positions.ndim != 2 or positions.shape[1] != 2:
            raise ValueError(
                f"motion({time:.6g}) returned positions of shape {positions.shape} and velocities of shape "
                f"{velocities.shape}; both must be (n, 2)"
            )
        if not (np.isfinite(positions).all() and np.isfinite(velocities).all()):
            raise ValueError(f"motion({time:.6g}) returned values that are not finite")
        return positions, velocities


def _enclosed_momentum(positions: Array, velocities: Array) -> Array:
    """Integral of the velocity over the inside of a closed polygon, shape (2,)."""
    step = np.roll(positions, -1, axis=0) - positions
    middle = 0.5 * (np.roll(positions, -1, axis=0) + positions)
    velocity = 0.5 * (np.roll(velocities, -1, axis=0) + velocities)
    orientation = np.sign(np.sum(middle[:, 0] * step[:, 1]))
    outflow = velocity[:, 0] * step[:, 1] - velocity[:, 1] * step[:, 0]
    return np.asarray(orientation * (outflow @ middle))
