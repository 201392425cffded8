"""Odd motions, which have odd harmonics alone, and whether a curve of motions consists of such.

They do where half a forcing period changes the sign of all that the equations hold: whatever odd motion these are given
they balance in odd harmonics, and what they leave in even ones is zero.
"""

from __future__ import annotations

import numpy as np

from hbnlp.balance.odd import even_positions
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.types import Array
from hbnlp.systems.symmetry import inherent

ROUNDING = 1e-9
"""Even harmonics that are smaller than this part of a solution are none."""
WITHIN = (0.381966, 0.834017)
"""Where in the span of a parameter the equations are asked for the symmetry, besides at the start."""


def is_odd_throughout(problem: HarmonicBalance, x: Array, values: Array, name: str, span: tuple[float, float]) -> bool:
    """Return whether a solution is odd and the equations keep it so when a parameter varies over a span.

    They are asked at places that are as good as any: what breaks the symmetry and is zero at the start, or at an end of
    the span, is there.
    """
    if problem.periods % 2 == 0:
        return False  # half of such a period is whole forcing periods
    even = x.reshape(problem.shape)[:, even_positions(problem.n_harmonics)]
    if not float(np.linalg.norm(even)) <= ROUNDING * float(np.linalg.norm(x)):
        return False
    change, index = inherent(problem.shape[0])[0], problem.system.parameters.index(name)
    invariance = problem.system.invariance
    for value in (values[index], *(span[0] + part * (span[1] - span[0]) for part in WITHIN)):
        there = values.copy()
        there[index] = value
        if not invariance.has(change, there):
            return False
    return True
