"""The sharp plate as a wall: rigid, with a prescribed deflection, or with one that the flow decides (`membrane`)."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from hbnlp.core.types import Array
from hbnlp.dns.bodies import SharpPlate
from hbnlp.dns.grid import Grid
from hbnlp.dns.kernels import sharp_plate_coupling
from hbnlp.dns.mapping import Metric, PlateMap
from hbnlp.dns.nested import NestedSolver
from hbnlp.dns.projection import Factor, WindowTransform, body_matrix
from hbnlp.dns.walls import Wall


class Shape(ABC):
    """Modal deflection W and rate W' of a plate during a step.

    ``current`` is accepted (start of the step), ``estimate`` the best knowledge of its end.
    """

    current: tuple[Array, Array]
    estimate: tuple[Array, Array]

    @abstractmethod
    def prepare(self, time: float) -> None:
        """Set the estimate for a step that ends at ``time``."""

    @abstractmethod
    def rates(self, load: Array, response: Array) -> Array:
        """W' at the end of the step if the load over it is dCp_k = load + response @ W'; also updates the estimate."""

    def accept(self) -> None:
        """Make the estimate the current state."""
        self.current = self.estimate

    def state(self) -> dict[str, Array]:
        """Arrays that a restart needs."""
        return {"W": self.current[0], "W_rate": self.current[1]}

    def restore(self, arrays: dict[str, Array], time: float) -> None:
        """Set the state at ``time`` from arrays of `state`; an empty dict keeps the initial deflection."""
        del time
        if arrays:
            self.current = self.estimate = (arrays["W"], arrays["W_rate"])


class PrescribedShape(Shape):
    """A deflection given as a function of time."""

    def __init__(self, body: SharpPlate) -> None:
        if body.deflection is None:
            raise ValueError("a rigid plate has no prescribed shape")
        self._deflection = body.deflection
        self._n_modes = body.n_modes
        self.prepare(0.0)
        self.accept()

    def prepare(self, time: float) -> None:
        """Evaluate the given deflection."""
        values = tuple(np.asarray(part, dtype=float) for part in self._deflection(time))
        if len(values) != 2 or any(part.shape != (self._n_modes,) or not np.isfinite(part).all() for part in values):
            raise ValueError(
                f"deflection({time:.6g}) returned arrays of shapes {[part.shape for part in values]}; "
                f"two finite ones of shape ({self._n_modes},) are needed, W and W'"
            )
        self.estimate = (values[0], values[1])

    def rates(self, load: Array, response: Array) -> Array:
        """The given rates, whatever the load."""
        del load, response
        return self.estimate[1]

    def restore(self, arrays: dict[str, Array], time: float) -> None:
        """Take the deflection given for ``time``."""
        del arrays
        self.prepare(time)
        self.accept()


class PlateWall(Wall):
    """The sharp plate from (0, 0) to (1, 0) in the frame, kept on its grid line by the map of `mapping`.

    Parameters
    ----------
    grid : Grid
        Grid of `Grid.around_plate`.
    nested : NestedSolver
        The linear solver.
    dt : float
        Time step.
    n_modes : int
        Number of sine modes of deflection and of loads.
    shape : Shape, optional
        What decides the deflection; None for a rigid plate.
    """

    def __init__(self, grid: Grid, nested: NestedSolver, dt: float, n_modes: int, shape: Shape | None = None) -> None:
        self.coupling, self.x_u, self.x_v = sharp_plate_coupling(grid)
        self.transform = WindowTransform(nested, self.coupling.window)
        self._factor = Factor(
            body_matrix(self.transform, self.coupling, dt, grid.spacing),
            "use Grid.around_plate, whose nodes suit the plate",
        )
        self.spacing = grid.spacing
        if not 1 <= n_modes < self.x_v.size:
            raise ValueError(f"n_modes is {n_modes}; between 1 and {self.x_v.size - 1} are resolved by this grid")
        k = np.pi * np.arange(1, n_modes + 1)
        self.modes = np.sin(np.outer(self.x_v, k))
        self._slopes = k * np.cos(np.outer(self.x_v, k))
        self.shape = shape
        self.map = None if shape is None else PlateMap(grid, n_modes)
        on_plate = np.vstack([np.zeros((self.x_u.size, n_modes)), self.modes])
        self._per_rate = self._factor.solve(on_plate)

    def prepare(self, time: float) -> None:
        """Predict the deflection at the end of the step."""
        if self.shape is not None:
            self.shape.prepare(time)

    def respond(self, velocities: Array) -> Array:
        """Forces for no slip on the plate, with the deflection's rate found at the same time."""
        without = self._factor.solve(-velocities)
        if self.shape is None:
            return without
        projection = self._to_coefficients()
        rates = self.shape.rates(projection @ without, projection @ self._per_rate)
        return np.asarray(without + self._per_rate @ rates)

    def metric(self) -> Metric | None:
        """Metric of the deflection as estimated for the end of the step."""
        return None if self.map is None or self.shape is None else self.map.metric(*self.shape.estimate)

    def accept(self) -> None:
        """Keep the deflection, and its mean slope for the loads of this step."""
        if self.shape is not None:
            self.shape.accept()

    def state(self) -> dict[str, Array]:
        """Arrays of the shape."""
        return {} if self.shape is None else self.shape.state()

    def restore(self, arrays: dict[str, Array], time: float) -> None:
        """Restore the shape."""
        if self.shape is not None:
            self.shape.restore(arrays, time)

    def middle_slope(self) -> Array:
        """w_x at the v-points halfway through the step, shape (n,)."""
        if self.shape is None:
            return np.zeros(self.x_v.size)
        return np.asarray(self._slopes @ (0.5 * (self.shape.current[0] + self.shape.estimate[0])))

    def pressure_jump(self, reaction: Array, slope: Array) -> Array:
        """Pressure jump dCp = 2 (p_low - p_up) at the v-points, shape (n,), from the covariant forces on the fluid.

        The force along y is f_2, that along the surface f_1 / sqrt(1 + w_x^2): f_2 less the part of the friction along
        y is the pressure's.
        """
        n_u = self.x_u.size
        friction = np.convolve(reaction[:n_u], [0.5, 0.5])
        return np.asarray(-2.0 / self.spacing * (reaction[n_u:] - slope / (1.0 + slope**2) * friction))

    def coefficients(self, jump: Array) -> Array:
        """Sine coefficients dCp_k of a pressure jump at the v-points, shape (n_modes,)."""
        return np.asarray(2.0 * self.spacing * (self.modes.T @ jump))

    def surface_force(self, reaction: Array, slope: Array) -> Array:
        """Force of the fluid on the plate in frame axes, shape (2,), with the slope at the v-points."""
        n_u = self.x_u.size
        along_y = -reaction[n_u:]
        return np.array([-reaction[:n_u].sum() - slope @ along_y, along_y.sum()])

    def force(self, reaction: Array) -> Array:
        """Force of the fluid on the plate in frame axes over the step just taken or being taken."""
        return self.surface_force(reaction, self.middle_slope())

    def outline(self, time: float) -> Array:
        """The plate's line in frame axes."""
        del time
        x = np.concatenate([[0.0], self.x_v, [1.0]])
        if self.shape is None:
            return np.column_stack([x, np.zeros_like(x)])
        deflection = self.shape.current[0]
        return np.column_stack([x, np.sin(np.pi * np.outer(x, np.arange(1, deflection.size + 1))) @ deflection])

    def _to_coefficients(self) -> Array:
        """Matrix from reactions to dCp_k, shape (n_modes, constraints), linear for the slope as now estimated."""
        slope = self.middle_slope()
        weight = slope / (1.0 + slope**2)
        on_v = 4.0 * self.modes.T
        weighted = on_v * weight
        on_u = 0.5 * (weighted[:, :-1] + weighted[:, 1:])
        return np.hstack([on_u, -on_v])
