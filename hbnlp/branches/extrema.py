"""Extrema of an output's amplitude along a branch, as nonlinear programs: max |Y_h|^2 subject to R = 0."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch, SpecialPoint
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.kinds import Kind, Status
from hbnlp.solutions.solution import Solution, make_solution
from hbnlp.solutions.solving import Ipopt


def locate_peak(
    problem: HarmonicBalance,
    output: str,
    name: str,
    near: Solution,
    *,
    harmonic: int = 1,
    method: Ipopt | None = None,
    bracket: tuple[float, float] | None = None,
    index: int = 0,
) -> SpecialPoint:
    """Return the point near a solution where the amplitude of an output is largest along the branch.

    Parameters
    ----------
    problem : HarmonicBalance
    output, harmonic
        Whose amplitude: one harmonic of a named output.
    name : str
        The parameter that is free.
    near : Solution
        A guess, best the largest point of a traced branch.
    method : Ipopt, optional
    bracket, index : optional
        Recorded in the result; ``bracket`` also bounds the free parameter.

    Raises
    ------
    ConvergenceError
        If IPOPT finds no maximum there.
    """
    values = problem.values(near.parameters)
    position = problem.system.parameters.index(name)
    x0 = problem.vector(near.coefficients)
    free = ca.MX.sym("free")
    symbols = ca.vertcat(*(free if i == position else problem.p[i] for i in range(values.size)))
    squared = problem.amplitude_squared(output, harmonic)
    size = max(float(np.abs(near.harmonics(output)[harmonic])), np.finfo(float).tiny)
    terms = max(problem.assembly.term_size(x0, values), np.finfo(float).tiny)
    amplitude = ca.substitute(squared, problem.p, symbols)
    program = {
        "x": ca.vertcat(problem.x, free),
        "p": problem.p,
        "f": -amplitude / size**2,
        "g": ca.substitute(problem.g, problem.p, symbols) / terms,
    }
    low, high = (-np.inf, np.inf) if bracket is None else sorted(bracket)
    bounds = np.full(problem.size, np.inf)
    solver = ca.nlpsol("peak", "ipopt", program, (method or Ipopt()).options())
    answer = solver(
        x0=np.append(x0, values[position]),
        p=values,
        lbx=np.append(-bounds, low),
        ubx=np.append(bounds, high),
        lbg=0.0,
        ubg=0.0,
    )
    y = answer["x"].full().ravel()
    statistics = solver.stats()
    values[position] = y[-1]
    record: dict[str, float | str] = {"method": "Ipopt", "iterations": int(statistics["iter_count"])}
    if not statistics["success"]:
        failed = make_solution(problem, y[:-1], values, status=Status.NOT_CONVERGED, statistics=record)
        raise ConvergenceError(
            f"no peak of {output!r} found near {name} = {near.parameters[name]:g} ({statistics['return_status']}): "
            "start from the largest point of a traced branch",
            failed,
        )
    return SpecialPoint(
        kind=Kind.PEAK,
        value=float(y[-1]),
        bracket=bracket or (float(y[-1]), float(y[-1])),
        index=index,
        refined=True,
        solution=make_solution(problem, y[:-1], values, statistics=record),
    )


def peaks(
    branch: Branch, output: str, *, harmonic: int = 1, problem: HarmonicBalance | None = None
) -> list[SpecialPoint]:
    """Return all interior maxima of an output's amplitude along a branch, in branch order, each solved for.

    A branch that closes on itself has no ends: a maximum where it began is one of them.

    Parameters
    ----------
    branch : Branch
    output : str
        Its name.
    harmonic : int
        Whose amplitude, from 1 to the branch's ``n_harmonics``.
    problem : HarmonicBalance, optional
        Needed for a branch that was loaded from a file.

    Returns
    -------
    list of SpecialPoint
        Of the kind `Kind.PEAK`.

    Raises
    ------
    ValueError
        If the harmonic is not retained, or a loaded branch comes without its problem.
    KeyError
        If there is no such output.
    ConvergenceError
        If IPOPT does not find one of the maxima.
    """
    problem = problem or branch.problem
    if problem is None:
        raise ValueError("this branch was loaded from a file; pass the problem that it was traced with, problem=...")
    if not 1 <= harmonic <= branch.n_harmonics:
        raise ValueError(f"harmonic = {harmonic}; 1 to {branch.n_harmonics} are retained")
    amplitude = np.abs(branch.harmonics(output)[:, harmonic])
    if branch.closed:  # its last point is its first again: the one before stands ahead of the first
        amplitude = np.append(amplitude[-2], amplitude)
    tops = np.flatnonzero((amplitude[1:-1] >= amplitude[:-2]) & (amplitude[1:-1] > amplitude[2:])) + (not branch.closed)
    return [
        locate_peak(
            problem,
            output,
            branch.name,
            branch.solution(int(top)),
            harmonic=harmonic,
            index=int(top),
            bracket=_around(branch, int(top)),
        )
        for top in tops
    ]


def _around(branch: Branch, index: int) -> tuple[float, float]:
    """Return an interval of the parameter that holds the points before and after, and a fold between them."""
    values = branch.parameter[[index - 1 if index else -2, index, index + 1]]
    margin = float(np.ptp(values)) or 1e-6 * abs(float(values[1]))
    return float(values.min() - margin), float(values.max() + margin)
