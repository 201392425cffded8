"""A problem for what came from a file: checked to be the record's own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.curve import TINY
from hbnlp.core.checks import instance_of

if TYPE_CHECKING:
    from hbnlp.solutions.solution import Solution

LARGEST_RESIDUAL = 1e-6
"""A solution whose residual is a larger part of its terms is none of the problem."""


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
    instance_of("problem", problem, HarmonicBalance, "the HarmonicBalance(system, n_harmonics=...) of the record")
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
    while not problem.samples_suffice(x, values):
        problem = problem.oversampled()
    balance, terms = problem.assembly.residual(x, values), problem.assembly.term_size(x, values)
    residual = float(np.abs(balance).max(initial=0.0)) / max(terms, TINY)
    if not residual <= LARGEST_RESIDUAL:
        raise ValueError(
            f"{where}the {what} has the residual {residual:.1e} in this system, more than {LARGEST_RESIDUAL:.0e}: give "
            "the system that it is of"
        )
    return problem
