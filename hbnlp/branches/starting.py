"""How a trace begins: at a cold start, at a solution, or at the end of a branch that is resumed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.continuation.curve import TINY, relative_residual
from hbnlp.continuation.point import Point, start_point
from hbnlp.core.errors import SamplingError
from hbnlp.core.types import Array
from hbnlp.fourier import n_coefficients
from hbnlp.solutions.attaching import attached, check_belongs
from hbnlp.solutions.cold_start import linear_size
from hbnlp.solutions.columns import check_numbers
from hbnlp.solutions.equations import Equations, along_load, along_parameter
from hbnlp.solutions.odd import is_odd_throughout
from hbnlp.solutions.odd_equations import OddEquations
from hbnlp.solutions.sizes import size_of_nonlinearity
from hbnlp.solutions.solution import Solution, guess_for
from hbnlp.solutions.solving import solved
from hbnlp.stability.result import Floquet

SOLVED = 1e-9
"""A start whose residual is below this part of its terms is a solution, also at a fold, where Newton's method fails."""

LARGE = 200
"""Unknowns from which on the two parts of an odd motion's equations are quicker than the whole."""
MANY = 15
"""Harmonics that some point of a branch with a tolerance may well have."""

Span = tuple[float, float]


class Start(NamedTuple):
    """Where a trace begins: its curve, the first point with its tangent, and where the whole branch began.

    ``step`` is the length to try first, None for that of the options: of a branch that is resumed its last step; of a
    solution that was switched to the way from its origin, which is short where special points crowd, if that is less.
    """

    curve: Equations
    point: Point
    origin: Point
    step: float | None = None


def fresh_start(
    problem: HarmonicBalance,
    name: str,
    span: Span,
    *,
    at: Mapping[str, float] | None,
    start: Solution | ArrayLike | None,
    direction: int,
) -> Start:
    """Return the start at a solution, which is solved for where there is none.

    It leads away from where the solution was switched to, otherwise towards the side that was asked for.
    """
    curve, first = _first(problem, name, span, at, start)
    heading = direction * np.sign(span[1] - span[0]) * curve.unknowns.fixing_last()
    origin, step = start.origin if isinstance(start, Solution) else None, None
    if origin is not None:
        heading = first - curve.point(_coefficients(curve.problem, origin), origin.parameters[name])
        step = float(np.linalg.norm(heading / curve.scale(first)))
    point = start_point(curve, first, heading)
    return Start(curve, point, point, step)


def resumed_start(
    problem: HarmonicBalance,
    name: str,
    span: Span,
    branch: Branch,
    *,
    at: Mapping[str, float] | None,
    direction: int,
    stability: Floquet | None,
) -> Start:
    """Return the start at the last point of a branch, on its way.

    Raises
    ------
    ValueError
        If the branch is not of this problem, parameter, or stability.
    """
    _check_resumable(name, at, branch, stability)
    check_numbers(problem, branch.n_harmonics, what="branch")
    last = branch.solution(len(branch) - 1)
    check_belongs(problem.carrying(last.n_harmonics), last, what="branch", where="the last point of ")
    if len(branch) == 1:
        return fresh_start(problem, name, span, at=branch.parameters, start=last, direction=direction)
    curve, first = _first(problem, name, span, branch.parameters, last)
    points = [curve.point(branch.coefficients[i], branch.parameter[i]) for i in (0, 1, -2)]
    return Start(
        curve,
        start_point(curve, first, first - points[2]),
        start_point(curve, points[0], points[1] - points[0]),
        float(branch.arclength[-1] - branch.arclength[-2]),
    )


def _first(
    problem: HarmonicBalance,
    name: str,
    span: Span,
    at: Mapping[str, float] | None,
    start: Solution | ArrayLike | None,
) -> tuple[Equations, Array]:
    """Return the curve and its first point, which is solved for unless it is a solution already."""
    parameters = problem.system.parameters
    parameters.values(at, but=parameters.names)  # what is wrong with them is said here
    asked, x = problem, None
    if isinstance(start, Solution):
        problem = problem.carrying(start.n_harmonics * max(problem.periods // start.periods, 1))
        x = guess_for(problem, start)
    its = parameters.of_start(start.parameters) if isinstance(start, Solution) else {}
    given = {name: span[0], **its, **(at or {})}
    values = problem.values(given)
    here, (low, high) = float(values[parameters.index(name)]), sorted(span)
    if not low <= here <= high:
        raise ValueError(f"the start has {name} = {here:g}, outside the span {span}")
    sampled = None if x is None else _solved(problem, x, values)
    if x is None or sampled is None:
        found = solved(asked, at=given, start=start)
        sampled, x = attached(found), found.coefficients.ravel()
    problem = sampled
    floor = _smallest_solution(problem, values, name, span, x)
    n_dof, length = problem.shape
    size = n_dof * (length if problem.truncation is None else max(length, n_coefficients(MANY)))
    kind = OddEquations if size >= LARGE and is_odd_throughout(problem, x, values, name, span) else Equations
    curve = along_parameter(problem, values, name, span=span, floor=floor, kind=kind)
    return curve, curve.point(x.reshape(problem.shape), here)


def _solved(problem: HarmonicBalance, x: Array, values: Array) -> HarmonicBalance | None:
    """Return the problem with the samples that suffice at a motion; None if that is no solution, or none suffice."""
    try:
        problem = problem.with_enough_samples(x, values)
    except SamplingError:
        return None
    curve = along_load(problem, values)
    return problem if relative_residual(curve, curve.unknowns.joined(x, [1.0])) <= SOLVED else None


def _coefficients(problem: HarmonicBalance, solution: Solution) -> Array:
    return guess_for(problem, solution).reshape(problem.shape)


def _smallest_solution(problem: HarmonicBalance, values: Array, name: str, span: Span, first: Array) -> float:
    """Return the size below which changes are not measured relative to the solution: a trace may begin at rest."""
    middle = values.copy()
    middle[problem.system.parameters.index(name)] = np.mean(span)
    size = max(float(np.linalg.norm(first)), linear_size(problem, middle))
    if size > 0.0 and not np.any(problem.assembly.load_derivative(middle)):
        # without excitation rest is a solution, and branches pass through it: not by ever smaller steps
        return 1e-2 * max(size, size_of_nonlinearity(problem, np.zeros(problem.size), first, middle))
    return max(1e-6 * size, TINY) if size > 0.0 else 1.0


def _check_resumable(name: str, at: Mapping[str, float] | None, branch: Branch, stability: Floquet | None) -> None:
    if (branch.multipliers is None) != (stability is None):
        how, give = ("without", "stability=None") if branch.multipliers is None else ("with", "stability=Floquet()")
        raise ValueError(f"the branch was traced {how} multipliers: resume it with {give}, or trace it anew")
    if branch.name != name:
        raise ValueError(f"the branch was traced in {branch.name!r}, not in {name!r}; resume it in the same parameter")
    for key, value in (at or {}).items():
        if key != name and branch.parameters.get(key) != value:
            raise ValueError(f"parameter {key!r} is {value!r} here but {branch.parameters.get(key)!r} on the branch")
