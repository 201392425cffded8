"""Period doublings and Neimark-Sacker points: which of them the multipliers at two points imply, and where exactly."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hbnlp.branches.forecast import MATTERS, unstable
from hbnlp.continuation.dips import Sample
from hbnlp.continuation.point import Point
from hbnlp.core.kinds import Kind
from hbnlp.core.types import BoolArray, ComplexArray
from hbnlp.stability.result import FloquetResult

Multipliers = Callable[[Point], FloquetResult]

ROUNDING = 1e-8
"""Factors of test functions below this have no sign to be trusted; nor has a function relative to its other end."""

SMALLEST = -600.0
"""Logarithm of the smallest product that is told from another."""


def crossings(a: FloquetResult, b: FloquetResult) -> tuple[Kind, ...]:
    """Return which Floquet bifurcations the multipliers of two neighbouring points imply, one for each.

    Folds and branch points (a multiplier through +1) are seen by the continuation itself and are not named here. The
    number of real multipliers beyond -1 changes parity at a period doubling; pairs of unstable multipliers that neither
    +1 nor -1 accounts for are Neimark-Sacker bifurcations. One may hide behind a multiplier through +1 or -1, as where
    a pair comes in, becomes real, and one of it goes out: the product of 1 - mu_i mu_j over all pairs changes its sign
    then. It does so as well where two real multipliers have the product one, so that what is critical there has to be
    looked at. What is beyond the unit circle by less than the tolerance of the multipliers is not beyond it: without
    damping all of them are on it.
    """
    if not (a.converged and b.converged):
        return ()
    counted = _counted(a, b)
    doublings = [Kind.PERIOD_DOUBLING] * counted.doubling
    return (*doublings, *[Kind.NEIMARK_SACKER] * (counted.pairs + counted.hidden))


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
    """Return a function that vanishes at the bifurcation between two points and differs in sign at these.

    Of several Neimark-Sackers in one step, ``which`` counts them. At an end a multiplier may lie beyond the unit circle
    by less than the tolerance, which counts as not beyond: then the function vanishes where it is beyond by that. None
    if neither changes its sign by more than rounding.
    """
    margin = max(at(point).options.tol for point in (before, after))
    hidden = kind is Kind.NEIMARK_SACKER and _counted(at(before), at(after)).hidden
    for radius in (1.0, 1.0 + margin):
        test = _test(kind, before, after, at, which, radius)
        ends = test(before), test(after)
        # a product of many factors differs by orders of magnitude between the ends, but its factors are above rounding
        least = 0.0 if hidden else ROUNDING * max(map(abs, ends))
        if ends[0] * ends[1] < 0.0 and min(map(abs, ends)) > least:
            return test
    return None


def _test(
    kind: Kind, before: Point, after: Point, at: Multipliers, which: int, radius: float
) -> Callable[[Point], float]:
    if kind is Kind.PERIOD_DOUBLING:
        return _doubling_test(at, radius)
    counted = _counted(at(before), at(after))
    if counted.hidden:
        return _product_test(at, before, after)
    # one that passes +1 or -1 as well does so first, last, or between two pairs
    return _modulus_test(at, counted.fewest + 2 * which + counted.change % 2, radius)


def critical_multiplier(kind: Kind, multipliers: ComplexArray) -> complex | None:
    """Return the multiplier nearest to -1, or of the two whose product is nearest to one; None if these are real."""
    if kind is Kind.PERIOD_DOUBLING:
        return complex(multipliers[np.argmin(np.abs(multipliers + 1.0))])
    i, j = np.triu_indices(multipliers.size, 1)
    nearest = np.argmin(np.abs(1.0 - multipliers[i] * multipliers[j]))
    value = multipliers[i[nearest]]
    return None if _is_real(value) else complex(value.real, abs(value.imag))


class _Counted(NamedTuple):
    """What the multipliers at two points say: how many are unstable at both at least, and at one of them more.

    ``doubling``: an odd number went through -1; ``pairs``: so many crossed the unit circle; ``hidden``: one may have.
    """

    fewest: int
    change: int
    doubling: int
    pairs: int
    hidden: int


def _counted(a: FloquetResult, b: FloquetResult) -> _Counted:
    margin = max(a.options.tol, b.options.tol)
    before, after = a.multipliers, b.multipliers
    counts = [unstable(each, margin) for each in (before, after)]
    change = abs(counts[0] - counts[1])
    doubling, through_one = ((_beyond(before, at, margin) - _beyond(after, at, margin)) % 2 for at in (-1.0, 1.0))
    pairs = max((change - doubling - through_one) // 2, 0)
    hidden = bool(doubling or through_one) and pairs == 0 and _product_changes_sign(before, after)
    return _Counted(min(counts), change, doubling, pairs, int(hidden))


def _product_changes_sign(before: ComplexArray, after: ComplexArray) -> bool:
    one, other = (samples_at(each, 0.0)[-1] for each in (before, after))
    return one is not None and other is not None and one.sign != other.sign


def _beyond(multipliers: ComplexArray, bound: float, margin: float) -> int:
    """Return how many real multipliers are > 1 (bound 1) or < -1 (bound -1), by more than a margin."""
    real = multipliers[_is_real(multipliers)].real
    return int(np.count_nonzero(bound * real > 1.0 + margin))


def _is_real(multipliers: ComplexArray) -> BoolArray:
    return np.asarray(np.abs(multipliers.imag) <= 1e-12 * np.abs(multipliers))


def _doubling_test(at: Multipliers, radius: float) -> Callable[[Point], float]:
    def test(point: Point) -> float:
        """Determinant of (monodromy + radius), of the multipliers that matter."""
        multipliers = at(point).multipliers
        return float(np.prod(radius + multipliers[np.abs(multipliers) > MATTERS]).real)

    return test


def _modulus_test(at: Multipliers, place: int, radius: float) -> Callable[[Point], float]:
    def test(point: Point) -> float:
        """How far a modulus is beyond the radius, by its place from the largest: continuous where multipliers meet."""
        return float(np.sort(np.abs(at(point).multipliers))[::-1][place] - radius)

    return test


def _product_test(at: Multipliers, before: Point, after: Point) -> Callable[[Point], float]:
    ends = [samples_at(at(point).multipliers, 0.0)[-1] for point in (before, after)]
    reference = max(sample.logarithm for sample in ends if sample is not None)

    def test(point: Point) -> float:
        """Product of 1 - mu_i mu_j over all pairs, relative to that at the ends."""
        sample = samples_at(at(point).multipliers, 0.0)[-1]
        if sample is None:
            return 0.0
        return sample.sign * float(np.exp(max(sample.logarithm - reference, SMALLEST)))  # not zero: its sign counts

    return test
