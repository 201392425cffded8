"""Period doublings and Neimark-Sacker points: which of them the multipliers at two points imply, and where exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import linear_sum_assignment

from hbnlp.continuation.dips import Sample
from hbnlp.continuation.point import Point
from hbnlp.core.kinds import Kind
from hbnlp.core.types import ComplexArray
from hbnlp.stability.result import FloquetResult

Multipliers = Callable[[Point], FloquetResult]

MATTERS = 1e-3
"""Multipliers of smaller modulus are far from the unit circle, and stay out of the test functions."""
ROUNDING = 1e-8
"""Factors of test functions below this have no sign that can be trusted."""


def crossings(a: FloquetResult, b: FloquetResult) -> tuple[Kind, ...]:
    """Return which Floquet bifurcations the multipliers of two neighbouring points imply, one for each.

    Folds and branch points (a multiplier through +1) are seen by the continuation itself and are not named here. The
    number of real multipliers beyond -1 changes parity at a period doubling; pairs of unstable multipliers that neither
    +1 nor -1 accounts for are Neimark-Sacker bifurcations. What is beyond the unit circle by less than the tolerance of
    the multipliers is not beyond it: without damping all of them are on it.
    """
    if not (a.converged and b.converged):
        return ()
    margin = max(a.options.tol, b.options.tol)
    before, after, kinds = a.multipliers, b.multipliers, []
    doubling = (_beyond(before, -1.0, margin) - _beyond(after, -1.0, margin)) % 2
    if doubling:
        kinds.append(Kind.PERIOD_DOUBLING)
    unstable = abs(_unstable(before, margin) - _unstable(after, margin))
    through_one = (_beyond(before, 1.0, margin) - _beyond(after, 1.0, margin)) % 2
    # one may come in through +1 or -1 while a pair goes out, or a pair become real on its way through +1
    hidden = bool(doubling or through_one) and _pair_crosses(before, after, margin)
    pairs = max((unstable - doubling - through_one) // 2, int(hidden))
    return (*kinds, *[Kind.NEIMARK_SACKER] * pairs)


def samples_at(multipliers: ComplexArray, place: float) -> tuple[Sample | None, ...]:
    """Return functions of the multipliers that change sign at bifurcations, as samples at a place along the branch.

    They are the determinants of 1 - Phi (folds and branch points), of 1 + Phi (doublings) and the product of 1 - mu_i
    mu_j over all pairs (Neimark-Sackers), of the multipliers that matter; None where one is zero but for rounding.
    """
    known = multipliers[np.abs(multipliers) > MATTERS]
    i, j = np.triu_indices(known.size, 1)
    factors = (1.0 - known, 1.0 + known, 1.0 - known[i] * known[j])
    return tuple(_sample(each, place) for each in factors)


def _sample(factors: ComplexArray, place: float) -> Sample | None:
    sizes = np.abs(factors)
    if not factors.size or not np.all(np.isfinite(sizes)) or sizes.min() < ROUNDING:
        return None
    return Sample(place, float(np.sign(np.prod(factors / sizes).real)), float(np.log(sizes).sum()))


def bifurcation_function(
    kind: Kind, before: Point, after: Point, at: Multipliers, *, which: int = 0
) -> Callable[[Point], float] | None:
    """Return a function that vanishes at the bifurcation between two points; None if nothing of that kind is there.

    Of several Neimark-Sackers in one step, ``which`` counts them.
    """
    if kind is Kind.PERIOD_DOUBLING:
        return _doubling_test(at)
    fewer, more = sorted(_unstable_pairs(at(point).multipliers) for point in (before, after))
    return _pair_test(at, fewer + which) if fewer + which < more else None


def critical_multiplier(kind: Kind, multipliers: ComplexArray) -> complex:
    """Return the multiplier nearest to -1, or the one of a pair nearest to the unit circle."""
    if kind is Kind.PERIOD_DOUBLING:
        return complex(multipliers[np.argmin(np.abs(multipliers + 1.0))])
    pairs = multipliers[multipliers.imag > 0.0]
    return complex(pairs[np.argmin(np.abs(np.abs(pairs) - 1.0))])


def _beyond(multipliers: ComplexArray, bound: float, margin: float) -> int:
    """Return how many real multipliers are > 1 (bound 1) or < -1 (bound -1), by more than a margin."""
    real = multipliers[np.abs(multipliers.imag) <= 1e-12 * np.abs(multipliers)].real
    return int(np.count_nonzero(bound * real > 1.0 + margin))


def _unstable(multipliers: ComplexArray, margin: float) -> int:
    return int(np.count_nonzero(np.abs(multipliers) > 1.0 + margin))


def _unstable_pairs(multipliers: ComplexArray) -> int:
    return int(np.count_nonzero((np.abs(multipliers) > 1.0) & (multipliers.imag > 0.0)))


def _pair_crosses(before: ComplexArray, after: ComplexArray, margin: float) -> bool:
    """Return whether a pair that is one at both points, each multiplier going to the nearest, crosses the circle."""
    rows, columns = linear_sum_assignment(np.abs(np.subtract.outer(before, after)))
    a, b = before[rows], after[columns]
    outside = [np.abs(each) > 1.0 + margin for each in (a, b)]
    return bool(np.any((a.imag > 0.0) & (b.imag > 0.0) & (outside[0] != outside[1])))


def _doubling_test(at: Multipliers) -> Callable[[Point], float]:
    def test(point: Point) -> float:
        """Determinant of (monodromy + 1), of the multipliers that matter."""
        multipliers = at(point).multipliers
        return float(np.prod(1.0 + multipliers[np.abs(multipliers) > MATTERS]).real)

    return test


def _pair_test(at: Multipliers, pairs: int) -> Callable[[Point], float]:
    def test(point: Point) -> float:
        """How far the modulus of the pair that crosses is from one."""
        multipliers = at(point).multipliers
        moduli = np.sort(np.abs(multipliers[multipliers.imag > 0.0]))[::-1]
        return float(moduli[pairs] - 1.0) if moduli.size > pairs else -1.0

    return test
