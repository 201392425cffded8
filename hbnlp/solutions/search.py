"""All solutions at one parameter point: random starts, deflation, and curves that join them as the load varies."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.continuation.curve import TINY
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import start_point
from hbnlp.continuation.walk import Walk
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import instance_of, list_of_callables
from hbnlp.core.errors import ConvergenceError, NonFiniteError
from hbnlp.core.tasks import Ending, Report, drive
from hbnlp.core.types import Array
from hbnlp.solutions.attempt import attempt
from hbnlp.solutions.cold_start import linear_guess, linear_size
from hbnlp.solutions.deflation import deflated_newton
from hbnlp.solutions.equations import along_load
from hbnlp.solutions.solution import Solution, guess_for
from hbnlp.solutions.solving import solve


@dataclass(frozen=True, kw_only=True)
class Search:
    """How many starts a search makes, and where from.

    Parameters
    ----------
    n_starts : int
        Random starts, after the neighbourhoods of what is known and of a cold start. Each harmonic h is drawn with a
        standard deviation of ``amplitude / h**2``.
    amplitudes : (float, float)
        Range of that amplitude, drawn log-uniformly, relative to the solution that a cold start finds.
    n_deflated : int
        Deflated Newton runs from the neighbourhood of each solution found.
    largest_load : float
        From each solution the load is varied, through folds, between 0 and this multiple of its value; where the curve
        comes back to the load itself is another solution. 0: off.
    separation : float
        Solutions nearer to each other than this, relative to their size, are one.
    max_iterations : int
        Damped Newton steps a start.
    newton : Newton
        Polish of what the search finds.
    """

    n_starts: int = 40
    amplitudes: tuple[float, float] = (0.1, 30.0)
    n_deflated: int = 2
    largest_load: float = 3.0
    separation: float = 1e-5
    max_iterations: int = 60
    newton: Newton = Newton()

    def __post_init__(self) -> None:
        if self.n_starts < 0 or self.n_deflated < 0:
            raise ValueError(f"n_starts = {self.n_starts!r}, n_deflated = {self.n_deflated!r}; neither can be negative")
        if not 0.0 < self.amplitudes[0] <= self.amplitudes[1]:
            raise ValueError(f"amplitudes = {self.amplitudes!r}; two positive numbers in rising order are needed")
        if not self.largest_load >= 0.0:
            raise ValueError(f"largest_load = {self.largest_load!r}; zero (off) or a number above 1 is needed")
        if not 0.0 < self.separation < 1.0:
            raise ValueError(f"separation = {self.separation!r}; a number between 0 and 1 is needed")
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations = {self.max_iterations!r}; at least 1 is needed")


def find_all(
    problem: HarmonicBalance,
    *,
    at: Mapping[str, float] | None = None,
    method: Search | None = None,
    rng: np.random.Generator | None = None,
    known: Sequence[Solution] = (),
    callbacks: Callbacks = (),
) -> list[Solution]:
    """Return the solutions at one parameter point that a search finds, smallest first.

    Newton's method, deflated by the solutions known so far, is run from random starts and from near each of them:
    deflation turns known solutions into poles, so that the same start leads elsewhere. From each solution the load is
    varied by continuation, and every further crossing of its value is a solution, too. A search can miss solutions;
    more starts miss fewer.

    Parameters
    ----------
    problem : HarmonicBalance
    at : mapping, optional
        Parameter values.
    method : Search, optional
    rng : numpy Generator, optional
        By default seeded with 0: the same call finds the same solutions.
    known : sequence of Solution
        Solutions at this point that are known already; they are among the result.
    callbacks : sequence of callables
        Called after each start with a `Progress`; one that raises `StopTracing` ends the search, as Ctrl-C does, with
        the solutions found so far.

    Returns
    -------
    list of Solution

    Raises
    ------
    KeyError, ValueError
        For a parameter that is not known, or has no value.
    TypeError
        For a problem, method, generator or callbacks of another kind.
    NonFiniteError
        If the force or its derivative is not finite at rest, and nothing is found.

    References
    ----------
    Farrell, Birkisson, Funke (2015), SIAM J. Sci. Comput. 37, A2026-A2045, doi:10.1137/140984798 (deflation).
    """
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
    instance_of("method", method, Search | None, "hbnlp.Search(...)")
    instance_of("rng", rng, np.random.Generator | None, "a Generator, numpy.random.default_rng(seed)")
    list_of_callables("callbacks", callbacks)
    options, rng = method or Search(), rng or np.random.default_rng(0)
    values = problem.values(at)
    found: list[Solution] = []

    def result(_ending: Ending) -> list[Solution]:
        return sorted(found, key=lambda s: float(np.linalg.norm(s.coefficients)))

    work = _attempts(problem, values, at, found, known, options, rng)
    solutions = drive("searching", work, result, name="start", callbacks=callbacks)
    if not solutions:
        linear_guess(problem, values)  # where the force is singular at rest, that is said
    return solutions


def _attempts(
    problem: HarmonicBalance,
    values: Array,
    at: Mapping[str, float] | None,
    found: list[Solution],
    known: Sequence[Solution],
    options: Search,
    rng: np.random.Generator,
) -> Iterator[Report]:
    """Add to what is found: around the known solutions and a cold start, then from one random start after another."""
    for solution in known:
        _add(found, attempt(problem, values, guess_for(problem, solution), options.newton, start="known"), options)
    with contextlib.suppress(ConvergenceError, NonFiniteError):
        _add(found, solve(problem, at=at), options)
    largest = max((float(np.linalg.norm(s.coefficients)) for s in found), default=0.0)
    reference = max(largest, linear_size(problem, values)) or 1.0
    visited = 0
    for start in range(options.n_starts + 1):
        if start > 0:
            _run(problem, values, _random(problem, reference, options, rng), found, options, "random start")
        while visited < len(found):
            vector = problem.vector(found[visited].coefficients)
            visited += 1
            for crossing in _crossings_of_load(problem, values, vector, options):
                _add(found, attempt(problem, values, crossing, options.newton, start="varied load"), options)
            for _ in range(options.n_deflated):
                nudge = np.exp(rng.uniform(-7.0, -1.0)) * np.linalg.norm(vector) * rng.standard_normal(vector.size)
                near = vector + nudge / np.sqrt(vector.size)
                _run(problem, values, near, found, options, "deflation")
        yield Report(start, start / max(options.n_starts, 1), {"solutions": len(found)})


def _run(
    problem: HarmonicBalance, values: Array, start: Array, found: list[Solution], options: Search, how: str
) -> None:
    guess = deflated_newton(problem, values, start, [s.coefficients.ravel() for s in found], options.max_iterations)
    if guess is not None:
        _add(found, attempt(problem, values, guess, options.newton, start=how), options)


def _crossings_of_load(problem: HarmonicBalance, values: Array, x: Array, options: Search) -> list[Array]:
    """Return guesses where the curve of solutions against load, both ways from x, meets load 1 again."""
    if options.largest_load <= 1.0:
        return []
    curve = along_load(problem, values, floor=1e-6 * float(np.linalg.norm(x)) or 1.0)
    crossings = []
    for sign in (1.0, -1.0):
        with contextlib.suppress(np.linalg.LinAlgError):
            start = start_point(curve, curve.unknowns.joined(x, [1.0]), sign * curve.unknowns.fixing_last())
            walk = Walk(curve, start, PseudoArclength(max_points=400), limits=(0.0, options.largest_load))
            for before, after in walk:
                if (before.value - 1.0) * (after.value - 1.0) < 0.0:
                    share = (1.0 - before.value) / (after.value - before.value)
                    crossings.append(curve.unknowns.coefficients(before.y + share * (after.y - before.y)))
    return crossings


def _add(found: list[Solution], solution: Solution, options: Search) -> None:
    if not solution.converged:
        return
    x = solution.coefficients
    for other in found:
        size = max(float(np.linalg.norm(x)), float(np.linalg.norm(other.coefficients)), TINY)
        if np.linalg.norm(x - other.coefficients) <= options.separation * size:
            return
    found.append(solution)


def _random(problem: HarmonicBalance, reference: float, options: Search, rng: np.random.Generator) -> Array:
    low, high = np.log(options.amplitudes)
    amplitude = reference * np.exp(rng.uniform(low, high)) / np.sqrt(2.0 * problem.shape[0])
    harmonic = np.maximum((np.arange(problem.shape[1]) + 1) // 2, 1)
    return np.asarray((amplitude / harmonic**2 * rng.standard_normal(problem.shape)).ravel())
