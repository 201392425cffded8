"""Samples a forcing period by which the harmonics of a system's own excitation, forcing and motion, are found.

Sampled harmonics above half the number of samples fold back onto lower ones, unseen: whoever samples the excitation
takes the number from here.
"""

from __future__ import annotations

from hbnlp.fourier import n_coefficients

FIRST_HARMONIC_SAMPLES = 64
"""For the first harmonic alone, as in the linear response."""
MOTION_SAMPLES = 256
"""For all harmonics of a prescribed motion: the lag states at one instant are a sum over them."""


def excitation_samples(n_harmonics: int, periods: int) -> int:
    """Return the samples in ``periods`` forcing periods for harmonics retained by a balance.

    Forcing and motion are seldom evaluated: so many that their higher harmonics do not fold back.
    """
    return max(128, 8 * n_coefficients(n_harmonics) * periods)
