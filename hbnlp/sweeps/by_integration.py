"""Marching through a range of a parameter by direct integration, each response starting from the state of the last."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.callbacks import Callbacks, Observers, StopTracing, ended_by
from hbnlp.core.checks import finite_numbers, instance_of, list_of_callables, whole_number
from hbnlp.core.errors import TaskError
from hbnlp.core.types import Array, ComplexArray
from hbnlp.integration.first_order import FirstOrderForm, Method
from hbnlp.integration.response import TimeResponse
from hbnlp.integration.settling import AUTOMATIC, check_limits, initial_state, settle
from hbnlp.sweeps.time_records import TimeSweep
from hbnlp.systems.system import System

SUSPICIOUS = 0.05
"""A relative change of the response from value to value that calls for the proof whether it is a jump."""
SUDDEN = 5.0
"""A change this many times the last one calls for it, too, if it is above `VISIBLE`."""
VISIBLE = 1e-3


def march(
    system: System,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Method = AUTOMATIC,
    initial: Any = None,
    n_harmonics: int = 5,
    periods: int = 1,
    max_periods: int = 2000,
    periodic_tol: float = 1e-8,
    find_jumps: bool = True,
    callbacks: Callbacks = (),
) -> TimeSweep:
    """March through values of a parameter by direct integration, the state carried over from one to the next.

    The parameter changes where the phase tau = omega t is a multiple of 2 pi, so that the forcing has no jump in phase.

    Parameters
    ----------
    system : System
    name : str
        The parameter that is varied.
    values : array (k,)
        Its values, in the order of marching.
    at : mapping of names to values, optional
        Other parameter values that differ from the system's own.
    method : RungeKutta4 or Adaptive
        The integration method; RungeKutta4() by default, which chooses its steps for each value anew.
    initial : optional
        Where the first response starts, as in `integrate`.
    n_harmonics : int
        Harmonics of the outputs that are kept.
    periods, max_periods, periodic_tol
        As in `integrate`, for each value. A response that does not become periodic is kept and
        marked; marching goes on.
    find_jumps : bool
        Whether jumps are looked for; the proof of each costs one more integration (see `TimeSweep`).
    callbacks : sequence of callables
        Called after each value with a `Progress`.

    Returns
    -------
    TimeSweep
        Of fewer values where the response diverged, where a fixed step was no longer stable, on Ctrl-C, or where a
        callback raised `StopTracing`; ``message`` says so.

    Raises
    ------
    ValueError, KeyError
        For an unknown parameter, values that are not finite, a step that is unstable at the first value.
    TypeError
        For a system, method or callbacks of another kind.
    """
    instance_of("system", system, System, "a System")
    instance_of("method", method, Method, "RungeKutta4(...) or Adaptive(...), which march a System")
    list_of_callables("callbacks", callbacks)
    check_limits(periods, max_periods, periodic_tol)
    marched = finite_numbers("values", values)
    if name == "omega" and marched.min() <= 0.0:
        raise ValueError(f"values of omega reach {marched.min():g}; time integration needs a period, so omega > 0")
    whole_number("n_harmonics", n_harmonics, least=1)
    point = system.parameters.values(at, but=(name,))
    index = system.parameters.index(name)
    form = FirstOrderForm(system)

    def respond(value: float, state: Array) -> TimeResponse:
        there = point.copy()
        there[index] = value
        return settle(
            form, there, state, method=method, periods=periods, max_periods=max_periods, periodic_tol=periodic_tol
        )

    state = initial_state(system, initial, np.where(np.arange(point.size) == index, marched[0], point), periods)
    points: list[_Point] = []
    parameters = system.parameters.as_dict(point)
    del parameters[name]

    def result(ending: str = "under way") -> TimeSweep:
        return _time_sweep(
            points,
            system,
            name=name,
            parameters=parameters,
            n_harmonics=n_harmonics,
            periods=int(periods),
            method=repr(method),
            complete=not ending,
            message=ending or f"all {marched.size} values reached",
        )

    observers, ending = Observers(callbacks, f"integrating along {name}", name), ""
    try:
        for value in marched:
            last = next((p for p in reversed(points) if p.periodic), None)
            try:
                response = respond(float(value), state)
                if response.stopped_at is not None:
                    ending = f"ended at {name} = {value:g}: {response.message}"
                    break
                here = _point(float(value), response, n_harmonics, last, respond if find_jumps else None)
            except ValueError as error:  # a fixed step is no longer stable
                if not points:
                    raise
                ending = f"ended at {name} = {value:g}: {error}"
                break
            points.append(here)
            state = response.state
            counts = {"values": len(points), "jumps": sum(p.jumped_from is not None for p in points)}
            observers.tell(value, len(points) / marched.size, counts, result)
    except (KeyboardInterrupt, StopTracing) as stop:
        ending = f"{ended_by(stop)} after {len(points)} of {marched.size} values"
        ending += "; go on from initial=sweep.states[-1]" if points else ""
    except Exception as error:
        if not points:
            raise
        sweep = result(f"{type(error).__name__} after {len(points)} of {marched.size} values: {error}")
        observers.finish(sweep)
        raise TaskError(f"integrating along {name}", sweep, error) from error
    sweep = result(ending)
    observers.finish(sweep)
    return sweep


def _time_sweep(
    points: Sequence[_Point],
    system: System,
    *,
    name: str,
    parameters: Mapping[str, float],
    n_harmonics: int,
    periods: int,
    method: str,
    complete: bool,
    message: str,
) -> TimeSweep:
    jumps = [i for i, p in enumerate(points) if p.jumped_from is not None]
    brackets = [(points[i].jumped_from, points[i].value) for i in jumps]
    n_outputs = len(system.output_names)
    return TimeSweep(
        name=name,
        parameter=np.array([p.value for p in points]),
        amplitudes=np.array([p.amplitudes for p in points], dtype=complex).reshape(-1, n_outputs, n_harmonics + 1),
        output_names=system.output_names,
        states=np.array([p.state for p in points]).reshape(-1, system.n_state),
        periodic=np.array([p.periodic for p in points], dtype=bool),
        defects=np.array([p.defect for p in points]),
        n_periods=np.array([p.n_periods for p in points], dtype=np.int64),
        jumps=np.array(jumps, dtype=np.int64),
        jump_brackets=np.array(brackets, dtype=float).reshape(-1, 2),
        parameters=dict(parameters),
        periods=periods,
        method=method,
        complete=complete,
        message=message,
    )


class _Point(NamedTuple):
    """One response of a sweep."""

    value: float
    amplitudes: ComplexArray
    displacements: ComplexArray
    state: Array
    periodic: bool
    defect: float
    n_periods: int
    change: float
    jumped_from: float | None


def _point(
    value: float,
    response: TimeResponse,
    n_harmonics: int,
    last: _Point | None,
    respond: Callable[[float, Array], TimeResponse] | None,
) -> _Point:
    """Return what is kept of a response, compared with the ``last`` periodic one; ``respond`` is for proving a jump."""
    new, change, jumped_from = response.displacement_harmonics(n_harmonics), 0.0, None
    if last is not None and response.periodic:
        old = last.displacements
        size = max(float(np.linalg.norm(new)), float(np.linalg.norm(old)))
        change = float(np.linalg.norm(new - old)) / size if size else 0.0
        if respond and (change > SUSPICIOUS or change > max(VISIBLE, SUDDEN * last.change)):
            back = respond(last.value, response.state)
            if back.stopped_at is not None or _nearer(back.displacement_harmonics(n_harmonics), new, old):
                jumped_from = last.value
    return _Point(
        value=value,
        amplitudes=response.all_harmonics(n_harmonics),
        displacements=new,
        state=response.state,
        periodic=response.periodic,
        defect=float(response.defects[-1]),
        n_periods=response.n_periods,
        change=change,
        jumped_from=jumped_from,
    )


def _nearer(point: ComplexArray, one: ComplexArray, other: ComplexArray) -> bool:
    return bool(np.linalg.norm(point - one) < np.linalg.norm(point - other))
