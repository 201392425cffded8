"""One branch of a diagram: from a start until it ends, or comes to a point where it crosses the one that it left."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass

from hbnlp.branches.branch import Branch
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.branches.tracer import Tracer
from hbnlp.branches.tracing import trace
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.kinds import End
from hbnlp.diagrams.meeting import is_crossed, place_of, turns_into_image
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.events import EventFunction
from hbnlp.solutions.solution import Solution
from hbnlp.stability.result import Floquet


@dataclass(frozen=True, kw_only=True)
class Errand:
    """What one branch of a diagram takes; it can be sent to another process.

    Attributes
    ----------
    start : Solution
        Switched to, or found.
    direction : int
        Which way to go from one that was found; one that was switched to leads away from its origin.
    name, span, stability, method
        As for `hbnlp.trace`.
    known : tuple of SpecialPoint
        Points of the branch that it was switched from: where it meets that again, it ends.
    size : float
        Size below which motions are not measured relative to themselves.
    resume : Branch or None
        A part of it that is there already.
    events : mapping, optional
        As for `hbnlp.trace`.
    """

    start: Solution
    direction: int
    name: str
    span: tuple[float, float]
    stability: Floquet | None
    method: PseudoArclength
    known: tuple[SpecialPoint, ...] = ()
    size: float = 0.0
    resume: Branch | None = None
    events: Mapping[str, EventFunction] | None = None


def steps(errand: Errand) -> Generator[Tracer, None, Branch]:
    """Yield the tracer after each point, and return the branch; an error on the way is its end."""
    if errand.resume is not None and errand.resume.complete:
        return errand.resume
    tracer = Tracer(
        errand.start if errand.resume is None else attached(errand.start),
        errand.name,
        errand.span,
        at=None if errand.resume is None else errand.resume.parameters,
        direction=errand.direction,
        stability=errand.stability,
        method=errand.method,
        events=errand.events,
        resume=errand.resume,
    )
    scale = max(map(abs, errand.span))
    try:
        for traced in tracer:
            yield tracer
            crossed = [point for point in traced.special_points if is_crossed(point)]
            if any(
                turns_into_image(point) or place_of(point, errand.known, scale=scale, size=errand.size) is not None
                for point in crossed
            ):
                return tracer.branch(End.MET)
    except Exception as error:  # noqa: BLE001 - of one of many branches, which tells it
        return tracer.branch(End.ERROR, f"{type(error).__name__}: {error}")
    return tracer.branch()


def before_first(branch: Branch, origin: SpecialPoint, value: float) -> tuple[Solution, ...]:
    """Return the motion of a branch at a value between the point where it begins and its own first one, if it is there.

    Raises
    ------
    ConvergenceError
        If the branch cannot be followed back to it.
    """
    first = branch.solution(0)
    here = first.parameters[branch.name]
    low, high = sorted((origin.value, here))
    if not low < value < high:
        return ()
    back = trace(first, branch.name, (here, value), stability=None)
    last = back.solution(len(back) - 1)
    if back.end is not End.SPAN_END:
        raise ConvergenceError(
            f"the branch that begins at {branch.name} = {origin.value:.8g} cannot be followed from {here:.8g} back to "
            f"{value:.8g}: {back.message}",
            last,
        )
    return (last,)


def traced(errand: Errand) -> Branch:
    """Return the branch of an errand."""
    progress = steps(errand)
    while True:
        try:
            next(progress)
        except StopIteration as done:
            branch: Branch = done.value
            return branch
