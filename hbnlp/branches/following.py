"""Following a fold or an event in two parameters, and where the response changes its shape on the way."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.fold_curves import FIRST_SPAN, SECOND_SPAN, FoldBranch, FoldCurvePoint
from hbnlp.branches.resolution import Resolution, beside_event, beside_fold
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.branches.starting import Start
from hbnlp.continuation.arclength import PseudoArclength, Stop
from hbnlp.continuation.curve import null_vector
from hbnlp.continuation.locating import locate
from hbnlp.continuation.newton import Newton, correct
from hbnlp.continuation.point import Point, start_point
from hbnlp.continuation.walk import Walk
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import instance_of, list_of_callables, refused
from hbnlp.core.errors import ConvergenceError, SamplingError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kept import by_one_thread
from hbnlp.core.kinds import FoldEvent, Kind
from hbnlp.core.renamed import fewer_arguments, renamed_arguments
from hbnlp.core.tasks import Ending, Report, drive
from hbnlp.core.types import Array
from hbnlp.fourier import resize
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.columns import not_met
from hbnlp.solutions.conditions import NullVector
from hbnlp.solutions.equations import Equations, along_event, along_folds, along_parameter, settled
from hbnlp.solutions.events import EXPECTED, Event, EventFunction
from hbnlp.solutions.ipopt import FreeParameters
from hbnlp.systems.parameters import ParameterSet

AS_FOLLOW = "follow(fold, 'force', span=...): a fold knows its problem and its own parameter"


@renamed_arguments(
    second_span="span", first_span="limits", problem=AS_FOLLOW, fold="point", first=AS_FOLLOW, second="name"
)
@fewer_arguments(2, AS_FOLLOW)
@interrupts_kept(returns=True)
def follow(
    point: SpecialPoint,
    name: str,
    *,
    span: tuple[float, float] | None = None,
    limits: tuple[float, float] | None = None,
    event: EventFunction | None = None,
    method: PseudoArclength | None = None,
    callbacks: Callbacks = (),
) -> FoldBranch:
    """Follow a fold, or an event of the user, as a second parameter varies, both ways.

    With a tolerance each fold has as many harmonics as its place in the plane of the two parameters asks for.

    Parameters
    ----------
    point : SpecialPoint
        A fold or an event, as `hbnlp.trace` finds it; it knows its problem and its own parameter.
    name : str
        The second parameter.
    span : (float, float), optional
        Where to stop in the second parameter; by default a tenth and ten times its value at the fold.
    limits : (float, float), optional
        Where to stop in the point's own parameter; by default a tenth and ten times its value.
    event : callable, optional
        The function of an event from a file or another process, which hold its name alone.
    method : PseudoArclength, optional
    callbacks : sequence of callables
        Called after each fold with a `Progress`; one that raises `StopTracing` ends the curve, as Ctrl-C does: with all
        folds so far, and ``ends`` says so.

    Returns
    -------
    FoldBranch
        ``ends`` says why it ended, on either side; ``event`` is the name of the event that it is of.

    Raises
    ------
    ConvergenceError
        If the point does not converge in this problem.
    ValueError, KeyError
        For another special point or one without its problem, an event without its function, spans that do not hold the
        point, or a parameter that is unknown or the point's own.
    TypeError
        For a point, method or callbacks of another kind.
    """
    instance_of("point", point, SpecialPoint, "one fold, such as branch.folds[0]")
    instance_of("method", method, PseudoArclength | None, "PseudoArclength(...)")
    list_of_callables("callbacks", callbacks)
    instance_of("event", event, Callable | None, EXPECTED)
    if point.kind not in (Kind.FOLD, Kind.EVENT):
        raise ValueError(
            f"point is a {point.kind.value}; a fold or an event is needed, one of branch.folds or "
            "branch.of_kind('event')"
        )
    if event is not None:
        if point.event is None:
            raise ValueError(f"event is {event!r}, and point a {point.kind.value}, which has no function; leave it out")
        point = dataclasses.replace(point, event=Event(point.event.name, event))
    problem = attached(point, "load its branch with problem=...")
    own, index = point.name, problem.system.parameters.index
    index(name)
    if own == name:
        raise ValueError(f"name is {name!r}, the {point.kind.value}'s own parameter; give another one")
    values = problem.values(point.solution.parameters)
    place = (float(values[index(own)]), float(values[index(name)]))
    spans = [
        _span_around(what, given, value, each, point, problem.system.parameters)
        for what, given, value, each in zip(("limits", "span"), (limits, span), place, (own, name), strict=True)
    ]
    x = problem.vector(point.solution.coefficients)
    if point.event is not None:
        equations, view = along_event(problem, x, values, point.event, (own, name), spans=spans), beside_event
    else:
        equations, view = along_folds(problem, x, values, own, name, spans=spans), beside_fold
    curve, y = _on_its_curve(equations, point, place)
    options = method or PseudoArclength(angle=5.0, max_points=3000)
    resolution = Resolution(problem, options, view) if problem.truncation is not None else None
    first = start_point(curve, y, curve.unknowns.fixing_last())
    if resolution is not None:
        curve, first, *_ = resolution.start(Start(curve, first, first), spans[1])
    others = {k: v for k, v in point.solution.parameters.items() if k not in (own, name)}
    beginning = _followed(curve, first, None, resolution)
    back, ahead = _Side(folds=[beginning]), _Side(folds=[beginning])

    def result(ending: Ending) -> FoldBranch:
        folds = [*back.folds[:0:-1], *ahead.folds]
        scalars = np.array([fold.curve.unknowns.scalars(fold.y) for fold in folds])
        numbers = np.array([fold.curve.problem.n_harmonics for fold in folds])
        return FoldBranch(
            names=(own, name),
            first=scalars[:, 0],
            second=scalars[:, 1],
            coefficients=np.array([resize(fold.curve.coefficients(fold.y), numbers.max()) for fold in folds]),
            n_harmonics=numbers,
            truncation_error=_errors(folds) if resolution is not None else None,
            events=tuple(fold.event for fold in folds if fold.event is not None),
            ends=(_end(back, ending, problem), _end(ahead, ending, problem)),
            parameters=others,
            output_names=problem.system.output_names,
            event=point.event.name if point.event is not None else None,
            periods=problem.periods,
            problem=problem,
        )

    work = _both_ways(back, ahead, first, spans, options, resolution)
    return drive(f"following a {point.kind.value} in {own} and {name}", work, result, name=name, callbacks=callbacks)


def _on_its_curve(curve: Equations, point: SpecialPoint, place: tuple[float, float]) -> tuple[Equations, Array]:
    """Return a fold or event as a point of its curve, which has as many samples of the force as it takes."""
    problem = curve.problem
    x, values, added = (
        problem.vector(point.solution.coefficients),
        problem.values(point.solution.parameters),
        np.zeros(0),
    )
    if point.kind is Kind.FOLD:
        null = null_vector(problem.assembly.jacobian(x, values)) if point.null is None else problem.vector(point.null)
        added = null / np.linalg.norm(null)
    guess = curve.unknowns.joined(x, place, added)
    curve = settled(curve, guess)
    found = correct(curve, guess, curve.unknowns.fixing_last(), Newton())
    if not found.converged:
        name = curve.unknowns.free[0].name
        raise ConvergenceError(
            f"the {point.kind.value} at {name} = {place[0]:g} does not converge in this problem: {found.reason}", found
        )
    return curve, found.y


def _span_around(
    what: str,
    span: tuple[float, float] | None,
    value: float,
    name: str,
    point: SpecialPoint,
    parameters: ParameterSet,
) -> tuple[float, float]:
    if span is None:
        reach = 10.0 * abs(value) or 1.0
        span = (value / 10.0, reach) if value > 0.0 else (-reach, value / 10.0 if value else reach)
    low, high = sorted(parameters.span(name, span, what=what))
    if not low <= value <= high:
        raise refused(ValueError, what, span, f"values on both sides of the {point.kind.value}, at {name} = {value:g}")
    return low, high


class _Followed(NamedTuple):
    """A fold that was come to, its estimated error, and what happens between it and the one before."""

    curve: Equations
    y: Array
    error: float
    event: FoldCurvePoint | None


@dataclass
class _Side:
    """One way along a fold curve."""

    folds: list[_Followed]
    end: str = ""


def _both_ways(
    back: _Side,
    ahead: _Side,
    first: Point,
    spans: list[tuple[float, float]],
    options: PseudoArclength,
    resolution: Resolution | None,
) -> Iterator[Report]:
    """Extend the two sides, fold by fold, until each says why it ends; a closed curve has only one."""

    def judge(curve: Equations, _before: Point, after: Point) -> Equations | None:
        other = curve.resampled(after.y)
        return resolution.finer(curve, after) if other is None and resolution is not None else other

    sides, curve = (back, ahead), back.folds[0].curve
    of_folds = isinstance(curve.condition, NullVector)
    for side, sign in ((ahead, 1.0), (back, -1.0)):
        start = start_point(curve, first.y, sign * curve.unknowns.fixing_last())
        walk = Walk(curve, start, options, limits=spans[1], judge=judge, alike=_alike)
        for before, after in _while_sampled(side, walk):
            if walk.n_points == len(side.folds):
                side.folds.pop()  # the step to it was made again, with more harmonics
            at_limit = _at_limit(walk.curve, before, after, spans[0], options.newton)
            reached = at_limit or after
            event = _event(walk.curve, before, reached, options.newton) if of_folds else None
            side.folds.append(_followed(walk.curve, reached, event, resolution))
            if at_limit is not None:
                side.end = FIRST_SPAN
            elif walk.stop is not None:
                side.end = _words(walk.stop)
            events = sum(fold.event is not None for s in sides for fold in s.folds)
            counts = {"folds": sum(len(s.folds) for s in sides) - 1, "events": events}
            yield Report(reached.value, 0.5 * sum(bool(s.end) for s in sides), counts)
            if side.end:
                break
            fewer = resolution.coarser(walk.curve, after, walk.on) if resolution is not None else None
            if fewer is not None and _alike(after, *fewer):
                walk.go_on(*fewer)
        if walk.stop is not None:
            side.end = side.end or _words(walk.stop)
        if walk.stop is Stop.CLOSED:
            back.end = side.end
            return


def _at_limit(
    curve: Equations, before: Point, after: Point, limits: tuple[float, float], newton: Newton
) -> Point | None:
    """Return where a step comes to a limit of the first parameter, or its end if that is not found; None: nowhere."""
    first = float(curve.unknowns.scalars(after.y)[0])
    if limits[0] < first < limits[1]:
        return None
    limit = limits[0] if first <= limits[0] else limits[1]

    def beyond(point: Point) -> float:
        return float(curve.unknowns.scalars(point.y)[0]) - limit

    return locate(curve, before, after, beyond, newton) or after


def _followed(curve: Equations, point: Point, event: FoldCurvePoint | None, resolution: Resolution | None) -> _Followed:
    """Return a fold as one of the curve."""
    if resolution is None:
        return _Followed(curve, point.y, np.nan, event)
    seen = resolution.seen(curve, point)
    resolution.see(seen.curve, seen.y)
    return _Followed(curve, point.y, resolution.error(curve, point), event)


def _alike(point: Point, _other: Equations, here: Point) -> bool:
    """Return whether a fold, and the one in its place with other harmonics, are on the same side of all events."""
    return bool(np.all(np.sign(point.tangent[-2:]) == np.sign(here.tangent[-2:])))


def _errors(folds: Sequence[_Followed]) -> Array:
    return np.array([fold.error for fold in folds])


def _end(side: _Side, ending: Ending, problem: HarmonicBalance) -> str:
    return (side.end or str(ending)) + not_met(_errors(side.folds), problem)


def _while_sampled(side: _Side, walk: Walk[Equations]) -> Iterator[tuple[Point, Point]]:
    """Yield the steps of a walk; where the force would take too many samples, that is the side's end."""
    try:
        yield from walk
    except SamplingError as error:
        side.end = str(error)


def _words(stop: Stop) -> str:
    return SECOND_SPAN if stop is Stop.LIMIT else stop.value


def _event(curve: Equations, before: Point, after: Point, newton: Newton) -> FoldCurvePoint | None:
    """Return the event between two points: the second parameter is stationary there, at a cusp the first one, too."""
    if before.tangent[-1] * after.tangent[-1] >= 0.0:
        return None
    located = locate(curve, before, after, lambda point: float(point.tangent[-1] / point.scale[-1]), newton)
    if located is None:
        return None
    y = located.y
    if before.tangent[-2] * after.tangent[-2] < 0.0:
        kind = FoldEvent.CUSP
    else:
        kind = FoldEvent.ISOLA_BIRTH if _is_centre(curve, y) else FoldEvent.ISOLA_MERGE
    first, second = curve.unknowns.scalars(y)
    return FoldCurvePoint(kind=kind, first=float(first), second=float(second), coefficients=curve.coefficients(y))


def _is_centre(curve: Equations, y: Array) -> bool:
    """Return whether the solutions in (x, first parameter) are an isolated point there, not a crossing of branches.

    On the two-dimensional null space of [R_x, R_lambda] the second derivative of w.R is a quadratic form: definite for
    a centre, indefinite for a crossing (Golubitsky and Schaeffer 1985, doi:10.1007/978-1-4612-5034-0).
    """
    problem, n = curve.problem, curve.problem.size
    values, name = curve.values(y), curve.unknowns.free[0].name
    assert name is not None
    along_first = along_parameter(problem, values, name)
    point = along_first.point(curve.coefficients(y), float(curve.unknowns.scalars(y)[0]))
    full, scale = np.zeros((n, n + 1)), along_first.scale(point)
    along_first.jacobian(point, full)
    left, _, right = np.linalg.svd(full * scale)
    w, plane = left[:, -1], right[-2:] * scale
    function = _second_derivative(problem, name)

    def quadratic(direction: Array) -> float:
        return float(function(point, values, w, direction))

    a, c = quadratic(plane[0]), quadratic(plane[1])
    b = 0.25 * (quadratic(plane[0] + plane[1]) - quadratic(plane[0] - plane[1]))
    return a * c - b * b > 0.0


@by_one_thread
def _second_derivative(problem: HarmonicBalance, name: str) -> ca.Function:
    """Return the function (unknowns and a free parameter, p, weight, direction) -> d^2 (weight . R), twice along it."""
    n = problem.size
    along, weight, substituted = ca.MX.sym("along", n + 1), ca.MX.sym("w", n), FreeParameters(problem, [name])
    form, unknowns = ca.dot(weight, substituted(problem.g)), substituted.unknowns
    second = ca.jtimes(ca.jtimes(form, unknowns, along), unknowns, along)
    return ca.Function("second", [unknowns, problem.p, weight, along], [second])
