"""Pseudo-arclength continuation: one trusted step after another along a curve, through its folds.

Tangent predictor with a second-order term, corrector in the plane normal to the tangent (Keller 1977), a metric that
measures changes relative to the present solution. A step that is refused (`acceptance`) is retried at half its length,
so that the continuation neither jumps to a neighbouring leg nor turns back unnoticed.
"""

from __future__ import annotations

import dataclasses
import enum
from dataclasses import dataclass, field
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from hbnlp.continuation.acceptance import REFUSED, accepted
from hbnlp.continuation.curve import Curve
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import Point, finish
from hbnlp.core.checks import instance_of, real_number, whole_number
from hbnlp.core.types import Array

MANY_ITERATIONS = 6
"""A corrector that takes more asks for a smaller step."""


@dataclass(frozen=True, kw_only=True)
class PseudoArclength:
    """Options of the continuation; lengths are relative to the size of solution and parameter.

    Parameters
    ----------
    step, min_step, max_step : float
        First, smallest and largest step.
    angle : float
        Angle in degrees between successive tangents that the step control aims at; twice as much is refused.
    max_points : int
        Points after which a trace ends.
    newton : Newton
        The corrector.
    """

    step: float = 0.02
    min_step: float = 1e-8
    max_step: float = 0.2
    angle: float = 7.0
    max_points: int = 20_000
    newton: Newton = field(default_factory=lambda: Newton(max_iterations=8))

    def __post_init__(self) -> None:
        largest = real_number("max_step", self.max_step, above=0.0)
        step = real_number("step", self.step, above=0.0, most=largest, advice=", the max_step")
        real_number("min_step", self.min_step, above=0.0, most=step, advice=", the first step")
        real_number("angle", self.angle, above=0.0, most=40.0, advice=", in degrees")
        whole_number("max_points", self.max_points, least=2)
        instance_of("newton", self.newton, Newton, "Newton(...)")


class Stop(enum.Enum):
    """Why a walk along a curve ends."""

    LIMIT = "reached a limit of the parameter"
    CLOSED = "closed on itself"
    MAX_POINTS = "reached max_points; give a larger one, PseudoArclength(max_points=...)"
    STEP_TOO_SMALL = "no acceptable step was found: the corrector fails however small the step"
    JUMP = "every step, however small, would jump to another branch or turn back"
    UNBOUNDED = "the solution grows without bound while the parameter stands still"


class StopContinuation(Exception):
    """Raised by a step that cannot be made."""

    def __init__(self, reason: Stop) -> None:
        super().__init__(reason.value)
        self.reason = reason

    def __reduce__(self) -> tuple[type[StopContinuation], tuple[Stop]]:
        return type(self), (self.reason,)


C = TypeVar("C", bound=Curve)


class Continuation(Generic[C]):
    """Steps along a curve from a converged start.

    Parameters
    ----------
    curve : Curve
    start : Point
        From `start_point`; its tangent says which way to go.
    options : PseudoArclength

    Attributes
    ----------
    point : Point
        The last point.
    step : float
        Length that will be tried next.
    refused : int
        Steps that were refused so far.
    """

    def __init__(self, curve: C, start: Point, options: PseudoArclength) -> None:
        self.curve = curve
        self.point = start
        self.options = options
        self.step = options.step
        self.refused = 0
        self._before: Point | None = None
        self._bend: Array = np.zeros_like(start.y)
        self._undo: tuple[Point, Point | None, Array] = (start, self._before, self._bend)

    def retract(self, step: float) -> None:
        """Take back the last step, and try this length next: it went too far."""
        self.point, self._before, self._bend = self._undo
        self.step = step
        self.refused += 1

    def advance(self, limits: tuple[float, float] | None = None) -> Point:
        """Make one accepted step and return the new point; a step across a parameter limit is cut to end on it.

        Raises
        ------
        StopContinuation
            If no step is accepted, however small.
        """
        reason = Stop.STEP_TOO_SMALL
        largest = 2.0 * np.radians(self.options.angle)
        while self.step >= self.options.min_step:
            base = self.point
            trial, verdict = self._trial(base, self.step, limits), REFUSED
            if trial is None:
                reason = Stop.STEP_TOO_SMALL
            else:
                verdict = accepted(
                    self.curve,
                    self._before,
                    base,
                    trial,
                    angle=largest,
                    newton=self.options.newton,
                    at=partial(self.at, base),
                )
                after = verdict.point
                if after is not None:
                    self._undo = (base, self._before, self._bend)
                    self._adapt(verdict.turn, after.iterations)
                    self._bend = _bend(base, after)
                    self._before = dataclasses.replace(base, factors=None)
                    self.point = after
                    return after
                reason = Stop.JUMP
            self.refused += 1
            self.step = verdict.length or 0.5 * self.step
        raise StopContinuation(reason)

    def go_on(self, curve: C, point: Point) -> None:
        """Go on along another curve from a point of it, nearest to one of the present curve."""
        self.point, self.curve = point, curve
        self._before, self._bend = None, np.zeros_like(point.y)

    def _trial(self, base: Point, step: float, limits: tuple[float, float] | None) -> Point | None:
        guess = base.y + step * base.tangent
        if limits is not None and not limits[0] <= guess[-1] <= limits[1]:
            return self._onto_limit(base, step, limits)
        trial = self.at(base, step)
        if trial is not None and limits is not None and not limits[0] <= trial.value <= limits[1]:
            return self._onto_limit(base, step, limits)
        return trial

    def _onto_limit(self, base: Point, step: float, limits: tuple[float, float]) -> Point | None:
        """Return the point where the curve meets the limit ahead, or None if it does not do so within the step."""
        bound = limits[1] if base.tangent[-1] > 0.0 else limits[0]
        if base.tangent[-1] == 0.0 or base.value == bound:
            return self.at(base, step)
        length = min(step, (bound - base.value) / base.tangent[-1])
        guess = base.y + length * base.tangent
        guess[-1] = bound
        row = np.zeros(guess.size)
        row[-1] = 1.0 / base.scale[-1]
        point = finish(self.curve, guess, row, base, self.options.newton)
        if point is not None:
            point.y[-1] = bound  # exactly, also where it is zero
        return point

    def at(self, base: Point, step: float) -> Point | None:
        """Return the point in the plane at distance ``step`` along the tangent of ``base``, or None."""
        row = base.tangent / base.scale**2
        guess = base.y + step * base.tangent
        if base is self.point:
            guess += step**2 * self._bend
        return finish(self.curve, guess, row, base, self.options.newton)

    def _adapt(self, turn: float, iterations: int) -> None:
        factor = np.radians(self.options.angle) / max(turn, 1e-12)
        if iterations > MANY_ITERATIONS:
            factor = min(factor, 0.8)
        self.step = float(np.clip(self.step * np.clip(factor, 0.5, 1.4), self.options.min_step, self.options.max_step))


def _bend(before: Point, after: Point) -> Array:
    """Return the predictor's second-order term: half the change of the unit tangent per length, normal to it."""
    scale = after.scale
    length = float(np.linalg.norm((after.y - before.y) / scale))
    earlier = before.tangent / np.linalg.norm(before.tangent / scale)
    bend = 0.5 * (after.tangent - earlier) / length
    return np.asarray(bend - after.tangent * float((after.tangent / scale**2) @ bend))
