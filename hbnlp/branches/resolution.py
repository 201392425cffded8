"""As many harmonics along a branch as each of its points needs, and as its special points need to be told rightly."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.branches.starting import Start
from hbnlp.continuation.acceptance import accepted
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.continuation.curve import Bordered
from hbnlp.continuation.point import Point, corrected, finish
from hbnlp.core.types import Array
from hbnlp.solutions.accuracy import Accuracy
from hbnlp.solutions.equations import Equations

logger = logging.getLogger(__name__)

WELL_BELOW = 0.3
"""Fewer harmonics are gone on with where the error with them is below this part of the tolerance."""
PATIENCE = 10
"""Points before fewer harmonics are tried again where they would not have done."""

LENIENT = 2.5
"""A step that is made with more harmonics may turn by this multiple of the angle aimed at; twice it is the rule."""

Detect = Callable[[Equations, Point, Point], tuple[SpecialPoint, ...]]
OnOther = Callable[[Equations, Point, Equations], Point | None]
"""(other, point, curve): the point of another curve in the place of one of a curve."""
View = Callable[[Equations, Point], "Seen"]


class Seen(NamedTuple):
    """How the error of a point is measured: as a solution on a curve without a condition, in the plane normal to a row.

    ``factors`` are those of the curve's derivative with that row, where there are some.
    """

    curve: Equations
    y: Array
    row: Array
    factors: Bordered | None


def along_branch(curve: Equations, point: Point) -> Seen:
    """Return a solution of a branch in the plane normal to that."""
    return Seen(curve, point.y, point.tangent / point.scale**2, point.factors)


def beside_fold(curve: Equations, point: Point) -> Seen:
    """Return a fold of a curve of folds as a solution with one free parameter, in the plane normal to its null vector.

    There a change of the residual moves the fold's parameter, not its motion along the branch. It is the one of the two
    parameters that the curve runs less along: the other's would grow without bound where folds come and go.
    """
    flat, y, _ = _flat(curve, point)
    null = flat.unknowns.joined(curve.unknowns.added(point.y), [0.0])
    return Seen(flat, y, null / flat.scale(y) ** 2, None)


def beside_event(curve: Equations, point: Point) -> Seen:
    """Return an event of a curve of events as a solution with one free parameter, in the plane of its condition."""
    flat, y, k = _flat(curve, point)
    full = np.zeros((curve.size, curve.size + 1))
    curve.jacobian(point.y, full)
    n = curve.problem.size
    return Seen(flat, y, flat.unknowns.joined(full[-1, :n], full[-1, n + k : n + k + 1]), None)


def _flat(curve: Equations, point: Point) -> tuple[Equations, Array, int]:
    """Return a point of a curve with one of its two parameters free, and which: the one that it runs less along."""
    first, second = np.abs(point.tangent / point.scale)[-2:]
    k = 0 if second >= first else 1
    flat = Equations(curve.problem, curve.values(point.y), curve.unknowns.free[k : k + 1], floor=curve.unknowns.floor)
    y = flat.unknowns.joined(curve.unknowns.coefficients(point.y), curve.unknowns.scalars(point.y)[k : k + 1])
    return flat, y, k


class Resolution:
    """The numbers of harmonics of one branch, rising where the error asks for more and falling where fewer would do.

    Parameters
    ----------
    problem : HarmonicBalance
        With a tolerance.
    options : PseudoArclength
        Of the continuation.
    view : callable, optional
        How the error of a point is measured; by default that of a solution, normal to the branch.
    """

    def __init__(self, problem: HarmonicBalance, options: PseudoArclength, view: View = along_branch) -> None:
        self._accuracy, self._options, self._view = Accuracy(problem), options, view
        self._policy = self._accuracy.policy
        self._latest: tuple[Point, float] | None = None
        self._wait = 0

    def start(self, begin: Start, span: tuple[float, float]) -> Start:
        """Return the start of a branch with the harmonics that it asks for, as far as it is found with them."""
        curve, point = begin.curve, begin.point
        finer = self.finer(curve, point)
        while finer is not None:
            fixed = point.value in span
            there = corrected(point, curve, finer, self._options.newton, fixed=fixed)
            if there is None:
                break
            curve, point = finer, there
            finer = self.finer(curve, point)
        return begin._replace(curve=curve, point=point, origin=point)

    def resumed(self, begin: Start, branch: Branch) -> Start:
        """Return the start at the end of a branch, which has its harmonics, after a look at all that came before."""
        for solution in map(branch.solution, range(len(branch))):
            curve = begin.curve.on(begin.curve.problem.carrying(solution.n_harmonics))
            self.see(curve, curve.point(solution.coefficients, solution.parameters[branch.name]))
        return begin

    def see(self, curve: Equations, y: Array) -> None:
        """Take a point as one of the branch."""
        self._accuracy.see(curve, y)

    def seen(self, curve: Equations, point: Point) -> Seen:
        """Return how the error of a point is measured."""
        return self._view(curve, point)

    def error(self, curve: Equations, point: Point) -> float:
        """Return the estimated error of a point of the branch."""
        if self._latest is None or self._latest[0] is not point:
            self._judge(curve, point)
        assert self._latest is not None
        return self._latest[1]

    def finer(self, curve: Equations, point: Point) -> Equations | None:
        """Return the curve with the harmonics that a point of this one asks for; None where it has them."""
        wanted = self._judge(curve, point)
        return None if wanted == curve.problem.n_harmonics else _with(curve, wanted)

    def coarser(self, curve: Equations, point: Point, on: OnOther) -> tuple[Equations, Point] | None:
        """Return a curve with fewer harmonics, and its point in the place of one of this; None where they do not do."""
        self._wait -= 1
        if self._wait > 0:
            return None
        seen = self._view(curve, point)
        enough = self._accuracy.enough(seen.curve, seen.y)
        if enough >= curve.problem.n_harmonics:
            return None
        fewer = _with(curve, enough)
        there = on(fewer, point, curve)
        if there is not None and fewer.resampled(there.y) is None:
            error = self._accuracy.judge(*self._view(fewer, there)).error
            if error <= WELL_BELOW * self._policy.tolerance:
                return fewer, there
        self._wait = PATIENCE
        return None

    def settled(
        self,
        curve: Equations,
        before: Point,
        after: Point,
        found: tuple[SpecialPoint, ...],
        detect: Detect,
        on: OnOther,
    ) -> tuple[SpecialPoint, ...] | Equations:
        """Return the special points of a step with as many harmonics as it takes until they stay, or a finer curve.

        The step is looked at with more and more harmonics. Where it has other special points then, those with fewer are
        not those of the motion: the step is to be made again with more.
        """
        while True:
            more = self._policy.above(curve.problem.n_harmonics + 1)
            if more <= curve.problem.n_harmonics:
                return tuple(dataclasses.replace(point, converged=False) for point in found)
            finer = _with(curve, more)
            step = self._step(finer, on(finer, before, curve), on(finer, after, curve))
            better = detect(finer, *step) if step is not None else None
            if better is None or [point.kind for point in better] != [point.kind for point in found]:
                logger.info(
                    "%s near %s = %.8g with %d harmonics, %s with %d: the step is made again",
                    _words(found),
                    curve.name,
                    after.value,
                    curve.problem.n_harmonics,
                    _words(better or ()),
                    more,
                )
                return finer
            assert step is not None
            errors = [self._difference(finer, *pair) for pair in zip(found, better, strict=True)]
            better = tuple(
                dataclasses.replace(point, truncation_error=error, converged=error <= self._policy.tolerance)
                for point, error in zip(better, errors, strict=True)
            )
            if max(errors) <= self._policy.tolerance:
                return better
            curve, found, (before, after) = finer, better, step

    def _judge(self, curve: Equations, point: Point) -> int:
        """Return the number of harmonics that a point should have, and keep its error."""
        judgement = self._accuracy.judge(*self._view(curve, point))
        self._latest = point, judgement.error
        return judgement.n_harmonics

    def _step(self, curve: Equations, before: Point | None, after: Point | None) -> tuple[Point, Point] | None:
        """Return two points as the ends of a step that the continuation would accept, with its branch point."""
        if before is None or after is None:
            return None
        newton, row = self._options.newton, before.tangent / before.scale**2
        verdict = accepted(
            curve,
            None,
            before,
            after,
            angle=LENIENT * np.radians(self._options.angle),
            newton=newton,
            at=lambda step: finish(curve, before.y + step * before.tangent, row, before, newton),
        )
        return None if verdict.point is None else (before, verdict.point)

    def _difference(self, curve: Equations, fewer: SpecialPoint, more: SpecialPoint) -> float:
        """Return by how much a special point moves when it has more harmonics, as errors of solutions are measured."""
        one, other = (curve.point(each.solution.coefficients, each.value) for each in (fewer, more))
        return self._accuracy.difference(curve, one, other)


def _with(curve: Equations, n_harmonics: int) -> Equations:
    return curve.on(curve.problem.with_harmonics(n_harmonics))


def _words(points: tuple[SpecialPoint, ...]) -> str:
    return ", ".join(point.kind.value for point in points) or "no special point"
