"""Where an exploration begins: its first motion, those at the ends of the span, and a diagram that it goes on from."""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import refused
from hbnlp.core.errors import ConvergenceError
from hbnlp.diagrams.diagram import Diagram
from hbnlp.solutions.attaching import attached, check_belongs
from hbnlp.solutions.columns import check_numbers
from hbnlp.solutions.solution import Solution
from hbnlp.solutions.solving import solved
from hbnlp.stability.result import Floquet


def first_motion(
    problem: HarmonicBalance,
    name: str,
    span: tuple[float, float],
    at: Mapping[str, float] | None,
    start: Solution | ArrayLike | None,
) -> Solution:
    """Return the motion that an exploration begins with, solved for unless it is one of the problem already."""
    if isinstance(start, Solution) and at is None and _is_of(start, problem):
        return start
    own = start.parameters if isinstance(start, Solution) else {}
    return solved(problem, at={name: span[0], **own, **(at or {})}, start=start)


def _is_of(start: Solution, problem: HarmonicBalance) -> bool:
    """Return whether a solution has the system and the harmonics of a problem; its periods may be more."""
    its = start.problem
    if its is None or its.system is not problem.system or its.truncation != problem.truncation:
        return False
    return problem.truncation is not None or its.n_harmonics * problem.periods == problem.n_harmonics * its.periods


def cold_motions(
    problem: HarmonicBalance, name: str, values: tuple[float, ...], parameters: Mapping[str, float]
) -> tuple[list[Solution], list[str]]:
    """Return the motions of cold starts at some values, and words for those that led to none."""
    motions, failed = [], []
    for value in values:
        try:
            motions.append(solved(problem, at={**parameters, name: value}))
        except (ConvergenceError, ArithmeticError) as error:
            failed.append(f"a cold start at {name} = {value:g}: {error}")
    return motions, failed


def check_goes_on(
    before: Diagram, name: str, span: tuple[float, float], first: Solution, stability: Floquet | None
) -> None:
    """Raise a ValueError if an earlier diagram is not of this parameter, span, problem, values and stability."""
    if before.name != name or before.span != span:
        was = f"{before.name} over {before.span}"
        raise refused(ValueError, "resume", was, f"a diagram in {name} over {span}")
    for branch in before.branches[:1]:
        if (branch.multipliers is None) != (stability is None):
            how = "without" if branch.multipliers is None else "with"
            raise ValueError(f"the diagram was made {how} multipliers: resume it so, or explore anew")
        for key, value in first.parameters.items():
            if key != name and branch.parameters.get(key) != value:
                its = branch.parameters.get(key)
                raise ValueError(f"parameter {key!r} is {value!r} here but {its!r} in the diagram that is resumed")
        problem = attached(first)
        check_numbers(problem, branch.n_harmonics, what="diagram")
        solution = branch.solution(0)
        check_belongs(problem.carrying(solution.n_harmonics), solution, what="diagram", where="the first point of ")
