"""A smooth line through the points of a traced curve.

A cubic a step, whose tangents are those of the cubic spline in the length along the curve: of fourth order in the step.
A curve that turns sharply from one step to the next has a corner there, and a spline ends at it. What is drawn is
interpolated as it is solved for, complex harmonics; a modulus is taken afterwards, with its corner where an amplitude
passes zero.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from hbnlp.core.types import Array

PARTS = 8
"""Straight parts that a step is drawn by."""
_SHARPEST = np.cos(np.radians(45.0))
"""A curve that turns by more from one step to the next has a corner there: the continuation refuses 14 degrees."""


class Line:
    """A curve given by its points in order, through which whatever belongs to them is interpolated.

    Parameters
    ----------
    parameters : array (n_points, n_parameters)
        Each counts by its range.
    motions : array (n_points, ...)
        Coefficients, which count together by the largest.
    """

    def __init__(self, parameters: Array, motions: Array) -> None:
        places = _places(parameters, motions)
        chords = np.diff(places, axis=0)
        self._steps = np.linalg.norm(chords, axis=1)
        self._edges = [0, *(1 + np.flatnonzero(_corners(chords, self._steps))), max(len(places) - 1, 0)]

    def __call__(self, values: Any, *, still: Any = ()) -> Any:
        """Return values (n_points, ...) at all points and between them, `PARTS` to a step.

        Parameters
        ----------
        values : array (n_points, ...), real or complex
        still : sequence of int
            Points where they are stationary along the curve, as the parameter is at a fold.
        """
        values = np.asarray(values)
        if len(values) < 2:
            return values
        fine = [values[:1]]
        for begin, end in itertools.pairwise(self._edges):
            if end > begin:
                steps = self._steps[begin:end].reshape(-1, *(1,) * (values.ndim - 1))
                stationary = [i - begin for i in still if begin <= i <= end]
                fine.append(_cubics(values[begin : end + 1], steps, stationary))
        return np.concatenate(fine)


def place_between(parameters: Array, motions: Array, parameter: Array, motion: Array) -> int:
    """Return before which point one more belongs: between the two where it is the least detour."""
    both = np.concatenate([parameters, parameter[None]]), np.concatenate([motions, motion[None]])
    *points, new = _places(*both)
    away, steps = np.linalg.norm(points - new, axis=1), np.linalg.norm(np.diff(points, axis=0), axis=1)
    return 1 + int(np.argmin(away[1:] + away[:-1] - steps)) if len(points) > 1 else len(points)


def _places(parameters: Array, motions: Array) -> Array:
    """Return the points (n_points, n) in a space where all counts alike: each parameter by its range."""
    flat = motions.reshape(len(motions), math.prod(motions.shape[1:]))
    extent = np.ptp(parameters, axis=0) if len(parameters) else np.ones(parameters.shape[1])
    size = float(np.linalg.norm(flat, axis=1).max(initial=0.0))
    return np.column_stack([parameters / np.where(extent > 0.0, extent, 1.0), flat / (size or 1.0)])


def _corners(chords: Array, steps: Array) -> Array:
    """Return which of the inner points (n_points - 2,) are corners; so are both ends of a step of no length."""
    along = np.einsum("ij,ij->i", chords[1:], chords[:-1])
    return np.asarray(along <= _SHARPEST * steps[1:] * steps[:-1])


def _cubics(values: Array, steps: Array, still: list[int]) -> Array:
    """Return what lies after the first of the values, along a part without a corner; a straight line through two."""
    change = np.diff(values, axis=0)
    first = last = change
    if len(values) > 2:
        along = np.append(0.0, np.cumsum(steps))
        tangents = CubicSpline(along, values)(along, 1)
        tangents[still] = 0.0
        first, last = steps * tangents[:-1], steps * tangents[1:]
    u = (np.arange(1, PARTS + 1) / PARTS).reshape(-1, *(1,) * (values.ndim - 1))
    bend = u * (1.0 - u) * ((1.0 - u) * (first - change)[:, None] - u * (last - change)[:, None])
    fine = values[:-1, None] + u * change[:, None] + bend
    fine[:, -1] = values[1:]
    return np.asarray(fine.reshape(-1, *values.shape[1:]))
