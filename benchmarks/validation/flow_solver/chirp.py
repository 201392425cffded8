"""Pitch whose frequency goes through a list."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Chirp:
    """Pitch amplitude sin(phase), the frequency held for some periods, then passing smoothly to the next.

    Parameters
    ----------
    amplitude : float
        Pitch amplitude, rad.
    omegas, periods : tuple
        Frequencies in turn, and how many periods each is held.
    passage : float
        Duration of the passage to the next one.
    """

    amplitude: float
    omegas: tuple[float, ...]
    periods: tuple[int, ...]
    passage: float = 4.0

    def ends(self) -> np.ndarray:
        """Times at which the holds end."""
        holds = 2.0 * math.pi * np.array(self.periods) / np.array(self.omegas)
        return np.cumsum(holds) + self.passage * np.arange(holds.size)

    def phase(self, time: np.ndarray) -> np.ndarray:
        """Phase, its rate and the rate of that, each of the shape of time, in rows."""
        rows = np.zeros((3, *np.shape(time)))
        rows[0], rows[1] = self.omegas[0] * np.asarray(time), self.omegas[0]
        for end, before, after in zip(self.ends(), self.omegas, self.omegas[1:], strict=False):
            r = np.clip((time - end) / self.passage, 0.0, 1.0)
            step = after - before
            rows[0] += step * (
                self.passage * r**4 * (2.5 - 3.0 * r + r**2) + np.maximum(time - end - self.passage, 0.0)
            )
            rows[1] += step * r**3 * (10.0 - 15.0 * r + 6.0 * r**2)
            rows[2] += step * 30.0 * r**2 * (1.0 - r) ** 2 / self.passage
        return rows

    def __call__(self, time: float) -> tuple[float, float, float]:
        """Pitch, rate and acceleration."""
        phase, rate, change = (float(row) for row in self.phase(np.asarray(time)))
        s, c = self.amplitude * math.sin(phase), self.amplitude * math.cos(phase)
        return s, rate * c, change * c - rate**2 * s
