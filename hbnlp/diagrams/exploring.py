"""Follow everything that is connected: from branch to branch through the points where they cross.

Branches are taken up in one order, level by level: those that cross the first, those that cross these, and so on. What
one of them is depends on the branch that it was switched from alone, so that it makes no difference which process
traces it, or when.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.switching import switch_branch
from hbnlp.branches.tracer import DEFAULT_STABILITY, Tracer
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import counted, flag, instance_of, list_of, list_of_callables, refused, whole_number
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kinds import End
from hbnlp.core.tasks import Ending, Report, drive
from hbnlp.core.types import Array
from hbnlp.diagrams.beginning import check_goes_on, cold_motions, first_motion
from hbnlp.diagrams.diagram import Diagram, Junction, Origin
from hbnlp.diagrams.meeting import (
    APART,
    branch_through,
    distance_from_origin,
    image_of,
    is_beside_stable,
    is_crossed,
    least_size,
    place_of,
)
from hbnlp.diagrams.tracing import Errand, steps, traced
from hbnlp.solutions.events import Event, EventFunction, events_of, is_sendable
from hbnlp.solutions.search import Search, find_all
from hbnlp.solutions.solution import Solution
from hbnlp.solutions.solving import solved
from hbnlp.stability.result import Floquet

AHEAD = 4
"""Branches that are given to an executor before the first of them is taken."""
FOUND = 1e-4
"""A motion that a search finds is on a branch that passes it nearer than this, relative to its size."""


@interrupts_kept(returns=True)
def explore(
    problem: HarmonicBalance,
    name: str,
    span: tuple[float, float],
    *,
    at: Mapping[str, float] | None = None,
    start: Solution | ArrayLike | None = None,
    depth: int = 1,
    max_points: int = 20_000,
    search_at: ArrayLike | None = None,
    search: Search | None = None,
    known: Sequence[Solution] = (),
    beside_stable: bool = False,
    stability: Floquet | None = DEFAULT_STABILITY,
    method: PseudoArclength | None = None,
    events: Mapping[str, EventFunction] | None = None,
    executor: Executor | None = None,
    callbacks: Callbacks = (),
    resume: Diagram | None = None,
) -> Diagram:
    """Return the branches that are connected with the one from a start, and those that a search finds beside them.

    Parameters
    ----------
    problem : HarmonicBalance
    name : str
        The continuation parameter.
    span : (float, float)
        Where to begin and where to end.
    at : mapping, optional
        Values of the other parameters.
    start : Solution or array (n_dof, 2H+1), optional
        Where to begin within the span, by default a cold start at ``span[0]``; of another problem, it is solved for in
        this one. Cold starts at the ends of the span follow, unless ``depth`` is 0: a resonance that leaves the span
        comes back into it as another branch.
    depth : int
        How many times to switch at a branch point or period doubling on the way to a branch; 0: one branch alone.
    max_points : int
        Points of all branches together after which no other one is begun; what is left then is listed.
    search_at : array (k,), optional
        Values of the parameter at which all solutions are searched for: of those on no branch so far the branches are
        traced as well, isolas among them.
    search : Search, optional
    known : sequence of Solution
        Motions within the span that are known already, from an integration in time or another problem: of those on no
        branch so far the branches are traced as well, before any search.
    beside_stable : bool
        Follow only what crosses where the motion is stable on one side at least: a slow march goes nowhere else, and
        unstable parts may have many branch points.
    stability : Floquet or None
        As for `hbnlp.trace`.
    method : PseudoArclength, optional
    events : mapping of names to functions, optional
        What to look for along all branches, as for `hbnlp.trace`.
    executor : concurrent.futures.Executor, optional
        Traces branches side by side, and runs the starts of searches; the diagram is the same. Other processes can be
        sent the functions of events that a module defines, no lambdas.
    callbacks : sequence of callables
        Called after each point, or with an executor after each branch; one that raises `StopTracing` ends it, as Ctrl-C
        does, with all there is so far.
    resume : Diagram, optional
        Go on from this one, of the same problem, span and start.

    Returns
    -------
    Diagram

    Raises
    ------
    ConvergenceError
        If the start does not converge.
    ValueError, KeyError, TypeError
        For a span or a name that cannot be, arguments of another kind, and a diagram of something else to go on from.
    TaskError
        If an error is raised on the way; its ``result`` is the diagram so far, its cause is the error.
    """
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, tolerance=1e-4)")
    instance_of("search", search, Search | None, "hbnlp.Search(...)")
    instance_of("stability", stability, Floquet | None, "Floquet(...), or None for off")
    instance_of("method", method, PseudoArclength | None, "PseudoArclength(...)")
    instance_of("executor", executor, Executor | None, "a concurrent.futures.Executor")
    instance_of("resume", resume, Diagram | None, "a Diagram, from a file Diagram.load(path)")
    list_of_callables("callbacks", callbacks)
    list_of("known", known, Solution, "a list of solutions, [solution]")
    flag("beside_stable", beside_stable)
    if beside_stable and stability is None:
        raise ValueError("beside_stable needs stability, which is None; give stability=Floquet(), or leave it out")
    looked_for = events_of(events, problem)
    if executor is not None and not isinstance(executor, ThreadPoolExecutor):
        _check_sendable(looked_for)
    whole_number("depth", depth, least=0)
    whole_number("max_points", max_points, least=2)
    span = problem.system.parameters.span(name, span)
    parameters = problem.system.parameters
    values = np.zeros(0) if search_at is None else parameters.series(name, search_at, what="search_at")
    low, high = sorted(span)
    if not np.all((low <= values) & (values <= high)):
        raise refused(ValueError, "search_at", search_at, f"values of {name} within the span {span}")
    for motion in known:
        if not low <= motion.parameters[name] <= high:
            raise refused(ValueError, "known", motion, f"solutions with {name} within the span {span}")
    parameters.values(at, but=parameters.names)  # what is wrong with them is said here
    first = first_motion(problem, name, span, at, start)
    if resume is not None:
        check_goes_on(resume, name, span, first, stability)
    explorer = _Explorer(
        problem,
        Errand(
            start=first,
            direction=1,
            name=name,
            span=span,
            stability=stability,
            method=method or PseudoArclength(),
            events=events,
        ),
        depth=depth,
        max_points=max_points,
        executor=executor,
        beside_stable=beside_stable,
        before=resume,
    )
    others = [solved(problem, at={**first.parameters, name: each.parameters[name]}, start=each) for each in known]
    ends = () if depth == 0 else span if start is not None else span[1:]
    work = explorer.work(first, ends, others, values, search or Search())
    warn_of = problem.system.warn_of
    return drive(f"exploring {name}", work, explorer.diagram, name=name, callbacks=callbacks, warn_of=warn_of)


def _check_sendable(events: tuple[Event, ...]) -> None:
    for event in events:
        if not is_sendable(event.function):
            raise refused(
                ValueError,
                f"events[{event.name!r}]",
                event.function,
                "with an executor of processes a function that a module defines by its name, as def, no lambda",
            )


class _Explorer:
    """The diagram as it grows."""

    def __init__(
        self,
        problem: HarmonicBalance,
        pattern: Errand,
        *,
        depth: int,
        max_points: int,
        executor: Executor | None,
        beside_stable: bool,
        before: Diagram | None,
    ) -> None:
        self._problem, self._pattern, self._depth, self._most = problem, pattern, depth, max_points
        self._executor, self._beside_stable = executor, beside_stable
        self._made = {} if before is None else dict(zip(before.origins, before.branches, strict=True))
        self._branches: list[Branch] = []
        self._origins: list[Origin] = []
        self._junctions: list[Junction] = []
        self._left: list[str] = []
        self._under_way: tuple[Origin, Tracer] | None = None

    # -- the record ---------------------------------------------------------------------------------------------------

    def diagram(self, ending: Ending) -> Diagram:
        """Return all there is, a branch under way included."""
        branches, origins = [*self._branches], [*self._origins]
        if self._under_way is not None and self._under_way[1].n_points:
            origin, tracer = self._under_way
            branches.append(tracer.branch(End.INTERRUPTED))
            origins.append(origin)
        return Diagram(
            name=self._pattern.name,
            span=self._pattern.span,
            branches=tuple(branches),
            origins=tuple(origins),
            junctions=tuple(self._junctions),
            left=tuple(self._left),
            message=ending.after(counted(len(branches), "branch")),
            problem=self._problem,
        )

    # -- the work -----------------------------------------------------------------------------------------------------

    def work(
        self, first: Solution, ends: tuple[float, ...], known: Sequence[Solution], values: Array, search: Search
    ) -> Iterator[Report]:
        """Trace branch after branch, and report after each point."""
        yield from self._both_ways(Origin(), first)
        yield from self._crossing(0)
        cold, failed = cold_motions(self._problem, self._pattern.name, ends, first.parameters)
        self._left += failed
        known = [*cold, *known]
        for number, motion in enumerate(known):
            yield from self._beside(number, motion)
        for value in values:
            at = {**first.parameters, self._pattern.name: float(value)}
            found = find_all(self._problem, at=at, method=search, executor=self._executor)
            for number, motion in enumerate(found, len(known)):
                yield from self._beside(number, motion)

    def _beside(self, number: int, motion: Solution) -> Iterator[Report]:
        """Trace the branch of a motion that is on none so far, and what crosses it."""
        begin = len(self._branches)
        if branch_through(motion, self._branches, FOUND) is None:
            yield from self._both_ways(Origin(value=motion.parameters[self._pattern.name], side=number), motion)
            yield from self._crossing(begin)

    def _both_ways(self, origin: Origin, start: Solution) -> Iterator[Report]:
        """Trace the branch of a motion to both sides; one that begins at an end of the span, or closes, has one."""
        value, (_, end) = start.parameters[self._pattern.name], self._pattern.span
        errand = dataclasses.replace(self._pattern, start=start, direction=-1 if value == end else 1)
        branch = yield from self._branch(origin, errand)
        self._take(origin, branch)
        inside = value not in errand.span
        if inside and not branch.closed:
            back = dataclasses.replace(origin, backward=True)
            branch = yield from self._branch(back, dataclasses.replace(errand, direction=-1))
            self._take(back, branch)

    def _crossing(self, begin: int) -> Iterator[Report]:
        """Trace what crosses the branches from one number on, and what crosses that, to the depth asked for."""
        for _ in range(self._depth):
            end = len(self._branches)
            if end == begin:
                return
            errands = self._errands(begin, end)
            if self._executor is None:
                for origin, errand in errands:
                    branch = yield from self._branch(origin, errand)
                    self._take(origin, branch)
            else:
                yield from self._side_by_side(errands, self._executor)
            begin = end

    def _errands(self, begin: int, end: int) -> Iterator[tuple[Origin, Errand]]:
        """Yield what crosses some branches, leaving out what is traced by the time that it is asked for."""
        for number, junction in enumerate([*self._junctions]):
            parent = junction.branches[0]
            if not begin <= parent < end:
                continue
            point = junction.point
            if self._beside_stable and not is_beside_stable(point, self._branches[parent]):
                continue
            try:
                starts = switch_branch(point)
            except (ConvergenceError, ArithmeticError) as error:
                self._left.append(f"{point!r}: {error}")
                continue
            if len(starts) > 1 and image_of(starts[1], starts[0], APART * distance_from_origin(starts[0])) is not None:
                self._junctions[number] = dataclasses.replace(self._junctions[number], has_images=True)
                starts = starts[:1]
            known = tuple(each for each in self._branches[parent].special_points if is_crossed(each))
            for side, start in enumerate(starts):
                there = branch_through(start, self._branches, APART * distance_from_origin(start))
                if there is not None:
                    self._link(number, there)
                elif sum(map(len, self._branches)) >= self._most:
                    self._left.append(f"{point!r}: max_points = {self._most} are reached")
                else:
                    origin = Origin(junction=number, side=side)
                    size = least_size([self._branches[parent]]) or float(np.linalg.norm(start.coefficients))
                    yield origin, dataclasses.replace(self._pattern, start=start, known=known, size=size)

    def _side_by_side(self, errands: Iterator[tuple[Origin, Errand]], executor: Executor) -> Iterator[Report]:
        """Trace branches ahead, and take them in their order; one that is known by then is dropped."""
        waiting: deque[tuple[Origin, Errand, Future[Branch]]] = deque()
        try:
            while True:
                while len(waiting) < AHEAD and (following := next(errands, None)) is not None:
                    waiting.append((*following, executor.submit(traced, self._continued(*following))))
                if not waiting:
                    return
                origin, errand, future = waiting.popleft()
                branch = future.result()
                there = branch_through(errand.start, self._branches, APART * distance_from_origin(errand.start))
                if there is None:
                    self._take(origin, branch)
                    yield self._report(branch, len(branch))
                elif origin.junction is not None:
                    self._link(origin.junction, there)
        finally:
            for _origin, _errand, future in waiting:
                future.cancel()

    def _branch(self, origin: Origin, errand: Errand) -> Generator[Report, None, Branch]:
        """Trace a branch here, point by point."""
        progress = steps(self._continued(origin, errand))
        while True:
            try:
                tracer = next(progress)
            except StopIteration as done:
                self._under_way = None
                branch: Branch = done.value
                return branch
            self._under_way = origin, tracer
            yield self._report(tracer, tracer.n_points)

    def _continued(self, origin: Origin, errand: Errand) -> Errand:
        """Return the errand that goes on with what there is of the branch already."""
        return dataclasses.replace(errand, resume=self._made.get(origin))

    def _take(self, origin: Origin, branch: Branch) -> None:
        """Add a branch, and the points where others cross it."""
        self._branches.append(branch)
        self._origins.append(origin)
        index, scale = len(self._branches) - 1, max(map(abs, branch.span))
        if origin.junction is not None:
            self._link(origin.junction, index)
        size = least_size(self._branches)
        for point in filter(is_crossed, branch.special_points):
            place = place_of(point, [junction.point for junction in self._junctions], scale=scale, size=size)
            if place is None:
                self._junctions.append(Junction(point=point, branches=(index,)))
            else:
                self._link(place, index)

    def _link(self, junction: int, branch: int) -> None:
        known = self._junctions[junction]
        if branch not in known.branches:
            self._junctions[junction] = dataclasses.replace(known, branches=(*known.branches, branch))

    def _report(self, at: Branch | Tracer, n_points: int) -> Report:
        value = float(at.parameter[-1]) if isinstance(at, Branch) else at.value
        points = sum(map(len, self._branches)) + (0 if isinstance(at, Branch) else n_points)
        return Report(value, min(points / self._most, 1.0), {"branches": len(self._branches), "points": points})
