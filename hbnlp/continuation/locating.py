"""Where a function of the points of a curve vanishes, between two of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from hbnlp.continuation.branch_points import Arc
from hbnlp.continuation.curve import Curve
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import Point, finish


def between(curve: Curve, base: Point, end: Point, share: float, newton: Newton) -> Point | None:
    """Return the point at a share of the arc from one point to another, or None where Newton's method fails."""
    arc = Arc(base.y, end.y, (base.tangent, end.tangent), base.scale)
    return finish(curve, arc.at(share), base.tangent / base.scale**2, base, newton)


MOST_HALVINGS = 200
"""Brent's method may need several times those of bisection, forty, where a test is flat or steep."""


def locate(curve: Curve, base: Point, end: Point, test: Callable[[Point], float], newton: Newton) -> Point | None:
    """Return the point between two others where ``test`` vanishes, by Brent's method along the tangent of ``base``.

    None is returned if a corrector fails, or if the points do not close in on one another: a jump.
    """
    row = base.tangent / base.scale**2
    length = float(row @ (end.y - base.y))
    if length <= 0.0:
        return None
    points = {0.0: base, length: end}
    found = {0.0: test(base), length: test(end)}

    def along(step: float) -> float:
        if step not in found:
            nearest = min(points, key=lambda s: abs(s - step))
            guess = points[nearest].y + (step - nearest) * base.tangent
            point = finish(curve, guess, row, points[nearest], newton)
            if point is None:
                raise ArithmeticError
            points[step], found[step] = point, test(point)
        return found[step]

    try:
        root = brentq(along, 0.0, length, xtol=1e-12 * length, rtol=8.9e-16, maxiter=MOST_HALVINGS)
    except (
        ArithmeticError,
        RuntimeError,
    ):  # the latter is brentq's: the sign changes in a step, or over a flat stretch
        return None
    signs = np.sign(found[0.0])
    left = max((s for s in found if s <= root and found[s] * signs > 0.0), default=0.0)
    right = min((s for s in found if s >= root and found[s] * signs <= 0.0), default=length)
    if abs(found[root]) > 1e-3 * min(abs(found[0.0]), abs(found[length])):
        return None
    if float(np.linalg.norm((points[right].y - points[left].y) / base.scale)) > 3.0 * (right - left) + 1e-6 * length:
        return None
    share = found[left] / (found[left] - found[right]) if found[left] != found[right] else 0.0
    guess = points[left].y + share * (points[right].y - points[left].y)
    return finish(curve, guess, row, points[root], newton)
