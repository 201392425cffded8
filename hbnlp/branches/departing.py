"""How far from a crossing of branches the new one is entered: no further than nothing on it is passed over.

The multiplier that is +1 at the crossing leaves it as the square of the distance, at a plain crossing as the distance.
Where it would be -1 the next doubling lies, and where doublings crowd that is within any length fixed beforehand.
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np
from scipy.optimize import linear_sum_assignment

from hbnlp.branches.floquet_points import crossings
from hbnlp.continuation.newton import Newton, correct
from hbnlp.continuation.point import start_point
from hbnlp.core.types import Array
from hbnlp.solutions.equations import Equations
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.stability.result import FloquetResult

logger = logging.getLogger(__name__)

MOVED = 0.5
"""A multiplier may move by this much, or this part of its modulus: a quarter of the way from +1 to -1."""
TURNED = np.radians(14.0)
"""The branch may turn by this angle: what a trace refuses by default."""
SHORTER, SHORTEST = 0.7, 0.1
"""A distance that is too long is tried again at no more than the first, no less than the second part of it."""
MOST_TRIALS = 12
STATIONARY, ROUNDING = 1e-3, 1e-8
"""Parameter components of a unit direction, and of a secant relative to the parameter, whose signs mean nothing."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Crossing:
    """Where a new branch leaves: its curve, the point, and the unit tangent of the new branch.

    ``evaluator`` is that of the curve's problem, and ``floquet`` has the multipliers at the point, over the period of
    the new branch; both are None where stability is off, and then only tangents tell what lies in between.
    """

    curve: Equations
    base: Array
    tangent: Array
    evaluator: FloquetEvaluator | None = None
    floquet: FloquetResult | None = None

    def enter(self, step: float, sign: float) -> tuple[Array | None, float]:
        """Return a point of the new branch on one side, at most a step away, and the step that was taken.

        Where even the shortest steps seem to pass something, the longest one is as good as any: the equations have a
        kink, or so few harmonics that multipliers and balance do not agree on where the crossing is. None if there is
        no point.
        """
        longest: tuple[Array | None, float] = (None, step)
        for _ in range(MOST_TRIALS):
            y = self.at(step, sign)
            longest = (y, step) if longest[0] is None else longest
            part = self._part(y, sign) if y is not None else 0.5
            if part is None:
                return y, step
            step *= part
        if longest[0] is not None:
            here, there = self.base[-1], longest[0][-1]
            logger.warning(
                "the branch that leaves at %s = %.8g is entered at %.8g, and special points in between may be missed: "
                "with more harmonics it can be entered nearer",
                *(self.curve.name, here, there),
            )
        return longest

    def at(self, step: float, sign: float) -> Array | None:
        """Return the point of the new branch in the plane at a step along its tangent, or None."""
        found = correct(self.curve, self.base + sign * step * self.tangent, self.tangent / self._scale**2, Newton())
        return found.y if found.converged else None

    @property
    def _scale(self) -> Array:
        return self.curve.scale(self.base)

    def _part(self, y: Array, sign: float) -> float | None:
        """Return which part of a step to try instead, None if nothing lies between the crossing and its end."""
        heading, tangent = sign * self.tangent, start_point(self.curve, y, y - self.base).tangent
        tangent = tangent / np.linalg.norm(tangent / self._scale)
        cosine = float((tangent / self._scale) @ (heading / self._scale))
        if cosine < np.cos(TURNED) or self._turns_round(y, heading, tangent):
            return 0.5
        if self.evaluator is None or self.floquet is None:
            return None
        here = self.evaluator(self.curve.coefficients(y), self.curve.values(y))
        if not (here.converged and self.floquet.converged):
            return None
        moved = _largest_move(self.floquet, here)
        if moved > MOVED:
            return float(np.clip(0.9 * np.sqrt(MOVED / moved), SHORTEST, SHORTER))
        return 0.5 if crossings(self.floquet, here) else None

    def _turns_round(self, y: Array, heading: Array, tangent: Array) -> bool:
        """Return whether there is a fold in between; at the crossing itself the parameter may be stationary."""
        scale = self._scale[-1]
        begin, end, reached = heading[-1] / scale, tangent[-1] / scale, (y[-1] - self.base[-1]) / scale
        if abs(begin) <= STATIONARY:
            begin = reached if abs(reached) > ROUNDING else 0.0
        return bool(begin * end < 0.0 and abs(end) > ROUNDING)


def over_two_periods(result: FloquetResult) -> FloquetResult:
    """Return the multipliers of the same motion over twice the period: their squares."""
    return dataclasses.replace(result, multipliers=result.multipliers**2, monodromy=result.monodromy @ result.monodromy)


def _largest_move(before: FloquetResult, after: FloquetResult) -> float:
    """Return how far a multiplier moves at most, each to the nearest, relative to its modulus where that is above 1."""
    a, b = before.multipliers, after.multipliers
    distances = np.abs(np.subtract.outer(a, b)) / np.maximum(1.0, np.abs(a))[:, None]
    return float(distances[linear_sum_assignment(distances)].max(initial=0.0))
