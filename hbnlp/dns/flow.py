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
from collections.abc import Callable, Mapping

import numpy as np

from hbnlp.core.checks import instance_of, real_number
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.types import Array
from hbnlp.dns.bodies import Body, MovingPoints, Points, SharpPlate
from hbnlp.dns.deformed import Deformed
from hbnlp.dns.explicit import Explicit
from hbnlp.dns.grid import Grid
from hbnlp.dns.history import History, Record
from hbnlp.dns.limits import check_courant
from hbnlp.dns.loads import step_record
from hbnlp.dns.mapping import Metric
from hbnlp.dns.membrane import Membrane, MembraneShape
from hbnlp.dns.motion import Background, Motion
from hbnlp.dns.nested import NestedSolver, Solution, sine_transform
from hbnlp.dns.plate import PlateWall, PrescribedShape
from hbnlp.dns.walls import FixedWall, MovingWall, Wall

_log = logging.getLogger(__name__)

_COURANT_EVERY = 10
# Passes over m(psi) a step. With psi extrapolated for the first, an even number is stable for metrics that stretch by
# less than about two, and two leave a remainder of 1e-5 of the loads at slopes of 0.5 (measured, docs/dns.md).
_PASSES = 2

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
        instance_of("grid", grid, Grid, "a Grid, such as Grid.around_plate()")
        instance_of("body", body, Body | Membrane, "Points, MovingPoints, a SharpPlate or a Membrane")
        instance_of("motion", motion, Motion | None, "a Motion, such as Motion.at_incidence(degrees)")
        real_number("reynolds", reynolds, above=0.0)
        real_number("stream", stream)
        step = 0.3 * grid.spacing if dt is None else real_number("dt", dt, above=0.0)
        check_courant(abs(stream) * step / grid.spacing, step, 0.0)
        self.grid, self.body, self.reynolds, self.dt = grid, body, reynolds, step
        self.motion = Motion() if motion is None else motion
        self._nested = NestedSolver(grid, step / reynolds)
        self._background = Background(grid, self.motion, stream)
        self.wall = _wall(grid, self._nested, step, body, self.motion)
        plate_map = self.wall.map if isinstance(self.wall, PlateWall) else None
        self._deformed = None if plate_map is None else Deformed(grid, self._nested, self._background, plate_map)
        nx, ny = grid.shape
        self.psi = np.zeros((grid.levels, nx + 1, ny + 1))
        self.gamma = np.zeros_like(self.psi)
        self._psi_before = self.psi[0].copy()
        self._explicit = Explicit(grid, step, reynolds, self._background, self._deformed)
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
        if self._deformed is not None and self._metric is not None:
            omega[0] = self._deformed.vorticity(self.gamma[0], self._metric)
        return omega

    def node_ordinates(self) -> Array:
        """Ordinates of the level-0 nodes in the frame, shape (nx + 1, ny + 1), moved with a deflected plate."""
        x, y = self.grid.nodes()
        ordinates = np.tile(y, (x.size, 1))
        if self._deformed is not None and self._metric is not None:
            ordinates[self._deformed.window] += self._metric.eta
        return ordinates

    def slip(self) -> Array:
        """Velocities at the body's constraints now, all u then all v, as the no-slip condition sees them."""
        psi = self.psi[0][self.wall.coupling.window.full] + self._background_at_body(self.time, self._metric)
        return self.wall.coupling.velocities(psi)

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
        KeyboardInterrupt
            On Ctrl-C, after a whole step: ``history`` has all of them, and the same call goes on.
        """
        real_number("until", until, least=self.time - 0.5 * self.dt, advice=", the flow is there already")
        instance_of("callback", callback, Callable | None, "a function of the simulation, or dns.together(...)")
        for _ in range(round((until - self.time) / self.dt)):
            self.step()
            if callback is not None:
                callback(self)
        return self.history

    @interrupts_kept()
    def step(self) -> None:
        """Advance by dt; Ctrl-C is raised after the step, so that the next one can go on from it."""
        nested, wall, levels = self._nested, self.wall, range(self.grid.levels)
        end = self._start + (self.steps + 1) * self.dt
        rhs = self._explicit.rhs(self.psi, self.gamma, self._metric, self.time, check=self.steps % _COURANT_EVERY == 0)
        circulation = float(self.gamma[-1, 1:-1, 1:-1].sum()) * self.grid.cell(self.grid.levels - 1) ** 2
        wall.prepare(end)
        guess = 2.0 * self.psi[0] - self._psi_before
        self._psi_before = self.psi[0].copy()
        solution, reaction = self._project(rhs, guess, end, circulation)
        for level in levels:
            nested.to_nodes(solution.gamma[level], solution.gamma_edges[level], self.gamma[level])
            nested.to_nodes(solution.psi[level], solution.psi_edges[level], self.psi[level])
        self._metric = wall.metric()
        inner = self.gamma[:, 1:-1, 1:-1]
        if self._deformed is not None and self._metric is not None:
            self._deformed.restrict_vorticity(inner, self.psi[0], self._metric)
        else:
            nested.restrict_all(inner)
        self.steps += 1
        pitch = self.motion.pitch(self.time - 0.5 * self.dt)[0]
        self._records.append(step_record(wall, reaction, self.time, pitch))
        wall.accept()

    def state(self) -> dict[str, Array]:
        """Everything a restart needs, as arrays of their own."""
        grid = self.grid
        arrays = {
            "grid": np.array([grid.spacing, *grid.shape, *grid.corner, grid.levels], dtype=float),
            "clock": np.array([self._start, self.steps, self.dt]),
            "reynolds": np.array(self.reynolds),
            "psi": self.psi,
            "gamma": self.gamma,
            "psi_before": self._psi_before,
            "convection": np.zeros(0) if self._explicit.convection is None else self._explicit.convection,
        }
        arrays |= {f"wall_{name}": value for name, value in self.wall.state().items()}
        # the fields are overwritten in every step
        return {name: value.copy() for name, value in arrays.items()}

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Continue from a state that `state` returned.

        With the same dt and body the run continues bit for bit; with another body (say a plate that starts to move from
        steady flow) or another dt it starts afresh from the saved flow at the saved time.

        Raises
        ------
        ValueError
            If the state lacks something or belongs to another grid.
        """
        instance_of("arrays", arrays, Mapping, "what Simulation.state returned")
        mine = self.state()
        missing = {name for name in mine if not name.startswith("wall_")} - arrays.keys()
        if missing:
            raise ValueError(f"the state lacks {sorted(missing)}; it must come from Simulation.state or dns.save_state")
        if not np.array_equal(arrays["grid"], mine["grid"]):
            raise ValueError(
                f"the state belongs to a grid with (h, nx, ny, x0, y0, levels) = {arrays['grid'].tolist()}, "
                f"this one has {mine['grid'].tolist()}; build the simulation with the grid of the state"
            )
        inner = (len(self.psi), *(size - 2 for size in self.psi[0].shape))
        wanted = {"psi": self.psi.shape, "gamma": self.psi.shape, "psi_before": self.psi[0].shape, "convection": inner}
        for name, shape in wanted.items():
            if arrays[name].shape != shape and (name != "convection" or arrays[name].size):
                raise ValueError(
                    f"{name} of the state has the shape {arrays[name].shape}, that of its grid is {shape}; "
                    "give a state as Simulation.state returned it"
                )
        if arrays["reynolds"] != self.reynolds:
            _log.warning(
                "the state was computed at Re = %g and goes on at Re = %g", float(arrays["reynolds"]), self.reynolds
            )
        start, steps, dt = (float(value) for value in arrays["clock"])
        same_step = dt == self.dt
        self._start, self.steps = (start, round(steps)) if same_step else (start + steps * dt, 0)
        self.psi, self.gamma = arrays["psi"].copy(), arrays["gamma"].copy()
        self._psi_before = arrays["psi_before"].copy() if same_step else self.psi[0].copy()
        convection = arrays["convection"]
        self._explicit.convection = convection.copy() if same_step and convection.size else None
        wall = {name.removeprefix("wall_"): value for name, value in arrays.items() if name.startswith("wall_")}
        same_wall = {n: v.shape for n, v in wall.items()} == {n: v.shape for n, v in self.wall.state().items()}
        self.wall.restore(wall if same_wall else {}, self.time)
        self._metric = self.wall.metric()
        self._records = []

    def _project(self, rhs: Array, guess: Array, end: float, circulation: float) -> tuple[Solution, Array]:
        """Find forces and new fields; ``guess`` is the level-0 streamfunction that the metric terms start from."""
        nested, transform, coupling, deformed = self._nested, self.wall.transform, self.wall.coupling, self._deformed
        metric, metric_hat, passes = self.wall.metric(), None, 1
        if deformed is not None and metric is not None:
            source = deformed.source(metric, guess)
            deformed.restrict_rhs(rhs, source)
            metric_hat, passes = sine_transform(source), _PASSES
        else:
            nested.restrict_all(rhs)
        rhs_hat = [sine_transform(level) for level in rhs]
        while True:
            predicted = nested.solve(rhs_hat, metric_hat, circulation)
            slip = transform.evaluate(predicted.psi[0]) + self._background_at_body(end, metric)
            reaction = self.wall.respond(coupling.velocities(slip))
            forces_hat = transform.source(coupling.source(reaction, self.grid.spacing) * self.dt)
            driven = [level + forces for level, forces in zip(rhs_hat, forces_hat, strict=True)]
            solution = nested.solve(driven, metric_hat, circulation)
            passes -= 1
            metric = self.wall.metric()
            if passes == 0 or deformed is None or metric is None:
                return solution, reaction
            nested.to_nodes(solution.psi[0], solution.psi_edges[0], guess)
            metric_hat = sine_transform(deformed.source(metric, guess))

    def _background_at_body(self, time: float, metric: Metric | None) -> Array:
        psi = self._background.levels(time)[0]
        if self._deformed is not None and metric is not None:
            psi = psi.copy()
            self._deformed.set_background(psi, metric, time)
        return np.asarray(psi[self.wall.coupling.window.full])


def _wall(grid: Grid, nested: NestedSolver, dt: float, body: Body | Membrane, motion: Motion) -> Wall:
    if isinstance(body, Points):
        return FixedWall(grid, nested, dt, body)
    if isinstance(body, MovingPoints):
        return MovingWall(grid, nested, dt, body)
    if isinstance(body, SharpPlate):
        shape = None if body.deflection is None else PrescribedShape(body)
        return PlateWall(grid, nested, dt, body.n_modes, shape)
    return PlateWall(grid, nested, dt, body.n_modes, MembraneShape(body, motion, dt))
