"""The solution at a given parameter value between two neighbouring points of a curve, as near to a fold as may be."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from hbnlp.continuation.curve import relative_residual
from hbnlp.continuation.newton import Newton, correct
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.types import Array
from hbnlp.solutions.accuracy import Accuracy
from hbnlp.solutions.equations import Equations
from hbnlp.solutions.solution import Solution

NEWTON = Newton()


def solution_between(curve: Equations, before: Solution, after: Solution, value: float) -> Solution:
    """Return the solution where a curve passes a parameter value between two of its solutions.

    The points are cut by planes normal to their chord, and the plane is sought whose point has the value: each of these
    problems is regular, where Newton's method at the fixed value is not near a fold.

    Parameters
    ----------
    curve : Equations
        With a tolerance, it is gone along with as many harmonics as the solution between asks for.
    before, after : Solution
        Neighbours on it, the value between their parameters, no fold between them.
    value : float

    Raises
    ------
    ConvergenceError
        If the curve is not followed from one point to the other: they are too far apart.
    """
    n_harmonics = max(before.n_harmonics, after.n_harmonics)
    accuracy = Accuracy(curve.problem) if curve.problem.truncation is not None else None
    while True:
        own = curve.on(curve.problem.carrying(n_harmonics))
        ends = [own.point(each.coefficients, each.parameters[own.name]) for each in (before, after)]
        y, row = _point_between(own, ends[0], ends[1], value)
        statistics: dict[str, float | str] = {"start": "branch", "residual": relative_residual(own, y)}
        if accuracy is None:
            return own.solution(y, **statistics)
        for end in ends:
            accuracy.see(own, end)
        error, wanted, _better = accuracy.judge(own, y, row)
        if wanted == n_harmonics:
            return own.solution(y, **statistics, truncation_error=error)
        n_harmonics = wanted


def _point_between(curve: Equations, before: Array, after: Array, value: float) -> tuple[Array, Array]:
    """Return the point of a curve between two points, and the normal of the plane in which it was sought."""
    chord = after - before
    row = chord / curve.scale(before) ** 2
    row /= np.linalg.norm(row)
    points: dict[float, Array] = {0.0: before, 1.0: after}

    def beyond(share: float) -> float:
        if share not in points:
            near = min(points, key=lambda known: abs(known - share))
            found = correct(curve, points[near] + (share - near) * chord, row, NEWTON)
            if not found.converged:
                raise ConvergenceError(
                    f"the branch could not be followed between its points at {curve.name} = {before[-1]:.8g} and "
                    f"{after[-1]:.8g} ({found.reason}): trace it in smaller steps, PseudoArclength(angle=...)",
                    curve.solution(found.y),
                )
            points[share] = found.y
        return float(points[share][-1] - value)

    share = float(brentq(beyond, 0.0, 1.0, xtol=1e-14, rtol=8.9e-16))
    beyond(share)
    y = points[share].copy()
    y[-1] = value
    return y, row
