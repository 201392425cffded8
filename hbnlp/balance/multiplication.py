"""Multiplication by periodic functions that are known at samples, as matrices on Fourier coefficients.

Sample a signal, multiply it by g there, project the product. With Z_m the mean over the samples of ``g exp(i m theta)``
and each pair of columns (cos k, sin k) written as one complex number, the matrix of this has the rows::

    cos h:  Z_(k-h) + Z_(k+h),      sin h:  i (Z_(k-h) - Z_(k+h)),      h, k = 1..H,

a Toeplitz and a Hankel matrix. Aliasing is part of it: m counts modulo the number of samples. A signal that is
differentiated by phase before has its columns multiplied by i k.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy import fft

from hbnlp.core.kept import built_once
from hbnlp.core.types import Array, ComplexArray, IntArray
from hbnlp.fourier import FourierBasis, n_coefficients

LARGEST_TABLE = 100_000
"""Entries of the map from samples to blocks up to which one product with it beats transform and sums.

For 4 H + 1 samples H = 18, where both take the same time: measured, H = 24 for one function and 15 for thirty.
"""
LARGEST_SCRATCH = 100_000
"""Numbers that are written before they are added to the matrix: what a processor keeps at hand."""

Places = tuple[IntArray, IntArray]
Blocks = Callable[[Array], Array]


class Multiplication:
    """What adds the blocks that multiply by functions to a matrix (n, L, n, L), L = 2H + 1.

    Parameters
    ----------
    basis : FourierBasis
        Its harmonics and samples.
    places : pair of arrays (count,)
        The signal that results and the signal that is multiplied, for each function.
    derivative : bool
        Whether the signals are differentiated by phase before.
    """

    def __init__(self, basis: FourierBasis, places: Places, *, derivative: bool = False) -> None:
        self._basis, self._places, self._derivative = basis, places, derivative
        self._at_once = max(1, LARGEST_SCRATCH // n_coefficients(basis.n_harmonics) ** 2)

    def add(self, matrix: Array, samples: Array) -> None:
        """Add the blocks of functions given by samples (n_samples, count)."""
        rows, columns = self._places
        n, size = matrix.shape[:2]
        if len(rows) <= self._at_once:
            if len(rows) == n**2:
                # entries come column by column: (column, row, L, L) to (row, L, column, L)
                matrix += self._blocks(samples).reshape(n, n, size, size).transpose(1, 2, 0, 3)
            elif len(rows):
                matrix[rows, :, columns, :] += self._blocks(samples)
        elif self._at_once > 1:
            for part in (slice(begin, begin + self._at_once) for begin in range(0, len(rows), self._at_once)):
                matrix[rows[part], :, columns[part], :] += self._blocks(samples[:, part])
        else:
            # one by one and into place: such blocks are not copied for the sake of their indices
            for k, (row, column) in enumerate(zip(rows, columns, strict=True)):
                matrix[row, :, column, :] += self._blocks(samples[:, k : k + 1])[0]

    @built_once
    def _blocks(self) -> Blocks:
        """Blocks (count, L, L) of samples (n_samples, count)."""
        basis = self._basis
        return (Table if self._is_small(n_coefficients(basis.n_harmonics)) else ToeplitzHankel)(basis, self._derivative)

    def _is_small(self, length: int) -> bool:
        """Return whether a table is the quicker way to blocks (length, length)."""
        return self._basis.n_samples * length**2 <= LARGEST_TABLE


class Table:
    """Blocks (count, L, L) of samples (n_samples, count) by a constant map (n_samples, L * L).

    ``which`` are the coefficients whose rows and columns they have, by default all.
    """

    def __init__(self, basis: FourierBasis, derivative: bool, which: IntArray | slice = slice(None)) -> None:
        sampling = (basis.derivative_sampling if derivative else basis.sampling)[:, which]
        self._length = sampling.shape[1]
        self._map = (basis.projection[which].T[:, :, None] * sampling[:, None, :]).reshape(basis.n_samples, -1)

    def __call__(self, samples: Array) -> Array:
        """Return the blocks."""
        return np.asarray((samples.T @ self._map).reshape(-1, self._length, self._length))


class ToeplitzHankel:
    """Blocks (count, L, L) of samples (n_samples, count) by their Fourier transforms."""

    def __init__(self, basis: FourierBasis, derivative: bool) -> None:
        h = self._n_harmonics = basis.n_harmonics
        self._folded = np.arange(1 - h, 2 * h + 1) % basis.n_samples
        self._by_phase = 1j * np.arange(1, h + 1) if derivative else None

    def __call__(self, samples: Array) -> Array:
        """Return the blocks."""
        h, count = self._n_harmonics, samples.shape[1]
        means = self._means(samples)
        first = means[:, : h + 1]
        blocks = np.empty((count, 2 * h + 1, 2 * h + 1))
        pairs = blocks[:, :, 1:].view(complex)
        self._write(pairs[:, 1:], means[:, self._folded], h + 1)
        pairs[:, 0] = first[:, 1:]
        if self._by_phase is None:
            blocks[:, 0, 0] = first[:, 0].real
            blocks[:, 1:, 0] = 2.0 * first[:, 1:].view(float)
        else:
            blocks[:, :, 0] = 0.0
            pairs[:, 0] *= self._by_phase
        return blocks

    def _means(self, samples: Array) -> ComplexArray:
        return np.asarray(fft.ifft(samples.T))

    def _write(self, pairs: ComplexArray, z: ComplexArray, hankel: int) -> None:
        """Write the rows (count, 2h, h) of the harmonics, their first Hankel window ``hankel`` after the Toeplitz."""
        h = self._n_harmonics
        windows, turned = _windows(z, h), _windows(1j * z, h)
        np.add(windows[:, h - 1 :: -1], windows[:, hankel:], out=pairs[:, ::2])
        np.subtract(turned[:, h - 1 :: -1], turned[:, hankel:], out=pairs[:, 1::2])
        if self._by_phase is not None:
            pairs *= self._by_phase


def _windows(z: ComplexArray, h: int) -> ComplexArray:
    """Return the windows of h numbers each, (count, length - h + 1, h), in rows (count, length)."""
    row, step = z.strides
    return as_strided(z, (z.shape[0], z.shape[1] - h + 1, h), (row, step, step), writeable=False)
