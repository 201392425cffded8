"""Direct integration of a system in time, until its response repeats itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import finite_array, flag, instance_of, list_of_callables, real_number, refused, whole_number
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.tasks import COMPLETE, UNDER_WAY, Ending, Report, drive
from hbnlp.core.types import Array
from hbnlp.fourier import to_complex
from hbnlp.integration.automatic import METHODS, automatic
from hbnlp.integration.first_order import FirstOrderForm, Method, Window
from hbnlp.integration.response import TimeResponse, respond
from hbnlp.systems.lags import lag_states_of_motion, periodic_lag_states
from hbnlp.systems.system import System

REST = 1e-6
"""A block of the state smaller than this fraction of the largest it has been is compared with that fraction instead."""


def state_of(system: System, coefficients: ArrayLike, values: ArrayLike, periods: int = 1) -> Array:
    """Return the state (q, q', x) at tau = 0 of a periodic motion given by its Fourier coefficients.

    Parameters
    ----------
    system : System
    coefficients : array (n, 2H+1)
        Of the displacements, harmonics of ``omega / periods``.
    values : array (n_parameters,)
        Parameter values in the order of ``system.parameters.names``.
    periods : int
        Length of the motion in periods of the forcing.

    Returns
    -------
    array (n_state,)
        The lag states are those of the periodic motion, ``x_h = (s - A)^-1 (B s^2 q_h + B_u s^2 u_h)``.
    """
    a = np.asarray(coefficients, dtype=float)
    if a.ndim != 2 or a.shape[0] != system.n_dof or a.shape[1] % 2 == 0:
        raise ValueError(f"coefficients have shape {a.shape}; ({system.n_dof}, 2H+1) is needed")
    point = np.asarray(values, dtype=float)
    omega = point[system.parameters.index("omega")]
    q_h = to_complex(a)
    s = 1j * omega / periods * np.arange(q_h.shape[1])
    lags = periodic_lag_states(system, s, (system.lag_input @ (s**2 * q_h)).T)
    lags += lag_states_of_motion(system, point)
    return np.concatenate([q_h.real.sum(axis=1), (s * q_h).real.sum(axis=1), lags])


def initial_state(system: System, start: Any, values: Array, periods: int) -> Array:
    """Return the state that `integrate` starts from: see there for what ``start`` may be."""
    if start is None:
        return np.zeros(system.n_state)
    if isinstance(start, TimeResponse):
        start = start.state
    elif isinstance(start, type) or callable(getattr(start, "coefficients", None)):
        raise refused(TypeError, "start", start, "a state, coefficients, a solution or a TimeResponse")
    elif hasattr(start, "coefficients"):
        its = system.parameters.of_start(getattr(start, "parameters", None) or system.parameters.as_dict(values))
        point = system.parameters.values(its)
        its_periods: int = getattr(start, "periods", 0) or getattr(getattr(start, "problem", None), "periods", 1)
        return state_of(system, start.coefficients, point, its_periods)
    state: Array = finite_array("start", start)
    if state.ndim == 2 and state.shape[0] == system.n_dof and state.shape[1] % 2:
        return state_of(system, state, values, periods)
    if state.shape != (system.n_state,):
        raise ValueError(
            f"start has shape {state.shape}; give an array of shape ({system.n_state},), (q, q', x) of {system.n_dof} "
            f"degrees of freedom and {system.n_lags} lag states, or ({system.n_dof}, 2H+1) for Fourier coefficients"
        )
    return state


@renamed_arguments(initial="start", progress="callbacks=[...]: each is called with a hbnlp.Progress")
@interrupts_kept(returns=True)
def integrate(
    system: System,
    *,
    at: Mapping[str, float] | None = None,
    method: Method | None = None,
    start: Any = None,
    periods: int = 1,
    max_periods: int = 2000,
    periodic_tol: float = 1e-8,
    throw: bool = True,
    callbacks: Callbacks = (),
) -> TimeResponse:
    """Integrate a system in time until its response repeats itself.

    Parameters
    ----------
    system : System
    at : mapping of names to values, optional
        Parameter values that differ from the system's own.
    method : RungeKutta4, ExponentialRungeKutta4 or Adaptive, optional
        The integration method; by default RungeKutta4() up to some sixteen states, ExponentialRungeKutta4() beyond, and
        where lag states decay ten times as fast as the structure moves.
    start : array (n_state,), array (n, 2H+1), solution or TimeResponse, optional
        The state (q, q', x) at tau = 0, rest by default; Fourier coefficients of the displacements (harmonics of
        ``omega / periods``), or a solution that has them as ``.coefficients``, stand for the state of their periodic
        motion (`state_of`).
    periods : int
        Periods of the forcing after which the response is expected to repeat itself, 2 for a period-doubled one.
    max_periods : int
        Periods of the forcing that are integrated at most.
    periodic_tol : float
        The response is periodic once the state changes over a window by less than this, relative to its size there; the
        larger of the values for displacements, velocities and lag states counts.
    throw : bool
        Whether a response that does not become periodic is an error.
    callbacks : sequence of callables
        Called after each window with a `Progress`, whose value is the change of the state over the window; one that
        raises `StopTracing` ends the integration there.

    Returns
    -------
    TimeResponse
        After Ctrl-C, or where a callback raised `StopTracing`, with the windows so far; ``message`` says so.

    Raises
    ------
    ConvergenceError
        If the response is not periodic after ``max_periods``, or ceases to be finite; ``.result`` is what there is.
    ValueError, KeyError
        For unknown parameters, an unstable step, a state of the wrong size.
    TypeError
        For a system, method or callbacks of another kind.
    TaskError
        If a callback fails; its ``result`` is the response so far.

    Examples
    --------
    >>> response = integrate(system, at={"omega": 1.2}, method=Adaptive(), start=[2.5, 0.0])  # doctest: +SKIP
    >>> abs(response.harmonics("x")[1])  # doctest: +SKIP
    """
    instance_of("system", system, System, "a System, such as problem.system")
    instance_of("method", method, Method | None, METHODS)
    list_of_callables("callbacks", callbacks)
    flag("throw", throw)
    check_limits(periods, max_periods, periodic_tol)
    values = system.parameters.values(at)
    state = initial_state(system, start, values, periods)
    form = FirstOrderForm(system)
    settling = Settling(
        form,
        values,
        state,
        method=automatic(form, values, state) if method is None else method,
        periods=periods,
        max_periods=max_periods,
        periodic_tol=periodic_tol,
    )
    response = drive("integrating", settling.windows(), settling.response, name="change", callbacks=callbacks)
    if throw and settling.over and not response.periodic:
        raise ConvergenceError(response.message, response)
    return response


def check_limits(periods: int, max_periods: int, periodic_tol: float) -> None:
    """Raise an error for numbers of periods or a tolerance that make no sense."""
    whole_number("periods", periods, least=1, most=10_000)
    whole_number("max_periods", max_periods, least=periods, advice=" (the number of periods)")
    real_number("periodic_tol", periodic_tol, above=0.0)


class Settling:
    """An integration window by window, until the state repeats itself: see `integrate`.

    Attributes
    ----------
    over : bool
        Whether it came to an end of its own.
    """

    def __init__(
        self,
        form: FirstOrderForm,
        values: Array,
        state: Array,
        *,
        method: Method,
        periods: int,
        max_periods: int,
        periodic_tol: float,
    ) -> None:
        self._propagate = method.propagator(form, form.pack(values), state, periods)
        self._form, self._values, self._method = form, values, method
        self._periods, self._max_periods, self._tol = periods, max_periods, periodic_tol
        self.over = False
        self._defects: list[float] = []
        self._window = Window(state[None], 0.0, 0.0, "the first window was not over")

    def windows(self) -> Iterator[Report]:
        """Integrate one window after another, and say of each how much the state changed."""
        defect_of, state = _Defect(self._form.system), self._window.states[-1]
        for _ in range(self._max_periods // self._periods):
            window = self._propagate(state)
            state = window.states[-1]
            if window.failed_at is not None:
                self._window = window
                break
            defect = defect_of(window.states)
            self._window = window
            self._defects.append(defect)
            n_periods = len(self._defects) * self._periods
            yield Report(defect, n_periods / self._max_periods, {"periods": n_periods})
            if defect <= self._tol:
                break
        self.over = True

    @property
    def remark(self) -> str:
        """What the method says of the last window."""
        return self._window.remark

    def response(self, ending: Ending = COMPLETE) -> TimeResponse:
        """Return what there is."""
        found = respond(
            self._form,
            self._values,
            method=self._method,
            periods=self._periods,
            periodic_tol=self._tol,
            window=self._window,
            defects=self._defects,
        )
        if ending in (COMPLETE, UNDER_WAY):
            return found
        advice = "; go on from start=response" if found.stopped_at is None and not found.periodic else ""
        return dataclasses.replace(found, message=ending.after(f"{found.n_periods} periods") + advice)


class _Defect:
    """The relative change of the state over a window, the largest of displacements', velocities' and lag states'."""

    def __init__(self, system: System) -> None:
        n = system.n_dof
        self._blocks = [slice(0, n), slice(n, 2 * n), slice(2 * n, None)]
        self._largest = np.zeros(3)

    def __call__(self, states: Array) -> float:
        sizes = np.array([np.linalg.norm(states[:, block], axis=1).max() for block in self._blocks])
        self._largest = np.maximum(self._largest, sizes)
        scales = np.maximum(sizes, REST * self._largest)
        change = states[-1] - states[0]
        changes = np.array([np.linalg.norm(change[block]) for block in self._blocks])
        return float(np.divide(changes, scales, out=np.zeros(3), where=scales > 0.0).max())
