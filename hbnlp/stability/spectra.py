"""Eigenvalues of products of step maps: accurate however wide their range, put in order, and compared."""

from __future__ import annotations

import numpy as np
from scipy.linalg import schur
from scipy.optimize import linear_sum_assignment

from hbnlp.core.types import Array, ComplexArray

NEGLIGIBLE = 1e-6  # multipliers smaller than this need not be accurate
# Ratio of eigenvalues up to which rounding in a product of maps is harmless.
_WIDE = 1e7


def product(maps: Array, keep: int = 1) -> Array:
    """Return at most ``keep`` maps (keep, n, n) with the product of all, by a balanced tree; the first acts first."""
    while len(maps) > keep:
        pairs = maps[1::2] @ maps[: len(maps) // 2 * 2 : 2]
        maps = pairs if len(maps) % 2 == 0 else np.concatenate([pairs, maps[-1:]])
    return maps


def spectrum(maps: Array) -> ComplexArray:
    """Return the eigenvalues of a product of maps (k, n, n), each accurate relative to the larger of itself and one.

    Rounding in the product is relative to its largest eigenvalue. If that is huge, the invariant subspace of the large
    ones is propagated through the maps, and the rest orthogonal to it (one sweep of periodic QR), so that the small
    ones never meet them. Where the product overflows, all are infinite.

    References
    ----------
    K. Lust, Improved numerical Floquet multipliers, Int. J. Bifurcation Chaos 11 (2001), doi:10.1142/S0218127401003486
    """
    (whole,) = product(maps)
    size = np.abs(whole).max()
    if not np.isfinite(size):
        return np.full(len(whole), np.inf + 0j)
    if size < _WIDE or len(maps) == 1:
        values: ComplexArray = np.linalg.eigvals(whole).astype(complex)
        return values
    form, start, large = schur(whole, output="real", sort=lambda re, im: np.hypot(re, im) > size / _WIDE)
    if large in (0, len(whole)):
        return spectrum(whole[None])
    basis, rest = start, []
    for step in maps:
        basis, upper = np.linalg.qr(step @ basis)
        rest.append(upper[large:, large:])
    rest[-1] = (start.T @ basis)[large:, large:] @ rest[-1]
    return np.concatenate([spectrum(form[None, :large, :large]), spectrum(np.array(rest))])


def ordered(multipliers: ComplexArray) -> ComplexArray:
    """Return multipliers by decreasing modulus, of a pair the one with positive imaginary part first."""
    return multipliers[np.lexsort((-multipliers.imag, -np.abs(multipliers)))]


def distance(one: ComplexArray, other: ComplexArray) -> float:
    """Return the largest difference of two sets of multipliers, paired, relative to max(1, abs(mu))."""
    modulus = np.maximum.outer(np.abs(one), np.abs(other))
    if not np.isfinite(modulus).all():
        return np.inf
    difference = np.abs(np.subtract.outer(one, other)) / np.maximum(modulus, 1.0)
    difference[modulus < NEGLIGIBLE] = 0.0
    return float(difference[linear_sum_assignment(difference)].max())
