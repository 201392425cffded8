"""Branch points: where a second branch crosses the one that is traced, located without touching it.

At a branch point of ``R(y) = 0``, n equations in n + 1 unknowns, the Jacobian J has lost a rank: its kernel is a plane
and a left null vector psi exists. Every plane through such a point is singular for a corrector, so that it cannot be
approached by points of the branch. It is found as the regular solution (y, mu) of equations that are unfolded as by
Moore [1]_, with g as by Griewank and Reddien [2]_::

    R(y) + mu w = 0,      g(y) = 0,      [ J    w ] [ Phi ]   [ 0 ]
                                         [ V^T  0 ] [  g  ] = [ I ]

with w close to psi and the two columns of V close to the kernel: g, (2,), vanishes where J loses rank, and its
derivative is ``-psi . R_yy Phi``. The unfolding mu vanishes if the branches really cross; two curves that only come
close to one another give a mu that does not.

References
----------
.. [1] G. Moore, "The numerical treatment of non-trivial bifurcation points", Numer. Funct. Anal. Optim. 2 (1980)
   441-472.
.. [2] A. Griewank, G. W. Reddien, "Characterization and computation of generalized turning points", SIAM J. Numer.
   Anal. 21 (1984) 176-185.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from hbnlp.continuation.curve import Bordered, Curve, relative_residual
from hbnlp.core.types import Array

STRAYS = 0.05
"""How far from the arc, relative to its length, its branch point may lie: the arc is known to fourth order."""
CROSSES = 1e-8
"""Curves that pass within this residual, relative to the terms, cross; a larger one keeps them apart."""
DIFFERENCE = 1e-5
"""Relative step of the central differences that give second derivatives."""


@dataclass(frozen=True, kw_only=True)
class BranchPoint:
    """A point y, (size + 1,), where another branch crosses; ``null`` spans the kernel of dR/dy with the tangent."""

    y: Array
    null: Array
    residual: float

    @property
    def value(self) -> float:
        """Value of the continuation parameter."""
        return float(self.y[-1])


class Arc:
    """The cubic through two points of a curve with the tangents there, y(s) for s from 0 to 1."""

    def __init__(self, begin: Array, end: Array, tangents: tuple[Array, Array], scale: Array) -> None:
        self.scale = scale
        self.length = float(np.linalg.norm((end - begin) / scale))
        self._ends = begin, end
        self._slopes = tuple(self.length * t / np.linalg.norm(t / scale) for t in tangents)

    def at(self, s: float) -> Array:
        """Return y(s)."""
        (a, b), (u, v), r = self._ends, self._slopes, 1.0 - s
        return a * (1.0 + 2.0 * s) * r**2 + b * (3.0 - 2.0 * s) * s**2 + u * s * r**2 - v * s**2 * r

    def tangent(self, s: float) -> Array:
        """Return the unit tangent at y(s)."""
        (a, b), (u, v), r = self._ends, self._slopes, 1.0 - s
        slope = 6.0 * s * r * (b - a) + u * r * (1.0 - 3.0 * s) - v * s * (3.0 * r - 1.0)
        return np.asarray(slope / np.linalg.norm(slope / self.scale))


def branch_point_on(
    curve: Curve, arc: Arc, determinants: tuple[float, float], *, tol: float, max_iterations: int
) -> BranchPoint | None:
    """Return the branch point on an arc whose ends have determinants of different sign, or None.

    Parameters
    ----------
    curve : Curve
    arc : Arc
    determinants : tuple of float
        Those of [dR/dy; tangent] at its ends, both divided by the same number.
    tol : float
        Bound on the error of y relative to its size.
    max_iterations : int
        Steps of Newton's method before it is given up.

    Returns
    -------
    BranchPoint or None
        None where Newton's method fails or strays from the arc, and where the curves pass each other without crossing:
        the ends then lie on different branches.
    """
    known = {0.0: determinants[0], 1.0: determinants[1]}
    logarithm = _determinant(curve, arc, 0.0)[1] - float(np.log(abs(determinants[0])))

    def determinant(s: float) -> float:
        if s not in known:
            sign, log = _determinant(curve, arc, s)
            known[s] = sign * float(np.exp(np.clip(log - logarithm, -700.0, 700.0)))
        return known[s]

    s = brentq(determinant, 0.0, 1.0, xtol=1e-3, rtol=1e-3)
    start, scale = arc.at(s), arc.scale
    null_space = _null_space(curve, start, arc.tangent(s), scale)
    if null_space is None:
        return None
    kernel, left = null_space
    y, unfolding = start, 0.0
    for _ in range(max_iterations):
        matrix, right, phi = _extended(curve, y, kernel, left, scale)
        right[:-2] += unfolding * left
        factors = Bordered(matrix)
        if factors.singular:
            return None
        step = -factors.solve(right)
        y = y + step[:-1]
        unfolding += float(step[-1])
        size = float(np.linalg.norm(step[:-1] / scale))
        if not float(np.linalg.norm((y - start) / scale)) <= STRAYS * arc.length:
            return None
        if size <= tol:
            # where the terms vanish, at rest, they are measured by those at the ends of the arc
            residual = relative_residual(curve, y, least=max(curve.term_size(arc.at(s)) for s in (0.0, 1.0)))
            null = phi[:, 1] / np.linalg.norm(phi[:, 1] / scale)
            return BranchPoint(y=y, null=null, residual=residual) if residual <= CROSSES else None
    return None


def _determinant(curve: Curve, arc: Arc, s: float) -> tuple[float, float]:
    return Bordered.at(curve, arc.at(s), arc.tangent(s) / arc.scale**2).determinant()


def _null_space(curve: Curve, y: Array, tangent: Array, scale: Array) -> tuple[Array, Array] | None:
    """Return near a branch point kernel (size + 1, 2), tangent first, and left null vector, by inverse iteration."""
    factors = Bordered.at(curve, y, tangent / scale**2)
    if factors.singular:
        return None
    right, left = scale.copy(), np.ones(y.size)
    for _ in range(3):
        right = scale * _unit(factors.solve(right / scale) / scale)
        left = _unit(factors.solve_transposed(left))
    right -= tangent * float((tangent / scale**2) @ right)
    kernel, left = np.stack([tangent, scale * _unit(right / scale)], axis=1), _unit(left[:-1])
    return (kernel, left) if np.isfinite(kernel.sum() + left.sum()) else None


def _unit(vector: Array) -> Array:
    """Return the unit vector of a direction; beside a singular point the squares of its entries may overflow."""
    with np.errstate(all="ignore"):
        vector = vector / np.abs(vector).max()
        return np.asarray(vector / np.linalg.norm(vector))


def _extended(curve: Curve, y: Array, kernel: Array, left: Array, scale: Array) -> tuple[Array, Array, Array]:
    """Return matrix and right side of Newton's method for (y, mu), the latter without the term in mu, and Phi."""
    n = y.size - 1
    bordered = np.zeros((n + 2, n + 2))
    curve.jacobian(y, bordered[:n, :-1])
    bordered[:n, -1] = left
    matrix = bordered.copy()
    bordered[n:, :-1] = (kernel / scale[:, None] ** 2).T
    factors = Bordered(bordered)
    identity = np.eye(n + 2)
    solutions = np.stack([factors.solve(identity[n]), factors.solve(identity[n + 1])], axis=1)
    phi, g = solutions[:-1], solutions[-1]
    psi = factors.solve_transposed(identity[n + 1])[:n]
    for j in (0, 1):
        step = DIFFERENCE / float(np.linalg.norm(phi[:, j] / scale))
        ahead, back = np.zeros((n, n + 1)), np.zeros((n, n + 1))
        curve.jacobian(y + step * phi[:, j], ahead)
        curve.jacobian(y - step * phi[:, j], back)
        matrix[n + j, :-1] = psi @ (back - ahead) / (2.0 * step)
    return matrix, np.concatenate([curve.residual(y), g]), phi
