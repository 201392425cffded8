"""Columns of records whose solutions have numbers of harmonics of their own: zeros stand for those that one lacks."""

from __future__ import annotations

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import counted
from hbnlp.core.layout import Column
from hbnlp.core.types import Array, IntArray

HARMONICS = {
    "coefficients": Column("points dof 2H+1", numbers="n_harmonics", about="displacements"),
    "amplitudes": Column("points outputs H+1", complex, numbers="n_harmonics", about="outputs"),
    "n_harmonics": Column("points", int, optional=True, about="number of harmonics", units="1"),
    "truncation_error": Column(
        "points", finite=False, optional=True, about="estimated error for want of harmonics", units="1"
    ),
}
"""What is recorded of the motions along a parameter."""


def numbers_of_harmonics(column: IntArray | None, coefficients: Array) -> IntArray:
    """Return the number of harmonics of each point; a file of an earlier version says nothing, as all have as many.

    Raises
    ------
    ValueError
        If there is a number that is none of the coefficients (n_points, n_dof, 2H+1).
    """
    most = coefficients.shape[2] // 2
    if column is None:
        return np.full(len(coefficients), most)
    if np.any((column < 1) | (column > most)):
        raise ValueError(f"a point has {column.max()} or {column.min()} harmonics, the coefficients have {most}")
    return column


def check_numbers(problem: HarmonicBalance, numbers: IntArray, *, what: str) -> None:
    """Raise a ValueError if a record's solutions have several numbers of harmonics, and the problem but one."""
    several = numbers.size > 0 and numbers.min() < numbers.max()
    if several and problem.truncation is None:
        raise ValueError(
            f"the {what} has {numbers.min()} to {numbers.max()} harmonics, the problem n_harmonics = "
            f"{problem.n_harmonics} for all points: give one with a tolerance, HarmonicBalance(system, tolerance=...)"
        )


def not_met(errors: Array | None, problem: HarmonicBalance) -> str:
    """Return what is to be said of points at which the most harmonics do not do; nothing where there is none."""
    policy = problem.truncation
    if policy is None or errors is None:
        return ""
    count = np.count_nonzero(errors > policy.tolerance)
    if not count:
        return ""
    return (
        f"; {counted(int(count), 'point')} not within the tolerance {policy.tolerance:g} with most_harmonics = "
        f"{policy.most_harmonics}"
    )
