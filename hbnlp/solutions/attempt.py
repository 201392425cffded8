"""What a method makes of a guess: Newton's method, CasADi's rootfinder or IPOPT, with enough samples of the force."""

from __future__ import annotations

import dataclasses

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.curve import relative_residual
from hbnlp.continuation.newton import LARGEST_RESIDUAL, Correction, Newton, correct
from hbnlp.core.errors import SamplingError
from hbnlp.core.kinds import Status
from hbnlp.core.types import Array
from hbnlp.solutions.accuracy import Accuracy
from hbnlp.solutions.equations import along_load
from hbnlp.solutions.ipopt import Ipopt, is_quick, minimise
from hbnlp.solutions.rootfinder import Rootfinder
from hbnlp.solutions.sizes import sizes_at
from hbnlp.solutions.solution import Solution, make_solution

ROUGH = "at the motion that is found"
"""So begins the reason of an attempt that converged, but to a motion on which no number of samples is enough."""

Method = Newton | Ipopt | Rootfinder


def attempt(
    problem: HarmonicBalance,
    values: Array,
    guess: Array,
    method: Method,
    *,
    start: str,
    accuracy: Accuracy | None = None,
) -> Solution:
    """Return what the method makes of a guess, with enough samples of the force; ``start`` says where it is from.

    Of a problem with a tolerance it has as many harmonics as that asks for, or the most that there may be; ``accuracy``
    is that of the record that it belongs to, where there is one. What leads on from one number of harmonics to a larger
    one is Newton's method where IPOPT would take long: it begins beside the solution.
    """
    if accuracy is None and problem.truncation is not None:
        accuracy = Accuracy(problem)
    problem, correction = _sampled(problem, values, guess, method)
    error: float | None = None
    while accuracy is not None and correction.converged:
        curve = along_load(problem, values)
        y = curve.unknowns.joined(correction.y, [1.0])
        error, wanted, better = accuracy.judge(curve, y, curve.unknowns.fixing_last())
        own = problem.n_harmonics
        if wanted == own:
            break
        problem = problem.with_harmonics(wanted)
        nearby = Newton() if isinstance(method, Ipopt) and not is_quick(problem) else method
        problem, correction = _sampled(problem, values, problem.vector(better), nearby)
        if not correction.converged:
            met = f"{own} harmonics lead to a motion with an error of {error:.1e}, {wanted} from there to none"
            correction = dataclasses.replace(correction, reason=f"{correction.reason}; {met}")
    statistics: dict[str, float | str] = {
        "start": start,
        "method": type(method).__name__,
        "iterations": correction.iterations,
        "residual": correction.residual,
    }
    if error is not None:
        statistics["truncation_error"] = error
    if not correction.converged:
        statistics["reason"] = correction.reason
    status = Status.CONVERGED if correction.converged else Status.NOT_CONVERGED
    return make_solution(problem, correction.y, values, status=status, statistics=statistics)


def _sampled(
    problem: HarmonicBalance, values: Array, guess: Array, method: Method
) -> tuple[HarmonicBalance, Correction]:
    """Return what the method makes of a guess, and the problem with the samples of the force that suffice there."""
    correction = iterate(problem, guess, values, method)
    try:
        while correction.converged and not problem.samples_suffice(correction.y, values):
            problem.check_doubling(correction.y, values)
            problem = problem.oversampled()
            correction = iterate(problem, correction.y, values, method)
    except SamplingError as error:
        correction = dataclasses.replace(correction, converged=False, reason=f"{ROUGH}, {error}")
    return problem, correction


def meets_a_corner(failed: Solution) -> bool:
    """Return whether a motion that an attempt ended at meets a corner of the force, of which no samples are enough."""
    problem = failed.problem
    if problem is None:
        return False
    return problem.corner(failed.coefficients.ravel(), problem.values(failed.parameters)) is not None


def iterate(problem: HarmonicBalance, guess: Array, values: Array, method: Method) -> Correction:
    """Return what the method makes of a guess; ``y`` holds the unknowns alone."""
    if isinstance(method, Newton):
        return _by_newton(problem, guess, values, method)
    if isinstance(method, Ipopt):
        found = minimise(problem, 0.0, guess, values, method=method)
        return _judged(found.x, found.residual, success=found.success, status=found.status, iterations=found.iterations)
    return _by_rootfinder(problem, guess, values, method)


def _by_newton(problem: HarmonicBalance, guess: Array, values: Array, method: Newton) -> Correction:
    curve = along_load(problem, values)
    start = curve.unknowns.joined(guess, [1.0])
    with np.errstate(all="ignore"):  # what is not finite ends the iteration
        found = correct(curve, start, curve.unknowns.fixing_last(), method)
    return dataclasses.replace(found, y=curve.unknowns.coefficients(found.y))


def _by_rootfinder(problem: HarmonicBalance, guess: Array, values: Array, method: Rootfinder) -> Correction:
    sizes, curve = sizes_at(problem, guess, values), along_load(problem, values)
    solver = method.solver(problem, sizes)
    x = sizes.length * solver(guess / sizes.length, values).full().ravel()
    statistics = solver.stats()
    with np.errstate(all="ignore"):
        residual = relative_residual(curve, curve.unknowns.joined(x, [1.0]))
    return _judged(
        x,
        residual,
        success=bool(statistics["success"]),
        status=str(statistics.get("return_status", "")),
        iterations=int(statistics.get("iter_count", 0)),
    )


def _judged(x: Array, residual: float, *, success: bool, status: str, iterations: int) -> Correction:
    """Return the verdict on what a foreign solver found, by its own word and by the residual."""
    converged = success and residual < LARGEST_RESIDUAL
    size = f"the residual is {residual:.1e} of its terms" if np.isfinite(residual) else "the residual is not finite"
    ended = "" if success else f"{status or 'ended without a word'}, "
    return Correction(
        y=x,
        converged=converged,
        iterations=iterations,
        factorisations=iterations,
        error=np.nan,
        residual=residual,
        reason="" if converged else ended + size,
    )
