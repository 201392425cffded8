"""Onto another branch: at a branch point along its second tangent, at a period doubling along the critical mode."""

from __future__ import annotations

import dataclasses

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.departing import Crossing, over_two_periods
from hbnlp.branches.doubling import doubled
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.curve import TINY
from hbnlp.core.checks import instance_of, real_number
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kinds import Kind
from hbnlp.core.renamed import fewer_arguments, renamed_arguments
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.equations import along_parameter
from hbnlp.solutions.sizes import size_of_nonlinearity
from hbnlp.solutions.solution import Solution, guess_for
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.stability.result import FloquetResult

AT_REST = 1e-3
"""A motion smaller than this part of the nonlinear ones is rest."""


@renamed_arguments(special="point", name="switch_branch(point): it knows its parameter")
@fewer_arguments(1, "switch_branch(point): a special point knows its problem and its parameter")
@interrupts_kept()
def switch_branch(point: SpecialPoint, *, step: float = 0.02) -> tuple[Solution, ...]:
    """Return starts on the branch that crosses at a special point, one to each side of it.

    Trace each with ``hbnlp.trace(start, name, span)``: it knows its problem and leads away from the point.

    Parameters
    ----------
    point : SpecialPoint
        A branch point, or a period doubling: the new branch then has twice the period, ``start.problem.periods``.
    step : float
        Largest distance from the special point, relative to the size of the solution. The starts lie nearer where the
        new branch has turned, or a multiplier moved, so far by then that another special point might lie in between.

    Returns
    -------
    tuple of Solution
        Two, or fewer where the corrector fails; the two sides of a symmetry-breaking branch are mirror images. Their
        ``origin`` is the solution at the point, at a period doubling where the new balance has it.

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
    if point.kind is Kind.BRANCH_POINT and point.null is not None:
        solution, direction = point.solution, point.null
    elif point.kind is Kind.PERIOD_DOUBLING:
        problem, solution, direction = doubled(point)
    else:
        raise ValueError(f"no branch crosses at a {point.kind.value}; a branch point or a period doubling is needed")
    origin = guess_for(problem, solution).reshape(problem.shape)
    values = problem.values(solution.parameters)
    floor = size_of_nonlinearity(problem, origin.ravel(), direction.ravel(), values)
    at_rest = float(np.linalg.norm(origin)) <= AT_REST * floor
    curve = along_parameter(problem, values, point.name, floor=floor if at_rest else TINY)
    base = curve.point(origin, values[problem.system.parameters.index(point.name)])
    tangent = curve.point(direction, 0.0)
    tangent /= np.linalg.norm(tangent / curve.scale(base))
    evaluator, floquet = _stability(problem, point)
    crossing = Crossing(curve=curve, base=base, tangent=tangent, evaluator=evaluator, floquet=floquet)
    first, length = crossing.enter(step, 1.0)
    # a motion that repeats itself less often, or has lost a symmetry, has an image on the other side, as far away
    alike = first is not None and (point.kind is Kind.PERIOD_DOUBLING or point.breaks is not None)
    second = crossing.at(length, -1.0) if alike else crossing.enter(step, -1.0)[0]
    starts = [curve.solution(y, start="switched") for y in (first, second) if y is not None]
    return tuple(dataclasses.replace(start, origin=solution) for start in starts)


def _stability(problem: HarmonicBalance, point: SpecialPoint) -> tuple[FloquetEvaluator | None, FloquetResult | None]:
    """Return how multipliers on the new branch are had, and those at its beginning; None where stability was off."""
    if point.multiplier is None:
        return None, None
    own = attached(point)
    values = own.values(point.solution.parameters)
    floquet = FloquetEvaluator.of(own)(point.solution.coefficients, values)
    return FloquetEvaluator.of(problem), floquet if problem.periods == own.periods else over_two_periods(floquet)
