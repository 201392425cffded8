"""Newton's method away from the solutions that are known.

References
----------
Farrell, Birkisson, Funke (2015), SIAM J. Sci. Comput. 37, A2026-A2045, doi:10.1137/140984798.
"""

from __future__ import annotations

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.curve import TINY
from hbnlp.core.types import Array
from hbnlp.solutions.sizes import sizes_at
from hbnlp.systems.symmetry import PERIOD


def deflated_newton(
    problem: HarmonicBalance, values: Array, start: Array, known: list[Array], max_iterations: int
) -> Array | None:
    """Return an approximate solution away from the known ones, and from them with angles turned by 2 pi, or None.

    The residual is multiplied by ``prod (1 + size^2 / |x - x_i|^2)``; by the Sherman-Morrison formula its Newton step
    is the plain one times a number.
    """
    x = start.copy()
    means = problem.shape[1] * np.array(problem.system.angles, dtype=int)
    with np.errstate(all="ignore"):
        sizes = sizes_at(problem, start, values)
    previous = np.inf
    for _ in range(max_iterations):
        with np.errstate(all="ignore"):  # what is not finite ends the run
            residual = problem.assembly.residual(x, values)
            jacobian = problem.assembly.jacobian(x, values)
            finite = np.isfinite(residual.sum()) and np.isfinite(jacobian.sum())
        if not finite:
            return None
        try:
            step = -np.linalg.solve(jacobian, residual)
        except np.linalg.LinAlgError:
            return None
        size = float(np.linalg.norm(x))
        slope = 0.0
        for other in known:
            away = x - other
            away[means] -= PERIOD * np.round(away[means] / PERIOD)
            distance = float(away @ away) or TINY
            scale = float(other @ other) or sizes.length**2
            slope += -2.0 * scale / (distance * (distance + scale)) * float(away @ step)
        factor = 1.0 / (1.0 - slope) if slope != 1.0 else 1.0
        length = abs(factor) * float(np.linalg.norm(step))
        if length <= 1e-6 * max(size, TINY):
            return x + step
        # steps larger than the solution itself are cut: far from a solution the linear model is worth little
        damping = min(1.0, max(size, 1e-12 * sizes.length) / length) if length > previous else 1.0
        x += damping * factor * step
        previous = length
        if not np.isfinite(length) or size > 1e12 * sizes.length:
            return None
    return None
