"""Onto another branch: at a branch point along its second tangent, at a period doubling along the critical mode."""

from __future__ import annotations

import dataclasses

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.curve import TINY, null_vector
from hbnlp.continuation.newton import Newton, correct
from hbnlp.core.checks import instance_of, real_number
from hbnlp.core.kinds import Kind
from hbnlp.core.renamed import fewer_arguments, renamed_arguments
from hbnlp.core.types import Array
from hbnlp.fourier import stretch
from hbnlp.solutions.equations import along_parameter
from hbnlp.solutions.sizes import size_of_nonlinearity
from hbnlp.solutions.solution import Solution, attached

AT_REST = 1e-3
"""A motion smaller than this part of the nonlinear ones is rest."""


@renamed_arguments(special="point", name="switch_branch(point): it knows its parameter")
@fewer_arguments(1, "switch_branch(point): a special point knows its problem and its parameter")
def switch_branch(point: SpecialPoint, *, step: float = 0.02) -> tuple[Solution, ...]:
    """Return starts on the branch that crosses at a special point, one to each side of it.

    Trace each with ``hbnlp.trace(start, name, span)``: it knows its problem and leads away from the point.

    Parameters
    ----------
    point : SpecialPoint
        A branch point, or a period doubling: the new branch then has twice the period, ``start.problem.periods``.
    step : float
        Distance from the special point, relative to the size of the solution.

    Returns
    -------
    tuple of Solution
        Two, or fewer where the corrector fails; the two sides of a symmetry-breaking branch are mirror images. Their
        ``origin`` is the point's solution.

    Raises
    ------
    ValueError
        For a special point at which no branch crosses, or one from a file, without its problem.
    TypeError
        For a point of another kind.
    """
    instance_of("point", point, SpecialPoint, "a special point of a branch, such as branch.branch_points[0]")
    problem = attached(point, "load its branch with problem=...")
    real_number("step", step, above=0.0, below=1.0)
    values = problem.values(point.solution.parameters)
    if point.kind is Kind.BRANCH_POINT and point.null is not None:
        origin, direction = point.solution.coefficients, point.null
    elif point.kind is Kind.PERIOD_DOUBLING:
        problem, origin, direction = _doubled(problem, point, values)
    else:
        raise ValueError(f"no branch crosses at a {point.kind.value}; a branch point or a period doubling is needed")
    floor = size_of_nonlinearity(problem, origin.ravel(), direction.ravel(), values)
    at_rest = float(np.linalg.norm(origin)) <= AT_REST * floor
    curve = along_parameter(problem, values, point.name, floor=floor if at_rest else TINY)
    base = curve.point(origin, values[problem.system.parameters.index(point.name)])
    scale = curve.scale(base)
    tangent = curve.point(direction, 0.0)
    tangent /= np.linalg.norm(tangent / scale)
    starts = []
    for sign in (1.0, -1.0):
        found = correct(curve, base + sign * step * tangent, tangent / scale**2, Newton())
        if found.converged:
            start = curve.solution(found.y, start="switched")
            starts.append(dataclasses.replace(start, origin=point.solution))
    return tuple(starts)


def _doubled(problem: HarmonicBalance, point: SpecialPoint, values: Array) -> tuple[HarmonicBalance, Array, Array]:
    """Return the balance over twice the period, the solution in it, and the null vector that appears there."""
    doubled = HarmonicBalance(problem.system, 2 * problem.n_harmonics, periods=2 * problem.periods)
    coefficients = stretch(point.solution.coefficients, 2)
    # the critical mode consists of odd harmonics, on which the solution itself has no part
    odd = (np.arange(doubled.shape[1]) + 1) // 2 % 2 == 1
    keep = np.tile(odd, doubled.shape[0])
    null = np.zeros(doubled.size)
    null[keep] = null_vector(doubled.assembly.jacobian(coefficients.ravel(), values)[np.ix_(keep, keep)])
    return doubled, coefficients, null.reshape(doubled.shape)
