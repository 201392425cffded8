"""Marching through a range of a parameter by direct integration, each response starting from the state of the last."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import instance_of, list_of_callables, whole_number
from hbnlp.core.tasks import COMPLETE, INTERRUPTED, STOPPED, Ending, Report, drive
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import to_real
from hbnlp.integration.automatic import METHODS, automatic
from hbnlp.integration.first_order import FirstOrderForm, Method
from hbnlp.integration.response import TimeResponse
from hbnlp.integration.settling import Settling, check_limits, initial_state
from hbnlp.sweeps.jumps import UNKNOWN, is_suspicious, relative_change
from hbnlp.sweeps.records import TimeSweep
from hbnlp.systems.system import System


def march(
    system: System,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Method | None = None,
    start: Any = None,
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
    method : RungeKutta4, ExponentialRungeKutta4 or Adaptive, optional
        The integration method, by default as in `integrate`; steps that are not given are chosen for each value anew.
    start : optional
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
    instance_of("method", method, Method | None, f"{METHODS}, which march a System")
    list_of_callables("callbacks", callbacks)
    check_limits(periods, max_periods, periodic_tol)
    marched = system.parameters.series(name, values)
    whole_number("n_harmonics", n_harmonics, least=1, most=10_000)
    point = system.parameters.values(at, but=(name,))
    index = system.parameters.index(name)
    form = FirstOrderForm(system)
    remarks: dict[float, str] = {}

    def respond(value: float, state: Array) -> TimeResponse:
        there = point.copy()
        there[index] = value
        settling = Settling(
            form, there, state, method=chosen, periods=periods, max_periods=max_periods, periodic_tol=periodic_tol
        )
        for _ in settling.windows():
            pass
        if settling.remark:
            remarks[value] = settling.remark
        return settling.response()

    first = np.where(np.arange(point.size) == index, marched[0], point)
    state = initial_state(system, start, first, periods)
    chosen = automatic(form, first, state) if method is None else method
    points: list[_Point] = []
    parameters = system.parameters.as_dict(point)
    del parameters[name]

    broken: list[str] = []

    def result(ending: Ending) -> TimeSweep:
        return _time_sweep(
            points,
            system,
            name=name,
            parameters=parameters,
            n_harmonics=n_harmonics,
            periods=int(periods),
            method=repr(chosen),
            complete=ending is COMPLETE and not broken,
            message=broken[0] if broken else _message(ending, len(points), marched.size) + _said_of(name, remarks),
        )

    def work() -> Iterator[Report]:
        current = state
        for value in marched:
            last = next((p for p in reversed(points) if p.periodic), None)
            try:
                response = respond(float(value), current)
                if response.stopped_at is not None:
                    broken.append(f"ended at {name} = {value:g}: {response.message}")
                    return
                here = _point(float(value), response, n_harmonics, last, respond if find_jumps else None)
            except ValueError as error:  # a fixed step is no longer stable
                if not points:
                    raise
                broken.append(f"ended at {name} = {value:g}: {error}")
                return
            points.append(here)
            current = response.state
            counts = {"values": len(points), "jumps": sum(p.jumped_from is not None for p in points)}
            yield Report(value, len(points) / marched.size, counts)

    task = f"integrating along {name}"
    return drive(task, work(), result, name=name, callbacks=callbacks, warn_of=system.warn_of)


def _message(ending: Ending, n_points: int, n_values: int) -> str:
    """Return how a sweep ended, and what to do about it."""
    if ending is COMPLETE:
        return f"all {n_values} values reached"
    advice = "; go on from start=sweep.states[-1]" if n_points and ending in (INTERRUPTED, STOPPED) else ""
    return ending.after(f"{n_points} of {n_values} values") + advice


def _said_of(name: str, remarks: Mapping[float, str]) -> str:
    """Return what the method said of the last of the values at which it had something to say."""
    if not remarks:
        return ""
    last, remark = list(remarks.items())[-1]
    return f"; at {len(remarks)} of them, the last at {name} = {last:g}: {remark}"


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
        coefficients=to_real(
            np.array([p.displacements for p in points], dtype=complex).reshape(-1, system.n_dof, n_harmonics + 1)
        ),
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
        system=system,
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
    new, change, jumped_from = response.displacement_harmonics(n_harmonics), UNKNOWN, None
    if last is not None and response.periodic:
        old = last.displacements
        change = relative_change(old, new)
        if respond and is_suspicious(change, last.change):
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
