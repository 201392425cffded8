"""Extrema of an output's amplitude along a branch, as nonlinear programs: max |Y_h|^2 subject to R = 0."""

from __future__ import annotations

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.curve import TINY
from hbnlp.continuation.point import start_point
from hbnlp.core.checks import instance_of, two_values, whole_number
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kinds import Kind, Status
from hbnlp.core.types import Array
from hbnlp.solutions.accuracy import Accuracy, Judgement
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.equations import along_parameter
from hbnlp.solutions.ipopt import Ipopt, minimise
from hbnlp.solutions.solution import Solution, make_solution


@interrupts_kept()
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

    With a tolerance it has as many harmonics as a point of the branch would have there.

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
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
    instance_of("near", near, Solution, "a Solution, best the largest point of a traced branch")
    instance_of("method", method, Ipopt | None, "Ipopt(...)")
    whole_number("index", index, least=0)
    if bracket is not None:
        two_values("bracket", bracket, f"values of {name}")
    values, problem = problem.values(near.parameters), problem.carrying(near.n_harmonics)
    bounds = None if bracket is None else [(min(bracket), max(bracket))]
    accuracy = Accuracy(problem) if problem.truncation is not None else None
    guess, error = problem.vector(near.coefficients), None
    while True:
        squared = problem.amplitude_squared(output, harmonic)
        size = max(float(np.abs(near.harmonics(output)[harmonic])), TINY)
        found = minimise(
            problem, -squared / size**2, guess, values, free=[name], method=method or Ipopt(), bounds=bounds
        )
        if accuracy is None or not found.success:
            break
        error, wanted, better = _judged(accuracy, problem, name, found.x, found.values)
        if wanted == problem.n_harmonics:
            break
        problem, values = problem.with_harmonics(wanted), found.values
        guess = problem.vector(better)
    value = float(found.values[problem.system.parameters.index(name)])
    status = Status.CONVERGED if found.success else Status.NOT_CONVERGED
    statistics: dict[str, float | str] = {"method": "Ipopt", "iterations": found.iterations}
    solution = make_solution(problem, found.x, found.values, status=status, statistics=statistics)
    if not found.success:
        raise ConvergenceError(
            f"no peak of {output!r} found near {name} = {near.parameters[name]:g} ({found.status}): "
            "start from the largest point of a traced branch",
            solution,
        )
    return SpecialPoint(
        kind=Kind.PEAK,
        name=name,
        value=value,
        bracket=bracket or (value, value),
        index=index,
        refined=True,
        solution=solution,
        truncation_error=error,
        converged=None if accuracy is None or error is None else error <= accuracy.policy.tolerance,
    )


def _judged(accuracy: Accuracy, problem: HarmonicBalance, name: str, x: Array, values: Array) -> Judgement:
    """Return the error of a peak normal to the branch, as that of its points, and the harmonics it should have."""
    curve = along_parameter(problem, values, name)
    y = curve.unknowns.joined(x, [values[problem.system.parameters.index(name)]])
    return accuracy.judge(curve, y, start_point(curve, y, curve.unknowns.fixing_last()).tangent / curve.scale(y) ** 2)


@interrupts_kept()
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
    instance_of("branch", branch, Branch, "a Branch, as hbnlp.trace returns it")
    instance_of(
        "problem", problem, HarmonicBalance | None, "the HarmonicBalance(system, n_harmonics=...) of the branch"
    )
    problem = problem or attached(branch, "pass the problem that it was traced with, problem=...")
    whole_number("harmonic", harmonic, least=1, most=int(branch.n_harmonics.max()), advice=", which are retained")
    amplitude = np.abs(branch.harmonics(output)[:, harmonic])
    amplitude[branch.n_harmonics < harmonic] = np.nan  # negligible there, and no maximum lies beside
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
