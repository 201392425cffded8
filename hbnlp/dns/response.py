"""Linear frequency response of the sharp plate from runs with small motions: one run an input, all frequencies at once.

The input is a sum of sines at multiples of the lowest frequency, of an amplitude at which the response is linear to
round-off's cube; after a settling time a period of the lowest frequency is whole in all of them, and least squares give
the complex harmonics of the loads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hbnlp.dns._types import Array
from hbnlp.dns.bodies import SharpPlate
from hbnlp.dns.flow import Callback, Simulation
from hbnlp.dns.grid import Grid
from hbnlp.dns.motion import Motion, Triple


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
    omegas = np.asarray(omegas, dtype=float)
    if omegas.size == 0 or omegas.min() <= 0.0 or np.unique(omegas).size < omegas.size:
        raise ValueError(f"omegas is {omegas.tolist()}; positive and distinct frequencies are needed")
    period = 2.0 * math.pi / omegas.min()
    step = (time[-1] - time[0]) / max(time.size - 1, 1)
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
class MultiSine:
    """Smoothly started sum of sines, with rate and acceleration.

    Parameters
    ----------
    omegas : ndarray of shape (n,)
        Frequencies.
    amplitude : float
        Amplitude of each.
    start : float
        Time at which it starts, from zero.
    ramp : float
        Duration of the start.
    """

    omegas: Array
    amplitude: float
    start: float
    ramp: float

    def __call__(self, time: float) -> Triple:
        """Value, rate and acceleration."""
        r = (time - self.start) / self.ramp
        if r <= 0.0:
            return 0.0, 0.0, 0.0
        w = self.omegas
        # Schroeder's phases keep the sum from peaking
        phase = w * (time - self.start) - math.pi * np.arange(w.size) ** 2 / w.size
        sine, cosine = np.sin(phase), np.cos(phase)
        value, rate, acceleration = sine.sum(), (w * cosine).sum(), -(w**2 * sine).sum()
        f, df, ddf = (
            (1.0, 0.0, 0.0)
            if r >= 1.0
            else (
                r**3 * (10.0 - 15.0 * r + 6.0 * r**2),
                30.0 * r**2 * (1.0 - r) ** 2 / self.ramp,
                60.0 * r * (1.0 - r) * (1.0 - 2.0 * r) / self.ramp**2,
            )
        )
        a = self.amplitude
        return (
            float(a * f * value),
            float(a * (f * rate + df * value)),
            float(a * (f * acceleration + 2.0 * df * rate + ddf * value)),
        )


@dataclass(frozen=True)
class LinearResponse:
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
        Input: pitch about the leading edge, heave, or the number k of a sine mode W_k.
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
    multiples = np.asarray(multiples)
    if periods < 1.5:
        raise ValueError(f"periods is {periods}; at least 1.5 are needed, a half to settle and one to measure")
    if not base > 0.0 or multiples.min() < 1 or not np.array_equal(multiples, np.round(multiples)):
        raise ValueError(
            f"base is {base} and multiples {multiples.tolist()}; base must be positive and the multiples whole, from 1"
        )
    period = 2.0 * math.pi / base
    per_period = math.ceil(period / (0.4 * grid.spacing if dt is None else dt))
    start, steps, step = (float(value) for value in steady["clock"])
    begin = start + steps * step
    signal = MultiSine(base * multiples, amplitude, begin, 0.25 * period)
    if isinstance(channel, int):
        if not 1 <= channel <= n_modes:
            raise ValueError(f"channel is {channel}; a sine mode between 1 and {n_modes} is accepted")
        unit = np.eye(n_modes)[channel - 1]

        def deflection(time: float) -> tuple[Array, Array]:
            value, rate, _ = signal(time)
            return value * unit, rate * unit

        body, motion = SharpPlate(deflection=deflection, n_modes=n_modes), Motion()
    elif channel in {"pitch", "heave"}:
        body, motion = SharpPlate(n_modes=n_modes), Motion(pitch=signal) if channel == "pitch" else Motion(heave=signal)
    else:
        raise ValueError(f'channel is {channel!r}; "pitch", "heave" or the number of a sine mode is accepted')
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
