"""Small motions that a linear response is measured with, and what in the flow they drive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hbnlp.core.types import Array
from hbnlp.dns.bodies import SharpPlate
from hbnlp.dns.motion import Motion, Triple


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
class Ramp:
    """Unit step of velocity times an amplitude: at rest up to ``start``, at constant rate from then on."""

    amplitude: float
    start: float

    def __call__(self, time: float) -> Triple:
        """Value, rate and acceleration (0, as the impulse is left to the step that it falls in)."""
        elapsed = time - self.start
        return (self.amplitude * elapsed, self.amplitude, 0.0) if elapsed > 0.0 else (0.0, 0.0, 0.0)


def drive(channel: str | int, signal: Callable[[float], Triple], n_modes: int) -> tuple[SharpPlate, Motion]:
    """Plate and motion of the frame for an input of the linear response.

    Parameters
    ----------
    channel : {"pitch", "heave"} or int
        Pitch about the leading edge, heave, or the number k of a sine mode W_k.
    signal : callable
        ``signal(t) -> (value, rate, acceleration)``.
    n_modes : int
        Number of sine modes.

    Raises
    ------
    ValueError
        If there is no such input.
    """
    if isinstance(channel, int):
        if not 1 <= channel <= n_modes:
            raise ValueError(f"channel is {channel}; a sine mode between 1 and {n_modes} is accepted")
        unit = np.eye(n_modes)[channel - 1]

        def deflection(time: float) -> tuple[Array, Array]:
            value, rate, _ = signal(time)
            return value * unit, rate * unit

        return SharpPlate(deflection=deflection, n_modes=n_modes), Motion()
    if channel not in {"pitch", "heave"}:
        raise ValueError(f'channel is {channel!r}; "pitch", "heave" or the number of a sine mode is accepted')
    motion = Motion(pitch=signal) if channel == "pitch" else Motion(heave=signal)
    return SharpPlate(n_modes=n_modes), motion
