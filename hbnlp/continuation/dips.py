"""Whether a function of the points of a curve, of one sign at both ends of a step, was zero twice within it.

Such a pair of zeros shows by a dip between them: a parabola through three samples tells where it may be, and the
function is looked at there, and again at the bottom of the parabola through the new sample, until the sign has changed
or the bottom is reached.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

LOW = 0.6
"""A parabola that falls below this part of the smaller end is a dip worth a look."""
NEAR = 0.02
"""So is one that falls below this part of the largest sample: an end of the step may be near the bottom itself."""
NO_DIP = -0.3
"""Logarithm of the part of the smaller end above which what is seen is no dip at all."""
BOTTOM, LAST = 0.5, 0.98
"""A dip whose parabola leads no lower than this part of what was found there has been seen to its bottom; where that is
near zero, the latter part."""
MOST_LOOKS = 6
AHEAD = 0.1
"""How far beyond the step, relative to its length, the bottom of the parabola may lie."""
WITHIN = 0.005
"""Looks are no nearer to the ends of the step than this part of it."""


class Sample(NamedTuple):
    """A function's value at a place along the curve, by its sign and the logarithm of its modulus."""

    place: float
    sign: float
    logarithm: float


def crossing_in(
    earlier: Sample | None, here: Sample, later: Sample, look: Callable[[float], Sample | None]
) -> float | None:
    """Return a place between two samples of one sign where the function has the other, or None if it has not.

    Parameters
    ----------
    earlier, here, later : Sample
        A sample before the step, and those at its ends. It may be None, or lie on the step where that is made again.
    look : callable
        The sample at a place in between; None where it cannot be had: the place is then returned as if it were one.
    """
    length, inner = later.place - here.place, [here, later]
    if earlier is None or earlier.place >= here.place:
        place: float | None = here.place + 0.5 * length
    else:
        place = _bottom((earlier, here, later), here, later)
    for _ in range(MOST_LOOKS):
        if place is None:
            return None
        seen = look(place)
        if seen is None or seen.sign != here.sign:
            return place
        near = seen.logarithm < max(here.logarithm, later.logarithm) + np.log(NEAR)
        if not near and seen.logarithm > min(here.logarithm, later.logarithm) + NO_DIP:
            return None
        # the three samples next to the bottom: the looks close in on it
        inner = sorted([*inner, seen])
        k = min(max(inner.index(min(inner, key=lambda sample: sample.logarithm)), 1), len(inner) - 2)
        following = _bottom((inner[k - 1], inner[k], inner[k + 1]), here, later, seen)
        place = following if following is not None and following != place else None
    return None


def _bottom(
    samples: tuple[Sample, Sample, Sample], begin: Sample, end: Sample, seen: Sample | None = None
) -> float | None:
    """Return where the parabola through three samples is lowest in a step; None if that is not low, or outside."""
    reference = max(sample.logarithm for sample in samples)
    x = np.array([sample.place for sample in samples])
    if x[0] == x[1] or x[1] == x[2]:  # it is looked at there a second time
        return None
    values = np.array([s.sign * begin.sign * np.exp(s.logarithm - reference) for s in samples])
    slopes = np.diff(values) / np.diff(x)
    curvature = (slopes[1] - slopes[0]) / (x[2] - x[0])
    if not curvature > 0.0:
        return None
    place = 0.5 * (x[0] + x[1]) - 0.5 * slopes[0] / curvature
    length = end.place - begin.place
    if not begin.place < place < end.place + AHEAD * length:
        return None
    lowest = values[0] + (place - x[0]) * (slopes[0] + curvature * (place - x[1]))
    if seen is None:
        bound = max(LOW * np.exp(min(begin.logarithm, end.logarithm) - reference), NEAR)
    else:
        known = float(np.exp(seen.logarithm - reference))
        bound = known * (LAST if known < NEAR else BOTTOM)
    if lowest > bound:
        return None
    return float(np.clip(place, begin.place + WITHIN * length, end.place - WITHIN * length))
