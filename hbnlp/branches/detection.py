"""Special points between two points of a branch: what tangents, determinant and multipliers say, and where exactly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from hbnlp.branches.critical import with_multiplier
from hbnlp.branches.events import Events
from hbnlp.branches.floquet_points import bifurcation_function, critical_multiplier, crossings, samples_at
from hbnlp.branches.folds import fold_by_newton, fold_sensitivity, left_null_vector
from hbnlp.branches.forecast import Spectrum, hidden_crossing, on_circle, turn
from hbnlp.branches.recent import Recent
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.along import Along
from hbnlp.continuation.branch_points import BranchPoint
from hbnlp.continuation.dips import Sample, crossing_in
from hbnlp.continuation.locating import between, locate
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import Point
from hbnlp.core.kinds import Kind
from hbnlp.core.types import Array, ComplexArray
from hbnlp.solutions.equations import Equations
from hbnlp.solutions.events import Event
from hbnlp.solutions.identity import broken_in
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.stability.result import FloquetResult

SHORTEST = 1e-6
"""Shorter steps are not looked into."""
STATIONARY = 1e-3
"""A direction whose parameter component is below this part of it is one in which the parameter is stationary."""
LOST, NEARLY_LOST = 1e-4, 1e-2
"""A singular value below this part of the next one is zero: at a point that is solved for, or near one that is not."""
BESIDE = 0.5
"""A fold nearer to a branch point than this part of the step is the turn of the branch there."""
THERE = 1e-3
"""A point of the branch within this part of the step of a branch point has a tangent that is not worth its name."""
CROWDED = 2e-3
"""Longer steps have no more than one crossing of multipliers: between several there may be two that cancel."""
LONG = 0.05
"""Steps that are longer are made again with half their length where a multiplier turns by more than the following."""
LARGEST_TURN = 0.4
"""Radians, by which no parabola through the multipliers of three points follows them yet."""
ASIDE = 0.8
"""A step that ends where a multiplier is on the unit circle but for the tolerance is made this much shorter."""
MOST_TIMES = 3
SAME_PLACE = 0.01
"""Steps whose ends are nearer than this part of them end at the same place, as at an end of the span."""
STEADY = 1e-11
"""A tangent's parameter component below this has no sign that can be trusted."""


class _Ended(NamedTuple):
    """A step that ended where a multiplier is on the unit circle, and how many from the same point did."""

    before: Point
    after: Point
    times: int = 1


class Detector:
    """Finds the special points in the steps of one trace, and knows the multipliers of its last points.

    Parameters
    ----------
    evaluator : FloquetEvaluator or None
        None: stability is off, and what only multipliers show is not found.
    newton : Newton
    events : sequence of Event
        What the user looks for.
    """

    def __init__(self, evaluator: FloquetEvaluator | None, newton: Newton, events: Sequence[Event] = ()) -> None:
        self._evaluator, self._newton = evaluator, newton
        self._events = Events(events, newton) if events else None
        self._known: Recent[FloquetResult] = Recent()
        self._earlier: Spectrum | None = None
        self._crossing: BranchPoint | None = None
        self._on_circle: _Ended | None = None

    def multipliers(self, curve: Equations, point: Point) -> FloquetResult | None:
        """Return the multipliers at a point of the curve, kept for the last few points; None where stability is off."""
        return self._floquet(curve, point, self._evaluator) if self._evaluator is not None else None

    def shorter_step(self, curve: Equations, before: Point, after: Point) -> float | None:
        """Return the length of a step into what this one steps over; None if it hides nothing, or stability is off.

        A tongue between two points is entered and left by two crossings, which cancel at its ends: the determinants
        then dip to zero and come back, and pairs of multipliers are forecast to leave the unit circle and return. Steps
        are made shorter as well where several crossings are in one, or multipliers turn too far to be followed, and
        where a multiplier comes on the circle at the end, if that helps: it is on no side.
        """
        evaluator, length = self._evaluator, after.arclength - before.arclength
        if evaluator is None or length <= SHORTEST:
            return None
        here, there = (self._spectrum(curve, point, evaluator) for point in (before, after))
        earlier = self._earlier
        if earlier is not None and earlier.place >= here.place:
            earlier = None  # the step before is made again, so that this one begins where it began
        seen: dict[float, Point] = {}

        def look(place: float) -> ComplexArray | None:
            if place not in seen:
                point = between(curve, before, after, (place - before.arclength) / length, self._newton)
                if point is None:
                    return None
                seen[place] = point
            return self._floquet(curve, seen[place], evaluator).multipliers

        place = _dip(earlier, here, there, look)
        if place is None and all(self._floquet(curve, point, evaluator).converged for point in (before, after)):
            known = [Spectrum(at, self._floquet(curve, point, evaluator).multipliers) for at, point in seen.items()]
            place = hidden_crossing(earlier, here, there, look, evaluator.options.tol, seen=known)
        along = before.tangent / before.scale**2
        if place is None:
            kinds = crossings(*(self._floquet(curve, point, evaluator) for point in (before, after)))
            if (length > CROWDED and len(kinds) > 1) or (length > LONG and turn(here, there) > LARGEST_TURN):
                return 0.5 * float(along @ (after.y - before.y))
            ends_on_it = self._ends_on_the_circle(before, after, here, there, evaluator)
            return ASIDE * float(along @ (after.y - before.y)) if ends_on_it else None
        return float(along @ (seen[place].y - before.y)) if place in seen else None

    def _ends_on_the_circle(
        self, before: Point, after: Point, here: Spectrum, there: Spectrum, evaluator: FloquetEvaluator
    ) -> bool:
        """Return whether more multipliers are on the circle at the end of a step than at its beginning.

        Not where the step was made shorter for that in vain, as without damping, where all of them come to lie on it;
        nor where the step before it was made shorter, and the same place is its end.
        """
        counts = [on_circle(each.multipliers, evaluator.options.tol) for each in (here, there)]
        if counts[1] <= counts[0]:
            return False
        known, self._on_circle = self._on_circle, _Ended(before, after)
        if known is None:
            return True
        if known.before is before:
            self._on_circle = _Ended(before, after, known.times + 1)
            return known.times < MOST_TIMES
        length = known.after.arclength - known.before.arclength
        return abs(known.after.arclength - after.arclength) > SAME_PLACE * length

    def between(self, curve: Equations, before: Point, after: Point, index: int) -> tuple[SpecialPoint, ...]:
        """Return the special points in a step; ``index`` is the number of the point before it."""
        found, evaluator = self._by_tangent_and_determinant(curve, before, after, index), self._evaluator
        if evaluator is not None:
            found = [with_multiplier(point, _with_harmonics_of(curve, evaluator)) for point in found]
            kinds = crossings(*(self._floquet(curve, point, evaluator) for point in (before, after)))
            for number, kind in enumerate(kinds):
                which = kinds[:number].count(kind)
                point = self._bifurcation(curve, kind, before, after, index, evaluator, which)
                found += [point] if point is not None else []
        if self._events is not None:
            found += self._events.between(curve, before, after, index)
        return tuple(found)

    def _by_tangent_and_determinant(
        self, curve: Equations, before: Point, after: Point, index: int
    ) -> list[SpecialPoint]:
        """Return the fold and the branch point in a step.

        Where the parameter is stationary in all directions of the kernel, as at the common fold of identical parts,
        there is a fold and no branch point.
        """
        found: list[SpecialPoint] = []
        crossing = after.branch_point
        turns = [point.tangent[-1] / point.scale[-1] for point in (before, after)]
        if turns[0] * turns[1] < 0.0 and max(map(abs, turns)) > STEADY:
            fold = _fold(curve, before, after, index, crossing or self._crossing)
            found += [fold] if fold is not None else []
        if crossing is not None and (crossing.is_across or not _is_multiple_fold(curve, crossing.y)):
            found.append(_branch_point(curve, before, after, index))
        return found

    def passed(self, curve: Equations, before: Point, after: Point) -> None:
        """Take a step as made: the next one is seen beside it."""
        self._crossing = after.branch_point
        if self._evaluator is not None:
            self._earlier = self._spectrum(curve, before, self._evaluator)

    def same(self, known: Point, other: Point) -> None:
        """Take the multipliers of one point for another, in its place on a curve with fewer harmonics."""
        result = self._known.of(known)
        if result is not None:
            self._known.keep(other, result)

    def alike(self, known: Point, curve: Equations, other: Point) -> bool:
        """Return whether a point, and another in its place on a curve, are on the same side of all special points."""
        turned = known.tangent[-1] * other.tangent[-1] < 0.0
        if turned or known.orientation != other.orientation or known.across[0] != other.across[0]:
            return False
        if self._events is not None and not self._events.alike(known, curve, other):
            return False
        if self._evaluator is None:
            return True
        before = self._known.of(known)
        return before is None or not crossings(before, self._floquet(curve, other, self._evaluator))

    def _spectrum(self, curve: Equations, point: Point, evaluator: FloquetEvaluator) -> Spectrum:
        return Spectrum(point.arclength, self._floquet(curve, point, evaluator).multipliers)

    def _floquet(self, curve: Equations, point: Point, evaluator: FloquetEvaluator) -> FloquetResult:
        known = self._known.of(point)
        if known is not None:
            return known
        own = _with_harmonics_of(curve, evaluator)
        result = own(curve.coefficients(point.y), curve.values(point.y), near=self._known.latest)
        return self._known.keep(point, result)

    def _bifurcation(
        self,
        curve: Equations,
        kind: Kind,
        before: Point,
        after: Point,
        index: int,
        evaluator: FloquetEvaluator,
        which: int,
    ) -> SpecialPoint | None:
        """Return the period doubling or Neimark-Sacker point in a step; None if what is there proves to be neither."""

        def at(point: Point) -> FloquetResult:
            return self._floquet(curve, point, evaluator)

        test = bifurcation_function(kind, before, after, at, which=which)
        located = locate(curve, before, after, test, self._newton) if test is not None else None
        if located is None:
            return _unrefined(curve, kind, before, after, index)
        critical = critical_multiplier(kind, at(located).multipliers)
        if critical is None:
            return None
        return SpecialPoint(
            kind=kind,
            name=curve.name,
            value=located.value,
            bracket=(before.value, after.value),
            index=index,
            refined=True,
            solution=curve.solution(located.y, residual=located.residual),
            multiplier=critical,
        )


def _with_harmonics_of(curve: Equations, evaluator: FloquetEvaluator) -> FloquetEvaluator:
    """Return the evaluator for the motions of a curve, which may have other harmonics."""
    if curve.problem.n_harmonics == evaluator.n_harmonics:
        return evaluator
    return FloquetEvaluator.of(curve.problem, evaluator.options)


def _dip(
    earlier: Spectrum | None, here: Spectrum, there: Spectrum, look: Callable[[float], ComplexArray | None]
) -> float | None:
    """Return a place in a step at which a test function has another sign than at both ends; None if there is none."""
    begin, end = (samples_at(each.multipliers, each.place) for each in (here, there))
    before = samples_at(earlier.multipliers, earlier.place) if earlier is not None else (None,) * len(begin)
    for k, (past, one, other) in enumerate(zip(before, begin, end, strict=True)):
        if one is None or other is None or one.sign != other.sign:
            continue

        def sample(place: float, k: int = k) -> Sample | None:
            multipliers = look(place)
            return samples_at(multipliers, place)[k] if multipliers is not None else None

        place = crossing_in(past, one, other, sample)
        if place is not None:
            return place
    return None


def _kernel(curve: Equations, y: Array) -> tuple[float, float]:
    """Return how near dR/dy is to having lost a rank, and the largest part of the parameter in its weak directions.

    These are the tangent and the one that the smallest singular value belongs to, whose ratio to the next is returned.
    """
    seen = Along(curve)
    jacobian, across = np.zeros((seen.size, seen.size + 1)), np.zeros((0, 0))
    if curve.parts is None:
        curve.jacobian(y, jacobian)
    else:
        across = curve.parts.blocks(y, jacobian) * curve.scale(y)[curve.parts.across]
    _, sizes, directions = np.linalg.svd(jacobian * seen.part(curve.scale(y)))
    others = np.linalg.svd(across, compute_uv=False)
    smallest = np.sort(np.append(sizes, others))[:2]
    ratio = float(smallest[0] / smallest[1]) if smallest.size > 1 else 1.0
    weak = directions[-2:] if not others.size or sizes[-1] <= others[-1] else directions[-1:]
    return ratio, float(np.abs(weak[:, -1]).max())


def _is_multiple_fold(curve: Equations, y: Array) -> bool:
    """Return whether the parameter is stationary in all directions of the kernel, of which there are several."""
    return _kernel(curve, y)[1] < STATIONARY


def _fold(
    curve: Equations, before: Point, after: Point, index: int, crossing: BranchPoint | None
) -> SpecialPoint | None:
    """Return the fold between two points whose tangents differ in the sign of their parameter component.

    None where it is none: a branch of broken symmetry turns in its parameter at its pitchfork. Such a point is that of
    a ``crossing`` beside it whose other branch moves in the parameter, or one where the Jacobian loses a rank and the
    parameter is not stationary in the direction that belongs to it.
    """
    a, b = before.tangent[-1], after.tangent[-1]
    share = a / (a - b)
    guess = before.y + share * (after.y - before.y)
    along = curve.unknowns.coefficients((1.0 - share) * before.tangent + share * after.tangent)
    problem, name, scale = curve.problem, curve.name, before.scale
    length = float(np.linalg.norm((after.y - before.y) / scale))

    def near(y: Array, other: Array, part: float) -> bool:
        return bool(np.linalg.norm((y - other) / scale) <= part * length)

    turn = crossing.y if crossing is not None and abs(crossing.null[-1]) / scale[-1] > STATIONARY else None
    if turn is not None and (near(guess, turn, BESIDE) or near(after.y, turn, THERE) or near(before.y, turn, THERE)):
        return None
    x, values = curve.unknowns.coefficients(guess), curve.values(guess)
    found = fold_by_newton(problem, x, values, name, Newton(), along, kind=type(curve))
    y = curve.unknowns.joined(found.x, [found.value])
    located = found.converged and near(y, guess, 1.0)
    ratio, part = _kernel(curve, y if located else guess)
    if part > STATIONARY and ratio < (LOST if found.by_newton and located else NEARLY_LOST):
        return None
    if not located or not (found.by_newton or part <= STATIONARY):
        return _unrefined(curve, Kind.FOLD, before, after, index)
    assert found.null is not None
    x, values, null = found.x, curve.values(y), found.null
    left = left_null_vector(problem, x, values, name, null, kind=type(curve))
    return SpecialPoint(
        kind=Kind.FOLD,
        name=name,
        value=found.value,
        bracket=(before.value, after.value),
        index=index,
        refined=True,
        solution=curve.solution(y, residual=found.residual, iterations=found.iterations),
        null=null.reshape(problem.shape),
        sensitivity=fold_sensitivity(problem, x, values, name, left),
    )


def _branch_point(curve: Equations, before: Point, after: Point, index: int) -> SpecialPoint:
    """Return the branch point that the continuation located on its way to ``after``."""
    assert after.branch_point is not None
    point = after.branch_point
    solution, null = curve.solution(point.y, residual=point.residual), curve.coefficients(point.null)
    return SpecialPoint(
        kind=Kind.BRANCH_POINT,
        name=curve.name,
        value=point.value,
        bracket=(before.value, after.value),
        index=index,
        refined=True,
        solution=solution,
        null=null,
        breaks=broken_in(solution, null, floor=curve.unknowns.size_of(point.y)),
    )


def _unrefined(curve: Equations, kind: Kind, before: Point, after: Point, index: int) -> SpecialPoint:
    """Return a special point that is only bracketed."""
    return SpecialPoint(
        kind=kind,
        name=curve.name,
        value=after.value,
        bracket=(before.value, after.value),
        index=index,
        refined=False,
        solution=curve.solution(after.y, residual=after.residual),
    )
