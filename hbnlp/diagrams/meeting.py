"""Whether a motion is known: one of a branch, or where branches meet, up to the symmetries of the system."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from hbnlp.branches.branch import Branch
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.curve import TINY
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.kinds import Kind
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.identity import meets
from hbnlp.solutions.solution import Solution, guess_for
from hbnlp.systems.symmetry import Symmetry

CROSSED = (Kind.BRANCH_POINT, Kind.PERIOD_DOUBLING)
"""Kinds of special points at which another branch crosses."""
SMALL = 1e-2
"""Motions smaller than this part of the largest are measured relative to that part."""
SAME_PLACE = 1e-4
"""Special points are one if their motions and parameters differ by less, relative to their size."""
APART = 0.1
"""A start is on a branch if that passes it nearer than this part of its way from where it was switched."""


def is_crossed(point: SpecialPoint) -> bool:
    """Return whether another branch crosses at a special point, which is known well enough to switch there."""
    return point.kind in CROSSED and point.refined


def turns_into_image(point: SpecialPoint) -> bool:
    """Return whether a branch turns back at a special point: a pitchfork beyond which are the images of its motions."""
    before, after = (value - point.value for value in point.bracket)
    return is_crossed(point) and before * after > 0.0


def is_beside_stable(point: SpecialPoint, branch: Branch) -> bool:
    """Return whether the motions of a branch are stable before or after one of its special points."""
    assert branch.stable is not None
    return bool(branch.stable[point.index : point.index + 2].any())


def image_of(a: Solution, b: Solution, tol: float, *, floor: float = 0.0) -> Symmetry | None:
    """Return a symmetry of the system that takes one motion to another, the identity first; None if there is none."""
    assert a.problem is not None
    known = a.problem.system.symmetries_at(a.parameters)
    for symmetry in (Symmetry.identity(a.coefficients.shape[0]), *known):
        if meets(a, b, symmetry, tol, floor=floor):
            return symmetry
    return None


def place_of(point: SpecialPoint, known: Iterable[SpecialPoint], *, scale: float, size: float) -> int | None:
    """Return which of the known special points, at which branches cross, this one is; None if it is none of them.

    A doubling of one branch is a branch point of those of twice the period that begin there.

    Parameters
    ----------
    point : SpecialPoint
    known : iterable of SpecialPoint
    scale : float
        Size of the parameter.
    size : float
        Motions smaller than this are not measured relative to themselves: they may be rest.
    """
    for i, other in enumerate(known):
        if abs(point.value - other.value) > SAME_PLACE * scale:
            continue
        if image_of(point.solution, other.solution, SAME_PLACE, floor=size) is not None:
            return i
    return None


def distance_from_origin(start: Solution) -> float:
    """Return how far a start is from where it was switched, relative to its size; 1 if it was not switched."""
    if start.origin is None:
        return 1.0
    x = start.coefficients.ravel()
    size = max(float(np.linalg.norm(x)), TINY)
    return float(np.linalg.norm(guess_for(attached(start), start.origin) - x)) / size


def least_size(branches: Iterable[Branch]) -> float:
    """Return the size below which motions on branches are not measured relative to themselves."""
    sizes = [float(np.linalg.norm(branch.coefficients, axis=(1, 2)).max(initial=0.0)) for branch in branches]
    return SMALL * max(sizes, default=0.0)


def branch_through(start: Solution, branches: Sequence[Branch], tol: float) -> int | None:
    """Return which branch passes a motion or an image of it, None if none does."""
    for i, branch in enumerate(branches):
        value = start.parameters[branch.name]
        low, high = float(branch.parameter.min()), float(branch.parameter.max())
        if branch.periods != start.periods or not low <= value <= high:
            continue
        try:
            there = branch.at(value)
        except ConvergenceError:
            continue
        if any(image_of(motion, start, tol) is not None for motion in there):
            return i
    return None
