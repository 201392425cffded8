"""The projection: forces on the body that make the new velocity satisfy the no-slip condition.

With Q from `kernels` and the fluid's response matrix G (vorticity source in a window of nodes to streamfunction in that
window, after implicit diffusion and the Poisson equation on all levels),

    B F = u_body - Q psi_star,        B = dt / h^2  Q G Q^T

References
----------
Colonius and Taira (2008), doi:10.1016/j.cma.2007.08.014.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from hbnlp.core.types import Array
from hbnlp.dns.errors import FlowError
from hbnlp.dns.kernels import Coupling, Window
from hbnlp.dns.nested import NestedSolver, Solution

# Beyond this condition number the forces keep fewer than four digits of double precision.
_MAX_CONDITION = 1e12
_MAX_WINDOW_NODES = 8000


class WindowTransform:
    """Sine transforms of fields that vanish outside a window of level 0, and their evaluation inside it."""

    def __init__(self, nested: NestedSolver, window: Window) -> None:
        self._nested = nested
        self.window = window
        self._blocks: list[tuple[Array, Array, tuple[slice, slice]]] = []
        nx, ny = nested.grid.shape
        marks = np.zeros((nested.grid.levels, nx - 1, ny - 1))
        marks[0][window.interior] = 1.0
        nested.restrict_all(marks)
        self._fields = np.zeros_like(marks)
        for mark in marks:
            used_x, used_y = np.flatnonzero(mark.any(axis=1)), np.flatnonzero(mark.any(axis=0))
            block = slice(int(used_x[0]), int(used_x[-1]) + 1), slice(int(used_y[0]), int(used_y[-1]) + 1)
            left = np.ascontiguousarray(nested.sx[:, block[0]])
            right = np.ascontiguousarray(nested.sy[block[1], :])
            self._blocks.append((left, right, block))

    def source(self, values: Array) -> list[Array]:
        """Sine coefficients, a list of levels, of a source given in the window."""
        fields = self._fields
        fields[0][self.window.interior] = values
        self._nested.restrict_all(fields)
        return [left @ field[block] @ right for (left, right, block), field in zip(self._blocks, fields, strict=True)]

    def evaluate(self, coefficients: Array) -> Array:
        """Values in the window of a level-0 field given by its sine coefficients."""
        left, right, _ = self._blocks[0]
        return np.asarray(left.T @ coefficients @ right.T)

    def respond(self, values: Array) -> Solution:
        """Solve with a source in the window as the only right-hand side."""
        return self._nested.solve(self.source(values))


def body_matrix(transform: WindowTransform, coupling: Coupling, dt: float, spacing: float) -> Array:
    """B of fixed points, shape (constraints, constraints), column by column."""
    size = coupling.matrix.shape[0]
    matrix = np.empty((size, size))
    dense = coupling.matrix.toarray() * (dt / spacing**2)
    for column in range(size):
        response = transform.respond(dense[column].reshape(coupling.window.shape))
        matrix[:, column] = coupling.velocities(transform.evaluate(response.psi[0]))
    return matrix


def window_matrix(transform: WindowTransform) -> Array:
    """G on all nodes of the window, shape (nodes, nodes), for bodies whose points move in it.

    Raises
    ------
    ValueError
        If the window has so many nodes that the matrix would not fit in memory.
    """
    shape = transform.window.shape
    size = shape[0] * shape[1]
    if size > _MAX_WINDOW_NODES:
        raise ValueError(
            f"the reach of the moving body has {size} nodes, above {_MAX_WINDOW_NODES} "
            f"(its matrix would take {8e-9 * size**2:.1f} GB): "
            "give a smaller reach or a coarser grid, or use a frame that moves with the body"
        )
    matrix = np.empty((size, size))
    unit = np.zeros(shape)
    for index in range(size):
        unit.flat[index] = 1.0
        matrix[:, index] = transform.evaluate(transform.respond(unit).psi[0]).ravel()
        unit.flat[index] = 0.0
    return matrix


class Factor:
    """LU factors of B, refused when B is singular in double precision.

    Parameters
    ----------
    matrix : ndarray of shape (n, n)
        B.
    advice : str
        What the user can do if it is singular.

    Raises
    ------
    FlowError
        If the condition number is above 1e12: points closer together than the grid resolves.
    """

    def __init__(self, matrix: Array, advice: str) -> None:
        norm = float(np.abs(matrix).sum(axis=0).max())
        if not np.isfinite(norm):
            raise FlowError("the body matrix is not finite; check the points of the body")
        lu, pivots, info = scipy.linalg.lapack.dgetrf(matrix)
        reciprocal = 0.0 if info > 0 else float(scipy.linalg.lapack.dgecon(lu, norm)[0])
        self.condition = np.inf if reciprocal == 0.0 else 1.0 / reciprocal
        if self.condition > _MAX_CONDITION:
            raise FlowError(
                f"the body matrix is singular to working precision (condition number {self.condition:.1e}, "
                f"accepted up to {_MAX_CONDITION:.0e}): {advice}"
            )
        self._factors = (lu, pivots)

    def solve(self, rhs: Array) -> Array:
        """Solve B F = rhs."""
        return np.asarray(scipy.linalg.lu_solve(self._factors, rhs, check_finite=False))
