"""Sizes of motions by which others are measured where there is nothing to measure them by: at rest."""

from __future__ import annotations

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.types import Array

LEAVES = 1e-2
"""Part of the linear terms that the curved ones are where a motion is said to be nonlinear."""


def size_of_nonlinearity(problem: HarmonicBalance, x: Array, direction: Array, values: Array) -> float:
    """Return the size of a change along a direction by which the balance leaves its linearisation by one per cent.

    Where a branch begins at rest, this is what its first motions can be measured by, in whatever units.
    """
    unit = direction / np.linalg.norm(direction)
    here, slope = problem.assembly.residual(x, values), problem.assembly.jacobian(x, values) @ unit

    def leaves(exponent: float) -> bool:
        step = 10.0**exponent
        with np.errstate(all="ignore"):
            curved = problem.assembly.residual(x + step * unit, values) - here - step * slope
            part = np.max(np.abs(curved)) / problem.assembly.term_size(step * unit, values)
        return not part <= LEAVES

    small, large = -100.0, 100.0
    if not leaves(large):
        return float(np.linalg.norm(x)) or 1.0  # a linear system
    while large - small > 0.1:
        middle = 0.5 * (small + large)
        small, large = (small, middle) if leaves(middle) else (middle, large)
    return float(10.0**large)
