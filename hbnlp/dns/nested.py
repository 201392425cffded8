"""Implicit diffusion and the Poisson equation on nested grids, by fast sine transforms.

On every level, from the coarsest inwards, with boundary values interpolated from the level outside,

    (1 - nu dt / 2 Lap) gamma = rhs,        - Lap psi = gamma + m

are solved together in the space of sine coefficients, so that a step needs one transform forwards and two backwards a
level instead of the eight of solving them one after another. What a coarse level needs of the region that a finer one
covers is restricted right-hand side: the restriction keeps circulation and its first moments.

References
----------
Colonius and Taira (2008), doi:10.1016/j.cma.2007.08.014.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.fft

from hbnlp.core.types import Array
from hbnlp.dns.grid import Grid
from hbnlp.dns.stencils import laplacian


@dataclass(frozen=True)
class Edges:
    """Boundary values of a level: sides, left and right, of shape (2, ny + 1); ends, bottom and top, (nx + 1, 2)."""

    sides: Array
    ends: Array

    def write(self, field: Array) -> None:
        """Write the values into the border of a node field of shape (nx + 1, ny + 1)."""
        field[[0, -1], :] = self.sides
        field[:, [0, -1]] = self.ends


@dataclass(frozen=True)
class Solution:
    """Sine coefficients of vorticity and streamfunction by level, shape (nx - 1, ny - 1), with boundary values."""

    gamma: list[Array]
    psi: list[Array]
    gamma_edges: list[Edges]
    psi_edges: list[Edges]


def sine_matrix(size: int) -> Array:
    """Orthonormal symmetric matrix of the sine transform of type I, shape (size, size)."""
    return np.asarray(scipy.fft.dst(np.eye(size), type=1, norm="ortho", axis=0))


def sine_transform(field: Array) -> Array:
    """Two-dimensional sine transform of interior node values, its own inverse; transforms the last two axes."""
    return np.asarray(scipy.fft.dstn(field, type=1, norm="ortho", axes=(-2, -1)))


class NestedSolver:
    """Linear solves of one time step on nested grids.

    Parameters
    ----------
    grid : Grid
        The nested grids.
    diffusion : float
        nu dt, in chords squared.
    """

    def __init__(self, grid: Grid, diffusion: float) -> None:
        self.grid = grid
        nx, ny = grid.shape
        self.sx, self.sy = sine_matrix(nx - 1), sine_matrix(ny - 1)
        symbol_x = 4.0 * np.sin(0.5 * np.pi * np.arange(1, nx) / nx) ** 2
        symbol_y = 4.0 * np.sin(0.5 * np.pi * np.arange(1, ny) / ny) ** 2
        symbol = symbol_x[:, None] + symbol_y[None, :]
        self._kappa = 0.5 * diffusion / grid.cells() ** 2
        self._cell2 = grid.cells() ** 2
        self._inverse_helmholtz = 1.0 / (1.0 + self._kappa[:, None, None] * symbol)
        self._inverse_poisson = self._cell2[:, None, None] / symbol
        self._to_finer = tuple(
            (to_nodes, np.ascontiguousarray(to_nodes[[0, -1]]))
            for to_nodes in (_cubic_interpolation(nx)[:, 1:-1] @ self.sx, _cubic_interpolation(ny)[:, 1:-1] @ self.sy)
        )
        self._border_sine = np.ascontiguousarray(self.sx[:, [0, -1]]), np.ascontiguousarray(self.sy[[0, -1], :])
        self._weights = (_restriction_weights(nx), _restriction_weights(ny))
        self._overlap = (_overlap(nx), _overlap(ny))
        self._log_distance = self._outer_log_distance()

    def solve(
        self, rhs_hat: Sequence[Array] | Array, metric_hat: Array | None = None, circulation: float = 0.0
    ) -> Solution:
        """Solve both equations on all levels.

        Parameters
        ----------
        rhs_hat : sequence of ndarray
            Sine coefficients of the Helmholtz right-hand sides, without boundary terms, of shape (nx - 1, ny - 1),
            finest level first.
        metric_hat : ndarray of shape (nx - 1, ny - 1), optional
            Sine coefficients of the source m on level 0.
        circulation : float
            Total circulation, for the point-vortex far field on the outermost boundary.
        """
        nx, ny = self.grid.shape
        gamma_edges = Edges(np.zeros((2, ny + 1)), np.zeros((nx + 1, 2)))
        strength = -circulation / (2.0 * np.pi)
        psi_edges = Edges(strength * self._log_distance.sides, strength * self._log_distance.ends)
        solution = Solution([], [], [], [])
        for level in range(self.grid.levels - 1, -1, -1):
            if solution.psi:
                gamma_edges, psi_edges = self._edges_inside(solution.gamma[-1]), self._edges_inside(solution.psi[-1])
            gamma = self._edge_source(gamma_edges, self._kappa[level])
            gamma += rhs_hat[level]
            gamma *= self._inverse_helmholtz[level]
            psi = self._edge_source(psi_edges, 1.0 / self._cell2[level])
            psi += gamma
            if level == 0 and metric_hat is not None:
                psi += metric_hat
            psi *= self._inverse_poisson[level]
            solution.gamma.append(gamma)
            solution.psi.append(psi)
            solution.gamma_edges.append(gamma_edges)
            solution.psi_edges.append(psi_edges)
        return Solution(solution.gamma[::-1], solution.psi[::-1], solution.gamma_edges[::-1], solution.psi_edges[::-1])

    def to_nodes(self, coefficients: Array, edges: Edges, out: Array) -> None:
        """Write the node values of a level, border included, from sine coefficients and boundary values."""
        out[1:-1, 1:-1] = sine_transform(coefficients)
        edges.write(out)

    def restrict(self, fine: Array, coarse: Array) -> None:
        """Overwrite the covered part of a coarse level's interior node values by the finer level's, restricted."""
        (cx, fx), (cy, fy) = self._overlap
        half = np.zeros((cx.stop - cx.start, fine.shape[1]))
        for k, weight in enumerate(self._weights[0]):
            half += weight * fine[fx + k : fx + k + 2 * half.shape[0] - 1 : 2, :]
        count = cy.stop - cy.start
        covered = coarse[cx, cy]
        covered[...] = 0.0
        for k, weight in enumerate(self._weights[1]):
            covered += weight * half[:, fy + k : fy + k + 2 * count - 1 : 2]

    def restrict_all(self, fields: Array) -> None:
        """Restrict interior node values of successive levels, shape (n, nx - 1, ny - 1), each to the next, in place."""
        for fine, coarse in pairwise(fields):
            self.restrict(fine, coarse)

    def helmholtz(self, field: Array, level: int) -> Array:
        """Apply 1 - nu dt / 2 Lap to interior node values that vanish near the boundary."""
        padded = np.pad(field, 1)
        return np.asarray(field - (self._kappa[level] * self._cell2[level]) * laplacian(padded, self.grid.cell(level)))

    def _edges_inside(self, coefficients: Array) -> Edges:
        (to_x, border_x), (to_y, border_y) = self._to_finer
        return Edges((border_x @ coefficients) @ to_y.T, to_x @ (coefficients @ border_y.T))

    def _edge_source(self, edges: Edges, factor: float) -> Array:
        source: Array = self._border_sine[0] @ ((factor * edges.sides[:, 1:-1]) @ self.sy)
        source += (self.sx @ (factor * edges.ends[1:-1, :])) @ self._border_sine[1]
        return source

    def _outer_log_distance(self) -> Edges:
        x, y = self.grid.nodes(self.grid.levels - 1)
        x, y = x - x.mean(), y - y.mean()
        scale = max(x[-1], y[-1])
        return Edges(
            np.log(np.hypot(x[[0, -1], None], y[None, :]) / scale),
            np.log(np.hypot(x[:, None], y[None, [0, -1]]) / scale),
        )


def _cubic_interpolation(cells: int) -> Array:
    """Four-point Lagrange interpolation in one direction from a level's nodes to those of the level inside it."""
    positions = 0.5 * (np.arange(cells + 1) - 0.5 * cells) + 0.5 * cells
    matrix = np.zeros((cells + 1, cells + 1))
    for row, position in enumerate(positions):
        first = int(np.floor(position)) - 1
        offsets = np.arange(4)
        for k in offsets:
            others = offsets[offsets != k]
            matrix[row, first + k] = np.prod((position - first - others) / (k - others))
    return matrix


def _restriction_weights(cells: int) -> tuple[float, ...]:
    # shares of the fine circulation by linear weighting; an odd number of cells staggers the nodes of successive levels
    return (0.25, 0.5, 0.25) if cells % 2 == 0 else (0.125, 0.375, 0.375, 0.125)


def _overlap(cells: int) -> tuple[slice, int]:
    """Covered interior nodes of the coarse level, and the first fine interior node of the first stencil."""
    reach = len(_restriction_weights(cells))
    coarse = np.arange(1, cells)
    # twice the fine node index, an integer also where the nodes are staggered
    first = (4 * coarse - cells - (reach - 1)) // 2
    inside = (first >= 1) & (first + reach - 1 <= cells - 1)
    index = np.flatnonzero(inside)
    return slice(int(index[0]), int(index[-1]) + 1), int(first[index[0]]) - 1
