"""Pseudo-arclength continuation: one trusted step after another along a curve, through its folds.

Tangent predictor, corrector in the plane normal to the tangent (Keller 1977), a metric that measures changes relative
to the present solution. A step is accepted only if the arc between its ends can be smooth: the angle between the
tangents is small, the chord lies between them, and the orientation of the curve is kept. Otherwise it is refused and
retried at half its length, so that the continuation neither jumps to a neighbouring leg nor turns back unnoticed.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq

from hbnlp.continuation.branch_points import Arc, BranchPoint, branch_point_on
from hbnlp.continuation.newton import Bordered, Curve, Newton, correct
from hbnlp.core.types import Array

SUSPICIOUS_LENGTH = 2e-3
"""Steps longer than this are looked at for a pair of branch points within them."""
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
        if not 0.0 < self.min_step <= self.step <= self.max_step:
            raise ValueError(
                f"min_step = {self.min_step!r}, step = {self.step!r}, max_step = {self.max_step!r}; "
                "0 < min_step <= step <= max_step is needed"
            )
        if not 0.0 < self.angle <= 40.0:
            raise ValueError(f"angle = {self.angle!r}; between 0 and 40 degrees are accepted")
        if self.max_points < 2:
            raise ValueError(f"max_points = {self.max_points!r}; at least 2 are needed")


@dataclass(frozen=True, kw_only=True)
class Point:
    """A converged point of a curve, with its unit tangent in the metric ``scale`` and what the factors tell."""

    y: Array
    tangent: Array
    scale: Array
    orientation: float
    log_determinant: float
    residual: float
    iterations: int = 0
    factorisations: int = 0
    arclength: float = 0.0
    branch_point: BranchPoint | None = None
    factors: Bordered | None = field(default=None, repr=False, compare=False)

    @property
    def parameter(self) -> float:
        """Value of the continuation parameter."""
        return float(self.y[-1])


class Stop(enum.Enum):
    """Why a continuation cannot go on."""

    STEP_TOO_SMALL = "no acceptable step was found: the corrector fails however small the step"
    JUMP = "every step, however small, would jump to another branch or turn back"


class StopContinuation(Exception):
    """Raised by a step that cannot be made."""

    def __init__(self, reason: Stop) -> None:
        super().__init__(reason.value)
        self.reason = reason


class Continuation:
    """Steps along a curve from a converged start; iterate over it for the points after the start.

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

    def __init__(self, curve: Curve, start: Point, options: PseudoArclength) -> None:
        self.curve = curve
        self.point = start
        self.options = options
        self.step = options.step
        self.refused = 0
        self._before: Point | None = None
        self._bend: Array = np.zeros_like(start.y)

    def __iter__(self) -> Iterator[Point]:
        """Yield accepted points for ever; end by raising StopContinuation."""
        while True:
            yield self.advance()

    def advance(self, limits: tuple[float, float] | None = None) -> Point:
        """Make one accepted step and return the new point; a step across a parameter limit is cut to end on it."""
        reason = Stop.STEP_TOO_SMALL
        while self.step >= self.options.min_step:
            trial = self._trial(self.point, self.step, limits)
            if trial is None:
                reason = Stop.STEP_TOO_SMALL
            else:
                accepted, angle = self._accepted(self.point, trial)
                if accepted is not None:
                    self._adapt(angle, accepted.iterations)
                    self._bend = _bend(self.point, accepted)
                    self._before = dataclasses.replace(self.point, factors=None)
                    self.point = accepted
                    return accepted
                reason = Stop.JUMP
            self.refused += 1
            self.step *= 0.5
        raise StopContinuation(reason)

    def _trial(self, base: Point, step: float, limits: tuple[float, float] | None) -> Point | None:
        guess = base.y + step * base.tangent
        if limits is not None and not limits[0] <= guess[-1] <= limits[1]:
            return self._onto_limit(base, step, limits)
        trial = self.at(base, step)
        if trial is not None and limits is not None and not limits[0] <= trial.parameter <= limits[1]:
            return self._onto_limit(base, step, limits)
        return trial

    def _onto_limit(self, base: Point, step: float, limits: tuple[float, float]) -> Point | None:
        """Return the point where the curve meets the limit ahead, or None if it does not do so within the step."""
        bound = limits[1] if base.tangent[-1] > 0.0 else limits[0]
        if base.tangent[-1] == 0.0 or base.parameter == bound:
            return self.at(base, step)
        length = min(step, (bound - base.parameter) / base.tangent[-1])
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

    def _accepted(self, base: Point, trial: Point) -> tuple[Point | None, float]:
        scale = base.scale
        chord = (trial.y - base.y) / scale
        length = float(np.linalg.norm(chord))
        before, after = base.tangent / scale, trial.tangent / scale
        after = after / np.linalg.norm(after)
        angle = _angle(before, after)
        middle = before + after
        aside = _angle(chord / length, middle / np.linalg.norm(middle)) if length > 0.0 else np.pi
        limit = np.radians(self.options.angle)
        if angle > 2.0 * limit or aside > 0.3 * angle + 0.02:
            return None, angle
        branch_point = None
        if trial.orientation == base.orientation:
            if length > SUSPICIOUS_LENGTH and self._dips(trial, length):
                half_way = self.at(base, 0.5 * float(base.tangent / scale**2 @ (trial.y - base.y)))
                if half_way is None or half_way.orientation != base.orientation:
                    return None, angle
        else:
            branch_point = self._branch_point(base, trial)
            if branch_point is None:
                return None, angle
        arclength = base.arclength + length
        return dataclasses.replace(trial, arclength=arclength, branch_point=branch_point), angle

    def _dips(self, trial: Point, length: float) -> bool:
        """Return whether the determinant may have been zero twice on the way, by a parabola through three points."""
        if self._before is None:
            return False
        base, before = self.point, self._before
        back = base.arclength - before.arclength
        earlier = (
            before.orientation * base.orientation * np.exp(min(before.log_determinant - base.log_determinant, 50.0))
        )
        later = np.exp(min(trial.log_determinant - base.log_determinant, 50.0))
        slopes = (1.0 - earlier) / back, (later - 1.0) / length
        curvature = (slopes[1] - slopes[0]) / (back + length)
        slope = slopes[0] + curvature * back
        if curvature <= 0.0 or not 0.0 < -slope < 2.0 * curvature * length:
            return False
        return bool(1.0 - 0.25 * slope**2 / curvature < 0.2 * min(1.0, later))

    def _adapt(self, angle: float, iterations: int) -> None:
        factor = np.radians(self.options.angle) / max(angle, 1e-12)
        if iterations > MANY_ITERATIONS:
            factor = min(factor, 0.8)
        self.step = float(np.clip(self.step * np.clip(factor, 0.5, 1.4), self.options.min_step, self.options.max_step))

    def _branch_point(self, base: Point, trial: Point) -> BranchPoint | None:
        """Return where the orientation changes; None if it changes by a jump and not through a singular point."""
        ratio = float(np.exp(min(trial.log_determinant - base.log_determinant, 500.0)))
        return branch_point_on(
            self.curve,
            Arc(base.y, trial.y, (base.tangent, trial.tangent), base.scale),
            (base.orientation, trial.orientation * ratio),
            tol=self.options.newton.tol,
            max_iterations=self.options.newton.max_iterations,
        )


def locate(stepper: Continuation, base: Point, end: Point, test: Callable[[Point], float]) -> Point | None:
    """Return the point between two others where ``test`` vanishes, by Brent's method along the tangent of ``base``.

    None is returned if a corrector fails, or if the points do not close in on one another: a jump.
    """
    row = base.tangent / base.scale**2
    length = float(row @ (end.y - base.y))
    if length <= 0.0:
        return None
    points = {0.0: base, length: end}
    found = {0.0: test(base), length: test(end)}

    def along(step: float) -> float:
        if step not in found:
            nearest = min(points, key=lambda s: abs(s - step))
            guess = points[nearest].y + (step - nearest) * base.tangent
            point = finish(stepper.curve, guess, row, points[nearest], stepper.options.newton)
            if point is None:
                raise ArithmeticError
            points[step], found[step] = point, test(point)
        return found[step]

    try:
        root = brentq(along, 0.0, length, xtol=1e-12 * length, rtol=8.9e-16, maxiter=60)
    except ArithmeticError:
        return None
    signs = np.sign(found[0.0])
    left = max((s for s in found if s <= root and found[s] * signs > 0.0), default=0.0)
    right = min((s for s in found if s >= root and found[s] * signs <= 0.0), default=length)
    if abs(found[root]) > 1e-3 * min(abs(found[0.0]), abs(found[length])):
        return None
    if float(np.linalg.norm((points[right].y - points[left].y) / base.scale)) > 3.0 * (right - left) + 1e-6 * length:
        return None
    share = found[left] / (found[left] - found[right]) if found[left] != found[right] else 0.0
    guess = points[left].y + share * (points[right].y - points[left].y)
    return finish(stepper.curve, guess, row, points[root], stepper.options.newton)


def start_point(curve: Curve, y: Array, toward: Array) -> Point:
    """Return a converged y as a point whose tangent makes an acute angle with ``toward``."""
    scale = curve.scale(y)
    jacobian = np.zeros((y.size - 1, y.size))
    curve.jacobian(y, jacobian)
    # the null vector of [R_x, R_lambda], also at a fold, where R_x alone is singular
    tangent = np.linalg.svd(jacobian * scale)[2][-1] * scale
    along = float((tangent / scale) @ (toward / scale))
    tangent *= (np.sign(along) or 1.0) / np.linalg.norm(tangent / scale)
    factors = Bordered(np.vstack([jacobian, tangent / scale**2]))
    orientation, log_determinant = factors.determinant()
    residual = float(np.max(np.abs(curve.residual(y)), initial=0.0)) / max(curve.term_size(y), np.finfo(float).tiny)
    return Point(
        y=y,
        tangent=tangent,
        scale=scale,
        orientation=orientation,
        log_determinant=log_determinant,
        residual=residual,
        factors=factors,
    )


def finish(curve: Curve, guess: Array, row: Array, base: Point, options: Newton) -> Point | None:
    """Return the corrected point with its tangent, turned the way of ``base``, or None if Newton's method failed."""
    near = (base.factors, base.tangent) if base.factors is not None else None
    correction = correct(curve, guess, row, options, near)
    if not correction.converged:
        return None
    y = correction.y
    scale = curve.scale(y)
    factors = Bordered.at(curve, y, base.tangent / base.scale**2)
    if factors.singular:
        return None
    unit = np.zeros(y.size)
    unit[-1] = 1.0
    tangent = factors.solve(unit)
    length = float(np.linalg.norm(tangent / scale))
    sign, log_determinant = factors.determinant()
    # det [J; t^T/s^2] from det [J; border]: both rows see the null vector t of J, t.t/s^2 = 1 and border . t = 1 /
    # length
    return Point(
        y=y,
        tangent=tangent / length,
        scale=scale,
        orientation=sign,
        log_determinant=log_determinant + float(np.log(length)),
        residual=correction.residual,
        iterations=correction.iterations,
        factorisations=correction.factorisations + 1,
        factors=factors,
    )


def _bend(before: Point, after: Point) -> Array:
    """Return the predictor's second-order term: half the change of the unit tangent per length, normal to it."""
    scale = after.scale
    length = float(np.linalg.norm((after.y - before.y) / scale))
    earlier = before.tangent / np.linalg.norm(before.tangent / scale)
    bend = 0.5 * (after.tangent - earlier) / length
    return np.asarray(bend - after.tangent * float((after.tangent / scale**2) @ bend))


def _angle(a: Array, b: Array) -> float:
    """Return the angle between unit vectors, accurate when it is small."""
    return float(2.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(a - b)))))
