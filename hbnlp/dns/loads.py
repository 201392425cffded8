"""Loads of a step along and normal to the stream, and the size of what the structural model leaves out."""

from __future__ import annotations

import math

import numpy as np

from hbnlp.core.checks import instance_of, real_number
from hbnlp.core.types import Array
from hbnlp.dns.history import History, Record
from hbnlp.dns.motion import Motion
from hbnlp.dns.plate import PlateWall
from hbnlp.dns.walls import Wall


def step_record(wall: Wall, reaction: Array, time: float, pitch: float) -> Record:
    """Record of a step, before the wall accepts it.

    Parameters
    ----------
    wall : Wall
        The body.
    reaction : ndarray of shape (constraints,)
        Forces on the fluid at its constraints.
    time : float
        End of the step.
    pitch : float
        alpha of the frame in the middle of the step, to which the loads belong.
    """
    force_x, force_y = wall.force(reaction)
    c, s = math.cos(pitch), math.sin(pitch)
    jump = coefficients = deflection = rate = np.empty(0)
    if isinstance(wall, PlateWall):
        jump = wall.pressure_jump(reaction, wall.middle_slope())
        coefficients = wall.coefficients(jump)
        if wall.shape is not None:
            deflection, rate = wall.shape.estimate
    return Record(
        time,
        2.0 * (force_y * c - force_x * s),
        2.0 * (force_x * c + force_y * s),
        jump,
        coefficients,
        deflection,
        rate,
    )


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
    instance_of("history", history, History, "a History, as Simulation.run returns it")
    instance_of("motion", motion, Motion, "a Motion, such as Motion.at_incidence(degrees)")
    real_number("mass_ratio", mass_ratio, least=0.0)
    if history.deflection.size == 0 or not np.any(history.coefficients):
        raise ValueError(
            "the record has no deflection or no load; a run of a Membrane or a deflected SharpPlate is needed"
        )
    rates = np.array([motion.pitch(time)[1] for time in history.time])
    centrifugal = 2.0 * mass_ratio * np.abs(rates[:, None] ** 2 * history.deflection).max()
    return float(centrifugal / np.abs(history.coefficients).max())
