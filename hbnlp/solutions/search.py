"""All solutions at one parameter point: random starts, deflation, and curves that join them as the load varies."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import start_point
from hbnlp.continuation.walk import Walk
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import instance_of, interval, list_of, list_of_callables, real_number, whole_number
from hbnlp.core.errors import ConvergenceError, NonFiniteError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.tasks import Ending, Report, drive
from hbnlp.core.types import Array
from hbnlp.solutions.accuracy import problem_and_guess
from hbnlp.solutions.attempt import attempt, iterate
from hbnlp.solutions.cold_start import linear_guess, linear_size
from hbnlp.solutions.deflation import deflated_newton
from hbnlp.solutions.equations import along_load
from hbnlp.solutions.identity import meets, moved, without_turns
from hbnlp.solutions.solution import Solution, attached, guess_for
from hbnlp.solutions.solving import solve
from hbnlp.systems.symmetry import Symmetry

REST = 1e-6
"""Solutions are told apart relative to their size, or to this part of the largest: Newton's method ends near rest."""
MODEST = 5
"""Harmonics of the forcing's frequency with which solutions are looked for where a tolerance says how many they get."""
WITHIN = 10.0
"""Solutions nearer to each other than this multiple of the tolerance are compared with the same number of harmonics."""


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
        Deflated Newton runs from the neighbourhood of each solution found, in each of its forcing periods.
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
        whole_number("n_starts", self.n_starts, least=0)
        interval("amplitudes", self.amplitudes, above=0.0)
        whole_number("n_deflated", self.n_deflated, least=0)
        real_number("largest_load", self.largest_load, least=0.0, advice=": zero for off, or more than 1")
        real_number("separation", self.separation, above=0.0, below=1.0)
        whole_number("max_iterations", self.max_iterations, least=1)
        instance_of("newton", self.newton, Newton, "Newton(...)")


@interrupts_kept(returns=True)
@renamed_arguments()
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
    varied by continuation, and every further crossing of its value is a solution, too. What is found brings its images
    under the symmetries of the system. A search can miss solutions; more starts miss fewer.

    Solutions are told apart as motions, by `same_motion`: shifts by whole forcing periods and turns of angles by 2 pi
    count once, the means of angles lying in (-pi, pi].

    With a tolerance the search is made with five harmonics of the forcing's frequency, and each solution that it comes
    to then has as many as it needs.

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
    list_of("known", known, Solution, "a list of solutions, [solution]")
    options, rng = method or Search(), rng or np.random.default_rng(0)
    values = problem.values(at)
    motions = _Motions(problem, values, options)

    def result(_ending: Ending) -> list[Solution]:
        return sorted(motions.found, key=lambda s: float(np.linalg.norm(s.coefficients)))

    work = _attempts(problem, values, at, motions, known, options, rng)
    solutions = drive("searching", work, result, name="start", callbacks=callbacks)
    if not solutions:
        linear_guess(problem, values)  # where the force is singular at rest, that is said
    return solutions


def _attempts(
    problem: HarmonicBalance,
    values: Array,
    at: Mapping[str, float] | None,
    motions: _Motions,
    known: Sequence[Solution],
    options: Search,
    rng: np.random.Generator,
) -> Iterator[Report]:
    """Add to what is found: around the known solutions and a cold start, then from one random start after another."""
    for solution in known:
        motions.polish(solution, "known")
    with contextlib.suppress(ConvergenceError, NonFiniteError):
        motions.add(solve(problem, at=at))
    reference, searched = motions.largest, motions.searched
    visited = 0
    for start in range(options.n_starts + 1):
        if start > 0:
            _run(_random(searched, reference, options, rng), motions, options, "random start")
        while visited < len(motions.found):
            vector = motions.roots[visited]
            if not motions.is_image[visited]:
                for crossing in _crossings_of_load(searched, values, vector, options):
                    motions.polish(crossing, "varied load")
            visited += 1
            for _ in range(options.n_deflated * searched.periods):
                nudge = np.exp(rng.uniform(-7.0, -1.0)) * np.linalg.norm(vector) * rng.standard_normal(vector.size)
                near = vector + nudge / np.sqrt(vector.size)
                _run(near, motions, options, "deflation")
        yield Report(start, start / max(options.n_starts, 1), {"solutions": len(motions.found)})


class _Motions:
    """The motions found so far, each followed by its images, which need not be searched for.

    Attributes
    ----------
    searched : HarmonicBalance
        The balance with which motions are looked for.
    values : array (n_parameters,)
    found : list of Solution
    is_image : list of bool
        Whether each of them was made instead of found: whatever is traced from it is an image, too.
    roots : list of array (size,)
        Each of them as the balance that is searched with has it.
    """

    def __init__(self, problem: HarmonicBalance, values: Array, options: Search) -> None:
        self.found: list[Solution] = []
        self.is_image: list[bool] = []
        self.roots: list[Array] = []
        self._spurious: list[Array] = []
        self._problem, self.values, self._options = problem, values, options
        policy = problem.truncation
        self.searched = problem if policy is None else problem.with_harmonics(policy.above(MODEST * policy.periods))
        self._identity = Symmetry.identity(problem.system.n_dof)
        self._symmetries = problem.system.symmetries_at(values)
        self._least = linear_size(problem, values)

    @property
    def largest(self) -> float:
        """Size of the largest solution, or of the linear response; 1 where all is at rest."""
        return max([self._least, *(float(np.linalg.norm(s.coefficients)) for s in self.found)]) or 1.0

    def polish(self, near: Solution | Array, start: str) -> None:
        """Add what Newton's method makes of a solution, or of unknowns of the balance that is searched with.

        ``start`` says where they are from.
        """
        given = near if isinstance(near, Solution) else near.reshape(self.searched.shape)
        problem, guess = problem_and_guess(self._problem, given)
        self.add(attempt(problem, self.values, guess, self._options.newton, start=start))

    def polish_root(self, root: Array, start: str) -> None:
        """Add what Newton's method makes of a root of the balance that is searched with: from now on it is known."""
        n_found = len(self.found)
        self.polish(root, start)
        if len(self.found) == n_found and self._problem.truncation is not None:
            self._spurious.append(root)  # with more harmonics it is no motion, or one that is known

    def add(self, solution: Solution) -> None:
        """Add a motion and its images, unless it did not converge or is known."""
        if not solution.converged or self._is_known(solution):
            return
        self._keep(solution, is_image=False)
        for image in (solution.image(symmetry) for symmetry in self._symmetries):
            if not self._is_known(image):
                self._keep(image, is_image=True)

    def _keep(self, solution: Solution, *, is_image: bool) -> None:
        angles = self._problem.system.angles
        if angles:
            solution = solution.with_coefficients(without_turns(solution.coefficients, angles))
        self.found.append(solution)
        self.is_image.append(is_image)
        self.roots.append(self._with_harmonics(self.searched, solution))

    def poles(self) -> list[Array]:
        """Return the vectors from which deflation leads away: all motions, as they look from any forcing period."""
        poles = []
        for root in (*self.roots, *self._spurious):
            seen: list[Array] = []
            for k in range(self._problem.periods):
                x = moved(root.reshape(self.searched.shape), self._identity, self._problem.periods, later=k).ravel()
                # a motion of fewer periods is there once: two poles in one place would push twice as far
                if all(np.linalg.norm(x - other) > self._options.separation * np.linalg.norm(x) for other in seen):
                    seen.append(x)
            poles += seen
        return poles

    def _is_known(self, solution: Solution) -> bool:
        return any(self._are_one(solution, other) for other in self.found)

    def _are_one(self, one: Solution, other: Solution) -> bool:
        """Return whether two solutions are one motion; they are compared with the same number of harmonics."""
        floor, tol, policy = REST * self.largest, self._options.separation, self._problem.truncation
        if meets(one, other, self._identity, tol, floor=floor):
            return True
        if policy is None or not meets(one, other, self._identity, max(tol, WITHIN * policy.tolerance), floor=floor):
            return False
        fewer, more = sorted((one, other), key=lambda solution: solution.n_harmonics)
        if fewer.n_harmonics == more.n_harmonics:
            return False
        x = self._with_harmonics(attached(more), fewer)
        return meets(
            more, replace(more, coefficients=x.reshape(more.coefficients.shape)), self._identity, tol, floor=floor
        )

    def _with_harmonics(self, problem: HarmonicBalance, solution: Solution) -> Array:
        """Return the unknowns of a solution with the harmonics of a balance, its own cut where there is none."""
        guess = guess_for(problem, solution)
        if problem.n_harmonics == solution.n_harmonics:
            return guess
        found = iterate(problem, guess, self.values, self._options.newton)
        return found.y if found.converged else guess


def _run(start: Array, motions: _Motions, options: Search, how: str) -> None:
    searched = motions.searched
    root = deflated_newton(searched, motions.values, start, motions.poles(), options.max_iterations)
    if root is not None:
        motions.polish_root(root, how)


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


def _random(problem: HarmonicBalance, reference: float, options: Search, rng: np.random.Generator) -> Array:
    low, high = np.log(options.amplitudes)
    amplitude = reference * np.exp(rng.uniform(low, high)) / np.sqrt(2.0 * problem.shape[0])
    harmonic = np.maximum((np.arange(problem.shape[1]) + 1) // 2, 1)
    start = amplitude / harmonic**2 * rng.standard_normal(problem.shape)
    angles = list(problem.system.angles)
    start[angles, 0] = rng.uniform(-np.pi, np.pi, len(angles))
    return np.asarray(start.ravel())
