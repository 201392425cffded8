"""Whether a step is trusted or refused: the arc between its ends must be smooth, and on one branch.

The angle between the tangents at its ends is small, the chord lies between them, and the orientation of the curve is
kept, or changes at a branch point that is found on the arc; nor may the determinant have been zero twice on the way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hbnlp.continuation.along import Along
from hbnlp.continuation.branch_points import Arc, BranchPoint, branch_point_on
from hbnlp.continuation.breaking import breaking_point
from hbnlp.continuation.curve import Curve
from hbnlp.continuation.dips import Sample, crossing_in
from hbnlp.continuation.newton import Newton
from hbnlp.continuation.pencil import singular_places
from hbnlp.continuation.point import Point
from hbnlp.core.types import Array

SUSPICIOUS_LENGTH = 2e-3
"""Steps longer than this are looked at for a pair of branch points within them."""
SHORT = 3e-3
"""A longer step in which the orientation changes by no branch point is refused: the two may still come apart."""
SMOOTH = 2e-3
"""How far from the cubic through its ends a step may run, relative to its length, to be one smooth curve."""


class Verdict(NamedTuple):
    """What becomes of a step: the point that is accepted, None where it is refused, and the angle between the tangents.

    ``length`` is the step to make instead, where one is known.
    """

    point: Point | None
    turn: float
    length: float | None = None


REFUSED = Verdict(None, 0.0)


def accepted(
    curve: Curve,
    before: Point | None,
    base: Point,
    trial: Point,
    *,
    angle: float,
    newton: Newton,
    at: Callable[[float], Point | None],
) -> Verdict:
    """Return the trial point with its arclength and the branch point before it, or that the step is refused.

    Parameters
    ----------
    curve : Curve
    before, base, trial : Point
        The point before the step's beginning, where there is one; its beginning and its end.
    angle : float
        Largest angle in radians between the tangents at the ends.
    newton : Newton
    at : callable
        The point at a distance along the tangent of ``base``, None where a corrector fails.

    Returns
    -------
    Verdict
    """
    scale = base.scale
    chord = (trial.y - base.y) / scale
    length = float(np.linalg.norm(chord))
    here, there = base.tangent / scale, trial.tangent / scale
    there = there / np.linalg.norm(there)
    turn = _angle(here, there)
    middle = here + there
    aside = _angle(chord / length, middle / np.linalg.norm(middle)) if length > 0.0 else np.pi
    if turn > angle or aside > 0.3 * turn + 0.02:
        return Verdict(None, turn)
    branch_point = None
    breaks = trial.across[0] != base.across[0]
    if breaks and trial.orientation == base.orientation and length > SUSPICIOUS_LENGTH:
        return Verdict(None, turn)  # the curve is crossed in both its parts: one at a time
    if trial.orientation == base.orientation and not breaks:
        shorter = _hidden(before, base, trial, at) if length > SUSPICIOUS_LENGTH else None
        if shorter is not None:
            return Verdict(None, turn, shorter)
    else:
        branch_point = (breaking_point if breaks else _branch_point)(curve, base, trial, newton)
        if branch_point is None and not (length < SHORT and _turns_smoothly(base, trial, at)):
            return Verdict(None, turn)
    point = dataclasses.replace(trial, arclength=base.arclength + length, branch_point=branch_point)
    return Verdict(point, turn)


def _hidden(before: Point | None, base: Point, trial: Point, at: Callable[[float], Point | None]) -> float | None:
    """Return a step's length at which the determinant has another sign than at both its ends, or None.

    It shows by a dip of the determinant, where one eigenvalue crosses zero and returns, or two do close to each other;
    or by the matrices at the ends, where two eigenvalues cross one after the other.
    """
    whole = float(base.tangent / base.scale**2 @ (trial.y - base.y))

    def sample(place: float, point: Point) -> Sample:
        return Sample(place, point.orientation, point.log_determinant)

    def look(place: float) -> Sample | None:
        point = at(place)
        return sample(place, point) if point is not None else None

    earlier = None
    if before is not None:
        earlier = sample(before.arclength - base.arclength, before)
    dip = crossing_in(earlier, sample(0.0, base), sample(whole, trial), look)
    return dip if dip is not None else _between_two(base, trial, whole, look)


def _between_two(base: Point, trial: Point, whole: float, look: Callable[[float], Sample | None]) -> float | None:
    """Return a step's length that leads between two singular points of the straight way from end to end, or None."""
    if base.factors is None or trial.factors is None:
        return None
    places = singular_places(base.factors, trial.factors, base.scale)
    if len(places) < 2:
        return None
    between = 0.5 * (places[0] + places[1]) * whole
    seen = look(between)
    return between if seen is not None and seen.sign != base.orientation else None


def _turns_smoothly(base: Point, trial: Point, at: Callable[[float], Point | None]) -> bool:
    """Return whether a step past a fold follows one smooth curve, though the orientation changes and no branch crosses.

    At the common fold of identical parts the Jacobian loses as many ranks as there are parts, and the determinant as
    many signs; no single branch point is there to be found.
    """
    if base.tangent[-1] * trial.tangent[-1] >= 0.0:
        return False
    arc = Arc(base.y, trial.y, (base.tangent, trial.tangent), base.scale)
    row = base.tangent / base.scale**2
    for share in (0.25, 0.5, 0.75):
        expected = arc.at(share)
        point = at(float(row @ (expected - base.y)))
        if point is None or np.linalg.norm((point.y - expected) / base.scale) > SMOOTH * arc.length:
            return False
    return True


def _branch_point(curve: Curve, base: Point, trial: Point, newton: Newton) -> BranchPoint | None:
    """Return where the orientation changes; None if it changes by a jump and not through a singular point."""
    seen = Along(curve)
    logarithms = [point.log_determinant - point.across[1] for point in (base, trial)]
    ratio = float(np.exp(min(logarithms[1] - logarithms[0], 500.0)))
    tangents = seen.part(base.tangent), seen.part(trial.tangent)
    found = branch_point_on(
        seen,
        Arc(seen.part(base.y), seen.part(trial.y), tangents, seen.part(base.scale)),
        (base.orientation * base.across[0], trial.orientation * trial.across[0] * ratio),
        tol=newton.tol,
        max_iterations=newton.max_iterations,
    )
    return found and dataclasses.replace(found, y=seen.whole(found.y), null=seen.whole(found.null))


def _angle(a: Array, b: Array) -> float:
    """Return the angle between unit vectors, accurate when it is small."""
    return float(2.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(a - b)))))
