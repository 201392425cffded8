"""Sizes of what the structural model leaves out."""

from __future__ import annotations

import numpy as np

from hbnlp.dns.history import History
from hbnlp.dns.motion import Motion


def neglected_inertia(history: History, motion: Motion, mass_ratio: float) -> float:
    """Largest centrifugal load 2 mu alpha'^2 w, which the inertial load C_f leaves out, over the largest pressure jump.

    Parameters
    ----------
    history : History
        Record of a run with a deflected plate.
    motion : Motion
        Motion of the frame.
    mass_ratio : float
        mu.

    Returns
    -------
    float
        Ratio of the largest sine coefficients.

    Raises
    ------
    ValueError
        If the record has no deflection or no load.
    """
    if history.deflection.size == 0 or not np.any(history.coefficients):
        raise ValueError(
            "the record has no deflection or no load; a run of a Membrane or a deflected SharpPlate is needed"
        )
    rates = np.array([motion.pitch(time)[1] for time in history.time])
    centrifugal = 2.0 * mass_ratio * np.abs(rates[:, None] ** 2 * history.deflection).max()
    return float(centrifugal / np.abs(history.coefficients).max())
