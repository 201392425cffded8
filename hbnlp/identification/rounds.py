"""Rounds of assigning measurements to stable parts of a branch and fitting: see `hbnlp.identification.measured`."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.tracing import trace
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.kinds import End
from hbnlp.core.types import Array, BoolArray
from hbnlp.design.variables import Variables
from hbnlp.identification.fitting import Identification, Identified
from hbnlp.identification.measurements import Measurements
from hbnlp.identification.parts import Assignment, Part, assign, parts_of
from hbnlp.systems.parameters import OMEGA

logger = logging.getLogger(__name__)

ROUNDS = 12
REWEIGHTED = 8
"""Most fits of a round, each with the weights of the last one's residuals."""
SETTLED = 1e-2
"""Weights that change by less have settled."""
EXACT = 1e-4
"""Residuals below this part of the largest amplitude are no sign of a wrong measurement."""
MAD = 1.4826
"""Standard deviation of a normal distribution over the median of its moduli."""
AT_FOLD = 2.0
"""A measurement is at a fold where its amplitude differs from the fold's by so many standard deviations or fewer."""
AT_END = 0.02
"""A measurement this near to the end of its part, in parts of the measured range, may be what holds that end there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """What is to be identified from what, with bounds for variables, as it can be sent; see `identify`."""

    problem: HarmonicBalance
    bounds: Mapping[str, tuple[float, float]]
    measured: Measurements
    output: str
    harmonic: int
    at: Mapping[str, float]
    weights: Array
    noise: float | None
    threshold: float
    span: tuple[float, float]

    def even(self, values: Array) -> Array:
        """Return amplitudes or residuals in the units in which all have the same standard deviation, (n,)."""
        return np.asarray(np.sqrt(self.weights) * values)

    def cost(self, done: Fitted, scale: float) -> float:
        """Return the sum of the squared residuals of a fit, of wrong ones the threshold's, with this deviation."""
        return float(np.sum(np.minimum((self.even(done.found.residuals) / scale) ** 2, self.threshold**2)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """A robust fit: the last one, the assignment that it was made with, what it used, and the standard deviation."""

    found: Identified
    assignment: Assignment
    used: BoolArray
    scale: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What the rounds came to: a fit, the branch and the parts of its values, and in how many rounds, None if in no."""

    fitted: Fitted
    branch: Branch
    assignment: Assignment
    at_fold: BoolArray
    rounds: int | None


class Rounds:
    """One identification; its program is compiled once."""

    def __init__(self, task: Task) -> None:
        self._task, self._measured = task, task.measured
        self._variables = Variables(task.bounds)
        self._barred: BoolArray = np.zeros(len(task.measured), dtype=bool)
        self._program: Identification | None = None

    def until_settled(self, start: Mapping[str, float]) -> Outcome:
        """Return the fit from which on nothing changes."""
        count, done = 0, None
        assignment = self._assigned(self._traced(start)[1])
        while True:
            count += 1
            done = self._round(assignment, start if done is None else done.found.values)
            self._barred |= done.assignment.beyond & ~done.used  # its part was let reach there, and still it is wrong
            branch, parts = self._traced(done.found.values)
            assignment = self._assigned(parts)
            freed = self._freed(done, assignment)
            settled = freed is None and self._agrees(done, assignment)
            logger.info("round %d: %s, %d left out", count, done.found.values, np.count_nonzero(~done.used))
            if settled or count == ROUNDS:
                return self._outcome(done, branch, assignment, count if settled else None)
            if freed is not None:
                done = freed
                assignment = self._assigned(self._traced(done.found.values)[1])

    def _traced(self, values: Mapping[str, float]) -> tuple[Branch, list[Part]]:
        task, at = self._task, {**self._task.at, **values}
        branch = trace(task.problem, OMEGA, task.span, at=at)
        if branch.end is End.INTERRUPTED:  # a part of it is good for nothing here
            raise KeyboardInterrupt
        parts = parts_of(branch, task.output, task.harmonic)
        if not parts:
            raise ConvergenceError(f"the branch has no stable part with {at}; start with other values", branch)
        return branch, parts

    def _assigned(self, parts: list[Part]) -> Assignment:
        return assign(parts, self._measured, self._barred)

    def _round(self, assignment: Assignment, values: Mapping[str, float]) -> Fitted:
        """Return the robust fit of an assignment; one that no values can meet is given up where parts reach further."""
        try:
            return self._robust(assignment, values)
        except ConvergenceError:
            if not (assignment.beyond & ~self._barred).any():
                raise
            self._barred |= assignment.beyond
            return self._robust(assign(assignment.parts, self._measured, self._barred), values)

    def _robust(self, assignment: Assignment, values: Mapping[str, float]) -> Fitted:
        task, amplitude, starts = self._task, self._measured.amplitude, assignment.starts(self._measured)
        if self._program is None:
            points = [({OMEGA: omega}, near) for omega, near in zip(self._measured.omega, starts, strict=True)]
            self._program = Identification(self._variables, task.problem, points, task.output, harmonic=task.harmonic)
        program = self._program
        weights = self._weights(np.where(assignment.beyond, 0.0, assignment.own - amplitude))
        found = program.fit(amplitude, values, near=starts, weights=task.weights * weights, noise=task.noise)
        for _ in range(REWEIGHTED):
            before, weights = weights, self._weights(found.residuals)
            if np.abs(weights - before).max() < SETTLED:
                break
            found = program.fit(amplitude, found, weights=task.weights * weights, noise=task.noise)
        scale = self._scale(found.residuals)
        used = self._within(found.residuals, scale)
        for _ in range(REWEIGHTED):
            found = program.fit(amplitude, found, weights=task.weights * used, noise=task.noise)
            last, scale = used, max(found.noise, self._least_scale)
            used = self._within(found.residuals, scale)
            if np.array_equal(used, last):
                break
        return Fitted(found=found, assignment=assignment, used=used, scale=scale)

    @property
    def _least_scale(self) -> float:
        return EXACT * float(self._task.even(self._measured.amplitude).max())

    def _scale(self, residuals: Array) -> float:
        """Return the standard deviation of residuals, a few of which may be wrong."""
        if self._task.noise is not None:
            return self._task.noise
        n, p = residuals.size, len(self._variables.names)
        found = MAD * float(np.median(np.abs(self._task.even(residuals)))) * float(np.sqrt(n / max(n - p, 1)))
        return max(found, self._least_scale)

    def _weights(self, residuals: Array) -> Array:
        """Return the weights by which least squares have the gradient of the soft l1 loss."""
        return np.asarray(1.0 / np.sqrt(1.0 + (self._task.even(residuals) / self._scale(residuals)) ** 2))

    def _within(self, residuals: Array, scale: float) -> BoolArray:
        return np.asarray(np.abs(self._task.even(residuals)) <= self._task.threshold * scale)

    def _agrees(self, done: Fitted, again: Assignment) -> bool:
        """Whether the measurements lie on the parts that the fitted amplitudes lie on, and the wrong ones on none."""
        fitted = self._measured.amplitude + done.found.residuals
        there = Measurements(self._measured.omega, np.maximum(fitted, 0.0))
        labels = assign(again.parts, there, np.ones(len(there), dtype=bool)).labels
        same = labels[done.used] == again.labels[done.used]
        off = ~self._within(again.own - self._measured.amplitude, done.scale)
        return bool(same.all() and not again.beyond.any() and off[~done.used].all())

    def _freed(self, done: Fitted, again: Assignment) -> Fitted | None:
        """Return a better fit without a measurement that holds the end of its part where it is, if there is one.

        At a fold no values near by have a solution at its frequency: its equations, not its residual, keep the fold
        from where the others would have it.
        """
        omega, width = self._measured.omega, float(np.ptp(self._measured.omega))
        misfits = np.abs(again.amplitudes - self._measured.amplitude)
        for index in map(int, np.flatnonzero(done.used & ~self._barred)):
            part = again.parts[again.labels[index]]
            ends = min(abs(omega[index] - part.omega[0]), abs(omega[index] - part.omega[-1]))
            elsewhere = misfits[:, index].copy()
            elsewhere[again.labels[index]] = np.nan
            near = ends <= AT_END * width or done.assignment.beyond[index]
            if not near or np.isnan(elsewhere).all():
                continue
            try:
                freed = self._robust(again.relabelled(index, int(np.nanargmin(elsewhere))), done.found.values)
            except ConvergenceError:
                continue
            scale = min(done.scale, freed.scale)
            if self._task.cost(freed, scale) < self._task.cost(done, scale):
                self._barred[index] = True
                return freed
        return None

    def _outcome(self, done: Fitted, branch: Branch, again: Assignment, rounds: int | None) -> Outcome:
        """Return the outcome, with errors that do not rest on what lies at a fold, if the others suffice."""
        fitted = self._measured.amplitude + done.found.residuals
        folds = [again.parts[label].folds for label in again.labels]
        widths = AT_FOLD * done.scale / np.sqrt(self._task.weights)
        near = [any(abs(a - fold) < width for fold in own) for a, width, own in zip(fitted, widths, folds, strict=True)]
        at_fold = done.used & np.array(near)
        rest = done.used & ~at_fold
        if np.count_nonzero(rest) <= 2 * len(self._variables.names):
            at_fold = np.zeros_like(at_fold)
        elif at_fold.any():
            assert self._program is not None
            found = self._program.described(
                done.found.optimum, self._measured.amplitude, self._task.weights * rest, self._task.noise
            )
            done = Fitted(found=found, assignment=done.assignment, used=done.used, scale=done.scale)
        return Outcome(fitted=done, branch=branch, assignment=again, at_fold=at_fold, rounds=rounds)
