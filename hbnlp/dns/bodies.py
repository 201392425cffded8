"""What a user may put into the flow: points of closed or thin bodies, fixed or moving, and the sharp plate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from hbnlp.core.checks import (
    finite_array,
    flag,
    function_of_time,
    interval,
    list_of,
    real_number,
    refused,
    whole_number,
)
from hbnlp.core.types import Array

_MOST_POINTS = 100_000


@dataclass(frozen=True)
class Points:
    """A body that rests in the frame, by points on its surface.

    Parameters
    ----------
    positions : ndarray of shape (n, 2)
        Points, about 1 to 2 cells apart, in order along the surface.
    closed : bool
        Whether the last point is joined to the first.
    """

    positions: Array
    closed: bool = False

    def __post_init__(self) -> None:
        positions = finite_array("positions", self.positions, (None, 2))
        if len(positions) < 2:
            raise refused(ValueError, "positions", self.positions, "two points or more, of shape (n, 2)")
        flag("closed", self.closed)
        object.__setattr__(self, "positions", positions)


@dataclass(frozen=True)
class MovingPoints:
    """A rigid or deforming body that moves through the grid.

    Parameters
    ----------
    motion : callable
        ``motion(t) -> (positions, velocities)``, each of shape (n, 2).
    reach : tuple
        Rectangle ((x_low, x_high), (y_low, y_high)) that holds the body at all times, as small as may be: the response
        of the fluid on it is tabulated once.
    closed : bool
        Whether the last point is joined to the first.
    """

    motion: Callable[[float], tuple[Array, Array]]
    reach: tuple[tuple[float, float], tuple[float, float]]
    closed: bool = False

    def __post_init__(self) -> None:
        accepted = "a function of time, motion(t) -> (positions, velocities)"
        function_of_time("motion", self.motion, accepted, ((None, 2), (None, 2)))
        list_of("reach", self.reach, Sequence | np.ndarray, "two pairs, ((x_low, x_high), (y_low, y_high))")
        if len(self.reach) != 2:
            raise refused(ValueError, "reach", self.reach, "two pairs, ((x_low, x_high), (y_low, y_high))")
        for pair in self.reach:
            interval("reach", pair, advice=", for x and for y")
        flag("closed", self.closed)


Modal = Callable[[float], tuple[Array, Array]]


@dataclass(frozen=True)
class SharpPlate:
    """The infinitely thin plate from (0, 0) to (1, 0) in the frame, rigid or with a prescribed deflection.

    Parameters
    ----------
    deflection : callable, optional
        ``deflection(t) -> (W, W')``, each of shape (n_modes,), for w = sum_k W_k sin(k pi x). None is a rigid plate.
    n_modes : int
        Number of sine modes of the deflection; also of the recorded pressure-jump coefficients.
    """

    deflection: Modal | None = None
    n_modes: int = 10

    def __post_init__(self) -> None:
        size = (whole_number("n_modes", self.n_modes, least=1, most=1000),)
        if self.deflection is not None:
            function_of_time("deflection", self.deflection, "a function of time, t -> (W, W'), or None", (size, size))

    @classmethod
    def oscillating(cls, omega: float, amplitudes: Array) -> SharpPlate:
        """Deflection W_k = amplitudes[k] sin(omega t)."""
        real_number("omega", omega)
        amplitudes = finite_array("amplitudes", amplitudes, (None,))
        return cls(deflection=partial(_sine, omega, amplitudes), n_modes=amplitudes.size)


def _sine(omega: float, amplitudes: Array, time: float) -> tuple[Array, Array]:
    return amplitudes * math.sin(omega * time), amplitudes * omega * math.cos(omega * time)


Body = Points | MovingPoints | SharpPlate


def circle(
    spacing: float,
    *,
    diameter: float = 1.0,
    centre: tuple[float, float] = (0.0, 0.0),
    ratio: float = 1.5,
    retraction: float = 0.3,
) -> Points:
    """Circular cylinder by points on a circle slightly inside its surface.

    A regularised surface acts like one that lies outside its points by about 0.3 cells, an error of first order in the
    cell size, which retracting the points by as much removes (Breugem 2012, for the kernel used here).

    Parameters
    ----------
    spacing : float
        Cell size of the fine grid.
    diameter : float
        Diameter.
    centre : tuple of float
        Centre.
    ratio : float
        Distance of the points in cells.
    retraction : float
        Depth of the points below the surface in cells.

    References
    ----------
    Breugem (2012), doi:10.1016/j.jcp.2012.02.026.
    """
    for name, value in (("spacing", spacing), ("diameter", diameter), ("ratio", ratio)):
        real_number(name, value, above=0.0)
    real_number("retraction", retraction)
    finite_array("centre", centre, (2,))
    radius = 0.5 * diameter - retraction * spacing
    if not radius > spacing:
        raise ValueError(
            f"diameter = {diameter} and retraction = {retraction} cells leave a radius of {radius:.3g}, less than a "
            f"cell, spacing = {spacing}: refine the grid"
        )
    if not 2.0 * math.pi * radius / (ratio * spacing) <= _MOST_POINTS:
        raise ValueError(
            f"diameter = {diameter}, ratio = {ratio} and spacing = {spacing} make more than {_MOST_POINTS} points; "
            "give a larger spacing"
        )
    n = max(8, round(2.0 * math.pi * radius / (ratio * spacing)))
    angle = 2.0 * np.pi * np.arange(n) / n
    return Points(
        np.column_stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)]), closed=True
    )
