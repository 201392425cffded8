"""A trace that the user drives: walk, special points and stability, one point at a time."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from functools import partial

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.collecting import Collection, Traced
from hbnlp.branches.detection import Detector
from hbnlp.branches.resolution import Resolution
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.branches.starting import fresh_start, resumed_start
from hbnlp.continuation.arclength import PseudoArclength, Stop
from hbnlp.continuation.point import Point
from hbnlp.continuation.walk import Walk
from hbnlp.core.checks import instance_of, refused
from hbnlp.core.errors import CornerError, NonFiniteError
from hbnlp.core.interrupts import guarded, interrupts_kept
from hbnlp.core.kinds import End
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.sending import StaysHere
from hbnlp.core.types import Array
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.equations import Equations
from hbnlp.solutions.events import EventFunction, events_of
from hbnlp.solutions.solution import Solution
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.stability.result import Floquet
from hbnlp.systems.linear_stability import check_linear_stability

DEFAULT_STABILITY = Floquet()
AWAY_FROM = "(start, name, span), the start in the problem's place: one from switch_branch leads away from its origin"

_ENDS = {
    Stop.CLOSED: End.CLOSED,
    Stop.MAX_POINTS: End.MAX_POINTS,
    Stop.STEP_TOO_SMALL: End.STEP_TOO_SMALL,
    Stop.JUMP: End.JUMP,
    Stop.UNBOUNDED: End.UNBOUNDED,
}


class Tracer(StaysHere):
    """A trace that the user drives: iterate for its points, stop at will, take `branch()` at any time.

    The parameters are those of `hbnlp.trace`.

    Attributes
    ----------
    name : str
    span : (float, float)
    options : PseudoArclength
    """

    _instead = "it is a walk under way; send its branch(), and resume that with hbnlp.trace(..., resume=branch)"

    @renamed_arguments(problem="subject", away_from=AWAY_FROM)
    @interrupts_kept()
    def __init__(
        self,
        subject: HarmonicBalance | Solution,
        name: str,
        span: tuple[float, float],
        *,
        at: Mapping[str, float] | None = None,
        start: Solution | ArrayLike | None = None,
        direction: int = 1,
        stability: Floquet | None = DEFAULT_STABILITY,
        method: PseudoArclength | None = None,
        events: Mapping[str, EventFunction] | None = None,
        resume: Branch | None = None,
    ) -> None:
        problem, start = _problem_and_start(subject, start)
        instance_of("stability", stability, Floquet | None, "Floquet(...), or None for off")
        instance_of("method", method, PseudoArclength | None, "PseudoArclength(...)")
        instance_of("resume", resume, Branch | None, "a Branch, from a file Branch.load(path)")
        looked_for = events_of(events, problem)
        self.name = name
        self.span = problem.system.parameters.span(name, span)
        self.options = method or PseudoArclength()
        if not isinstance(direction, int) or isinstance(direction, bool) or direction not in (1, -1):
            raise refused(ValueError, "direction", direction, "1 (towards the end of the span) or -1")
        self._resumed = resume
        self._corner = ""
        if resume is not None:
            begin = resumed_start(problem, name, self.span, resume, at=at, direction=direction, stability=stability)
        else:
            begin = fresh_start(problem, name, self.span, at=at, start=start, direction=direction)
        self._resolution = Resolution(problem, self.options) if problem.truncation is not None else None
        if self._resolution is not None:
            begin = (
                self._resolution.start(begin, self.span) if resume is None else self._resolution.resumed(begin, resume)
            )
        # the walk may be on a finer curve than the last point, for a step that it does not come to make
        self._collection = Collection(begin.curve, resume)
        self._last = begin.point
        evaluator = None if stability is None else FloquetEvaluator.of(problem, stability)
        self._detector = Detector(evaluator, self.options.newton, looked_for)
        self._found: tuple[Point, tuple[SpecialPoint, ...]] | None = None
        low, high = sorted(self.span)
        self._walk = Walk(
            begin.curve,
            begin.point,
            self.options,
            limits=(low, high),
            judge=self._judge,
            alike=self._detector.alike,
            origin=begin.origin,
            n_points=len(resume) if resume is not None else 1,
        )
        if begin.step is not None:
            self._walk.step = begin.step if resume is not None else min(begin.step, self.options.step)
        if resume is None:
            self._check_fresh(begin.point)

    def __iter__(self) -> Iterator[Traced]:
        """Yield the points of the trace, the first included unless it was resumed."""
        return guarded(self._points())

    @property
    def problem(self) -> HarmonicBalance:
        """The problem, with the samples of the force that the last point takes."""
        return self._collection.curve.problem

    @property
    def value(self) -> float:
        """The parameter at the last point."""
        return self._last.value

    @property
    def end(self) -> End | None:
        """Why there are no more points; None while there may be."""
        if self._resumed is not None and self._resumed.closed:
            return End.CLOSED
        if self._walk.stop is Stop.LIMIT:
            return End.SPAN_END if self._walk.point.value == self.span[1] else End.SPAN_START
        if self._corner:
            return End.CORNER
        return _ENDS[self._walk.stop] if self._walk.stop is not None else None

    @property
    def n_points(self) -> int:
        """Points so far, those resumed from included."""
        return len(self._collection)

    @property
    def n_folds(self) -> int:
        """Folds so far, those resumed from included."""
        return self._collection.n_folds

    def branch(self, end: End | None = None, message: str = "") -> Branch:
        """Return all points so far."""
        reason = end or self.end or End.STOPPED
        return self._collection.branch(
            self.span,
            end=reason,
            message=message or (self._corner if reason is End.CORNER else reason.value),
            refused=self._walk.refused,
        )

    def _points(self) -> Iterator[Traced]:
        if not len(self._collection):
            yield self._kept(self._walk.point, ())
        if self.end is None:
            for before, after in self._steps():
                if self.n_points == self._walk.n_points and self._collection.records:
                    self._collection.drop()  # the step to it was made again, with more harmonics
                if before is not self._last:
                    self._collection.correct(self._traced(before, ()))
                curve = self._walk.curve
                if self._found is not None and self._found[0] is after:
                    found = self._found[1]
                else:
                    found = self._detector.between(curve, before, after, self.n_points - 1)
                self._detector.passed(curve, before, after)
                yield self._kept(after, found)
                self._go_on_with_fewer(after)

    def _steps(self) -> Iterator[tuple[Point, Point]]:
        """Yield the steps of the walk; where a corner or singularity of the force ends it, keep that as the reason."""
        try:
            yield from self._walk
        except (CornerError, NonFiniteError) as error:
            self._corner = str(error)
            return
        if self._walk.stop in (Stop.STEP_TOO_SMALL, Stop.JUMP):
            last = self._walk.point
            # the step that failed may have been the one onto the corner
            curve = self._walk.curve
            motions = [last.y, last.y + self.options.step * last.tangent]
            corners = [curve.problem.corner(curve.unknowns.coefficients(y), curve.values(y)) for y in motions]
            reasons = [str(each) for each in corners if each is not None]
            if not reasons and not _is_finite(curve, motions[-1]):
                reasons = [
                    "the value or a derivative of nonlinear_force is not finite on the motions ahead: smooth it there"
                ]
            self._corner = f"{self._walk.stop.value}; perhaps because {reasons[0]}" if reasons else ""

    def _judge(self, curve: Equations, before: Point, after: Point) -> Equations | float | None:
        """Return a curve on which a step is to be made again, the length of a shorter one, or None: it will do."""
        other = curve.resampled(after.y)
        if other is None and self._resolution is not None:
            other = self._resolution.finer(curve, after)
        if other is not None:
            return other
        shorter = self._detector.shorter_step(curve, before, after)
        if shorter is not None or self._resolution is None:
            return shorter
        detect = partial(self._detector.between, index=self._walk.n_points - 1)
        found = detect(curve, before, after)
        settled = self._resolution.settled(curve, before, after, found, detect, self._walk.on) if found else ()
        if isinstance(settled, Equations):
            return settled
        self._found = after, settled
        return None

    def _go_on_with_fewer(self, point: Point) -> None:
        """Go on with fewer harmonics where these do; the point that is kept has its own."""
        if self._resolution is None or self.end is not None:
            return
        fewer = self._resolution.coarser(self._walk.curve, point, self._walk.on)
        if fewer is not None and self._detector.alike(point, *fewer):
            self._detector.same(point, fewer[1])
            self._walk.go_on(*fewer)
            self._last = fewer[1]

    def _kept(self, point: Point, special_points: tuple[SpecialPoint, ...]) -> Traced:
        if self._resolution is not None:
            self._resolution.see(self._walk.curve, point.y)
        record = self._traced(point, special_points)
        self._collection.add(record)
        self._last = point
        return record

    def _traced(self, point: Point, special_points: tuple[SpecialPoint, ...]) -> Traced:
        curve = self._walk.curve
        return Traced(
            point=point,
            curve=curve,
            floquet=self._detector.multipliers(curve, point),
            special_points=special_points,
            truncation_error=self._resolution.error(curve, point) if self._resolution is not None else None,
        )

    def _check_fresh(self, point: Point) -> None:
        """Refuse a way out of the span, and warn of a system that is unstable about rest."""
        if self._walk.stop is Stop.LIMIT:
            raise ValueError(
                f"the start lies at {self.name} = {point.value:g}, an end of the span {self.span}, and the way "
                "first taken leads out of it: turn the direction round, or widen the span"
            )
        system = self.problem.system
        if not ca.depends_on(system.force, system.tau):
            with contextlib.suppress(NonFiniteError):  # a force that is singular at rest has no stability there
                check_linear_stability(system, system.parameters.as_dict(self._walk.curve.values(point.y)))


def _problem_and_start(
    subject: HarmonicBalance | Solution, start: Solution | ArrayLike | None
) -> tuple[HarmonicBalance, Solution | ArrayLike | None]:
    """Return the problem and where to start: a solution is both."""
    if isinstance(subject, Solution):
        if start is not None:
            raise TypeError("the solution in the problem's place is the start already; leave out start=")
        return attached(subject), subject
    instance_of("subject", subject, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...), or a Solution")
    return subject, start


@np.errstate(all="ignore")
def _is_finite(curve: Equations, y: Array) -> bool:
    """Return whether the equations and their derivatives are finite at a point."""
    jacobian = np.zeros((curve.size, y.size))
    curve.jacobian(y, jacobian)
    return bool(np.isfinite(curve.residual(y)).all() and np.isfinite(jacobian).all())
