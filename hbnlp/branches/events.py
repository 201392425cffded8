"""Where the user's events lie on a branch: a function of the solutions that changes its sign, or dips through zero."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.recent import Recent
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.locating import between, locate
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.point import Point
from hbnlp.core.kinds import Kind
from hbnlp.solutions.equations import Equations
from hbnlp.solutions.events import Event, EventValue


class Events:
    """Finds the events in the steps of one trace."""

    def __init__(self, events: Sequence[Event], newton: Newton) -> None:
        self._events, self._newton = tuple(events), newton
        self._known: Recent[tuple[EventValue, ...]] = Recent()

    def between(self, curve: Equations, before: Point, after: Point, index: int) -> list[SpecialPoint]:
        """Return the events in a step, in branch order; ``index`` is the number of the point before it."""
        found = []
        for number, event in enumerate(self._events):
            for base, end in self._crossings(curve, before, after, number):
                point = locate(curve, base, end, partial(self._value, curve, number), self._newton)
                found.append((end if point is None else point, point is not None, event))
        row = before.tangent / before.scale**2
        found.sort(key=lambda each: float(row @ each[0].y))
        return [
            SpecialPoint(
                kind=Kind.EVENT,
                name=curve.name,
                value=point.value,
                bracket=(before.value, after.value),
                index=index,
                refined=refined,
                solution=curve.solution(point.y, residual=point.residual),
                event=event,
                sensitivity=_sensitivity(curve, point, event) if refined else {},
            )
            for point, refined, event in found
        ]

    def alike(self, known: Point, curve: Equations, other: Point) -> bool:
        """Return whether a point, and another in its place on a curve, are on the same side of all events."""
        here = self._known.of(known)
        if here is None:
            return True
        pairs = zip(here, self._at(curve, other), strict=True)
        return all((one.value >= 0.0) == (another.value >= 0.0) for one, another in pairs)

    def _value(self, curve: Equations, number: int, point: Point) -> float:
        return self._at(curve, point)[number].value

    def _at(self, curve: Equations, point: Point) -> tuple[EventValue, ...]:
        known = self._known.of(point)
        if known is not None:
            return known
        x, p = curve.coefficients(point.y).ravel(), curve.values(point.y)
        return self._known.keep(point, tuple(event.at(curve.problem, x, p) for event in self._events))

    def _crossings(self, curve: Equations, before: Point, after: Point, number: int) -> list[tuple[Point, Point]]:
        """Return the parts of a step in which an event's function changes its sign: none, the step, or two parts.

        It may vanish twice in a step, when the cubic of its values and slopes at both ends dips through zero.
        """
        here, there = (self._at(curve, point)[number] for point in (before, after))
        if (here.value >= 0.0) != (there.value >= 0.0):
            return [(before, after)]
        length = after.arclength - before.arclength
        begin, end = (length * _slope(curve, point, at) for point, at in ((before, here), (after, there)))
        rise = there.value - here.value
        cubic = np.polynomial.Polynomial([here.value, begin, 3.0 * rise - 2.0 * begin - end, begin + end - 2.0 * rise])
        for root in cubic.deriv().roots():
            share = float(root.real)
            if root.imag or not 0.0 < share < 1.0 or (cubic(share) >= 0.0) == (here.value >= 0.0):
                continue
            middle = between(curve, before, after, share, self._newton)
            if middle is not None and (self._value(curve, number, middle) >= 0.0) != (here.value >= 0.0):
                return [(before, middle), (middle, after)]
        return []


def _slope(curve: Equations, point: Point, at: EventValue) -> float:
    """Return the derivative of an event's function along the branch."""
    by_value = at.by_p[curve.problem.system.parameters.index(curve.name)]
    return float(curve.unknowns.joined(at.by_x, [by_value]) @ point.tangent)


def _sensitivity(curve: Equations, point: Point, event: Event) -> dict[str, float]:
    """Return the derivative of an event's place on the branch by every other parameter.

    With ``w [R_x, R_lambda; e_x, e_lambda] = (0, 1)`` it is ``-w (R_q, e_q)``.
    """
    problem: HarmonicBalance = curve.problem
    x, values = curve.coefficients(point.y).ravel(), curve.values(point.y)
    own = problem.system.parameters.index(curve.name)
    at = event.at(problem, x, values)
    with np.errstate(all="ignore"):  # at the edge of a parameter's domain there is no derivative by it
        slopes = [problem.assembly.parameter_derivative(x, values, i) for i in range(at.by_p.size)]
    by_q = [np.append(slope, by_p) for slope, by_p in zip(slopes, at.by_p, strict=True)]
    matrix = np.zeros((problem.size + 1, problem.size + 1))
    problem.assembly.jacobian(x, values, matrix[:-1, :-1])
    matrix[-1, :-1], matrix[:, -1] = at.by_x, by_q[own]
    rows = np.abs(matrix).max(axis=1)
    rows[rows == 0.0] = 1.0
    try:
        w = np.linalg.solve((matrix / rows[:, None]).T, np.append(np.zeros(problem.size), 1.0)) / rows
    except np.linalg.LinAlgError:  # it touches zero there, and has no place of its own
        return {}
    names = problem.system.parameters.names
    return {name: float(-w @ by_q[i]) for i, name in enumerate(names) if i != own}
