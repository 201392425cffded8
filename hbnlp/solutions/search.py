"""All solutions at one parameter point: random starts, deflation, and curves that join them as the load varies."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import start_point
from hbnlp.continuation.walk import Walk
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import counted, instance_of, interval, list_of, list_of_callables, real_number, whole_number
from hbnlp.core.errors import ConvergenceError, NonFiniteError
from hbnlp.core.generators import at_state, state_of
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.tasks import COMPLETE, INTERRUPTED, STOPPED, UNDER_WAY, Ending, Report, drive
from hbnlp.core.types import Array
from hbnlp.solutions.ahead import Ahead
from hbnlp.solutions.cold_start import linear_guess
from hbnlp.solutions.deflation import deflated_newton
from hbnlp.solutions.equations import along_load
from hbnlp.solutions.motions import Motions
from hbnlp.solutions.solution import Solution
from hbnlp.solutions.solution_set import SearchState, SolutionSet, set_with_problem
from hbnlp.solutions.solving import solved


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
    executor: Executor | None = None,
    callbacks: Callbacks = (),
) -> SolutionSet:
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
        Parameter values; by default those of a set that is ``known``.
    method : Search, optional
    rng : numpy Generator, optional
        By default seeded with 0: the same call finds the same solutions.
    known : sequence of Solution, or SolutionSet
        Solutions at this point that are known already; they are among the result. A set that a search of this problem
        at this point returned, in memory or from a file, is gone on with: none of its starts is made again, ``rng`` is
        brought to where it was then, and what is found is what one search would have found.
    executor : concurrent.futures.Executor, optional
        Runs the random starts that follow, before it is their turn. What is found is the same: as most starts find
        nothing, little of this is in vain.
    callbacks : sequence of callables
        Called after each start with a `Progress`; one that raises `StopTracing` ends the search, as Ctrl-C does, with
        the solutions found so far.

    Returns
    -------
    SolutionSet
        A sequence of Solution; ``message`` says how many starts were made, and what ended it before.

    Raises
    ------
    KeyError, ValueError
        For a parameter that is not known, or has no value; a set of another system; a generator of another kind than
        that of the set.
    TypeError
        For a problem, method, generator, executor or callbacks of another kind.
    NonFiniteError
        If the force or its derivative is not finite at rest, and nothing is found.
    TaskError
        If a callback fails; its ``result`` is the set so far.

    References
    ----------
    Farrell, Birkisson, Funke (2015), SIAM J. Sci. Comput. 37, A2026-A2045, doi:10.1137/140984798 (deflation).
    """
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
    instance_of("method", method, Search | None, "hbnlp.Search(...)")
    instance_of("rng", rng, np.random.Generator | None, "a Generator, numpy.random.default_rng(seed)")
    instance_of("executor", executor, Executor | None, "a concurrent.futures.Executor")
    list_of_callables("callbacks", callbacks)
    list_of("known", known, Solution, "a list of solutions, [solution]")
    if at is None and isinstance(known, SolutionSet):
        at = known.parameters
    values = problem.values(at)
    work = _Run(problem, values, method or Search(), rng, known, executor)
    warn_of = problem.system.warn_of
    found = drive("searching", work.steps(), work.result, name="start", callbacks=callbacks, warn_of=warn_of)
    if not found:
        linear_guess(problem, values)  # where the force is singular at rest, that is said
    return found


class _Run:
    """A search under way: around the known solutions and a cold start, then from one random start after another.

    Where it is after a start is kept, so that a search which ends within the next one begins that anew.
    """

    def __init__(
        self,
        problem: HarmonicBalance,
        values: Array,
        options: Search,
        rng: np.random.Generator | None,
        known: Sequence[Solution],
        executor: Executor | None,
    ) -> None:
        self._problem, self._values, self._options, self._known = problem, values, options, known
        self._ahead = None if executor is None else Ahead(executor)
        self._motions = Motions(problem, values, options.newton, options.separation)
        self._late: list[Solution] = []  # of a start that was not over: it is made again
        self._tried, self._searched, self._place, self._n_spurious = 0, 0, 0, 0
        self._scale: float | None = None
        if isinstance(known, SolutionSet) and _is_of(known, problem, values):
            self._go_on(set_with_problem(known, problem))
            self._rng = at_state(known.state.generator, rng)
        else:
            self._rng = rng or np.random.default_rng(0)
        self._generator = state_of(self._rng)

    def _go_on(self, before: SolutionSet) -> None:
        """Take what a search had when its last start was over."""
        state = before.state
        self._known, self._tried, self._scale = (), before.n_tried, state.scale
        self._searched = self._place = state.searched
        for i in state.order[: state.searched]:
            self._motions.take(before[i], is_image=state.images[i])
        self._motions.spurious = [np.array(root) for root in state.spurious]
        self._n_spurious = len(state.spurious)
        self._late = [before[i] for i in state.order[state.searched :]]

    def steps(self) -> Iterator[Report]:
        """Add to what is found, start by start."""
        scale = self._scale
        if scale is None:
            scale = self._first()
            yield self._done(0, scale)
        try:
            for start in range(self._tried + 1, self._options.n_starts + 1):
                self._run_at_random(scale, self._options.n_starts - start)
                yield self._done(start, scale)
        finally:
            if self._ahead is not None:
                self._ahead.drop()

    def _first(self) -> float:
        """Add the known solutions and a cold start, and return the size of the largest."""
        for solution in self._known:
            self._motions.polish(solution, "known")
        with contextlib.suppress(ConvergenceError, NonFiniteError):
            self._motions.add(solved(self._problem, at=self._problem.system.parameters.as_dict(self._values)))
        return self._motions.largest

    def _around(self) -> None:
        """Search around each solution that is new."""
        motions, options, rng = self._motions, self._options, self._rng
        while self._place < len(motions.found):
            vector = motions.roots[self._place]
            if not motions.is_image[self._place]:
                for crossing in _crossings_of_load(motions.searched, self._values, vector, options):
                    motions.polish(crossing, "varied load")
            self._place += 1
            for _ in range(options.n_deflated * motions.searched.periods):
                nudge = np.exp(rng.uniform(-7.0, -1.0)) * np.linalg.norm(vector) * rng.standard_normal(vector.size)
                self._run(vector + nudge / np.sqrt(vector.size), "deflation")

    def _run_at_random(self, scale: float, left: int) -> None:
        """Run from a random start, of which so many are left."""
        draw = partial(_random, self._motions.searched, scale, self._options)
        start = draw(self._rng)
        if self._ahead is None:
            self._run(start, "random start")
            return
        n_known = len(self._motions.roots) + len(self._motions.spurious)
        root = self._ahead.run(start, self._away(), draw, self._rng, n_known=n_known, left=left)
        if root is not None:
            self._motions.polish_root(root, "random start")

    def _run(self, start: Array, how: str) -> None:
        root = self._away()(start)
        if root is not None:
            self._motions.polish_root(root, how)

    def _away(self) -> Callable[[Array], Array | None]:
        """Return what leads from a start to a root that is not known."""
        motions = self._motions
        return partial(_found_from, motions.searched, self._values, motions.poles(), self._options.max_iterations)

    def _done(self, start: int, scale: float) -> Report:
        """Search around what is new, keep where the search is then, and say it."""
        self._around()
        for solution in self._late:
            self._motions.add(solution)
        self._late = []
        self._around()
        self._tried, self._searched, self._scale = start, len(self._motions.found), scale
        self._n_spurious, self._generator = len(self._motions.spurious), state_of(self._rng)
        return Report(start, start / max(self._options.n_starts, 1), {"solutions": self._searched})

    def result(self, ending: Ending) -> SolutionSet:
        """Return what there is."""
        problem, motions = self._problem, self._motions
        late = [solution for solution in self._late if not motions.has(solution)]
        found, images = motions.found + late, motions.is_image + [False] * len(late)
        by_size = sorted(range(len(found)), key=lambda i: float(np.linalg.norm(found[i].coefficients)))
        n_starts = max(self._options.n_starts, self._tried)
        return SolutionSet(
            solutions=tuple(found[i] for i in by_size),
            parameters=problem.system.parameters.as_dict(self._values),
            system_name=problem.system.name,
            output_names=problem.system.output_names,
            periods=problem.periods,
            n_starts=n_starts,
            n_tried=self._tried,
            complete=self._scale is not None and self._tried == n_starts,
            message=_message(ending, self._tried, n_starts),
            state=SearchState(
                order=tuple(np.argsort(by_size).tolist()),
                images=tuple(images[i] for i in by_size),
                searched=self._searched,
                scale=self._scale,
                generator=self._generator,
                spurious=tuple(tuple(root.tolist()) for root in motions.spurious[: self._n_spurious]),
            ),
            problem=problem,
        )


def _found_from(
    problem: HarmonicBalance, values: Array, known: list[Array], max_iterations: int, start: Array
) -> Array | None:
    return deflated_newton(problem, values, start, known, max_iterations)


def _message(ending: Ending, tried: int, n_starts: int) -> str:
    if ending is COMPLETE:
        return f"all {counted(n_starts, 'random start')} made" if n_starts else "no random starts were asked for"
    done = f"{tried} of {counted(n_starts, 'random start')}"
    left = tried < n_starts and ending in (INTERRUPTED, STOPPED)
    advice = "; go on with find_all(problem, known=found)" if left else ""
    return f"{ending} after {done}" if ending is UNDER_WAY else ending.after(done) + advice


def _is_of(found: SolutionSet, problem: HarmonicBalance, values: Array) -> bool:
    """Return whether a set is of a search with a problem's unknowns at a point: it can be gone on with."""
    return found.parameters == problem.system.parameters.as_dict(values) and all(
        each.coefficients.shape == problem.carrying(each.n_harmonics).shape and each.periods == problem.periods
        for each in found
    )


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
