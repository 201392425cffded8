"""What a step knows at its beginning: convection by Adams-Bashforth and the explicit half of diffusion."""

from __future__ import annotations

import numpy as np

from hbnlp.core.types import Array
from hbnlp.dns.deformed import Deformed
from hbnlp.dns.grid import Grid
from hbnlp.dns.limits import check_courant, check_metric_diffusion, courant_number
from hbnlp.dns.mapping import Metric
from hbnlp.dns.motion import Background
from hbnlp.dns.stencils import advection, laplacian, node_velocity


class Explicit:
    """Right-hand sides (1 + nu dt/2 Lap) gamma + dt (3 N - N_old) / 2, N the convection.

    Parameters
    ----------
    grid : Grid
        The grids.
    dt, reynolds : float
        Time step and Reynolds number.
    background : Background
        Flow of frame and free stream.
    deformed : Deformed, optional
        Terms of the coordinate map, for a plate that deforms.

    Attributes
    ----------
    convection : ndarray of shape (levels, nx - 1, ny - 1), or None
        N of the step before; without it a step is one of Euler's.
    """

    def __init__(
        self, grid: Grid, dt: float, reynolds: float, background: Background, deformed: Deformed | None
    ) -> None:
        self._grid, self._dt, self._diffusivity = grid, dt, 1.0 / reynolds
        self._background, self._deformed = background, deformed
        nx, ny = grid.shape
        self._rhs = np.empty((grid.levels, nx - 1, ny - 1))
        self.convection: Array | None = None

    def rhs(self, psi: Array, gamma: Array, metric: Metric | None, time: float, *, check: bool) -> Array:
        """Right-hand sides without the body's forces at the interior nodes of all levels; overwritten by the next call.

        Parameters
        ----------
        psi, gamma : ndarray of shape (levels, nx + 1, ny + 1)
            The fields at ``time``.
        metric : Metric or None
            Metric of a deformed plate then.
        time : float
            Beginning of the step.
        check : bool
            Whether to refuse a flow that has become too fast for the time step.
        """
        dt = self._dt
        background = self._background.levels(time)
        first = self.convection is None
        if self.convection is None:
            self.convection = np.zeros_like(self._rhs)
        # level by level, so that the fields of one stay in the processor's cache
        for level, cell in enumerate(self._grid.cells()):
            h = float(cell)
            mapped = metric if level == 0 else None
            convection = self._convect(psi[level], gamma[level], background[level], h, mapped, time, check=check)
            rhs = laplacian(gamma[level], h)
            rhs *= 0.5 * dt * self._diffusivity
            rhs += gamma[level, 1:-1, 1:-1]
            rhs += (1.5 * dt) * convection
            rhs -= (0.5 * dt) * (convection if first else self.convection[level])
            self.convection[level] = convection
            self._rhs[level] = rhs
        return self._rhs

    def _convect(
        self, psi: Array, gamma: Array, background: Array, h: float, metric: Metric | None, time: float, *, check: bool
    ) -> Array:
        """N of a level; under a metric with that part of diffusion which the implicit step leaves out."""
        deformed = self._deformed
        if deformed is None or metric is None:
            u, v = node_velocity(psi + background, h)
            if check:
                check_courant(courant_number(u, v, self._dt, h), self._dt, time)
            return advection(u, v, gamma, h)
        mapped = background.copy()
        deformed.set_background(mapped, metric, time)
        u, v = node_velocity(psi + mapped, h)
        deformed.add_grid_velocity(v, metric)
        if check:
            check_courant(courant_number(u, v, self._dt, h), self._dt, time)
        check_metric_diffusion(metric.stretch_max, self._dt, self._diffusivity, h, time)
        omega = deformed.vorticity(gamma, metric)
        out = advection(u, v, omega, h)
        deformed.add_diffusion(out, omega, gamma, metric, self._diffusivity)
        return out
