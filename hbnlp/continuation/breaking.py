"""Where a curve of symmetric points is crossed by one that lacks the symmetry.

On such a curve the unknowns across stay zero and their equations hold by themselves; the block B of their derivatives
becomes singular where branches without the symmetry cross: pitchforks, to which the curve itself is regular. With the
null vectors v and w of B near there, fixed, the function g of::

    [ B    w ] [ phi ]   [ 0 ]
    [ v^T  0 ] [ g   ] = [ 1 ]

vanishes where det B does (Griewank and Reddien 1984, doi:10.1093/imanum/4.3.295), is smooth and of a size that varies
little, so that the secant method finds its zero along the curve.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from hbnlp.continuation.branch_points import STRAYS, Arc, BranchPoint
from hbnlp.continuation.curve import Bordered, Curve, Parts
from hbnlp.continuation.locating import between
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import Point
from hbnlp.core.types import Array

NEAR = 1e-3
"""How near, relative to the length of the arc, its root is before the curve itself is asked."""


def breaking_point(curve: Curve, base: Point, end: Point, newton: Newton) -> BranchPoint | None:
    """Return the point between two others of a curve with `Parts` where its block across is singular.

    None where a corrector fails, or where the secant method strays from the root that the arc between them has.
    """
    assert curve.parts is not None
    parts, reference = curve.parts, base.across[1]
    arc = Arc(base.y, end.y, (base.tangent, end.tangent), base.scale)
    ends = {0.0: base.across, 1.0: end.across}

    def determinant(share: float) -> float:
        sign, logarithm = ends[share] if share in ends else Bordered(_block(parts, arc.at(share))).determinant()
        return sign * float(np.exp(np.clip(logarithm - reference, -700.0, 700.0)))

    root = float(brentq(determinant, 0.0, 1.0, xtol=NEAR, rtol=NEAR))
    borders = _null_vectors(_block(parts, arc.at(root)))
    share, last, step, size = root, None, NEAR if root < 0.5 else -NEAR, np.inf
    for _ in range(newton.max_iterations):
        point = between(curve, base, end, share, newton)
        if point is None:
            return None
        phi, g = _bordered(_block(parts, point.y), *borders)
        if size <= newton.tol:
            null = np.zeros(point.y.size)
            null[parts.across] = phi
            null /= np.linalg.norm(null / point.scale)
            return BranchPoint(y=point.y, null=null, residual=point.residual, is_across=True)
        if last is not None:
            step *= g / (last - g) if g != last else 0.0
        size = abs(step) * arc.length
        share, last = share + step, g
        if abs(share - root) > STRAYS:
            return None
    return None


def _block(parts: Parts, y: Array) -> Array:
    """Return the block across."""
    return parts.blocks(y, np.zeros((parts.along.size - 1, parts.along.size)))


def _null_vectors(block: Array) -> tuple[Array, Array]:
    """Return right and left unit vectors that a matrix shrinks most, by inverse iteration."""
    factors = Bordered(block)
    right, left = np.random.default_rng(0).standard_normal((2, len(block)))
    for _ in range(3):
        right, left = factors.solve(right), factors.solve_transposed(left)
        right, left = right / np.linalg.norm(right), left / np.linalg.norm(left)
    return right, left


def _bordered(block: Array, right: Array, left: Array) -> tuple[Array, float]:
    """Return phi and g."""
    n = len(right)
    matrix, unit = np.zeros((n + 1, n + 1)), np.zeros(n + 1)
    matrix[:n, :n], matrix[:n, n], matrix[n, :n] = block, left, right
    unit[n] = 1.0
    solution = Bordered(matrix).solve(unit)
    return solution[:n], float(solution[n])
