"""Motion of the frame in which the grid is fixed: pitch about the origin and heave of the origin.

In the body frame the flow relative to the grid, besides that of the vorticity, has the streamfunction

    psi_b = a y - b x - alpha' (x^2 + y^2) / 2,   a = U cos(alpha) + z' sin(alpha),   b = U sin(alpha) - z' cos(alpha)

(pitch nose-up about the leading edge, heave upward; derivation in docs/dns.md). Vorticity is that of the absolute flow,
so that no fictitious force appears.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from hbnlp.core.checks import function_of_time, real_number
from hbnlp.core.types import Array
from hbnlp.dns.grid import Grid

Triple = tuple[float, float, float]


def _rest(time: float) -> Triple:
    del time
    return 0.0, 0.0, 0.0


def _held(value: float, _time: float) -> Triple:
    return value, 0.0, 0.0


def _sine(omega: float, amplitude: float, mean: float, time: float) -> Triple:
    s, c = math.sin(omega * time), math.cos(omega * time)
    return mean + amplitude * s, amplitude * omega * c, -amplitude * omega**2 * s


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Pitch and heave of the frame, as functions of time that return value, rate and acceleration.

    Parameters
    ----------
    pitch : callable
        ``pitch(t) -> (alpha, alpha', alpha'')`` in radians, nose-up positive, about the origin (the leading edge).
    heave : callable
        ``heave(t) -> (z, z', z'')`` in chords, upward positive.
    """

    pitch: Callable[[float], Triple] = field(default=_rest)
    heave: Callable[[float], Triple] = field(default=_rest)

    def __post_init__(self) -> None:
        for name, law in (("pitch", self.pitch), ("heave", self.heave)):
            function_of_time(name, law, "a function of time that returns value, rate and acceleration", ((3,),))

    @classmethod
    def at_incidence(cls, degrees: float) -> Motion:
        """Frame at rest at a fixed incidence."""
        angle = math.radians(real_number("degrees", degrees, above=-180.0, most=180.0))
        return cls(pitch=partial(_held, angle))

    @classmethod
    def sinusoidal(
        cls, omega: float, *, pitch: float = 0.0, heave: float = 0.0, mean_pitch: float = 0.0, axis: float = 0.0
    ) -> Motion:
        """Pitch mean_pitch + pitch sin(omega t) about x = axis, with heave sin(omega t) besides; radians and chords."""
        real_number("omega", omega, above=0.0, advice=" (Motion.at_incidence holds a fixed incidence)")
        for name, value in (("pitch", pitch), ("heave", heave), ("mean_pitch", mean_pitch), ("axis", axis)):
            real_number(name, value)
        return cls(
            pitch=partial(_sine, omega, pitch, mean_pitch),
            heave=partial(_sine, omega, heave + axis * pitch, axis * mean_pitch),
        )


class Background:
    """The streamfunction psi_b on the grids.

    Parameters
    ----------
    grid : Grid
        The grids.
    motion : Motion
        Motion of the frame.
    stream : float
        Velocity of the free stream, 1 by convention or 0 for fluid at rest.
    """

    def __init__(self, grid: Grid, motion: Motion, stream: float = 1.0) -> None:
        self._motion = motion
        self._stream = stream
        nodes = [grid.nodes(level) for level in range(grid.levels)]
        self._x = np.stack([x for x, _ in nodes])[:, :, None]
        self._y = np.stack([y for _, y in nodes])[:, None, :]
        self._cached: tuple[Triple, Array] | None = None

    def coefficients(self, time: float) -> Triple:
        """a, b and alpha' at a time."""
        alpha, alpha_rate, _ = self._motion.pitch(time)
        _, heave_rate, _ = self._motion.heave(time)
        c, s = math.cos(alpha), math.sin(alpha)
        return self._stream * c + heave_rate * s, self._stream * s - heave_rate * c, alpha_rate

    def levels(self, time: float) -> Array:
        """psi_b on the nodes of all levels, shape (levels, nx + 1, ny + 1); not to be written to."""
        coefficients = self.coefficients(time)
        if self._cached is None or self._cached[0] != coefficients:
            self._cached = coefficients, self._evaluate(coefficients, self._x, self._y)
        return self._cached[1]

    def fine(self, time: float, y: Array, window: tuple[slice, slice]) -> Array:
        """psi_b on a window of level-0 nodes that a map has moved to the ordinates y, of the window's shape."""
        return self._evaluate(self.coefficients(time), self._x[0, window[0]], y)

    @staticmethod
    def _evaluate(coefficients: Triple, x: Array, y: Array) -> Array:
        a, b, rate = coefficients
        along_x = -b * x - 0.5 * rate * x**2
        along_y = a * y - 0.5 * rate * y**2
        return np.asarray(along_x + along_y)
