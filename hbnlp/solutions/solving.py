"""All unknowns at one parameter point, from a guess or from nothing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Newton
from hbnlp.core.checks import flag, instance_of, refused
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kinds import Status
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.types import Array
from hbnlp.fourier import to_complex
from hbnlp.solutions.accuracy import problem_and_guess
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.attempt import Method, attempt
from hbnlp.solutions.cold_start import cold_start
from hbnlp.solutions.solution import Solution
from hbnlp.systems.signals import excitation_signals

MANY = 20
"""Harmonics of the forcing with which a cold start begins at most, where fewer lead nowhere."""
LARGEST_LOAD = 1e100
"""Of larger ones the squares, which norms sum, are no numbers any more."""
SMALLEST_LOAD = 1e-140
"""Of smaller ones, other than none, they are nothing."""
NOTHING = 1e-12
"""Part of the largest harmonic of an excitation that is round-off."""


@renamed_arguments(guess="start")
@interrupts_kept()
def solve(
    problem: HarmonicBalance,
    *,
    at: Mapping[str, float] | None = None,
    start: Solution | ArrayLike | None = None,
    method: Method | None = None,
    throw: bool = True,
) -> Solution:
    """Return a periodic solution at one parameter point.

    Without a start it begins with the linear response and, where the method fails there, from the solution with one
    harmonic, then along the solutions that lead from a damped linear system to this one (a continuation, which arrives
    wherever motions are bounded by damping, at a cost of about a hundred points), and last by IPOPT.

    Parameters
    ----------
    problem : HarmonicBalance
    at : mapping, optional
        Parameter values; the system's own for the rest.
    start : Solution or array (n_dof, any odd number), optional
        Where the method begins.
    method : Newton, Ipopt or Rootfinder, optional
        Newton by default.
    throw : bool
        Raise a ConvergenceError, with the unconverged solution as ``result``, rather than returning that.

    Raises
    ------
    ConvergenceError
        If nothing converged and ``throw`` is true.
    KeyError, ValueError
        For a parameter that is not known, or has no value.
    TypeError
        For a problem or a method of another kind.
    NonFiniteError
        If there is no start, and the force or its derivative is not finite at rest.
    """
    solution = solved(problem, at=at, start=start, method=method, throw=throw)
    if solution.converged:
        problem.system.warn_of(solution)
    return solution


def solved(
    problem: HarmonicBalance,
    *,
    at: Mapping[str, float] | None = None,
    start: Solution | ArrayLike | None = None,
    method: Method | None = None,
    throw: bool = True,
) -> Solution:
    """Return a solution as `solve` does, for a run that warns of its motions once, at its end."""
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
    values = problem.values(at)
    problem.system.state_matrices(values)  # a singular mass matrix is said here
    load = float(np.max(np.abs(problem.assembly.load_derivative(values)), initial=0.0))
    if load > LARGEST_LOAD or 0.0 < load < SMALLEST_LOAD:
        accepted = f"none, or one from {SMALLEST_LOAD:g} to {LARGEST_LOAD:g}, in other units"
        raise refused(ValueError, "the load of forcing or motion", load, accepted)
    _check_excitation(problem, values)
    method = Newton() if method is None else method
    instance_of("method", method, Method, "Newton(), Ipopt() or Rootfinder()")
    flag("throw", throw)
    if start is not None:
        problem, first = problem_and_guess(problem, start)
        if not np.all(np.isfinite(first)):
            raise ValueError("the start has entries that are not finite; give finite coefficients")
        solution = attempt(problem, values, first, method, start="given")
    else:
        solution = cold_start(problem, values, method)
        policy = problem.truncation
        while (
            not solution.converged and policy is not None and problem.n_harmonics < policy.above(MANY * policy.periods)
        ):
            # a motion need not show with few harmonics
            problem = problem.with_harmonics(policy.above(2 * problem.n_harmonics))
            solution = cold_start(problem, values, method)
    if solution.converged or not throw:
        return solution
    reason, ended = solution.statistics["reason"], attached(solution)
    corner = ended.corner(solution.coefficients, values)
    if corner is not None and str(corner) not in str(reason):
        reason = f"{reason}; perhaps because {corner}"
    point = ", ".join(f"{k}={v:g}" for k, v in solution.parameters.items())
    raise ConvergenceError(f"no solution at {point}: {reason}. {Status.NOT_CONVERGED.value}", solution)


def _check_excitation(problem: HarmonicBalance, values: Array) -> None:
    """Raise a ValueError if forcing and motion vary, but in no harmonic that the problem has: nothing would move."""
    sizes = [np.zeros(2)]
    for signals in excitation_signals(problem.system):
        if signals.highest is None:
            return
        if signals.highest:
            amplitudes = np.abs(to_complex(signals.coefficients(values, signals.highest)))
            sizes.append(amplitudes.max(axis=0, initial=0.0))
    largest = np.zeros(max(size.size for size in sizes))
    for size in sizes:
        largest[: size.size] = np.maximum(largest[: size.size], size)
    kept = problem.sampling.n_harmonics_of_excitation
    within, beyond = largest[1 : kept + 1].max(initial=0.0), largest[kept + 1 :].max(initial=0.0)
    if within <= NOTHING * beyond and beyond > 0.0:
        lowest = kept + 1 + int(np.argmax(largest[kept + 1 :] > NOTHING * beyond))
        needed = lowest * problem.periods
        raise refused(
            ValueError,
            "n_harmonics",
            problem.n_harmonics,
            f"{needed} or more: forcing and motion begin with harmonic {lowest} of omega, and nothing would be kept",
        )
