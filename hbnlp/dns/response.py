"""Linear frequency response of the sharp plate from runs with small motions: one run an input, all frequencies at once.

The input is a sum of sines at multiples of the lowest frequency, of an amplitude at which the response is linear to
round-off's cube; after a settling time a period of the lowest frequency is whole in all of them, and least squares give
the complex harmonics of the loads.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbnlp.core.checks import finite_array, instance_of, real_number, refused, whole_number
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array
from hbnlp.dns.flow import Callback, Simulation
from hbnlp.dns.grid import Grid
from hbnlp.dns.signals import MultiSine, Ramp, drive


def harmonics(time: Array, values: Array, omegas: Array) -> Array:
    """Complex harmonics a - i b of a(w) cos(w t) + b(w) sin(w t), by least squares together with a mean.

    Parameters
    ----------
    time : ndarray of shape (steps,)
        Times.
    values : ndarray of shape (steps, ...)
        Signals.
    omegas : ndarray of shape (n,)
        Frequencies.

    Returns
    -------
    ndarray of shape (n, ...)
        Complex amplitudes, time factor exp(+i w t).

    Raises
    ------
    ValueError
        If the record is shorter than a period of the lowest frequency, or the frequencies are not positive and
        distinct.
    """
    time, values, omegas = (
        finite_array("time", time, (None,)),
        finite_array("values", values),
        finite_array("omegas", omegas, (None,)),
    )
    if values.shape[:1] != time.shape:
        raise ValueError(f"values has shape {values.shape}; give an array of shape ({time.size}, ...), one row a time")
    if omegas.size == 0 or omegas.min() <= 0.0 or np.unique(omegas).size < omegas.size:
        raise ValueError(f"omegas is {omegas.tolist()}; positive and distinct frequencies are needed")
    if not np.all(np.diff(time) > 0.0):
        raise refused(ValueError, "time", time, "rising times")
    period = 2.0 * math.pi / omegas.min()
    step = (time[-1] - time[0]) / max(time.size - 1, 1)
    if omegas.max() * step >= math.pi:
        raise refused(ValueError, "omegas", omegas, f"frequencies below {math.pi / step:.4g}: two samples a period")
    if time.size < 2 or time.size * step < period * (1.0 - 1e-6) - step:
        raise ValueError(
            f"the record lasts {time.size * step:.4g}; one period of the lowest frequency, "
            f"{period:.4g}, is needed: run longer"
        )
    phase = np.outer(time, omegas)
    basis = np.hstack([np.ones((time.size, 1)), np.cos(phase), np.sin(phase)])
    flat = values.reshape(time.size, -1)
    fitted = np.linalg.lstsq(basis, flat, rcond=None)[0]
    n = omegas.size
    return np.asarray((fitted[1 : n + 1] - 1j * fitted[n + 1 :]).reshape(n, *values.shape[1:]))


@dataclass(frozen=True)
class LinearResponse(ReadOnlyArrays):
    """One column of G(i w), motion to load.

    Parameters
    ----------
    omega : ndarray of shape (n,)
        Frequencies.
    lift : ndarray of shape (n,), complex
        C_L per unit of the input.
    coefficients : ndarray of shape (n, n_modes), complex
        dCp_k per unit of the input.
    drift : float
        Change of the column from a window a quarter period earlier to the measured one, relative to its norm, the
        largest over the frequencies: what is left of the start.
    """

    omega: Array
    lift: Array
    coefficients: Array
    drift: float


def linear_response(
    grid: Grid,
    channel: str | int,
    multiples: Array,
    *,
    base: float,
    steady: dict[str, Array],
    reynolds: float = 100.0,
    dt: float | None = None,
    n_modes: int = 10,
    amplitude: float = 1e-5,
    periods: float = 1.5,
    callback: Callback | None = None,
) -> LinearResponse:
    """Measure one column of G(i w) about a steady flow at zero incidence.

    Parameters
    ----------
    grid : Grid
        Grid around the plate.
    channel : {"pitch", "heave"} or int
        Input; see `signals.drive`.
    multiples : ndarray of int, shape (n,)
        Frequencies as multiples of ``base``.
    base : float
        Lowest common frequency.
    steady : dict
        State (`Simulation.state`) of the rigid plate in steady flow on the same grid.
    reynolds, dt : float
        As for `Simulation`; dt is shortened to divide the period.
    n_modes : int
        Number of sine coefficients.
    amplitude : float
        Amplitude of each sine.
    periods : float
        Periods of ``base`` to run, at least 1.5; the input starts during the first quarter, the last period is
        evaluated.
    callback : callable, optional
        As for `Simulation.run`.

    Raises
    ------
    ValueError
        If the channel is unknown or a number is out of range.
    """
    multiples = finite_array("multiples", multiples, (None,))
    if not multiples.size or multiples.min() < 1 or not np.array_equal(multiples, np.round(multiples)):
        raise refused(ValueError, "multiples", multiples, "whole numbers from 1 on")
    real_number("base", base, above=0.0)
    real_number("periods", periods, least=1.5, advice=", a half to settle and one to measure")
    _check_run(grid, channel, steady, reynolds=reynolds, dt=dt, n_modes=n_modes, amplitude=amplitude, callback=callback)
    period = 2.0 * math.pi / base
    per_period = math.ceil(period / (0.4 * grid.spacing if dt is None else dt))
    if per_period < 4 * multiples.max():
        raise refused(ValueError, "base", base, f"a frequency whose multiples dt = {dt} resolves, or a smaller dt")
    begin = _time_of(steady)
    signal = MultiSine(base * multiples, amplitude, begin, 0.25 * period)
    body, motion = drive(channel, signal, n_modes)
    simulation = Simulation(grid, body, reynolds=reynolds, dt=period / per_period, motion=motion)
    simulation.restore(steady)
    history = simulation.run(begin + periods * period, callback=callback)
    loads = np.column_stack([history.lift, history.coefficients])
    given = np.array([signal(time)[0] for time in history.load_time])
    columns = []
    for earlier in (0, per_period // 4):
        rows = slice(len(history.time) - per_period - earlier, len(history.time) - earlier)
        time = history.load_time[rows]
        columns.append(
            harmonics(time, loads[rows], signal.omegas) / harmonics(time, given[rows], signal.omegas)[:, None]
        )
    change = np.linalg.norm(columns[0] - columns[1], axis=1) / np.linalg.norm(columns[0], axis=1)
    return LinearResponse(signal.omegas, columns[0][:, 0], columns[0][:, 1:], float(change.max()))


@dataclass(frozen=True)
class StepResponse(ReadOnlyArrays):
    """Loads after a unit step of velocity in one input, as the eigensystem realisation takes them.

    Parameters
    ----------
    time : ndarray of shape (steps,)
        Time since the velocity step, uniform.
    loads : ndarray of shape (steps, n_modes + 1)
        (C_L, dCp_1 .. dCp_n) per unit of velocity.
    impulse : ndarray of shape (n_modes + 1,)
        Time integral of the loads over the step in which the velocity jumps: the added mass.
    """

    time: Array
    loads: Array
    impulse: Array


def step_response(
    grid: Grid,
    channel: str | int,
    duration: float,
    *,
    steady: dict[str, Array],
    reynolds: float = 100.0,
    dt: float | None = None,
    n_modes: int = 10,
    amplitude: float = 1e-6,
    callback: Callback | None = None,
) -> StepResponse:
    """Measure the loads after a unit step of velocity about a steady flow at zero incidence.

    Parameters
    ----------
    grid, channel, steady, reynolds, n_modes, callback
        As for `linear_response`.
    duration : float
        Length of the record.
    dt : float, optional
        Time step; default 0.3 of the cell size.
    amplitude : float
        Velocity; times the duration the displacement reached, which must stay small.

    Raises
    ------
    ValueError
        If the channel is unknown or the duration is not positive.
    """
    real_number("duration", duration, above=0.0)
    _check_run(grid, channel, steady, reynolds=reynolds, dt=dt, n_modes=n_modes, amplitude=amplitude, callback=callback)
    begin = _time_of(steady)
    body, motion = drive(channel, Ramp(amplitude, begin), n_modes)
    simulation = Simulation(grid, body, reynolds=reynolds, dt=dt, motion=motion)
    simulation.restore(steady)
    history = simulation.run(begin + duration, callback=callback)
    loads = np.column_stack([history.lift, history.coefficients]) / amplitude
    return StepResponse(history.load_time[1:] - begin, loads[1:], loads[0] * simulation.dt)


def _check_run(
    grid: Any, channel: Any, steady: Any, *, reynolds: Any, dt: Any, n_modes: Any, amplitude: Any, callback: Any
) -> None:
    instance_of("grid", grid, Grid, "a Grid, such as Grid.around_plate()")
    whole_number("n_modes", n_modes, least=1, most=1000)
    real_number("amplitude", amplitude, above=0.0, below=1.0)
    if not isinstance(channel, str) or channel not in ("pitch", "heave"):
        whole_number("channel", channel, least=1, most=n_modes, advice=", a mode, or 'pitch' or 'heave'")
    real_number("reynolds", reynolds, above=0.0)
    if dt is not None:
        real_number("dt", dt, above=0.0)
    instance_of("callback", callback, Callable | None, "a function of the simulation, or dns.together(...)")
    if not isinstance(steady, dict) or "clock" not in steady:
        raise refused(TypeError, "steady", steady, "the state of a steady flow, simulation.state()")


def _time_of(state: dict[str, Array]) -> float:
    start, steps, step = (float(value) for value in state["clock"])
    return start + steps * step
