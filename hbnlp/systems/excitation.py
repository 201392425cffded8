"""Samples a forcing period by which the harmonics of a system's own excitation, forcing and motion, are found.

Sampled harmonics above half the number of samples fold back onto lower ones, unseen: whoever samples the excitation
takes the number from here.
"""

from __future__ import annotations

from hbnlp.fourier import n_coefficients

OF_FIRST_HARMONIC = 64
"""For the first harmonic alone: the linear response."""
OF_MOTION = 256
"""For every harmonic of a prescribed motion: the lag states at one instant are a sum over all of them."""


def of_harmonics(n_harmonics: int, periods: int) -> int:
    """Return the samples in ``periods`` forcing periods for harmonics retained by a balance.

    Forcing and motion are seldom evaluated: so many that their higher harmonics do not fold back.
    """
    return max(128, 8 * n_coefficients(n_harmonics) * periods)
