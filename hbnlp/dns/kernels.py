"""Between grid and body: interpolation of velocities to points and, by its transpose, regularisation of point forces.

A `Coupling` is the sparse matrix Q from streamfunction values in a window of nodes to the constrained velocity
components (all u first, then all v). A force F on the points is the vorticity source ``Q.T @ F / h**2``, so
interpolation and regularisation are adjoint by construction.

References
----------
Roma, Peskin and Berger (1999), doi:10.1006/jcph.1999.6293; Taira and Colonius (2007), doi:10.1016/j.jcp.2007.03.005.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from hbnlp.core.types import Array, IntArray
from hbnlp.dns.grid import PLATE_OVERHANG, Grid

# half the support of the kernel, in cells, plus the reach of the curl
_ROMA_MARGIN = 3.0
_SHARP_MARGIN = 3.0
# cubic interpolation to the plate's line from the node rows -1, 0 below and 1, 2 above it; `grid.PLATE_OVERHANG`
# depends on these weights
PLATE_WEIGHTS = {-1: -1.0 / 16.0, 0: 9.0 / 16.0, 1: 9.0 / 16.0, 2: -1.0 / 16.0}


def roma(distance: Array) -> Array:
    """Three-point kernel of Roma, Peskin and Berger; distance in cells."""
    r = np.abs(distance)
    inner = (1.0 + np.sqrt(np.maximum(1.0 - 3.0 * r**2, 0.0))) / 3.0
    outer = (5.0 - 3.0 * r - np.sqrt(np.maximum(1.0 - 3.0 * (1.0 - r) ** 2, 0.0))) / 6.0
    return np.where(r <= 0.5, inner, np.where(r <= 1.5, outer, 0.0))


def hat(distance: Array) -> Array:
    """Two-point kernel; distance in cells."""
    return np.maximum(1.0 - np.abs(distance), 0.0)


@dataclass(frozen=True)
class Window:
    """Rectangle of interior nodes of level 0: node indices first_x .. last_x and first_y .. last_y, both included."""

    first_x: int
    last_x: int
    first_y: int
    last_y: int

    @property
    def shape(self) -> tuple[int, int]:
        """Number of nodes each way."""
        return self.last_x - self.first_x + 1, self.last_y - self.first_y + 1

    @property
    def interior(self) -> tuple[slice, slice]:
        """Slices of the window in an array of interior nodes."""
        return slice(self.first_x - 1, self.last_x), slice(self.first_y - 1, self.last_y)

    @property
    def full(self) -> tuple[slice, slice]:
        """Slices of the window in an array of all nodes."""
        return slice(self.first_x, self.last_x + 1), slice(self.first_y, self.last_y + 1)

    @classmethod
    def around(cls, grid: Grid, points: Array, margin_cells: float = _ROMA_MARGIN) -> Window:
        """Smallest window with a margin of cells around points of shape (n, 2)."""
        grid.check_inside(points, margin_cells + 1.0, "the body")
        margin = margin_cells * grid.spacing
        bounds = []
        for axis in (0, 1):
            nodes = grid.nodes()[axis]
            bounds.append(int(np.searchsorted(nodes, points[:, axis].min() - margin)))
            bounds.append(int(np.searchsorted(nodes, points[:, axis].max() + margin, side="right")) - 1)
        return cls(*bounds)


@dataclass(frozen=True)
class Coupling:
    """Sparse matrix Q, shape (constraints, window nodes), with its window."""

    matrix: sp.csr_array
    window: Window

    def velocities(self, psi: Array) -> Array:
        """Constrained velocity components of streamfunction values in the window."""
        return np.asarray(self.matrix @ psi.ravel())

    def source(self, force: Array, spacing: float) -> Array:
        """Rate of vorticity in the window, shape of the window, that forces on the fluid at the points produce."""
        return np.asarray(self.matrix.T @ force).reshape(self.window.shape) / spacing**2


def point_coupling(grid: Grid, points: Array, window: Window, kernel: Callable[[Array], Array] = roma) -> Coupling:
    """Coupling of points anywhere in a window.

    Parameters
    ----------
    grid : Grid
        The grids.
    points : ndarray of shape (n, 2)
        Positions on the body.
    window : Window
        Nodes that the kernel may touch.
    kernel : callable
        One-dimensional kernel of the distance in cells; at most four cells wide.

    Raises
    ------
    ValueError
        If a point's kernel leaves the window.
    """
    nodes_x, nodes_y = grid.nodes()
    h = grid.spacing
    x_low, x_high = nodes_x[window.first_x], nodes_x[window.last_x]
    y_low, y_high = nodes_y[window.first_y], nodes_y[window.last_y]
    low, high = points.min(axis=0), points.max(axis=0)
    if low[0] < x_low + 2 * h or high[0] > x_high - 2 * h or low[1] < y_low + 2 * h or high[1] > y_high - 2 * h:
        raise ValueError(
            f"the body spans x = {low[0]:.4g} .. {high[0]:.4g}, y = {low[1]:.4g} .. {high[1]:.4g} and leaves its reach "
            f"x = {x_low:.4g} .. {x_high:.4g}, y = {y_low:.4g} .. {y_high:.4g} (two cells of margin): "
            "give it a larger reach"
        )
    in_cells = (points - [x_low, y_low]) / h
    at_x, at_y = _local_weights(in_cells[:, 0], kernel), _local_weights(in_cells[:, 1], kernel)
    # u = psi_y at (node, half), v = -psi_x at (half, node)
    step_x, step_y = (_differenced(_local_weights(in_cells[:, axis] - 0.5, kernel)) for axis in (0, 1))
    rows = [_products(at_x, step_y, 1.0 / h, window), _products(step_x, at_y, -1.0 / h, window)]
    return Coupling(sp.csr_array(sp.vstack(rows)), window)


def sharp_plate_coupling(grid: Grid) -> tuple[Coupling, Array, Array]:
    """Coupling of the infinitely thin plate from (0, 0) to (1, 0) on a line of u-points.

    u is taken at the nodes between the ends, v at the cell middles from the two rows above and the two below by cubic
    interpolation. On a plate that moves across the stream v has a curvature that grows as the vorticity over the
    plate's scale: with the nearest rows alone, its h^2/8 is the largest error of all.

    Returns
    -------
    coupling : Coupling
        Q with the n - 1 u-constraints first, then the n v-constraints.
    x_u, x_v : ndarray
        Chordwise positions of the constraints.

    Raises
    ------
    ValueError
        If the plate does not suit the grid (`Grid.plate_cells`).
    """
    h, n = grid.spacing, grid.plate_cells()
    i0, j0 = round(-grid.corner[0] / h - PLATE_OVERHANG), round(-grid.corner[1] / h - 0.5)
    window = Window.around(grid, np.array([[0.0, 0.0], [1.0, 0.0]]), _SHARP_MARGIN)
    wx, wy = window.shape
    # flat index in the window of the node below the plate's line at its left end
    origin = (i0 - window.first_x) * wy + j0 - window.first_y
    v_rows, v_columns, v_values = [], [], []
    for up, weight in PLATE_WEIGHTS.items():
        for right, sign in ((0, 1.0), (1, -1.0)):
            v_rows.append(np.arange(n))
            v_columns.append(origin + (np.arange(n) + right) * wy + up)
            v_values.append(np.full(n, sign * weight / h))
    inner = origin + np.arange(1, n) * wy
    u_columns, u_values = np.concatenate([inner + 1, inner]), np.repeat([1.0 / h, -1.0 / h], n - 1)
    u = sp.coo_array((u_values, (np.tile(np.arange(n - 1), 2), u_columns)), shape=(n - 1, wx * wy))
    v = sp.coo_array(
        (np.concatenate(v_values), (np.concatenate(v_rows), np.concatenate(v_columns))), shape=(n, wx * wy)
    )
    x_u, x_v = (np.asarray((part - PLATE_OVERHANG) * h) for part in (np.arange(1.0, n), np.arange(n) + 0.5))
    return Coupling(sp.csr_array(sp.vstack([u, v])), window), x_u, x_v


Local = tuple[IntArray, Array]


def _local_weights(positions: Array, kernel: Callable[[Array], Array]) -> Local:
    """First index, shape (n,), and four kernel weights, shape (n, 4), of points on a line of grid points."""
    first = np.floor(positions).astype(int) - 1
    return first, kernel(positions[:, None] - (first[:, None] + np.arange(4)))


def _differenced(local: Local) -> Local:
    """Weights on half points turned into weights on the nodes whose differences they take."""
    first, weights = local
    return first, np.pad(weights, ((0, 0), (1, 0))) - np.pad(weights, ((0, 0), (0, 1)))


def _products(along_x: Local, along_y: Local, factor: float, window: Window) -> sp.csr_array:
    """Products of weights along x and along y as rows over the window's nodes."""
    (first_x, weights_x), (first_y, weights_y) = along_x, along_y
    columns = ((first_x[:, None] + np.arange(weights_x.shape[1])) * window.shape[1])[:, :, None]
    columns = columns + (first_y[:, None] + np.arange(weights_y.shape[1]))[:, None, :]
    values = factor * weights_x[:, :, None] * weights_y[:, None, :]
    n = first_x.size
    rows = np.repeat(np.arange(n), columns[0].size)
    used = values.ravel() != 0.0
    return sp.csr_array(
        (values.ravel()[used], (rows[used], columns.ravel()[used])), shape=(n, window.shape[0] * window.shape[1])
    )
