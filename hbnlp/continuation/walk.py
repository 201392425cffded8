"""The one walk along any curve: accepted steps one after another, until there is a reason to stop."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Generic

import numpy as np
from scipy.optimize import minimize_scalar

from hbnlp.continuation.arclength import C, Continuation, PseudoArclength, Stop, StopContinuation
from hbnlp.continuation.branch_points import Arc
from hbnlp.continuation.point import Point, carried

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
    renew : callable (curve, point) -> curve or None, optional
        Asked at the end of each step for another curve to go on with, where this one does not serve there (with more
        samples of a force); the step is then made again on it, so that both its ends lie on one curve. None: go on. The
        curve carries points over (`Curve.carried_from`), so that it may have other unknowns: more harmonics.
    inspect : callable (curve, before, after) -> length or None, optional
        Asked after that for a shorter step to make instead, where this one hides something; None: it does not.
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
        renew: Callable[[C, Point], C | None] | None = None,
        inspect: Callable[[C, Point, Point], float | None] | None = None,
        origin: Point | None = None,
        n_points: int = 1,
    ) -> None:
        self._stepper = Continuation(curve, start, options)
        self._options, self._limits = options, limits
        self._renew, self._inspect = renew, inspect
        self._origin = origin or start
        self._still = start
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
            other = self._renew(self.curve, after) if self._renew is not None else None
            if other is not None:
                self._origin = carried(self._origin, self.curve, other)
                self._stepper.point = before
                try:
                    self._stepper.resume_on(other, self._limits)
                except StopContinuation as stop:
                    self.stop = stop.reason
                continue
            shorter = self._inspect(self.curve, before, after) if self._inspect is not None else None
            if shorter is not None and shorter >= self._options.min_step:
                self._stepper.retract(shorter)
                continue
            again = self._closing(before, after)
            if again is not None:
                self.stop = Stop.CLOSED
            elif self._limits is not None and after.value in self._limits:
                self.stop = Stop.LIMIT
            elif self._runs_away(after):
                self.stop = Stop.UNBOUNDED
            self.n_points += 1
            yield before, again or after

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
        return bool(np.max(after.scale[:-1] / self._still.scale[:-1]) > GROWN)

    def _closing(self, before: Point, after: Point) -> Point | None:
        """Return the first point of the curve again if the step passed it in the same direction."""
        if self.n_points < FEWEST_POINTS:
            return None
        row = before.tangent / before.scale**2
        to_origin = self._origin.y - before.y
        ahead, length = float(row @ to_origin), float(row @ (after.y - before.y))
        if not 0.0 < ahead <= length or float(row @ self._origin.tangent) <= 0.0:
            return None
        aside = np.linalg.norm((to_origin - ahead * before.tangent) / before.scale)
        if aside > ASIDE * length:
            return None
        again = self._stepper.at(before, ahead)
        if again is None and self._on_arc(before, after):
            again = self._origin  # beside a branch point correctors fail
        if again is None or np.linalg.norm((again.y - self._origin.y) / before.scale) > SAME:
            return None
        length = float(np.linalg.norm((again.y - before.y) / before.scale))
        # the step went on past the first point: what it crossed there is in the first step as well
        crossed = after.branch_point if again.orientation != before.orientation else None
        return dataclasses.replace(again, arclength=before.arclength + length, branch_point=crossed)

    def _on_arc(self, before: Point, after: Point) -> bool:
        """Return whether the first point lies on the cubic through a step."""
        arc = Arc(before.y, after.y, (before.tangent, after.tangent), before.scale)

        def distance(share: float) -> float:
            return float(np.linalg.norm((arc.at(share) - self._origin.y) / before.scale))

        return bool(minimize_scalar(distance, bounds=(0.0, 1.0), method="bounded").fun <= ON_ARC * arc.length)
