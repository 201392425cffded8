"""Sizes that make a balance dimensionless, for tolerances that are absolute, and those of motions beside rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.types import Array

LEAVES = 1e-2
"""Part of the linear terms that the curved ones are where a motion is said to be nonlinear."""


def size_of_nonlinearity(problem: HarmonicBalance, x: Array, direction: Array, values: Array) -> float:
    """Return the size of a change along a direction by which the balance leaves its linearisation by one per cent.

    Where a branch begins at rest, this is what its first motions can be measured by, in whatever units. A linear system
    has no such size: of one that is loaded it is that of x, otherwise 1.
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
        # of a linear system without a load all multiples of a motion are one, and what rest is found as is round-off
        loaded = np.any(problem.assembly.residual(np.zeros(problem.size), values))
        return float(np.linalg.norm(x)) if loaded and np.any(x) else 1.0
    while large - small > 0.1:
        middle = 0.5 * (small + large)
        small, large = (small, middle) if leaves(middle) else (middle, large)
    return float(10.0**large)


class Sizes(NamedTuple):
    """Of the coefficients, and of the terms that the balance sums."""

    length: float
    force: float


def sizes_at(problem: HarmonicBalance, x: Array, values: Array) -> Sizes:
    """Return the sizes at a guess; one at rest has those of the load, or of the force at rest, over the stiffness."""
    force, length = problem.assembly.term_size(x, values), float(np.linalg.norm(x))
    if not (force > 0.0 and length > 0.0):
        residual = float(np.abs(problem.assembly.residual(x, values)).max())
        stiffness = float(np.abs(problem.assembly.jacobian(x, values)).max())
        force = _usable(force) or residual
        length = _usable(length) or (_usable(residual / stiffness) if stiffness > 0.0 else 0.0)
    return Sizes(_usable(length) or 1.0, _usable(force) or 1.0)


def _usable(size: float) -> float:
    return size if np.isfinite(size) else 0.0
