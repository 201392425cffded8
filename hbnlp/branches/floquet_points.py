"""Period doublings and Neimark-Sacker points: which of them the multipliers at two points imply, and where exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import linear_sum_assignment

from hbnlp.continuation.point import Point
from hbnlp.core.kinds import Kind
from hbnlp.core.types import ComplexArray
from hbnlp.stability.result import FloquetResult

Multipliers = Callable[[Point], FloquetResult]


def crossings(a: FloquetResult, b: FloquetResult) -> tuple[Kind, ...]:
    """Return which Floquet bifurcations the multipliers of two neighbouring points imply.

    Folds and branch points (a multiplier through +1) are seen by the continuation itself and are not named here. The
    number of real multipliers beyond -1 changes parity at a period doubling; a pair of unstable multipliers that
    neither +1 nor -1 accounts for is a Neimark-Sacker bifurcation.
    """
    if not (a.converged and b.converged):
        return ()
    before, after, kinds = a.multipliers, b.multipliers, []
    doubling = (_beyond(before, -1.0) - _beyond(after, -1.0)) % 2
    if doubling:
        kinds.append(Kind.PERIOD_DOUBLING)
    unstable = abs(np.count_nonzero(np.abs(before) > 1.0) - np.count_nonzero(np.abs(after) > 1.0))
    through_one = (_beyond(before, 1.0) - _beyond(after, 1.0)) % 2
    # one may come in through +1 or -1 while a pair goes out, or a pair become real on its way through +1
    hidden = bool(doubling or through_one) and _pair_crosses(before, after)
    if unstable - doubling - through_one >= 2 or hidden:
        kinds.append(Kind.NEIMARK_SACKER)
    return tuple(kinds)


def bifurcation_function(kind: Kind, before: Point, after: Point, at: Multipliers) -> Callable[[Point], float] | None:
    """Return a function that vanishes at the bifurcation between two points; None if nothing of that kind is there."""
    if kind is Kind.PERIOD_DOUBLING:
        return _doubling_test(at)
    fewer, more = sorted(_unstable_pairs(at(point).multipliers) for point in (before, after))
    return _pair_test(at, fewer) if fewer != more else None


def critical_multiplier(kind: Kind, multipliers: ComplexArray) -> complex:
    """Return the multiplier nearest to -1, or the one of a pair nearest to the unit circle."""
    if kind is Kind.PERIOD_DOUBLING:
        return complex(multipliers[np.argmin(np.abs(multipliers + 1.0))])
    pairs = multipliers[multipliers.imag > 0.0]
    return complex(pairs[np.argmin(np.abs(np.abs(pairs) - 1.0))])


def _beyond(multipliers: ComplexArray, bound: float) -> int:
    """Return how many real multipliers are > 1 (bound 1) or < -1 (bound -1)."""
    real = multipliers[np.abs(multipliers.imag) <= 1e-12 * np.abs(multipliers)].real
    return int(np.count_nonzero(real > 1.0) if bound > 0.0 else np.count_nonzero(real < -1.0))


def _unstable_pairs(multipliers: ComplexArray) -> int:
    return int(np.count_nonzero((np.abs(multipliers) > 1.0) & (multipliers.imag > 0.0)))


def _pair_crosses(before: ComplexArray, after: ComplexArray) -> bool:
    """Return whether a pair that is one at both points, each multiplier going to the nearest, crosses the circle."""
    rows, columns = linear_sum_assignment(np.abs(np.subtract.outer(before, after)))
    a, b = before[rows], after[columns]
    return bool(np.any((a.imag > 0.0) & (b.imag > 0.0) & ((np.abs(a) > 1.0) != (np.abs(b) > 1.0))))


def _doubling_test(at: Multipliers) -> Callable[[Point], float]:
    def test(point: Point) -> float:
        """Determinant of (monodromy + 1), of the multipliers that matter."""
        multipliers = at(point).multipliers
        return float(np.prod(1.0 + multipliers[np.abs(multipliers) > 1e-3]).real)

    return test


def _pair_test(at: Multipliers, pairs: int) -> Callable[[Point], float]:
    def test(point: Point) -> float:
        """How far the modulus of the pair that crosses is from one."""
        multipliers = at(point).multipliers
        moduli = np.sort(np.abs(multipliers[multipliers.imag > 0.0]))[::-1]
        return float(moduli[pairs] - 1.0) if moduli.size > pairs else -1.0

    return test
