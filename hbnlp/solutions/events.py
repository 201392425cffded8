"""Events of the user: a function that vanishes on a curve of solutions, an expression so that its slopes are exact."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import instance_of, refused
from hbnlp.core.types import Array

EventFunction = Callable[[HarmonicBalance], ca.MX]
"""(problem) -> an expression of ``problem.x`` and ``problem.p``, such as ``problem.amplitude_squared("x") - 1.0``."""

EXPECTED = "a function of the problem that returns an expression, such as lambda s: s.amplitude_squared('x') - 1.0"


class EventValue(NamedTuple):
    """The function of an event at a solution, and its derivatives by the coefficients and by all parameters."""

    value: float
    by_x: Array
    by_p: Array


@dataclass(frozen=True)
class Event:
    """What the user looks for along a branch: where a function of the solution vanishes.

    Attributes
    ----------
    name : str
        What it is called, as "camber 0.1".
    function : callable or None
        (problem) -> expression of ``problem.x`` and ``problem.p``. The problem is the one with the harmonics of the
        solution. None in records from files, which hold the name alone, and from other processes, to which a lambda
        cannot be sent.
    """

    name: str
    function: EventFunction | None = field(default=None, repr=False, compare=False)

    def at(self, problem: HarmonicBalance, x: Array, values: Array) -> EventValue:
        """Return the function and its slopes at a solution of a problem.

        Raises
        ------
        ValueError
            If the function is not known, or returns something other than one expression of the problem's symbols.
        """
        value, by_x, by_p = self.compiled(problem)(x, values)
        return EventValue(float(value), np.ravel(by_x.full()), np.ravel(by_p.full()))

    def compiled(self, problem: HarmonicBalance) -> ca.Function:
        """Return the CasADi function (x, p) -> value and its derivatives by both, kept by the problem."""
        compiled: ca.Function = problem.kept.get(("event", self.name, self.function), lambda: self._compile(problem))
        return compiled

    def _compile(self, problem: HarmonicBalance) -> ca.Function:
        if self.function is None:
            raise ValueError(
                f"the event {self.name!r} comes from a file or another process without its function; give it: "
                f"events={{{self.name!r}: function}} in trace and explore, event=function in follow"
            )
        x, p, what = problem.x, problem.p, f"events[{self.name!r}]"
        try:
            expression = self.function(problem)
        except Exception as error:
            raise ValueError(f"{what} raises {type(error).__name__}: {error}; give {EXPECTED}") from error
        if not isinstance(expression, ca.MX) or expression.numel() != 1:
            raise refused(ValueError, f"what {what} returns", expression, "one expression of problem.x and problem.p")
        known = ca.symvar(ca.veccat(x, p))
        foreign = [each for each in ca.symvar(expression) if not any(ca.is_equal(each, own) for own in known)]
        if foreign:
            raise ValueError(f"{what} returns an expression of {foreign[0]}, which is no symbol of the problem it gets")
        slopes = [ca.densify(ca.jacobian(expression, by)) for by in (x, p)]
        return ca.Function("event", [x, p], [ca.densify(expression), *slopes])

    def __copy__(self) -> Event:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Event:
        return self

    def __reduce__(self) -> tuple[type[Event], tuple[Any, ...]]:
        """Send the function where it can be sent: one that a module defines by its name."""
        return Event, (self.name, self.function if is_sendable(self.function) else None)


def is_sendable(function: EventFunction | None) -> bool:
    """Return whether a function can be sent to another process."""
    try:
        pickle.dumps(function)
    except (pickle.PicklingError, AttributeError, TypeError):
        return False
    return True


def events_of(functions: Mapping[str, EventFunction] | None, problem: HarmonicBalance) -> tuple[Event, ...]:
    """Return the events of the user's mapping of names to functions, once these are known to serve for a problem."""
    instance_of("events", functions, Mapping | None, "a mapping of names to functions of the problem, or None")
    for name, function in (functions or {}).items():
        if not isinstance(name, str) or not name:
            raise refused(TypeError, "a name of events", name, "a text, such as 'camber 0.1'")
        if not callable(function):
            raise refused(TypeError, f"events[{name!r}]", function, EXPECTED)
    events = tuple(Event(name, function) for name, function in (functions or {}).items())
    for event in events:
        event.compiled(problem)
    return events
