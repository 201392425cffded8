"""Periodic solutions and folds as parts of a program: their unknowns, their equations, and where they begin.

A fold stays one while the design varies, by ``R_x v = 0, v.v = 1`` in the further unknowns v and lambda (Moore and
Spence 1980, doi:10.1137/0717048).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

import casadi as ca
import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.core.checks import instance_of
from hbnlp.core.kept import by_one_thread
from hbnlp.core.kinds import Kind
from hbnlp.core.renamed import renamed_name
from hbnlp.core.sending import StaysHere
from hbnlp.core.types import Array
from hbnlp.design.variables import Variables
from hbnlp.solutions.sizes import sizes_at
from hbnlp.solutions.solution import Solution


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Response(StaysHere):
    """A periodic solution or a fold as part of a program, made by `response_at` or `fold_at`.

    Call it with an expression of ``problem.x`` and ``problem.p`` for that expression here, such as
    ``cruise(problem.amplitude_squared("C_L"))``.
    """

    _instead = "its symbols are those of its variables; send the problem and the solution or fold, and make it there"

    problem: HarmonicBalance
    x: ca.MX
    p: ca.MX
    unknowns: ca.MX = field(repr=False)
    equations: ca.MX = field(repr=False)
    start: Array = field(repr=False)
    size: float | Array = field(repr=False)

    @by_one_thread
    def __call__(self, expression: ca.MX) -> ca.MX:
        """Return an expression of the problem's symbols at this response."""
        return ca.Function("here", [self.problem.x, self.problem.p], [expression])(self.x, self.p)

    def symbol(self, name: str) -> ca.MX:
        """Return a parameter here: a number, a variable, or the free parameter of a fold."""
        return self.p[self.problem.system.parameters.index(name)]

    def __getattr__(self, name: str) -> Any:
        raise renamed_name("Response", name, {"parameter": "response.symbol(name)"})


@by_one_thread
def response_at(
    problem: HarmonicBalance, variables: Variables, start: Solution, *, at: Mapping[str, float] | None = None
) -> Response:
    """Return the response at the parameters of ``start``, but for ``at`` and the variables; it begins at ``start``.

    Parameters
    ----------
    problem : HarmonicBalance
    variables : Variables
        Those of the program.
    start : Solution
        Coefficients to begin from, and the values of the parameters that are no variables.
    at : mapping of names to values, optional
        Values that override those of ``start``.

    Returns
    -------
    Response

    Raises
    ------
    KeyError, ValueError
        For a name that is no parameter, or coefficients that do not fit the problem; for a problem with a tolerance, as
        a program has one number of harmonics.
    """
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
    instance_of("variables", variables, Variables, "the Variables(...) of the program")
    instance_of("start", start, Solution, "a Solution")
    _check_number(problem, start)
    problem.values(at, but=problem.system.parameters.names)
    values, x0 = problem.values({**start.parameters, **(at or {})}), problem.vector(start.coefficients)
    size, terms = sizes_at(problem, x0, values)
    xi, p = ca.MX.sym("x", problem.size), _parameters(problem, variables, values, {})
    x = size * xi
    equations = problem.residual(x, p) / terms
    return Response(problem=problem, x=x, p=p, unknowns=xi, equations=equations, start=x0 / size, size=size)


@by_one_thread
def fold_at(problem: HarmonicBalance, variables: Variables, fold: SpecialPoint, name: str) -> Response:
    """Return a fold in the parameter ``name``, which is free; it begins at ``fold``, one of ``branch.folds``.

    Parameters
    ----------
    problem : HarmonicBalance
    variables : Variables
        Those of the program.
    fold : SpecialPoint
        A refined fold in ``name``.
    name : str
        The parameter whose value at the fold is an unknown of the program: ``response.symbol(name)``.

    Returns
    -------
    Response

    Raises
    ------
    ValueError
        If ``fold`` is no refined fold, or ``name`` is a variable, too; for a problem with a tolerance.
    KeyError
        For a name that is no parameter.
    """
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
    instance_of("variables", variables, Variables, "the Variables(...) of the program")
    instance_of("fold", fold, SpecialPoint, "one fold, such as branch.folds[0]")
    _check_number(problem, fold.solution)
    problem.system.parameters.index(name)
    if fold.kind is not Kind.FOLD or fold.null is None:
        raise ValueError(f"{fold!r} was given; a refined fold, one of branch.folds, is needed")
    if name in variables.names:
        raise ValueError(f"{name!r} is the free parameter of the fold; it cannot be a variable, too")
    values, x0 = problem.values(fold.solution.parameters), problem.vector(fold.solution.coefficients)
    (size, terms), unit, null = sizes_at(problem, x0, values), abs(fold.value) or 1.0, problem.vector(fold.null)
    xi, v, free, along = (ca.MX.sym(s, n) for s, n in (("x", x0.size), ("v", x0.size), ("free", 1), ("along", x0.size)))
    x, p = size * xi, _parameters(problem, variables, values, {name: unit * free})
    tangent = ca.Function("tangent", [problem.x, problem.p, along], [ca.jtimes(problem.g, problem.x, along)])
    equations = [problem.residual(x, p) / terms, tangent(x, p, v) * (size / terms), 0.5 * (ca.sumsqr(v) - 1.0)]
    return Response(
        problem=problem,
        x=x,
        p=p,
        unknowns=ca.vertcat(xi, v, free),
        equations=ca.vertcat(*equations),
        start=np.concatenate([x0 / size, null / np.linalg.norm(null), [fold.value / unit]]),
        size=size,
    )


def begun_at(response: Response, solution: Solution) -> Array:
    """Return the unknowns with which a response, no fold, begins at a solution."""
    start: Array = response.problem.vector(solution.coefficients) / response.size
    if start.shape != response.start.shape:
        raise ValueError("a response is a fold, which does not begin at a solution alone; leave near out")
    return start


def _check_number(problem: HarmonicBalance, start: Solution) -> None:
    """Raise a ValueError for a problem with a tolerance: in a program nothing but variables and responses varies."""
    if problem.truncation is not None:
        periods = f", periods={problem.periods}" if problem.periods > 1 else ""
        raise ValueError(
            f"the problem has tolerance = {problem.truncation.tolerance:g}, but a program has one number of harmonics: "
            f"give HarmonicBalance(system, n_harmonics={start.n_harmonics}{periods}), as many as its start has, or more"
        )


def _parameters(problem: HarmonicBalance, variables: Variables, values: Array, free: Mapping[str, ca.MX]) -> ca.MX:
    entries = [ca.MX(float(value)) for value in values]
    for name, symbol in {**{name: variables[name] for name in variables.names}, **free}.items():
        entries[problem.system.parameters.index(name)] = symbol
    return ca.vertcat(*entries)
