"""The problem that a record knows, or is given when it comes from a file: checked to be its own."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.curve import TINY
from hbnlp.core.checks import instance_of

if TYPE_CHECKING:
    from hbnlp.solutions.solution import Solution

EXPECTED = "the HarmonicBalance(system, n_harmonics=...) of the record"
LARGEST_RESIDUAL = 1e-6
"""A solution whose residual is a larger part of its terms is none of the problem."""


class Attachable(Protocol):
    """A record that knows its problem, unless it came from a file."""

    @property
    def problem(self) -> HarmonicBalance | None:
        """The problem, or None."""
        ...


def attached(
    record: Attachable, advice: str = "load it with problem=..., or its branch, or solve it again"
) -> HarmonicBalance:
    """Return the problem of a record; a record from a file has none, which is a ValueError with the advice."""
    if record.problem is None:
        kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(record).__name__).lower()
        raise ValueError(f"a {kind} from a file has no problem, and so no equations: {advice}")
    return record.problem


def check_problem(problem: HarmonicBalance | None) -> None:
    """Raise a TypeError unless what is given to `load` with a record is a problem, or None."""
    instance_of("problem", problem, HarmonicBalance | None, EXPECTED)


def check_belongs(problem: HarmonicBalance, solution: Solution, *, what: str, where: str = "") -> HarmonicBalance:
    """Return the problem with as many samples of the force as a solution of it needs; see what is raised for others.

    Parameters
    ----------
    problem : HarmonicBalance
    solution : Solution
        One that converged; without outputs, these are not compared.
    what, where : str
        Words for the record that the solution is of, and for its place there: "branch", "the last point of ".

    Raises
    ------
    TypeError
        For a problem of another kind.
    ValueError
        If parameters, outputs, degrees of freedom, harmonics or periods are others, or if the solution's residual in
        the problem is too large.
    """
    instance_of("problem", problem, HarmonicBalance, EXPECTED)
    shape, periods = solution.coefficients.shape, solution.periods
    if shape != problem.shape or periods != problem.periods:
        raise ValueError(
            f"the {what} has coefficients of shape {shape} and {periods} period(s), the problem {problem.shape} and "
            f"{problem.periods}: give a problem of the same system and harmonics"
        )
    system = problem.system
    for name, its, wanted in (
        ("parameters", tuple(solution.parameters), system.parameters.names),
        ("outputs", tuple(solution.output_names), system.output_names),
    ):
        if its and sorted(its) != sorted(wanted):
            raise ValueError(f"the {what} has {name} {its}, the system {wanted}: give a problem of the same system")
    x, values = solution.coefficients.ravel(), problem.values(solution.parameters)
    problem = problem.with_enough_samples(x, values)
    balance, terms = problem.assembly.residual(x, values), problem.assembly.term_size(x, values)
    residual = float(np.abs(balance).max(initial=0.0)) / max(terms, TINY)
    if not residual <= LARGEST_RESIDUAL:
        raise ValueError(
            f"{where}the {what} has the residual {residual:.1e} in this system, more than {LARGEST_RESIDUAL:.0e}: give "
            "the system that it is of"
        )
    return problem


def with_problem(solution: Solution, problem: HarmonicBalance, *, what: str = "solution") -> Solution:
    """Return a solution with its problem, which has as many samples as it needs; see `check_belongs`."""
    own, origin = problem.carrying(solution.n_harmonics), solution.origin
    if solution.converged:
        own = check_belongs(own, solution, what=what)
    there = own.carrying(origin.n_harmonics) if origin is not None else own
    if origin is not None and origin.coefficients.shape == there.shape and origin.periods == there.periods:
        origin = replace(origin, problem=there)
    return replace(solution, problem=own, origin=origin)
