"""The one walk along any curve: accepted steps one after another, until there is a reason to stop."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Generic

import numpy as np
from scipy.optimize import minimize_scalar

from hbnlp.continuation.arclength import C, Continuation, PseudoArclength, Stop, StopContinuation
from hbnlp.continuation.branch_points import Arc
from hbnlp.continuation.point import Point, carried, corrected

FEWEST_POINTS = 4
"""A curve with fewer points behind it is not looked at for closing on itself."""
ASIDE = 0.3
"""How far from a step, relative to its length, the first point may lie to be looked at."""
ON_ARC = 2e-3
"""How far from the cubic through a step, relative to its length, it may lie where no corrector tells."""
SAME = 1e-6
"""Distance, relative to the solution, at which the corrected point is the first one again."""
STILL, GROWN = 1e-10, 1e3
"""A solution that grows by the second while the parameter moves by less than the first has no bound."""
SOON = 1e-6
"""Part of its scale from which on a parameter that leaves zero is measured by itself."""


class Walk(Generic[C]):
    """Steps (before, after) along a curve from a converged start; iterate over it, stop at will.

    Parameters
    ----------
    curve : Curve
    start : Point
        From `start_point`; its tangent says which way to go.
    options : PseudoArclength
    limits : (float, float), optional
        Range of the continuation parameter, the last unknown: a step across its end is cut to end on it.
    judge : callable (curve, before, after) -> curve, length or None, optional
        Asked at the end of each step. A curve: this one does not serve there (it takes more samples of a force, or more
        harmonics, so that the other may have other unknowns: it carries points over, `Curve.carried_from`); the step is
        made again on that, so that both its ends lie on one curve. A length: the step hides something, and a shorter
        one is made instead. None: go on.
    alike : callable (point, curve, other) -> bool, optional
        Whether a point, and the one in its place on another curve, are on the same side of all special points. Where
        they are not, the step before is made again as well: ``n_points`` is less then.
    origin : Point, optional
        Where the curve began, by default the start: coming back to it in the same direction ends the walk.
    n_points : int
        Points that there are already, the start among them.

    Attributes
    ----------
    stop : Stop or None
        Why there are no more steps; None while there may be.
    n_points : int
        Points so far.
    """

    def __init__(
        self,
        curve: C,
        start: Point,
        options: PseudoArclength,
        *,
        limits: tuple[float, float] | None = None,
        judge: Callable[[C, Point, Point], C | float | None] | None = None,
        alike: Callable[[Point, C, Point], bool] | None = None,
        origin: Point | None = None,
        n_points: int = 1,
    ) -> None:
        self._stepper = Continuation(curve, start, options)
        self._options, self._limits = options, limits
        self._judge, self._alike = judge, alike
        self._origin, self._earlier, self._still = (curve, origin or start), (curve, start), start
        self.n_points = n_points
        self.stop: Stop | None = Stop.LIMIT if self.leaves(start) else None

    @property
    def curve(self) -> C:
        """The curve that is walked along at present."""
        return self._stepper.curve

    @property
    def point(self) -> Point:
        """The last point."""
        return self._stepper.point

    @property
    def step(self) -> float:
        """Length that will be tried next."""
        return self._stepper.step

    @step.setter
    def step(self, length: float) -> None:
        self._stepper.step = float(np.clip(length, self._options.min_step, self._options.max_step))

    @property
    def refused(self) -> int:
        """Steps that were refused so far."""
        return self._stepper.refused

    def leaves(self, point: Point) -> bool:
        """Return whether a point lies on a limit and its tangent leads out."""
        if self._limits is None or point.value not in self._limits:
            return False
        low, high = self._limits
        outward = low - high if point.value == low else high - low
        return bool(point.tangent[-1] * outward > 0.0)

    def __iter__(self) -> Iterator[tuple[Point, Point]]:
        """Yield the steps; where they end, ``stop`` says why."""
        while self.stop is None:
            if self.n_points >= self._options.max_points:
                self.stop = Stop.MAX_POINTS
                return
            before = self._stepper.point
            try:
                after = self._stepper.advance(self._limits)
            except StopContinuation as stop:
                self.stop = stop.reason
                return
            verdict = self._judge(self.curve, before, after) if self._judge is not None else None
            if isinstance(verdict, float):
                if verdict >= self._options.min_step:
                    self._stepper.retract(verdict)
                    continue
            elif verdict is not None:
                if not self._made_again(verdict, before):
                    self.stop = Stop.STEP_TOO_SMALL
                continue
            again = self._closing(before, after)
            if again is not None:
                self.stop = Stop.CLOSED
            elif self._limits is not None and after.value in self._limits:
                self.stop = Stop.LIMIT
            elif self._runs_away(after):
                self.stop = Stop.UNBOUNDED
            self.n_points += 1
            self._earlier = self.curve, before
            yield before, again or after

    def on(self, other: C, point: Point, curve: C | None = None) -> Point | None:
        """Return the point of another curve in the place of one of the present curve, or of the one given, or None.

        One that lies on a limit has its place there.
        """
        at_limit, own = self._limits is not None and point.value in self._limits, curve or self.curve
        again = corrected(point, own, other, self._options.newton, fixed=at_limit)
        return again or (corrected(point, own, other, self._options.newton) if at_limit else None)

    def go_on(self, curve: C, point: Point) -> None:
        """Go on along another curve, from its point in the place of the last."""
        self._stepper.go_on(curve, point)

    def _made_again(self, other: C, before: Point) -> bool:
        """Set out again along another curve from the beginning of a step; return whether there is a point to do so."""
        here = self.on(other, before)
        if here is None:
            self._stepper.go_on(self.curve, before)
            return False
        if self._alike is not None and not self._alike(before, other, here) and self.n_points > 1:
            curve, point = self._earlier
            there = self.on(other, point, curve) if point is not before else None
            if there is not None and self._alike(point, other, there):
                self.n_points -= 1
                here = there
        self._stepper.go_on(other, here)
        return True

    def _runs_away(self, after: Point) -> bool:
        """Return whether the solution has grown far while the parameter stood still.

        So it does towards a value at which there is none, and along a vertical branch. Growth is measured by the scale:
        where a branch begins at rest, small solutions grow while the parameter is stationary, but below its floor. A
        parameter that leaves zero takes many such solutions along: it moves if it does so relative to itself.
        """
        here, there, scale = abs(self._still.value), abs(after.value), float(after.scale[-1])
        moves = STILL * (scale if there <= here else max(there, SOON * scale))
        if abs(after.value - self._still.value) > moves:
            self._still = after
        return bool(after.scale[0] > GROWN * self._still.scale[0])

    def _closing(self, before: Point, after: Point) -> Point | None:
        """Return the first point of the curve again if the step passed it in the same direction."""
        if self.n_points < FEWEST_POINTS:
            return None
        row = before.tangent / before.scale**2
        origin = carried(self._origin[1], self._origin[0], self.curve)
        to_origin = origin.y - before.y
        ahead, length = float(row @ to_origin), float(row @ (after.y - before.y))
        if not 0.0 < ahead <= length or float(row @ origin.tangent) <= 0.0:
            return None
        aside = np.linalg.norm((to_origin - ahead * before.tangent) / before.scale)
        if aside > ASIDE * length:
            return None
        if self._origin[0] is not self.curve:
            origin = corrected(self._origin[1], self._origin[0], self.curve, self._options.newton) or origin
            ahead = float(row @ (origin.y - before.y))
        again = self._stepper.at(before, ahead)
        if again is None and self._on_arc(origin, before, after):
            again = origin  # beside a branch point correctors fail
        if again is None or np.linalg.norm((again.y - origin.y) / before.scale) > SAME:
            return None
        length = float(np.linalg.norm((again.y - before.y) / before.scale))
        # the step went on past the first point: what it crossed there is in the first step as well
        crossed = after.branch_point if again.orientation != before.orientation else None
        return dataclasses.replace(again, arclength=before.arclength + length, branch_point=crossed)

    def _on_arc(self, origin: Point, before: Point, after: Point) -> bool:
        """Return whether the first point lies on the cubic through a step."""
        arc = Arc(before.y, after.y, (before.tangent, after.tangent), before.scale)

        def distance(share: float) -> float:
            return float(np.linalg.norm((arc.at(share) - origin.y) / before.scale))

        return bool(minimize_scalar(distance, bounds=(0.0, 1.0), method="bounded").fun <= ON_ARC * arc.length)
