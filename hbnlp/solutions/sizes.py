"""The sizes that make a balance dimensionless for solvers whose tolerances are absolute."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.types import Array


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
