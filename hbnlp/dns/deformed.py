"""What a deformed plate adds to a step on level 0, and to what coarser levels see of it."""

from __future__ import annotations

import numpy as np

from hbnlp.core.types import Array
from hbnlp.dns.grid import Grid
from hbnlp.dns.mapping import Metric, PlateMap
from hbnlp.dns.motion import Background
from hbnlp.dns.nested import NestedSolver
from hbnlp.dns.stencils import laplacian


class Deformed:
    """Terms of the coordinate map, placed in the arrays of level 0.

    Parameters
    ----------
    grid : Grid
        The grids.
    nested : NestedSolver
        The linear solver.
    background : Background
        Flow of frame and free stream.
    plate_map : PlateMap
        The map.
    """

    def __init__(self, grid: Grid, nested: NestedSolver, background: Background, plate_map: PlateMap) -> None:
        self._grid, self._nested, self._background = grid, nested, background
        self._y = grid.nodes()[1][None, plate_map.window[1]]
        self.window, self._interior = plate_map.window, plate_map.interior()
        window_x, window_y = self.window
        self._inner_x, self._all_y = slice(window_x.start, window_x.stop - 2), window_y

    def source(self, metric: Metric, psi: Array) -> Array:
        """m(psi) at the interior nodes of level 0, from its streamfunction at all nodes."""
        nx, ny = self._grid.shape
        source = np.zeros((nx - 1, ny - 1))
        source[self._interior] = metric.source(psi[self.window])
        return source

    def set_background(self, psi: Array, metric: Metric, time: float) -> None:
        """Overwrite psi_b on level 0, where the map moves the nodes."""
        psi[self.window] = self._background.fine(time, self._y + metric.eta, self.window)

    def vorticity(self, gamma: Array, metric: Metric) -> Array:
        """Vorticity gamma / J on level 0."""
        omega = gamma.copy()
        omega[self.window] /= metric.jacobian
        return omega

    def add_grid_velocity(self, v: Array, metric: Metric) -> None:
        """Make v, on the nodes as `node_velocity` returns it, relative to the moving coordinates."""
        v[self._inner_x, self._all_y] -= metric.eta_rate[1:-1, :]

    def add_diffusion(self, out: Array, omega: Array, gamma: Array, metric: Metric, diffusivity: float) -> None:
        """Add nu (mapped Laplacian of omega - plain Laplacian of gamma), which the implicit step leaves out."""
        plain = laplacian(gamma[self.window], self._grid.spacing)
        out[self._interior] -= diffusivity * (metric.rotation(omega[self.window]) + plain)

    def restrict_rhs(self, rhs: Array, source: Array) -> None:
        """Restrict right-hand sides such that coarser levels see the apparent vorticity gamma + m."""
        if self._grid.levels == 1:
            return
        apparent = np.zeros_like(source)
        self._nested.restrict(source, apparent)
        self._nested.restrict(rhs[0], rhs[1])
        rhs[1] += self._nested.helmholtz(apparent, 1)
        self._nested.restrict_all(rhs[1:])

    def restrict_vorticity(self, gamma: Array, psi: Array, metric: Metric) -> None:
        """Pass the apparent vorticity on to the coarser levels; arrays of all interior and of all level-0 nodes."""
        if self._grid.levels == 1:
            return
        self._nested.restrict(gamma[0] + self.source(metric, psi), gamma[1])
        self._nested.restrict_all(gamma[1:])
