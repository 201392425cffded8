"""The time step: convection by Adams-Bashforth, diffusion by Crank-Nicolson, no-slip by projection.

    (1 - nu dt/2 Lap) gamma_new = (1 + nu dt/2 Lap) gamma + dt (3 N - N_old) / 2 + dt / h^2 Q^T F
    - Lap psi_new = gamma_new + m(psi_new),        Q (psi_new + psi_b) = u_body

F belongs to the middle of the step: Crank-Nicolson and Adams-Bashforth are centred there.

References
----------
Colonius and Taira (2008), doi:10.1016/j.cma.2007.08.014.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

import numpy as np

from hbnlp.dns._types import Array, FlowError
from hbnlp.dns.bodies import Body, MovingPoints, Points, SharpPlate
from hbnlp.dns.grid import Grid
from hbnlp.dns.history import History, Record
from hbnlp.dns.mapping import Metric
from hbnlp.dns.membrane import Membrane, MembraneShape
from hbnlp.dns.motion import Background, Motion
from hbnlp.dns.nested import NestedSolver, Solution, sine_transform
from hbnlp.dns.plate import PlateWall, PrescribedShape
from hbnlp.dns.stencils import advection, laplacian, node_velocity
from hbnlp.dns.walls import FixedWall, MovingWall, Wall

_log = logging.getLogger(__name__)

# Adams-Bashforth with central differences at cell Reynolds numbers of a few stays stable up to about here (measured, docs/dns.md).
CFL_LIMIT = 0.8
_CFL_EVERY = 10
# Passes over m(psi) a step. With psi extrapolated for the first, an even number is stable for metrics that stretch by less than about two, and
# two leave a remainder of 1e-5 of the loads at slopes of 0.5 (measured, docs/dns.md).
_SWEEPS = 2
# Adams-Bashforth on the metric's part of diffusion: stable for (stretch - 1) * 8 nu dt / h^2 < 1.
_METRIC_DIFFUSION_LIMIT = 1.0

Callback = Callable[["Simulation"], None]


class Simulation:
    """Incompressible two-dimensional flow past a body at unit free stream and chord.

    Parameters
    ----------
    grid : Grid
        Nested grids.
    body : Points, MovingPoints, SharpPlate or Membrane
        What stands in the flow.
    reynolds : float
        U c / nu.
    dt : float, optional
        Time step in c/U; default 0.3 of the cell size.
    motion : Motion, optional
        Pitch and heave of the frame that carries grid and body.
    stream : float
        Free stream velocity: 1, or 0 for fluid at rest.

    Raises
    ------
    ValueError
        For a parameter out of range, or a body that does not fit the grid.
    FlowError
        If the body's points are closer than the grid resolves.
    """

    def __init__(
        self,
        grid: Grid,
        body: Body | Membrane,
        *,
        reynolds: float = 100.0,
        dt: float | None = None,
        motion: Motion | None = None,
        stream: float = 1.0,
    ) -> None:
        if not (math.isfinite(reynolds) and reynolds > 0.0):
            raise ValueError(f"reynolds is {reynolds}; it must be positive and finite")
        step = 0.3 * grid.spacing if dt is None else dt
        if not (math.isfinite(step) and step > 0.0):
            raise ValueError(f"dt is {dt}; it must be positive and finite")
        if abs(stream) * step > CFL_LIMIT * grid.spacing:
            raise FlowError(_cfl_message(abs(stream) * step / grid.spacing, step))
        self.grid, self.body, self.reynolds, self.dt = grid, body, reynolds, step
        self.motion = Motion() if motion is None else motion
        self._nested = NestedSolver(grid, step / reynolds)
        self._background = Background(grid, self.motion, stream)
        self.wall = _wall(grid, self._nested, step, body, self.motion)
        self._cells = grid.cells()[:, None, None]
        nx, ny = grid.shape
        self.psi = np.zeros((grid.levels, nx + 1, ny + 1))
        self.gamma = np.zeros_like(self.psi)
        self._psi_before = self.psi[0].copy()
        self._convection: Array | None = None
        self.steps = 0
        self._start = 0.0
        self._metric = self.wall.metric()
        self._records: list[Record] = []

    @property
    def time(self) -> float:
        """Time reached, in c/U."""
        return self._start + self.steps * self.dt

    @property
    def history(self) -> History:
        """Loads and deflections of the steps taken since construction or restart."""
        return History.of(self._records, self.dt)

    @property
    def last(self) -> Record:
        """Record of the last step."""
        return self._records[-1]

    @property
    def metric(self) -> Metric | None:
        """Metric of the deformed plate now; None without a map."""
        return self._metric

    def vorticity(self) -> Array:
        """Vorticity on the nodes of all levels, shape (levels, nx + 1, ny + 1)."""
        omega = self.gamma.copy()
        if self._metric is not None:
            omega[0][self._map_window()] /= self._metric.jacobian
        return omega

    def node_ordinates(self) -> Array:
        """Ordinates of the level-0 nodes in the frame, shape (nx + 1, ny + 1), moved with a deflected plate."""
        x, y = self.grid.nodes()
        ordinates = np.tile(y, (x.size, 1))
        if self._metric is not None:
            ordinates[self._map_window()] += self._metric.eta
        return ordinates

    def run(self, until: float, *, callback: Callback | None = None) -> History:
        """Step up to a time, calling ``callback(self)`` after each step.

        Parameters
        ----------
        until : float
            Time to reach, rounded to whole steps.
        callback : callable, optional
            Progress, saving, pictures: see `progress` and `snapshots`.

        Returns
        -------
        History
            All records since construction or restart.

        Raises
        ------
        FlowError
            If the flow becomes too fast for the time step or is no longer finite.
        """
        if not until > self.time - 0.5 * self.dt:
            raise ValueError(f"until is {until}, but the flow is at t = {self.time:.6g} already; give a later time")
        for _ in range(round((until - self.time) / self.dt)):
            self.step()
            if callback is not None:
                callback(self)
        return self.history

    def step(self) -> None:
        """Advance by dt."""
        dt, nested, wall = self.dt, self._nested, self.wall
        end = self._start + (self.steps + 1) * dt
        convection = self._explicit()
        before = convection if self._convection is None else self._convection
        rhs = laplacian(self.gamma, self._cells)
        rhs *= 0.5 * dt / self.reynolds
        rhs += self.gamma[:, 1:-1, 1:-1]
        rhs += (1.5 * dt) * convection
        rhs -= (0.5 * dt) * before
        self._convection = convection
        circulation = float(self.gamma[-1, 1:-1, 1:-1].sum()) * self.grid.cell(self.grid.levels - 1) ** 2

        wall.prepare(end)
        guess = 2.0 * self.psi[0] - self._psi_before
        solution, psi_fine, reaction = self._project(rhs, guess, end, circulation)

        self._psi_before = self.psi[0]
        self.psi = nested.to_nodes(solution.psi, solution.psi_edges) if psi_fine is None else self._replace_fine(solution, psi_fine)
        self.gamma = nested.to_nodes(solution.gamma, solution.gamma_edges)
        self._metric = wall.metric()
        inner = self.gamma[:, 1:-1, 1:-1]
        if self._metric is not None and self.grid.levels > 1:
            apparent = inner[0].copy()
            apparent[self._map_interior()] += self._metric.source(self.psi[0][self._map_window()])
            nested.restrict(apparent, inner[1])
            for level in range(1, self.grid.levels - 1):
                nested.restrict(inner[level], inner[level + 1])
        else:
            nested.restrict_all(inner)
        self.steps += 1
        self._records.append(self._record(reaction))
        wall.accept()

    def state(self) -> dict[str, Array]:
        """Everything a restart needs, as arrays."""
        grid = self.grid
        arrays = {
            "grid": np.array([grid.spacing, *grid.shape, *grid.corner, grid.levels], dtype=float),
            "clock": np.array([self._start, self.steps, self.dt]),
            "reynolds": np.array(self.reynolds),
            "psi": self.psi,
            "gamma": self.gamma,
            "psi_before": self._psi_before,
            "convection": np.zeros(0) if self._convection is None else self._convection,
        }
        return arrays | {f"wall_{name}": value for name, value in self.wall.state().items()}

    def restore(self, arrays: dict[str, Array]) -> None:
        """Continue from a state that `state` returned.

        With the same dt and body the run continues bit for bit; with another body (say a plate that starts to move from steady flow) or another
        dt it starts afresh from the saved flow at the saved time.

        Raises
        ------
        ValueError
            If the state lacks something or belongs to another grid.
        """
        mine = self.state()
        missing = {name for name in mine if not name.startswith("wall_")} - arrays.keys()
        if missing:
            raise ValueError(f"the state lacks {sorted(missing)}; it must come from Simulation.state or dns.save_state")
        if not np.array_equal(arrays["grid"], mine["grid"]):
            raise ValueError(
                f"the state belongs to a grid with (h, nx, ny, x0, y0, levels) = {arrays['grid'].tolist()}, this one has "
                f"{mine['grid'].tolist()}; build the simulation with the grid of the state"
            )
        if arrays["reynolds"] != self.reynolds:
            _log.warning("the state was computed at Re = %g and goes on at Re = %g", float(arrays["reynolds"]), self.reynolds)
        start, steps, dt = (float(value) for value in arrays["clock"])
        same_step = dt == self.dt
        self._start, self.steps = (start, round(steps)) if same_step else (start + steps * dt, 0)
        self.psi, self.gamma = arrays["psi"].copy(), arrays["gamma"].copy()
        self._psi_before = arrays["psi_before"].copy() if same_step else self.psi[0].copy()
        self._convection = arrays["convection"].copy() if same_step and arrays["convection"].size else None
        wall = {name.removeprefix("wall_"): value for name, value in arrays.items() if name.startswith("wall_")}
        same_wall = wall.keys() == self.wall.state().keys()
        self.wall.restore(wall if same_wall else {}, self.time)
        self._metric = self.wall.metric()
        self._records = []

    def _project(self, rhs: Array, guess: Array, end: float, circulation: float) -> tuple[Solution, Array | None, Array]:
        """Find forces and new fields; returns the level-0 streamfunction too if the map needed it."""
        nested, wall = self._nested, self.wall
        transform, coupling = wall.transform, wall.coupling
        metric = wall.metric()
        mapped = metric is not None
        metric_hat: Array | None = None
        rhs_hat: Array | None = None
        solution: Solution | None = None
        reaction = np.empty(0)
        psi_fine: Array | None = None
        for _ in range(_SWEEPS if mapped else 1):
            if mapped:
                metric = wall.metric()
                assert metric is not None  # noqa: S101  (for the type checker)
                source = np.zeros(rhs.shape[1:])
                source[self._map_interior()] = metric.source(guess[self._map_window()])
                metric_hat = sine_transform(source)
                if rhs_hat is None:
                    self._restrict_mapped(rhs, source)
            else:
                nested.restrict_all(rhs)
            if rhs_hat is None:
                rhs_hat = sine_transform(rhs)
            predicted = nested.solve(rhs_hat, metric_hat, circulation)
            slip = transform.evaluate(predicted.psi[0]) + self._background_at_body(end, metric)
            reaction = wall.respond(coupling.velocities(slip))
            source_hat = transform.source(coupling.source(reaction, self.grid.spacing) * self.dt)
            solution = nested.solve(rhs_hat + source_hat, metric_hat, circulation)
            if mapped:
                psi_fine = nested.to_nodes(solution.psi[:1], solution.psi_edges)[0]
                guess = psi_fine
        assert solution is not None  # noqa: S101  (at least one pass)
        return solution, psi_fine, reaction

    def _explicit(self) -> Array:
        """Convection and the metric's part of diffusion, N, at the interior nodes of all levels."""
        psi = self.psi + self._background.levels(self.time)
        omega = self.gamma
        metric = self._metric
        if metric is None:
            u, v = node_velocity(psi, self._cells)
        else:
            window = self._map_window()
            psi[0][window] = self.psi[0][window] + self._mapped_background(self.time, metric)
            omega = self.vorticity()
            u, v = node_velocity(psi, self._cells)
            x_rows = slice(window[0].start, window[0].stop - 2)
            v[0][x_rows, window[1]] -= metric.eta_rate[1:-1, :]
        if self.steps % _CFL_EVERY == 0:
            self._check(u, v)
        out = advection(u, v, omega, self._cells)
        if metric is not None:
            number = (metric.stretch_max - 1.0) * 8.0 * self.dt / (self.reynolds * self.grid.spacing**2)
            if number > _METRIC_DIFFUSION_LIMIT:
                raise FlowError(
                    f"at t = {self.time:.6g} the explicit diffusion of the deflected plate's metric has the number {number:.3g}, above the limit "
                    f"{_METRIC_DIFFUSION_LIMIT}: dt = {0.75 * self.dt / number:.2g} would do (dt is {self.dt:.4g})"
                )
            window = self._map_window()
            gamma = self.gamma[0][window]
            extra = metric.rotation(omega[0][window]) + laplacian(gamma, self.grid.spacing)
            out[0][self._map_interior()] -= extra / self.reynolds
        return out

    def _check(self, u: Array, v: Array) -> None:
        speed = np.abs(u[:, 1:-1, :])
        speed += np.abs(v[:, :, 1:-1])
        cfl = float((speed.max(axis=(1, 2)) / self.grid.cells()).max()) * self.dt
        if not math.isfinite(cfl):
            raise FlowError(f"the flow is no longer finite at t = {self.time:.6g}: restart from a saved state with a smaller dt than {self.dt:.3g}")
        if cfl > CFL_LIMIT:
            raise FlowError(f"at t = {self.time:.6g} " + _cfl_message(cfl, self.dt))

    def _record(self, reaction: Array) -> Record:
        time = self.time
        wall = self.wall
        force_x, force_y = wall.force(reaction)
        alpha = self.motion.pitch(time - 0.5 * self.dt)[0]
        c, s = math.cos(alpha), math.sin(alpha)
        empty = np.empty(0)
        jump = coefficients = deflection = rate = empty
        if isinstance(wall, PlateWall):
            jump = wall.pressure_jump(reaction, wall.middle_slope())
            coefficients = wall.coefficients(jump)
            if wall.shape is not None:
                deflection, rate = wall.shape.estimate
        return Record(
            time, 2.0 * (force_y * c - force_x * s), 2.0 * (force_x * c + force_y * s), jump, coefficients, deflection, rate
        )

    def _restrict_mapped(self, rhs: Array, source: Array) -> None:
        """Restrict right-hand sides such that coarser levels see the apparent vorticity gamma + m of the map."""
        nested = self._nested
        if self.grid.levels == 1:
            return
        nested.restrict(rhs[0], rhs[1])
        apparent = np.zeros_like(source)
        nested.restrict(source, apparent)
        rhs[1] += nested.helmholtz(apparent, 1)
        for level in range(1, self.grid.levels - 1):
            nested.restrict(rhs[level], rhs[level + 1])

    def _replace_fine(self, solution: Solution, psi_fine: Array) -> Array:
        coarse = self._nested.to_nodes(solution.psi[1:], solution.psi_edges[1:])
        return np.concatenate([psi_fine[None], coarse])

    def _background_at_body(self, time: float, metric: Metric | None) -> Array:
        window = self.wall.coupling.window.full
        if metric is None:
            return self._background.levels(time)[0][window]
        psi = self._background.levels(time)[0].copy()
        psi[self._map_window()] = self._mapped_background(time, metric)
        return psi[window]

    def _mapped_background(self, time: float, metric: Metric) -> Array:
        window = self._map_window()
        _, y = self.grid.nodes()
        return self._background.fine(time, y[None, window[1]] + metric.eta, window)

    def _map_window(self) -> tuple[slice, slice]:
        assert isinstance(self.wall, PlateWall) and self.wall.map is not None  # noqa: S101
        return self.wall.map.window

    def _map_interior(self) -> tuple[slice, slice]:
        assert isinstance(self.wall, PlateWall) and self.wall.map is not None  # noqa: S101
        return self.wall.map.interior()


def _wall(grid: Grid, nested: NestedSolver, dt: float, body: Body | Membrane, motion: Motion) -> Wall:
    if isinstance(body, Points):
        return FixedWall(grid, nested, dt, body)
    if isinstance(body, MovingPoints):
        return MovingWall(grid, nested, dt, body)
    if isinstance(body, SharpPlate):
        shape = None if body.deflection is None else PrescribedShape(body)
        return PlateWall(grid, nested, dt, body.n_modes, shape)
    return PlateWall(grid, nested, dt, body.n_modes, MembraneShape(body, motion, dt))


def _cfl_message(cfl: float, dt: float) -> str:
    # round the advice down, so that following it is enough
    advice = math.floor(1e4 * dt * 0.75 * CFL_LIMIT / cfl) / 1e4
    return f"the Courant number (|u| + |v|) dt / h is {cfl:.3g}, above the limit {CFL_LIMIT}: dt = {advice:.4g} would do (dt is {dt:.4g})"
