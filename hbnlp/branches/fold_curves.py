"""Curves of folds in two parameters, and where the response changes its shape: cusps, isola births and merges."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import SpecialPoint
from hbnlp.branches.folds import FoldCurve
from hbnlp.continuation.arclength import Continuation, Point, PseudoArclength, StopContinuation, locate, start_point
from hbnlp.continuation.newton import Newton, correct
from hbnlp.core.callbacks import Callbacks, Observers, StopTracing, ended_by
from hbnlp.core.checks import instance_of, list_of_callables
from hbnlp.core.errors import ConvergenceError, TaskError
from hbnlp.core.interrupts import guarded
from hbnlp.core.kinds import FoldEvent, Kind
from hbnlp.core.storage import load_arrays, save_arrays
from hbnlp.core.types import Array
from hbnlp.solutions.solving import samples_suffice

if TYPE_CHECKING:
    from matplotlib.axes import Axes

logger = logging.getLogger(__name__)

_KIND = "fold curve"


@dataclass(frozen=True, kw_only=True, eq=False)
class FoldCurvePoint:
    """A located event: ``first`` and ``second`` are the two parameters there."""

    kind: FoldEvent
    first: float
    second: float
    coefficients: Array = field(repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class FoldBranch:
    """Folds in the plane of two parameters, in order along the curve.

    Attributes
    ----------
    names : (str, str)
        Continuation parameter of the folds, second parameter.
    first, second : array (n_points,)
    coefficients : array (n_points, n_dof, 2H+1)
    events : tuple of FoldCurvePoint
        Cusps (two folds meet), isola births (a detached branch appears as a point) and merges (it joins another
        branch).
    ends : (str, str)
        Why the curve ends, on either side.
    parameters : dict
        Values of the other parameters.
    """

    names: tuple[str, str]
    first: Array
    second: Array
    coefficients: Array
    events: tuple[FoldCurvePoint, ...]
    ends: tuple[str, str]
    parameters: Mapping[str, float]

    def __len__(self) -> int:
        return int(self.first.size)

    def of_kind(self, kind: FoldEvent) -> tuple[FoldCurvePoint, ...]:
        """Return the events of one kind."""
        return tuple(event for event in self.events if event.kind is kind)

    @property
    def cusps(self) -> tuple[FoldCurvePoint, ...]:
        """The cusps."""
        return self.of_kind(FoldEvent.CUSP)

    @property
    def isola_births(self) -> tuple[FoldCurvePoint, ...]:
        """Where a detached branch appears."""
        return self.of_kind(FoldEvent.ISOLA_BIRTH)

    @property
    def isola_merges(self) -> tuple[FoldCurvePoint, ...]:
        """Where a detached branch joins another one."""
        return self.of_kind(FoldEvent.ISOLA_MERGE)

    def plot(self, *, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the curve and its events in the plane of the two parameters; see `hbnlp.plot.plot_fold_curve`."""
        from hbnlp.plot import plot_fold_curve

        return plot_fold_curve(self, ax=ax, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the curve to one ``.npz`` file without pickle, whole or not at all."""
        arrays = {"first": self.first, "second": self.second, "coefficients": self.coefficients}
        if self.events:
            arrays["event_coefficients"] = np.array([event.coefficients for event in self.events])
        events = [{"kind": e.kind.name, "first": e.first, "second": e.second} for e in self.events]
        metadata = {"names": self.names, "ends": self.ends, "parameters": dict(self.parameters), "events": events}
        save_arrays(path, _KIND, arrays, metadata)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> FoldBranch:
        """Return the curve from a file that `save` wrote."""
        arrays, metadata = load_arrays(path, _KIND)
        events = tuple(
            FoldCurvePoint(
                kind=FoldEvent[e["kind"]],
                first=e["first"],
                second=e["second"],
                coefficients=arrays["event_coefficients"][i],
            )
            for i, e in enumerate(metadata["events"])
        )
        return cls(
            names=tuple(metadata["names"]),
            first=arrays["first"],
            second=arrays["second"],
            coefficients=arrays["coefficients"],
            events=events,
            ends=tuple(metadata["ends"]),
            parameters=metadata["parameters"],
        )

    def __repr__(self) -> str:
        def extent(values: Array) -> str:
            return f"[{values.min():.6g}, {values.max():.6g}]"

        events = ", ".join(f"{e.kind.value} at ({e.first:.8g}, {e.second:.8g})" for e in self.events) or "none"
        return (
            f"FoldBranch: {len(self)} folds, {self.names[0]} in {extent(self.first)}, {self.names[1]} in "
            f"{extent(self.second)}\n  events: {events}\n  ends: {self.ends[0]}; {self.ends[1]}"
        )


def fold_curve(
    problem: HarmonicBalance,
    fold: SpecialPoint,
    first: str,
    second: str,
    *,
    first_span: tuple[float, float] | None = None,
    second_span: tuple[float, float] | None = None,
    method: PseudoArclength | None = None,
    callbacks: Callbacks = (),
) -> FoldBranch:
    """Follow a fold in two parameters, both ways.

    Parameters
    ----------
    problem : HarmonicBalance
    fold : SpecialPoint
        A fold in ``first``, as `hbnlp.trace` finds it.
    first, second : str
        The parameters.
    first_span, second_span : (float, float), optional
        Where to stop; by default a tenth and ten times the values at the fold.
    method : PseudoArclength, optional
    callbacks : sequence of callables
        Called after each fold with a `Progress`; one that raises `StopTracing` ends the curve, as Ctrl-C does: with all
        folds so far, and ``ends`` says so.

    Returns
    -------
    FoldBranch
        ``ends`` says why it ended, on either side.

    Raises
    ------
    ConvergenceError
        If the fold does not converge in this problem.
    ValueError, KeyError
        For another special point, spans that do not hold the fold, or unknown or equal parameters.
    TypeError
        For a problem, fold, method or callbacks of another kind.
    """
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
    instance_of("fold", fold, SpecialPoint, "one fold, such as branch.folds[0]")
    instance_of("method", method, PseudoArclength | None, "PseudoArclength(...)")
    list_of_callables("callbacks", callbacks)
    if first == second:
        raise ValueError(f"first and second are both {first!r}; two different parameters are needed")
    if fold.kind is not Kind.FOLD:
        raise ValueError(f"fold is a {fold.kind.value}; a fold is needed, one of branch.folds")
    values = problem.values(fold.solution.parameters)
    while not samples_suffice(problem, problem.vector(fold.solution.coefficients), values):
        problem = problem.oversampled()
    curve = FoldCurve(problem, values, first, second)
    place = values[[curve.first, problem.system.parameters.index(second)]]
    spans = [
        _span_around(span, value, name)
        for span, value, name in zip((first_span, second_span), place, (first, second), strict=True)
    ]
    x = problem.vector(fold.solution.coefficients)
    null = (
        problem.vector(fold.null)
        if fold.null is not None
        else np.linalg.svd(problem.assembly.jacobian(x, values))[2][-1]
    )
    guess = np.concatenate([x, null / np.linalg.norm(null), place])
    unit = np.zeros(guess.size)
    unit[-1] = 1.0
    found = correct(curve, guess, unit, Newton())
    if not found.converged:
        raise ConvergenceError(
            f"the fold at {first} = {place[0]:g} does not converge in this problem: {found.reason}", found
        )
    options = method or PseudoArclength(angle=5.0, max_points=3000)
    others = {k: v for k, v in fold.solution.parameters.items() if k not in (first, second)}
    sides = [_Side(points=[found.y]), _Side(points=[found.y])]

    def result() -> FoldBranch:
        back, ahead = sides
        points = np.array([*back.points[:0:-1], *ahead.points])
        return FoldBranch(
            names=(first, second),
            first=points[:, -2],
            second=points[:, -1],
            coefficients=points[:, : problem.size].reshape(-1, *problem.shape),
            events=(*back.events[::-1], *ahead.events),
            ends=(back.end, ahead.end),
            parameters=others,
        )

    observers = Observers(callbacks, f"following a fold in {first} and {second}", second)
    try:
        for side, sign in zip(sides[::-1], (1.0, -1.0), strict=True):
            for _ in guarded(_follow(side, curve, sign * unit, spans, options)):
                counts = {"folds": sum(len(s.points) for s in sides), "events": sum(len(s.events) for s in sides)}
                observers.tell(side.points[-1][-1], 0.5 * sum(bool(s.end) for s in sides), counts, result)
            if side.end == _CLOSED:
                sides[0].end = _CLOSED
                break
    except (KeyboardInterrupt, StopTracing) as stop:
        for side in sides:
            side.end = side.end or ended_by(stop)
        logger.warning("the fold curve was %s after %d folds", ended_by(stop), sum(len(s.points) for s in sides) - 1)
    except Exception as error:
        for side in sides:
            side.end = side.end or f"{type(error).__name__}: {error}"
        observers.finish(result())
        raise TaskError(f"following a fold in {first} and {second}", result(), error) from error
    branch = result()
    observers.finish(branch)
    return branch


@dataclass
class _Side:
    """One way along a fold curve."""

    points: list[Array]
    events: list[FoldCurvePoint] = field(default_factory=list)
    end: str = ""


_CLOSED = "closed on itself"


def _span_around(span: tuple[float, float] | None, value: float, name: str) -> tuple[float, float]:
    if span is None:
        reach = 10.0 * abs(value) or 1.0
        span = (value / 10.0, reach) if value > 0.0 else (-reach, value / 10.0 if value else reach)
    if len(span) != 2:
        raise ValueError(f"the span of {name} is {span!r}; give two values, the lowest and the highest")
    low, high = sorted(span)
    if not low <= value <= high:
        raise ValueError(f"the fold lies at {name} = {value:g}, outside of {span!r}")
    return low, high


def _follow(
    side: _Side, curve: FoldCurve, toward: Array, spans: list[tuple[float, float]], options: PseudoArclength
) -> Iterator[None]:
    """Extend a side fold by fold, until it says why it ends."""
    start = start_point(curve, side.points[0], toward)
    stepper = Continuation(curve, start, options)
    while len(side.points) < options.max_points:
        before = stepper.point
        try:
            after = stepper.advance(spans[1])
        except StopContinuation as stop:
            side.end = str(stop)
            return
        event = _event(stepper, curve, before, after)
        side.events += [event] if event is not None else []
        side.points.append(after.y)
        if after.parameter in spans[1]:
            side.end = "end of the second span"
        elif not spans[0][0] < after.y[-2] < spans[0][1]:
            side.end = "end of the first span"
        elif len(side.points) > 4 and _passed(before, after, start):
            side.end = _CLOSED
        yield
        if side.end:
            return
    side.end = "reached max_points; give a larger one, PseudoArclength(max_points=...)"


def _passed(before: Point, after: Point, start: Point) -> bool:
    row = before.tangent / before.scale**2
    to_start = start.y - before.y
    ahead, length = float(row @ to_start), float(row @ (after.y - before.y))
    aside = np.linalg.norm((to_start - ahead * before.tangent) / before.scale)
    return bool(0.0 < ahead <= length and aside < 0.2 * length and row @ start.tangent > 0.0)


def _event(stepper: Continuation, curve: FoldCurve, before: Point, after: Point) -> FoldCurvePoint | None:
    """Return the event between two points: the second parameter is stationary there, at a cusp the first one, too."""
    if before.tangent[-1] * after.tangent[-1] >= 0.0:
        return None
    located = locate(stepper, before, after, lambda point: float(point.tangent[-1] / point.scale[-1]))
    if located is None:
        return None
    y, n = located.y, curve.n
    if before.tangent[-2] * after.tangent[-2] < 0.0:
        kind = FoldEvent.CUSP
    else:
        kind = FoldEvent.ISOLA_BIRTH if _is_centre(curve, y) else FoldEvent.ISOLA_MERGE
    return FoldCurvePoint(
        kind=kind, first=float(y[-2]), second=float(y[-1]), coefficients=y[:n].reshape(curve.problem.shape)
    )


def _is_centre(curve: FoldCurve, y: Array) -> bool:
    """Return whether the solutions in (x, first parameter) are an isolated point there, not a crossing of branches.

    On the two-dimensional null space of [R_x, R_lambda] the second derivative of w.R is a quadratic form: definite for
    a centre, indefinite for a crossing (Golubitsky and Schaeffer 1985, doi:10.1007/978-1-4612-5034-0).
    """
    problem, n = curve.problem, curve.n
    values, x = curve.values(y), y[:n]
    full = np.column_stack(
        [problem.assembly.jacobian(x, values), problem.assembly.parameter_derivative(x, values, curve.first)]
    )
    left, _, right = np.linalg.svd(full)
    w, plane = left[:, -1], right[-2:]
    free, along, weight = ca.MX.sym("free"), ca.MX.sym("along", n + 1), ca.MX.sym("w", n)
    symbols = ca.vertcat(*(free if i == curve.first else problem.p[i] for i in range(values.size)))
    form = ca.dot(weight, ca.substitute(problem.g, problem.p, symbols))
    unknown = ca.vertcat(problem.x, free)
    second = ca.jtimes(ca.jtimes(form, unknown, along), unknown, along)
    function = ca.Function("second", [unknown, problem.p, weight, along], [second])
    point = np.append(x, values[curve.first])

    def quadratic(direction: Array) -> float:
        return float(function(point, values, w, direction))

    a, c = quadratic(plane[0]), quadratic(plane[1])
    b = 0.25 * (quadratic(plane[0] + plane[1]) - quadratic(plane[0] - plane[1]))
    return a * c - b * b > 0.0
