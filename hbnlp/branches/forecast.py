"""Whether multipliers pass the unit circle and come back within a step, forecast from those at three points.

Where two multipliers come near each other their moduli turn within a fraction of a step. Half the sum of their
logarithms, and the square of half the difference, do not: they are smooth through a meeting, at which the square
changes sign. Parabolas through these tell what the two do in between, and the points of the curve are asked then.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment, minimize_scalar

from hbnlp.core.types import Array, ComplexArray

MATTERS = 1e-3
"""Multipliers of smaller modulus are not followed from point to point."""
REACH = 1.5
"""Those whose logarithm's real part is larger than this do not come to the unit circle within a step."""
APART = 2.6
"""Two whose angles differ by more than this at one of the points do not meet: the difference has no sign near pi."""
MEETING = 1.0
"""Two whose parabola is zero nowhere within this many of its lengths, in the complex plane, do not meet: each is smooth
by itself."""
FAR = 0.3
"""A forecast that comes no nearer to the unit circle than this part of the nearer end is not looked at."""
FAR_APART, UNKNOWN = 8.0, 1e-12
"""Two that part or join, at one end by this many times the distance of the nearer one from the unit circle, are worth a
look, if less than what is forecast."""
ERROR = 0.03
"""How far the parabola through the squares of differences may be off between two points, relative to their change."""
MIDWAY = 3.0 / 64.0
"""Product of the distances to three places at equal distances, midway between two of them and relative to the outer."""
MOST_LOOKS = 4
CLOSE = 1e-5
"""Looks are no nearer to one another than this part of the step."""
INSIDE = np.linspace(0.0, 1.0, 26)[1:-1]
"""Places within a step, as parts of it, at which the forecast is made."""


class Spectrum(NamedTuple):
    """Multipliers at a place along the curve."""

    place: float
    multipliers: ComplexArray


def hidden_crossing(
    earlier: Spectrum | None,
    here: Spectrum,
    later: Spectrum,
    look: Callable[[float], ComplexArray | None],
    margin: float,
    *,
    seen: Sequence[Spectrum] = (),
) -> float | None:
    """Return a place in a step at which more multipliers are unstable than at both its ends, or fewer; None if none is.

    Parameters
    ----------
    earlier, here, later : Spectrum
        Multipliers before the step, None where there are none, and at its ends.
    look : callable
        The multipliers at a place in between; None where they cannot be had: the place is then returned as if it hid
        something.
    margin : float
        How far from the unit circle a multiplier has to be.
    seen : sequence of Spectrum
        Those that are known within the step already.
    """
    fewest, most = sorted((unstable(here.multipliers, margin), unstable(later.multipliers, margin)))
    known = sorted([here, *seen, later], key=lambda each: each.place)
    place: float | None = 0.5 * (here.place + later.place)
    if seen:
        place = _likeliest(known, later.place - here.place, margin)
    elif earlier is not None:
        expected = _forecast((earlier, here, later), here.place, margin)
        place = expected.place if expected is not None else None
    for _ in range(MOST_LOOKS):
        if place is None:
            return None
        there = look(place)
        # what is nearer to the circle than the margin is neither outside nor inside: a step that ended there would
        # begin and end with a crossing that it does not enclose
        if there is None or unstable(there, margin) > most or unstable(there, -margin) < fewest:
            return place
        known = sorted([*known, Spectrum(place, there)], key=lambda each: each.place)
        place = _likeliest(known, later.place - here.place, margin)
    return None


def _likeliest(known: Sequence[Spectrum], length: float, margin: float) -> float | None:
    """Return where between known places of a step a crossing most probably hides; None if nothing more is expected."""
    nearby = [_forecast(three, three[0].place, margin) for three in zip(known, known[1:], known[2:], strict=False)]
    expected = max((each for each in nearby if each is not None), default=None)
    if expected is None or min(abs(expected.place - each.place) for each in known) < CLOSE * length:
        return None
    return expected.place


def unstable(multipliers: ComplexArray, margin: float) -> int:
    """Return how many multipliers are beyond the unit circle by more than a margin."""
    return int(np.count_nonzero(np.abs(multipliers) > 1.0 + margin))


def on_circle(multipliers: ComplexArray, margin: float) -> int:
    """Return how many multipliers are on the unit circle but for a margin."""
    return int(np.count_nonzero(np.abs(np.abs(multipliers) - 1.0) <= margin))


def turn(here: Spectrum, there: Spectrum) -> float:
    """Return by how much the angle of a multiplier near the unit circle changes at most between two places."""
    followed = _followed((here, here, there))
    return 0.0 if followed is None else float(np.abs(np.log(followed[2] / followed[1]).imag).max(initial=0.0))


class _Expected(NamedTuple):
    """How far beyond what is worth a look a multiplier is expected to be, and where."""

    worth: float
    place: float


def _forecast(spectra: tuple[Spectrum, Spectrum, Spectrum], begin: float, margin: float) -> _Expected | None:
    """Return where two multipliers most probably are beyond the unit circle that are not at the ends of an interval.

    Or not beyond it where they are at the ends; None where that is not to be expected. The interval is that from
    ``begin``, the place of the first or second of the spectra, to the last of them.
    """
    followed = _followed(spectra)
    if followed is None:
        return None
    i, j = np.triu_indices(followed.shape[1])
    ratio = np.log(followed[:, i] / followed[:, j])
    once = (followed[1, i] + followed[1, j]).imag > -MATTERS  # conjugates tell the same
    together = once & (np.abs(ratio.imag).max(axis=0) < APART)
    if not together.any():
        return None
    places = np.array([spectrum.place for spectrum in spectra])
    i, j, square = i[together], j[together], (0.5 * ratio[:, together]) ** 2
    asked = (i == j) | (_distance_of_zero(places, square, begin) < MEETING * (places[2] - places[0]))
    i, j, square = i[asked], j[asked], square[:, asked]
    logarithms = np.log(np.abs(followed))
    mean = 0.5 * (logarithms[:, i] + logarithms[:, j])
    error = ERROR * np.abs(square - np.roll(square, 1, axis=0)).max(axis=0)
    inside = begin + INSIDE * (places[2] - begin)
    basis = _lagrange(places, inside)
    off = np.abs(np.prod(inside[:, None] - places, axis=1)) / (places[2] - places[0]) ** 3 / MIDWAY
    likely, either = basis @ square, error * off[:, None]
    known = np.abs(np.sqrt(square).real)
    ends = [0 if begin == places[0] else 1, 2]
    best = None
    for sign in (1.0, -1.0):
        at_ends = mean[ends] + sign * known[ends]
        side = np.sign(at_ends[0])
        nearer = np.abs(at_ends).min(axis=0)
        farthest = -side * sign  # the error that takes the multiplier farthest beyond the circle, as seen from the ends
        beyond = -side * (basis @ mean + sign * np.sqrt(likely + farthest * either).real)
        worth = np.minimum(beyond + FAR * nearer, beyond + nearer - 4.0 * margin).max(axis=0)
        # where two part, or join, within the step the parabola through what was before tells least
        parts = (square[ends[0]].real * square[ends[1]].real < 0.0) & (known[ends].max(axis=0) > FAR_APART * nearer)
        worth[parts & (worth <= 0.0)] = UNKNOWN
        worth[at_ends[0] * at_ends[1] <= 0.0] = -np.inf
        k = int(worth.argmax())
        if worth[k] > (best.worth if best is not None else 0.0):

            def distance(at: Array, k: int = k, sign: float = sign, side: float = side[k]) -> Array:
                rows = _lagrange(places, at)
                half = np.sqrt(rows @ square[:, k] - side * sign * error[k]).real
                return np.asarray(side * (rows @ mean[:, k] + sign * half))

            best = _Expected(float(worth[k]), _lowest(distance, inside))
    return best


def _distance_of_zero(places: Array, values: Array | ComplexArray, begin: float) -> Array:
    """Return how far the nearest zero of parabolas through values (3, n) is from an interval, in the complex plane.

    The interval is that from ``begin`` to the last of the places. A square root of the parabola is smooth within it as
    far as its zeros are away.
    """
    steps = np.diff(places)
    slopes = np.diff(values, axis=0) / steps[:, None]
    a = (slopes[1] - slopes[0]) / steps.sum()
    b, c = slopes[0] + a * steps[0], values[1]  # in the distance from the second place
    root = np.sqrt(b * b - 4.0 * a * c)
    q = -0.5 * (b + np.where((b.conj() * root).real < 0.0, -root, root))
    with np.errstate(divide="ignore", invalid="ignore"):
        zeros = np.array([q / a, c / q])
    zeros = places[1] + np.where(np.isfinite(zeros), zeros, np.where(c == 0.0, 0.0, np.inf))
    aside = np.maximum(np.maximum(begin - zeros.real, zeros.real - places[2]), 0.0)
    return np.asarray(np.hypot(aside, zeros.imag).min(axis=0))


def _lowest(function: Callable[[Array], Array], places: Array) -> float:
    """Return where a function is lowest: by its values at places in order, then between those beside the lowest."""
    k = int(np.argmin(function(places)))
    bounds = places[max(k - 1, 0)], places[min(k + 1, len(places) - 1)]
    return float(minimize_scalar(lambda place: function(np.array([place]))[0], bounds=bounds, method="bounded").x)


def _followed(spectra: tuple[Spectrum, Spectrum, Spectrum]) -> ComplexArray | None:
    """Return the multipliers near the unit circle at three points (3, n), each column those of one; None if none is."""
    known = [each.multipliers[np.abs(each.multipliers) > MATTERS] for each in spectra]
    count = min(len(each) for each in known)
    if count == 0 or not all(np.isfinite(each).all() for each in known):
        return None
    before, middle, after = (each[np.argsort(-np.abs(each), kind="stable")][:count] for each in known)
    rows = [_assigned(middle, other) for other in (before, after)]
    near = np.abs(np.log(np.abs(middle))) < REACH
    return np.array([rows[0], middle, rows[1]])[:, near]


def _assigned(multipliers: ComplexArray, others: ComplexArray) -> ComplexArray:
    """Return the others in the order of the multipliers that they are nearest to."""
    distances = np.abs(np.log(others[None, :] / multipliers[:, None]))
    return others[linear_sum_assignment(distances)[1]]


def _lagrange(nodes: Array, at: Array) -> Array:
    """Return the values (n, 3) of the three parabolas that are one at a node and zero at the others."""
    a, b, c = nodes
    return np.column_stack(
        [
            (at - b) * (at - c) / ((a - b) * (a - c)),
            (at - a) * (at - c) / ((b - a) * (b - c)),
            (at - a) * (at - b) / ((c - a) * (c - b)),
        ]
    )
