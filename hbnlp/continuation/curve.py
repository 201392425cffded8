"""A curve R(y) = 0, one more unknown than equations, and the linear algebra at one of its points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.linalg import blas, lapack

from hbnlp.core.kept import built_once
from hbnlp.core.types import Array, IntArray

TINY = float(np.finfo(float).tiny)
"""Divisors are at least this."""


class Curve(Protocol):
    """Equations R(y) = 0, ``size`` of them, in y of one entry more; the last entry is the continuation parameter."""

    size: int

    @property
    def parts(self) -> Parts | None:
        """The parts that a symmetry of its points leaves, None where there are none."""
        ...

    def residual(self, y: Array) -> Array:
        """Return R(y), (size,)."""
        ...

    def jacobian(self, y: Array, out: Array) -> None:
        """Write dR/dy into an array (size, size + 1) of zeros."""
        ...

    def scale(self, y: Array) -> Array:
        """Return the sizes (size + 1,) by which changes of y are measured."""
        ...

    def term_size(self, y: Array) -> float:
        """Return the size of the terms whose sum is R."""
        ...

    def carried_from(self, other: Any, y: Array) -> Array:
        """Return a point or direction of another curve, of the same kind, in this one's unknowns."""
        ...


@dataclass(frozen=True)
class Parts:
    """Of a curve whose points are all symmetric: the unknowns that vary along it, and those that are zero on it.

    Its Jacobian has two blocks then. The curve has its folds by the first, and others of its kind cross it there; where
    the second is singular, a curve crosses that lacks the symmetry.

    Attributes
    ----------
    along : array of int
        Positions of the unknowns that vary, the continuation parameter last. All but the last are also those of the
        equations that are not zero by symmetry.
    across : array of int
        Positions of the other unknowns, and of the other equations.
    blocks : callable (y, out) -> array (n, n)
        Returns the block across, and writes the one along into an array (m, m + 1) of zeros.
    """

    along: IntArray
    across: IntArray
    blocks: Callable[[Array, Array], Array]


class Bordered:
    """LU factors of a square matrix [jacobian; row]; what is given is overwritten."""

    across: tuple[float, float] = (1.0, 0.0)
    """Sign and logarithm of the modulus of the determinant of the block across, where there are `Parts`."""

    def __init__(self, matrix: Array) -> None:
        # LAPACK sees the transpose of an array stored by rows; the solves below undo that without a copy
        self._lu, self._pivots, info = lapack.dgetrf(matrix.T, overwrite_a=True)
        self.singular = bool(info > 0) or not np.isfinite(self._lu[-1, -1])

    @classmethod
    def at(cls, curve: Curve, y: Array, row: Array) -> Bordered:
        """Return the factors of [dR/dy; row] at a point of a curve."""
        if curve.parts is not None:
            return InParts(curve.parts, y, row)
        matrix = np.zeros((y.size, y.size))
        curve.jacobian(y, matrix[:-1])
        matrix[-1] = row
        return cls(matrix)

    def product(self, vector: Array) -> Array:
        """Return the product of the matrix itself with a vector (size,), from its factors."""
        permuted = lapack.dlaswp(vector[:, None], self._pivots)[:, 0]
        lower = blas.dtrmv(self._lu, permuted, lower=1, trans=1, diag=1)
        return np.asarray(blas.dtrmv(self._lu, lower, trans=1))

    def solve(self, right: Array) -> Array:
        """Return the solution for the right side (size,) or (size, k)."""
        return np.asarray(lapack.dgetrs(self._lu, self._pivots, right, trans=1)[0])

    def solve_transposed(self, right: Array) -> Array:
        """Return the solution of the transposed system."""
        return np.asarray(lapack.dgetrs(self._lu, self._pivots, right, trans=0)[0])

    def determinant(self) -> tuple[float, float]:
        """Return sign and logarithm of the modulus of the determinant."""
        diagonal = self._lu.diagonal()
        swaps = np.count_nonzero(self._pivots != np.arange(self._pivots.size))
        negative = np.count_nonzero(diagonal < 0.0) + swaps
        with np.errstate(divide="ignore"):
            return (-1.0 if negative % 2 else 1.0), float(np.log(np.abs(diagonal)).sum())


class InParts(Bordered):
    """The same in two blocks; the row must be zero across. The block across is factorised where it is asked for."""

    def __init__(self, parts: Parts, y: Array, row: Array) -> None:
        matrix = np.zeros((parts.along.size,) * 2)
        self._parts, self._block = parts, parts.blocks(y, matrix[:-1])
        matrix[-1] = row[parts.along]
        self._along = Bordered(matrix)
        self.singular = self._along.singular

    @built_once
    def _across(self) -> Bordered:
        return Bordered(self._block)

    @built_once
    def across(self) -> tuple[float, float]:
        """Sign and logarithm of the modulus of the determinant of the block across."""
        return self._across.determinant()

    def product(self, vector: Array) -> Array:
        """Return the product of the matrix itself with a vector (size,), from its factors."""
        return self._in_parts(vector, Bordered.product)

    def solve(self, right: Array) -> Array:
        """Return the solution for the right side (size,) or (size, k)."""
        return self._in_parts(right, Bordered.solve)

    def solve_transposed(self, right: Array) -> Array:
        """Return the solution of the transposed system."""
        return self._in_parts(right, Bordered.solve_transposed)

    def determinant(self) -> tuple[float, float]:
        """Return sign and logarithm of the modulus of the determinant."""
        (sign, logarithm), across = self._along.determinant(), self.across
        return sign * across[0], logarithm + across[1]

    def _in_parts(self, vector: Array, operation: Callable[[Bordered, Array], Array]) -> Array:
        result = np.zeros(vector.shape)
        result[self._parts.along] = operation(self._along, vector[self._parts.along])
        across = vector[self._parts.across]
        if across.any():
            result[self._parts.across] = operation(self._across, across)
        return result


def relative_residual(curve: Curve, y: Array, *, least: float = 0.0) -> float:
    """Return the largest entry of R(y) relative to the size of its terms, which is taken to be at least ``least``."""
    terms = max(curve.term_size(y), least, TINY)
    return float(np.max(np.abs(curve.residual(y)), initial=0.0)) / terms


def null_vector(matrix: Array) -> Array:
    """Return the unit vector that a matrix (m, n), m <= n, shrinks most: its null vector where it has one."""
    return np.asarray(np.linalg.svd(matrix)[2][-1])
