"""Special points between two points of a branch: what tangents, determinant and multipliers say, and where exactly."""

from __future__ import annotations

import numpy as np

from hbnlp.branches.critical import with_multiplier
from hbnlp.branches.floquet_points import bifurcation_function, critical_multiplier, crossings
from hbnlp.branches.folds import fold_by_newton, fold_sensitivity, left_null_vector
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.locating import locate
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import Point
from hbnlp.core.kinds import Kind
from hbnlp.solutions.equations import Equations
from hbnlp.solutions.identity import broken_in
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.stability.result import FloquetResult


class Detector:
    """Finds the special points in the steps of one trace, and knows the multipliers of its last points.

    Parameters
    ----------
    evaluator : FloquetEvaluator or None
        None: stability is off, and what only multipliers show is not found.
    newton : Newton
    """

    def __init__(self, evaluator: FloquetEvaluator | None, newton: Newton) -> None:
        self._evaluator, self._newton = evaluator, newton
        self._known: list[tuple[Point, FloquetResult]] = []

    def multipliers(self, curve: Equations, point: Point) -> FloquetResult | None:
        """Return the multipliers at a point of the curve, kept for the last few points; None where stability is off."""
        return self._floquet(curve, point, self._evaluator) if self._evaluator is not None else None

    def between(self, curve: Equations, before: Point, after: Point, index: int) -> tuple[SpecialPoint, ...]:
        """Return the special points in a step; ``index`` is the number of the point before it."""
        found: list[SpecialPoint] = []
        if before.tangent[-1] * after.tangent[-1] < 0.0:
            found.append(_fold(curve, before, after, index))
        if after.branch_point is not None:
            found.append(_branch_point(curve, before, after, index))
        evaluator = self._evaluator
        if evaluator is not None:
            found = [with_multiplier(point, evaluator) for point in found]
            for kind in crossings(*(self._floquet(curve, point, evaluator) for point in (before, after))):
                point = self._bifurcation(curve, kind, before, after, index, evaluator)
                found += [point] if point is not None else []
        return tuple(found)

    def _floquet(self, curve: Equations, point: Point, evaluator: FloquetEvaluator) -> FloquetResult:
        for known, result in self._known:
            if known is point:
                return result
        near = self._known[-1][1] if self._known else None
        result = evaluator(curve.coefficients(point.y), curve.values(point.y), near=near)
        self._known = [*self._known[-3:], (point, result)]
        return result

    def _bifurcation(
        self, curve: Equations, kind: Kind, before: Point, after: Point, index: int, evaluator: FloquetEvaluator
    ) -> SpecialPoint | None:
        """Return the period doubling or Neimark-Sacker point in a step; None if nothing of that kind is there."""

        def at(point: Point) -> FloquetResult:
            return self._floquet(curve, point, evaluator)

        test = bifurcation_function(kind, before, after, at)
        if test is None:
            return None
        crosses = test(before) * test(after) < 0.0
        located = locate(curve, before, after, test, self._newton) if crosses else None
        if located is None:
            return _unrefined(curve, kind, before, after, index)
        return SpecialPoint(
            kind=kind,
            name=curve.name,
            value=located.value,
            bracket=(before.value, after.value),
            index=index,
            refined=True,
            solution=curve.solution(located.y, residual=located.residual),
            multiplier=critical_multiplier(kind, at(located).multipliers),
        )


def _fold(curve: Equations, before: Point, after: Point, index: int) -> SpecialPoint:
    """Return the fold between two points whose tangents differ in the sign of their parameter component."""
    a, b = before.tangent[-1], after.tangent[-1]
    share = a / (a - b)
    guess = before.y + share * (after.y - before.y)
    along = curve.unknowns.coefficients((1.0 - share) * before.tangent + share * after.tangent)
    problem, name, values = curve.problem, curve.name, curve.values(guess)
    found = fold_by_newton(problem, curve.unknowns.coefficients(guess), values, name, Newton(), along)
    y = curve.unknowns.joined(found.x, [found.value])
    length = np.linalg.norm((after.y - before.y) / before.scale)
    if found.null is None or not (found.converged and np.linalg.norm((y - guess) / before.scale) <= length):
        return _unrefined(curve, Kind.FOLD, before, after, index)
    values = curve.values(y)
    left = left_null_vector(problem, found.x, values, name, found.null)
    return SpecialPoint(
        kind=Kind.FOLD,
        name=curve.name,
        value=found.value,
        bracket=(before.value, after.value),
        index=index,
        refined=True,
        solution=curve.solution(y, residual=found.residual, iterations=found.iterations),
        null=found.null.reshape(problem.shape),
        sensitivity=fold_sensitivity(problem, found.x, values, name, left),
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
