"""A period doubling as the balance over twice the period sees it: a branch point, whose null vector has odd harmonics.

With few harmonics it does not lie quite where the multiplier of the truncated motion is -1. A switch leaves from the
balance's own point, beside which the doubled motions are; where doublings crowd the difference would be too much.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.curve import TINY
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import finish, start_point
from hbnlp.core.types import Array
from hbnlp.fourier import stretch
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.equations import along_parameter
from hbnlp.solutions.solution import Solution

FIRST, FARTHEST = 1e-5, 0.05
"""Steps along the branch, relative to the solution: the first of the secant method, and beyond which it has failed."""
MOST_STEPS, SMALL = 10, 1e-9


def doubled(point: SpecialPoint) -> tuple[HarmonicBalance, Solution, Array]:
    """Return the balance over twice the period, the motion at which its Jacobian is singular, and the null vector."""
    own = attached(point)
    problem = own.over_twice_the_period()
    # the critical mode consists of odd harmonics, on which the solution itself has no part
    odd = (np.arange(problem.shape[1]) + 1) // 2 % 2 == 1
    keep = np.tile(odd, problem.shape[0])

    def block(coefficients: Array, values: Array) -> Array:
        jacobian = problem.assembly.jacobian(stretch(coefficients, 2).ravel(), values)
        return np.asarray(jacobian[np.ix_(keep, keep)])

    solution, vector = _singular(point, block)
    null = np.zeros(problem.size)
    null[keep] = vector
    return problem, solution, null.reshape(problem.shape)


def _singular(point: SpecialPoint, block: Callable[[Array, Array], Array]) -> tuple[Solution, Array]:
    """Return the motion beside a special point at which a block of a Jacobian is singular, and its null vector.

    The function that vanishes there is the last unknown of the block bordered by its singular vectors (Griewank and
    Reddien, SIAM J. Numer. Anal. 21, 1984); it is followed to zero along the branch by secants. Where that fails the
    special point's motion serves.
    """
    given, problem = point.solution, attached(point)
    values = problem.values(given.parameters)
    # rest has no size of its own, and stays rest
    curve = along_parameter(problem, values, point.name, floor=TINY if np.any(given.coefficients) else 1.0)
    y = curve.point(given.coefficients, given.parameters[point.name])
    base = start_point(curve, y, curve.unknowns.fixing_last())
    left, sizes, right = np.linalg.svd(block(given.coefficients, values))
    unknown = np.eye(sizes.size + 1)[-1]

    def solved_at(y: Array) -> Array:
        matrix = block(curve.coefficients(y), curve.values(y))
        bordered = np.block([[matrix, sizes[0] * left[:, -1:]], [right[-1:], np.zeros((1, 1))]])
        return np.asarray(np.linalg.lstsq(bordered, unknown, rcond=None)[0])  # singular where two modes double at once

    before, step = (0.0, float(solved_at(y)[-1])), FIRST
    for _ in range(MOST_STEPS):
        at = finish(curve, base.y + step * base.tangent, base.tangent / base.scale**2, base, Newton())
        if at is None:
            break
        solved = solved_at(at.y)
        slope = (solved[-1] - before[1]) / (step - before[0])
        if slope == 0.0:
            break
        following = step - solved[-1] / slope
        if abs(following) > FARTHEST:
            break
        if abs(following - step) <= SMALL:
            return curve.solution(at.y), solved[:-1]
        before, step = (step, float(solved[-1])), following
    return given, right[-1]
