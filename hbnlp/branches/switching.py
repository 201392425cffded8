"""Onto another branch: at a branch point along its second tangent, at a period doubling along the critical mode."""

from __future__ import annotations

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.curve import null_vector
from hbnlp.continuation.newton import Newton, correct
from hbnlp.core.kinds import Kind
from hbnlp.core.types import Array
from hbnlp.fourier import stretch
from hbnlp.solutions.equations import along_parameter
from hbnlp.solutions.solution import Solution


def switch_branch(
    problem: HarmonicBalance, special: SpecialPoint, name: str, *, step: float = 0.02
) -> tuple[Solution, ...]:
    """Return starts on the branch that crosses at a special point, one to each side of it.

    Trace each with ``hbnlp.trace(start.problem, name, span, start=start, away_from=special.solution)``.

    Parameters
    ----------
    problem : HarmonicBalance
        That of the branch on which the point lies.
    special : SpecialPoint
        A branch point, or a period doubling: the new branch then has twice the period, ``start.problem.periods``.
    name : str
        The continuation parameter.
    step : float
        Distance from the special point, relative to the size of the solution.

    Returns
    -------
    tuple of Solution
        Two, or fewer where the corrector fails; the two sides of a symmetry-breaking branch are mirror images.

    Raises
    ------
    ValueError
        For a special point at which no branch crosses.
    """
    if not 0.0 < step < 1.0:
        raise ValueError(f"step = {step!r}; a length between 0 and 1 is needed")
    values = problem.values(special.solution.parameters)
    if special.kind is Kind.BRANCH_POINT and special.null is not None:
        origin, direction = special.solution.coefficients, special.null
    elif special.kind is Kind.PERIOD_DOUBLING:
        problem, origin, direction = _doubled(problem, special, values)
    else:
        raise ValueError(f"no branch crosses at a {special.kind.value}; a branch point or a period doubling is needed")
    curve = along_parameter(problem, values, name)
    base = curve.point(origin, values[problem.system.parameters.index(name)])
    scale = curve.scale(base)
    tangent = curve.point(direction, 0.0)
    tangent /= np.linalg.norm(tangent / scale)
    starts = []
    for sign in (1.0, -1.0):
        found = correct(curve, base + sign * step * tangent, tangent / scale**2, Newton())
        if found.converged:
            starts.append(curve.solution(found.y, start="switched"))
    return tuple(starts)


def _doubled(problem: HarmonicBalance, special: SpecialPoint, values: Array) -> tuple[HarmonicBalance, Array, Array]:
    """Return the balance over twice the period, the solution in it, and the null vector that appears there."""
    doubled = HarmonicBalance(problem.system, 2 * problem.n_harmonics, periods=2 * problem.periods)
    coefficients = stretch(special.solution.coefficients, 2)
    # the critical mode consists of odd harmonics, on which the solution itself has no part
    odd = (np.arange(doubled.shape[1]) + 1) // 2 % 2 == 1
    keep = np.tile(odd, doubled.shape[0])
    null = np.zeros(doubled.size)
    null[keep] = null_vector(doubled.assembly.jacobian(coefficients.ravel(), values)[np.ix_(keep, keep)])
    return doubled, coefficients, null.reshape(doubled.shape)
