"""Whether a step is trusted or refused: the arc between its ends must be smooth, and on one branch.

The angle between the tangents at its ends is small, the chord lies between them, and the orientation of the curve is
kept, or changes at a branch point that is found on the arc; nor may the determinant have been zero twice on the way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from hbnlp.continuation.branch_points import Arc, BranchPoint, branch_point_on
from hbnlp.continuation.curve import Curve
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import Point
from hbnlp.core.types import Array

SUSPICIOUS_LENGTH = 2e-3
"""Steps longer than this are looked at for a pair of branch points within them."""


def accepted(
    curve: Curve,
    before: Point | None,
    base: Point,
    trial: Point,
    *,
    angle: float,
    newton: Newton,
    at: Callable[[float], Point | None],
) -> tuple[Point | None, float]:
    """Return the trial point with its arclength and the branch point before it, or None if the step is refused.

    Parameters
    ----------
    curve : Curve
    before, base, trial : Point
        The point before the step's beginning, where there is one; its beginning and its end.
    angle : float
        Largest angle in radians between the tangents at the ends.
    newton : Newton
    at : callable
        The point at a distance along the tangent of ``base``, None where a corrector fails.

    Returns
    -------
    Point or None
    float
        The angle between the tangents, for the next step's length.
    """
    scale = base.scale
    chord = (trial.y - base.y) / scale
    length = float(np.linalg.norm(chord))
    here, there = base.tangent / scale, trial.tangent / scale
    there = there / np.linalg.norm(there)
    turn = _angle(here, there)
    middle = here + there
    aside = _angle(chord / length, middle / np.linalg.norm(middle)) if length > 0.0 else np.pi
    if turn > angle or aside > 0.3 * turn + 0.02:
        return None, turn
    branch_point = None
    if trial.orientation == base.orientation:
        if before is not None and length > SUSPICIOUS_LENGTH and _dips(before, base, trial, length):
            half_way = at(0.5 * float(base.tangent / scale**2 @ (trial.y - base.y)))
            if half_way is None or half_way.orientation != base.orientation:
                return None, turn
    else:
        branch_point = _branch_point(curve, base, trial, newton)
        if branch_point is None:
            return None, turn
    return dataclasses.replace(trial, arclength=base.arclength + length, branch_point=branch_point), turn


def _dips(before: Point, base: Point, trial: Point, length: float) -> bool:
    """Return whether the determinant may have been zero twice on the way, by a parabola through three points."""
    back = base.arclength - before.arclength
    earlier = before.orientation * base.orientation * np.exp(min(before.log_determinant - base.log_determinant, 50.0))
    later = np.exp(min(trial.log_determinant - base.log_determinant, 50.0))
    slopes = (1.0 - earlier) / back, (later - 1.0) / length
    curvature = (slopes[1] - slopes[0]) / (back + length)
    slope = slopes[0] + curvature * back
    if curvature <= 0.0 or not 0.0 < -slope < 2.0 * curvature * length:
        return False
    return bool(1.0 - 0.25 * slope**2 / curvature < 0.2 * min(1.0, later))


def _branch_point(curve: Curve, base: Point, trial: Point, newton: Newton) -> BranchPoint | None:
    """Return where the orientation changes; None if it changes by a jump and not through a singular point."""
    ratio = float(np.exp(min(trial.log_determinant - base.log_determinant, 500.0)))
    return branch_point_on(
        curve,
        Arc(base.y, trial.y, (base.tangent, trial.tangent), base.scale),
        (base.orientation, trial.orientation * ratio),
        tol=newton.tol,
        max_iterations=newton.max_iterations,
    )


def _angle(a: Array, b: Array) -> float:
    """Return the angle between unit vectors, accurate when it is small."""
    return float(2.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(a - b)))))
