"""A trace that the user drives: stepper, special points and stability, one point at a time."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch, SpecialPoint
from hbnlp.branches.detection import branch_point, crossings, floquet_bifurcation, refined_fold, with_multiplier
from hbnlp.branches.recording import Traced, make_branch
from hbnlp.continuation.arclength import (
    Continuation,
    Point,
    PseudoArclength,
    Stop,
    StopContinuation,
    finish,
    start_point,
)
from hbnlp.core.checks import instance_of
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kinds import End, Kind
from hbnlp.core.types import Array
from hbnlp.solutions.equations import ParameterCurve
from hbnlp.solutions.solution import Solution, guess_for
from hbnlp.solutions.solving import linear_guess, samples_suffice, solve
from hbnlp.stability.multipliers import Floquet, FloquetEvaluator, FloquetResult
from hbnlp.systems.linear_stability import check_linear_stability

RESUMABLE_RESIDUAL = 1e-6
SOLVED = 1e-9
"""A start whose residual is below this part of its terms is a solution, also at a fold, where Newton's method fails."""
DEFAULT_STABILITY = Floquet()


class Tracer:
    """A trace that the user drives: iterate for its points, stop at will, take `branch()` at any time.

    The parameters are those of `hbnlp.trace`.

    Attributes
    ----------
    end : End or None
        Why there are no more points; None while there may be.
    """

    def __init__(
        self,
        problem: HarmonicBalance,
        name: str,
        span: tuple[float, float],
        *,
        at: Mapping[str, float] | None = None,
        start: Solution | ArrayLike | None = None,
        direction: int = 1,
        away_from: Solution | None = None,
        stability: Floquet | None = DEFAULT_STABILITY,
        method: PseudoArclength | None = None,
        resume: Branch | None = None,
    ) -> None:
        instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
        instance_of("stability", stability, Floquet | None, "Floquet(...), or None for off")
        instance_of("method", method, PseudoArclength | None, "PseudoArclength(...)")
        instance_of("resume", resume, Branch | None, "a Branch, from a file hbnlp.load_branch(path)")
        self.problem = problem
        self.name = name
        self.span = _checked_span(problem, name, span)
        self.options = method or PseudoArclength()
        self.end: End | None = None
        self._records: list[Traced] = []
        self._resumed = resume
        self._n_folds = len(resume.folds) if resume is not None else 0
        self._evaluator: FloquetEvaluator | None = None
        if stability is not None:
            self._evaluator = FloquetEvaluator(problem.system, problem.periods, problem.n_harmonics, stability)
        self._known: list[tuple[Point, FloquetResult]] = []
        if direction not in (1, -1):
            raise ValueError(f"direction = {direction!r}; 1 (towards the end of the span) or -1 is needed")
        if resume is not None:
            _check_resumable(problem, name, at, resume, stability)
            at, start = resume.parameters, resume.solution(len(resume) - 1)
        first, self._values = self._first(at, start)
        self._curve = self._new_curve()
        self._curve.solution_floor = self._smallest_solution(first)
        heading = np.zeros(first.size)
        heading[-1] = direction * np.sign(self.span[1] - self.span[0])
        if resume is not None and len(resume) > 1:
            heading = first - np.append(resume.coefficients[-2].ravel(), resume.parameter[-2])
        elif away_from is not None:
            heading = first - np.append(guess_for(problem, away_from), away_from.parameters[name])
        point = start_point(self._curve, first, heading)
        self._stepper = Continuation(self._curve, point, self.options)
        self._origin = point
        if resume is not None:
            self._resume_from(resume)
        elif self._leaves(point):
            raise ValueError(
                f"the start lies at {name} = {point.parameter:g}, an end of the span {self.span}, and the way first "
                "taken leads out of it: turn the direction round, or widen the span"
            )
        else:
            parameters = problem.system.parameters
            if not ca.depends_on(problem.system.force, problem.system.tau):
                check_linear_stability(problem.system, parameters.as_dict(self._values))

    def __iter__(self) -> Iterator[Traced]:
        """Yield the points of the trace, the first included unless it was resumed."""
        if not self._records and self._resumed is None:
            yield self._kept(self._record(self._stepper.point, ()))
        while self.end is None:
            with interrupts_kept():
                traced = self._next()
            if traced is not None:
                yield self._kept(traced)

    @property
    def n_points(self) -> int:
        """Points so far, those resumed from included."""
        return len(self._records) + (len(self._resumed) if self._resumed is not None else 0)

    @property
    def n_folds(self) -> int:
        """Folds so far, those resumed from included."""
        return self._n_folds

    def branch(self, end: End | None = None, message: str = "") -> Branch:
        """Return all points so far."""
        reason = end or self.end or End.STOPPED
        return make_branch(
            self._records,
            self.problem,
            self.name,
            self.span,
            self.problem.system.parameters.as_dict(self._values),
            end=reason,
            message=message or reason.value,
            refused=self._stepper.refused,
            resumed=self._resumed,
        )

    # -- one point --------------------------------------------------------------------------------------------------

    def _next(self) -> Traced | None:
        if self.n_points >= self.options.max_points:
            self.end = End.MAX_POINTS
            return None
        before = self._stepper.point
        low, high = sorted(self.span)
        if self._leaves(before):
            self.end = End.SPAN_END if before.parameter == self.span[1] else End.SPAN_START
            return None
        try:
            after = self._stepper.advance((low, high))
        except StopContinuation as stop:
            self.end = End.JUMP if stop.reason is Stop.JUMP else End.STEP_TOO_SMALL
            return None
        if not samples_suffice(self.problem, after.y[:-1], self._curve.values(after.y)):
            self._use_more_samples(before)
            return None
        closing = self._closing(before, after)
        traced = self._record(closing or after, self._between(before, closing or after))
        if closing is not None:
            self.end = End.CLOSED
        elif after.parameter in self.span:
            self.end = End.SPAN_END if after.parameter == self.span[1] else End.SPAN_START
        return traced

    def _leaves(self, point: Point) -> bool:
        """Return whether a point is on an end of the span and its tangent leads out."""
        begin, end = self.span
        outward = {begin: begin - end, end: end - begin}.get(point.parameter, 0.0)
        return bool(point.tangent[-1] * outward > 0.0)

    def _kept(self, traced: Traced) -> Traced:
        self._records.append(traced)
        self._n_folds += sum(point.kind is Kind.FOLD for point in traced.special_points)
        return traced

    def _record(self, point: Point, special_points: tuple[SpecialPoint, ...]) -> Traced:
        floquet = self._multipliers(point) if self._evaluator else None
        return Traced(point=point, floquet=floquet, special_points=special_points, n_samples=self.problem.n_samples)

    def _between(self, before: Point, after: Point) -> tuple[SpecialPoint, ...]:
        index = self.n_points - 1
        found: list[SpecialPoint] = []
        if before.tangent[-1] * after.tangent[-1] < 0.0:
            found.append(refined_fold(self._curve, before, after, index))
        if after.branch_point is not None:
            found.append(branch_point(self._curve, before, after, index))
        if self._evaluator:
            found = [with_multiplier(point, self._evaluator) for point in found]
            a, b = self._multipliers(before), self._multipliers(after)
            for kind in crossings(a, b):
                point = floquet_bifurcation(self._stepper, self._curve, kind, before, after, index, self._multipliers)
                found += [point] if point is not None else []
        return tuple(found)

    def _multipliers(self, point: Point) -> FloquetResult:
        """Return the multipliers at a point of the curve, kept for the last few points."""
        for known, result in self._known:
            if known is point:
                return result
        assert self._evaluator is not None
        coefficients = point.y[:-1].reshape(self.problem.shape)
        near = self._known[-1][1] if self._known else None
        result = self._evaluator(coefficients, self._curve.values(point.y), near=near)
        self._known = [*self._known[-3:], (point, result)]
        return result

    def _closing(self, before: Point, after: Point) -> Point | None:
        """Return the first point of the branch again if the step passed it in the same direction."""
        if self.n_points < 4:
            return None
        row = before.tangent / before.scale**2
        to_origin = self._origin.y - before.y
        ahead, length = float(row @ to_origin), float(row @ (after.y - before.y))
        if not 0.0 < ahead <= length or float(row @ self._origin.tangent) <= 0.0:
            return None
        aside = np.linalg.norm((to_origin - ahead * before.tangent) / before.scale)
        if aside > 0.3 * length:
            return None
        again = self._stepper.at(before, ahead)
        if again is None or np.linalg.norm((again.y - self._origin.y) / before.scale) > 1e-6:
            return None
        length = float(np.linalg.norm((again.y - before.y) / before.scale))
        return dataclasses.replace(again, arclength=before.arclength + length)

    def _use_more_samples(self, before: Point) -> None:
        """Go back to the point before, with twice the samples of the force."""
        self.problem = self.problem.oversampled()
        floor, step, refused = self._curve.solution_floor, self._stepper.step, self._stepper.refused
        self._curve = self._new_curve()
        self._curve.solution_floor = floor
        again = finish(self._curve, before.y, before.tangent / before.scale**2, before, self.options.newton) or before
        again = dataclasses.replace(again, arclength=before.arclength)
        self._stepper = Continuation(self._curve, again, self.options)
        self._stepper.step, self._stepper.refused = step, refused

    # -- the start --------------------------------------------------------------------------------------------------

    def _first(self, at: Mapping[str, float] | None, start: Solution | ArrayLike | None) -> tuple[Array, Array]:
        """Return the converged first point and all parameter values."""
        parameters = self.problem.system.parameters
        index = parameters.index(self.name)
        given = dict(at or {})
        if isinstance(start, Solution):
            given = {**start.parameters, **given}
        given.setdefault(self.name, self.span[0])
        low, high = sorted(self.span)
        if not low <= given[self.name] <= high:
            raise ValueError(f"the start has {self.name} = {given[self.name]:g}, outside the span {self.span}")
        values = parameters.values(given)
        if isinstance(start, Solution):
            x = guess_for(self.problem, start)
            residual = float(np.max(np.abs(self.problem.assembly.residual(x, values))))
            solved = residual <= SOLVED * self.problem.assembly.term_size(x, values)
            if solved and samples_suffice(self.problem, x, values):
                return np.append(x, values[index]), values
        found = solve(self.problem, at=given, guess=start)
        assert found.problem is not None
        self.problem = found.problem
        return np.append(found.coefficients.ravel(), values[index]), values

    def _new_curve(self) -> ParameterCurve:
        return ParameterCurve(self.problem, self._values, self.name, 0.01 * abs(self.span[1] - self.span[0]))

    def _smallest_solution(self, first: Array) -> float:
        """Return the size below which changes are not measured relative to the solution: a trace may begin at rest."""
        values = self._values.copy()
        values[self.problem.system.parameters.index(self.name)] = np.mean(self.span)
        linear = linear_guess(self.problem, values)
        size = max(float(np.linalg.norm(first[:-1])), float(np.linalg.norm(linear)))
        return max(1e-6 * size, float(np.finfo(float).tiny)) if size > 0.0 else 1.0

    def _resume_from(self, resume: Branch) -> None:
        if resume.end is End.CLOSED:
            self.end = End.CLOSED
        last = np.append(resume.coefficients[-1].ravel(), resume.parameter[-1])
        size = max(self._curve.term_size(last), float(np.finfo(float).tiny))
        residual = float(np.max(np.abs(self._curve.residual(last)))) / size
        if residual > RESUMABLE_RESIDUAL:
            raise ValueError(
                f"the last point of the branch has the residual {residual:.1e} in this system, more than "
                f"{RESUMABLE_RESIDUAL:.0e}: give the system that the branch was traced with"
            )
        if len(resume) > 1:
            step = float(resume.arclength[-1] - resume.arclength[-2])
            self._stepper.step = float(np.clip(step, self.options.min_step, self.options.max_step))
            first, second = (np.append(resume.coefficients[i].ravel(), resume.parameter[i]) for i in (0, 1))
            self._origin = start_point(self._curve, first, second - first)


def _checked_span(problem: HarmonicBalance, name: str, span: tuple[float, float]) -> tuple[float, float]:
    problem.system.parameters.index(name)
    wrong = f"span = {span!r}; two finite values of {name} are needed, where to begin and where to end"
    try:
        begin, end = (float(value) for value in span)
    except (TypeError, ValueError):
        raise ValueError(wrong) from None
    if not (np.isfinite(begin) and np.isfinite(end)):
        raise ValueError(wrong)
    if begin == end:
        raise ValueError(f"span = {span!r} has no length; give two different values of {name}")
    if name == "omega" and min(begin, end) <= 0.0:
        raise ValueError(
            f"span = {span!r} reaches omega = 0, where the period is infinite; begin above, for instance at 1e-3"
        )
    return begin, end


def _check_resumable(
    problem: HarmonicBalance, name: str, at: Mapping[str, float] | None, branch: Branch, stability: Floquet | None
) -> None:
    if (branch.multipliers is None) != (stability is None):
        how, give = ("without", "stability=None") if branch.multipliers is None else ("with", "stability=Floquet()")
        raise ValueError(f"the branch was traced {how} multipliers: resume it with {give}, or trace it anew")
    if branch.name != name:
        raise ValueError(f"the branch was traced in {branch.name!r}, not in {name!r}; resume it in the same parameter")
    shape = branch.coefficients.shape[1:]
    if shape != problem.shape or branch.periods != problem.periods:
        raise ValueError(
            f"the branch has coefficients of shape {shape} and {branch.periods} period(s), the problem "
            f"{problem.shape} and "
            f"{problem.periods}: give a problem of the same system and harmonics"
        )
    if branch.parameter_names != problem.system.parameters.names:
        raise ValueError(
            f"the branch has parameters {branch.parameter_names}, the system {problem.system.parameters.names}"
        )
    for key, value in (at or {}).items():
        if key != name and branch.parameters.get(key) != value:
            raise ValueError(f"parameter {key!r} is {value!r} here but {branch.parameters.get(key)!r} on the branch")
