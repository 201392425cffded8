"""When two solutions are one motion, which symmetry relates two, and which of them a motion has itself.

A motion is a solution wherever it begins: shifts by whole forcing periods give the same one, and so do turns of angles
by 2 pi. Motions are compared over a common number of periods, in the harmonics that both have.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose, lcm
from typing import TYPE_CHECKING

import numpy as np

from hbnlp.continuation.curve import TINY
from hbnlp.core.checks import counted, real_number, refused
from hbnlp.core.types import Array
from hbnlp.fourier import resize, shift, stretch
from hbnlp.systems.symmetry import PERIOD, Symmetry

if TYPE_CHECKING:
    from hbnlp.solutions.solution import Solution

TOL = 1e-6
"""Motions that differ by less than this, relative to their size, are one."""
SAME_PARAMETERS = 1e-9
"""Parameters that differ by less than this, relative to their size, are one."""
KEPT = 1e-3
"""A direction that a symmetry changes by less than this keeps it."""


def same_motion(a: Solution, b: Solution, *, tol: float = TOL) -> bool:
    """Return whether two solutions are one motion, at the same parameters.

    Parameters
    ----------
    a, b : Solution
        Of any number of harmonics and periods: compared over the smallest common number of periods, in the harmonics of
        the one that has fewer, up to shifts by whole forcing periods and turns of angles by 2 pi.
    tol : float
        Largest difference of the coefficients, relative to their norm. Solutions with different numbers of harmonics
        differ by their errors of truncation.

    Raises
    ------
    ValueError, TypeError
        For a tolerance that is no positive number.
    """
    return _comparable(a, b, tol) and meets(a, b, Symmetry.identity(a.coefficients.shape[0]), tol)


def relation(a: Solution, b: Solution, *, tol: float = TOL) -> Symmetry | None:
    """Return the symmetry that takes the motion of one solution to that of another.

    Parameters
    ----------
    a, b : Solution
    tol : float
        As for `same_motion`.

    Returns
    -------
    Symmetry or None
        The identity for the same motion (``is_identity``); for a mirror image, a symmetry of the system at these
        parameters; None for other parameters and for motions that no symmetry relates. Two solutions from files know no
        system and so no symmetries: they are the same motion, or not related.

    Raises
    ------
    ValueError, TypeError
        For a tolerance that is no positive number.
    """
    if not _comparable(a, b, tol):
        return None
    problem = a.problem if a.problem is not None else b.problem
    known = problem.system.symmetries_at(a.parameters) if problem is not None else ()
    for symmetry in (Symmetry.identity(a.coefficients.shape[0]), *known):
        if meets(a, b, symmetry, tol):
            return symmetry
    return None


def meets(a: Solution, b: Solution, symmetry: Symmetry, tol: float = TOL, *, floor: float = 0.0) -> bool:
    """Return whether a symmetry takes the motion of ``a`` to that of ``b``, whatever their parameters.

    Differences are measured relative to the larger of the two, or to ``floor`` where that is larger still.
    """
    periods = lcm(a.periods, b.periods)
    one, other = (stretch(s.coefficients, periods // s.periods) for s in (a, b))
    n_harmonics = min(one.shape[1], other.shape[1]) // 2
    one, other = resize(one, n_harmonics), resize(other, n_harmonics)
    angles = _angles(a) or _angles(b)
    return any(
        _difference(moved(one, symmetry, periods, later=later), other, angles, floor) <= tol for later in range(periods)
    )


def moved(coefficients: Array, symmetry: Symmetry, periods: int, *, later: int = 0) -> Array:
    """Return the coefficients (n_dof, 2H+1), over so many periods, of ``matrix @ q(tau + shift + 2 pi later)``."""
    return np.asarray(symmetry.matrix @ shift(coefficients, (symmetry.shift + PERIOD * later) / periods))


def without_turns(coefficients: Array, angles: Sequence[int]) -> Array:
    """Return coefficients (n_dof, 2H+1) with the means of angles in (-pi, pi]."""
    turned = coefficients.copy()
    means = turned[list(angles), 0]
    turned[list(angles), 0] = means - PERIOD * np.ceil(means / PERIOD - 0.5 - TOL)
    return turned


def broken_in(solution: Solution, direction: Array, *, floor: float = 0.0) -> Symmetry | None:
    """Return the first symmetry of a motion that it loses in a direction (n_dof, 2H+1), None where it keeps all.

    A motion over several periods that repeats itself sooner may lose that: the shift by forcing periods is returned.

    Parameters
    ----------
    solution : Solution
        With its problem.
    direction : array (n_dof, 2H+1)
        At a branch point, of the other branch.
    floor : float
        Size below which the motion is not measured relative to itself: it may be rest.
    """
    n, periods, angles = direction.shape[0], solution.periods, _angles(solution)
    whole = [
        Symmetry(np.eye(n), shift=PERIOD * k, name=f"shift by {counted(k, 'forcing period')}")
        for k in range(1, periods)
    ]
    known = solution.problem.system.symmetries_at(solution.parameters) if solution.problem is not None else ()
    for symmetry in (*whole, *known):
        for later in range(periods):
            image = moved(solution.coefficients, symmetry, periods, later=later)
            if _difference(image, solution.coefficients, angles, floor) <= TOL:
                lost = moved(direction, symmetry, periods, later=later) - direction
                if float(np.linalg.norm(lost)) > KEPT * float(np.linalg.norm(direction)):
                    return symmetry
                break
    return None


def _comparable(a: Solution, b: Solution, tol: float) -> bool:
    """Return whether two solutions are of as many displacements, and at the same parameters."""
    for name, value in (("a", a), ("b", b)):
        if not hasattr(value, "coefficients") or not hasattr(value, "statistics"):
            raise refused(TypeError, name, value, "a Solution")
    real_number("tol", tol, above=0.0)
    if a.coefficients.shape[0] != b.coefficients.shape[0] or a.parameters.keys() != b.parameters.keys():
        return False
    return all(
        isclose(value, b.parameters[name], rel_tol=SAME_PARAMETERS, abs_tol=TINY)
        for name, value in a.parameters.items()
    )


def _angles(solution: Solution) -> tuple[int, ...]:
    return solution.problem.system.angles if solution.problem is not None else ()


def _difference(one: Array, other: Array, angles: Sequence[int], floor: float) -> float:
    """Return the norm of the difference of coefficients, relative to the larger's, turns of angles apart."""
    size = max(float(np.linalg.norm(without_turns(each, angles))) for each in (one, other))
    return float(np.linalg.norm(without_turns(one - other, angles))) / max(size, floor, TINY)
