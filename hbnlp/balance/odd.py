"""The balance of odd motions, ``q(theta + pi) = -q(theta)``: odd harmonics alone, sampled over half a period.

Where the equations change sign with half a period, so does their residual on such a motion, and the derivative of the
force by the motion has even harmonics alone. It takes odd changes to odd ones and even changes, the mean among them, to
even ones: two blocks are all that the Jacobian has. The first one belongs to odd motions, the second to those that
leave them; it is that of a balance of ``H // 2`` harmonics over half the period.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import as_strided

from hbnlp.balance.assembly import Terms
from hbnlp.balance.linear_terms import LinearBalance
from hbnlp.balance.multiplication import Blocks, Multiplication, Table, ToeplitzHankel
from hbnlp.balance.sampling import Sampling
from hbnlp.core.kept import built_once
from hbnlp.core.types import Array, ComplexArray, IntArray
from hbnlp.fourier import FourierBasis, n_coefficients
from hbnlp.systems.system import System


def odd_positions(n_harmonics: int) -> IntArray:
    """Return where the coefficients of odd harmonics stand among all 2H + 1."""
    orders = (np.arange(n_coefficients(n_harmonics)) + 1) // 2
    return np.flatnonzero(orders % 2 == 1)


def even_positions(n_harmonics: int) -> IntArray:
    """Return where those of even harmonics stand, the mean first."""
    return np.setdiff1d(np.arange(n_coefficients(n_harmonics)), odd_positions(n_harmonics))


@dataclass(frozen=True)
class OddBasis(FourierBasis):
    """The odd ones among ``n_harmonics`` harmonics, seen at ``n_samples`` equidistant phases of half a period.

    Signals have the coefficients of all harmonics; those of even ones are zero.
    """

    def __post_init__(self) -> None:
        if self.n_samples <= self.n_harmonics:
            raise ValueError(f"{self.n_samples} samples of half a period cannot hold {self.n_harmonics} harmonics")

    @built_once
    def _whole(self) -> FourierBasis:
        return FourierBasis(self.n_harmonics, 2 * self.n_samples)

    @built_once
    def theta(self) -> Array:
        """Phases of the samples, (n_samples,)."""
        return self._whole.theta[: self.n_samples]

    @built_once
    def sampling(self) -> Array:
        """Matrix (n_samples, 2H+1) from coefficients to samples."""
        return self._whole.sampling[: self.n_samples]

    @built_once
    def projection(self) -> Array:
        """Matrix (2H+1, n_samples) from samples of an odd signal to coefficients."""
        matrix = 2.0 * self._whole.projection[:, : self.n_samples]
        matrix[even_positions(self.n_harmonics)] = 0.0
        return matrix

    def sampled(self, coefficients: Array) -> Array:
        """Return the samples (..., n_samples) of odd signals given by coefficients (..., 2H+1)."""
        if self.is_small:
            return np.asarray(coefficients @ self.sampling.T)
        return self._whole.sampled(coefficients)[..., : self.n_samples]

    def projected(self, samples: Array) -> Array:
        """Return the coefficients (..., 2H+1) of samples (..., n_samples) of odd signals."""
        if self.is_small:
            return np.asarray(samples @ self.projection.T)
        coefficients = self._whole.projected(np.concatenate([samples, -samples], axis=-1))
        coefficients[..., even_positions(self.n_harmonics)] = 0.0
        return coefficients


class OddAssembly(Terms):
    """Residual and Jacobian on odd motions; vectors of unknowns have all harmonics, the blocks those of one kind."""

    def __init__(self, system: System, sampling: Sampling, linear: LinearBalance) -> None:
        basis = OddBasis(sampling.n_harmonics, (sampling.n_samples + 1) // 2)
        super().__init__(system, sampling, basis, linear)
        n_harmonics = sampling.n_harmonics
        self._odd, self._even = odd_positions(n_harmonics), even_positions(n_harmonics)
        half = FourierBasis(n_harmonics // 2, basis.n_samples)
        by_q, by_v = self._places
        self._none = np.zeros((2, system.n_dof, system.n_dof))
        self._odd_by_q, self._odd_by_r = OddMultiplication(basis, by_q), OddMultiplication(basis, by_v, derivative=True)
        self._even_by_q, self._even_by_r = Multiplication(half, by_q), Multiplication(half, by_v, derivative=True)

    def residual(self, x: Array, values: Array, load: float = 1.0) -> Array:
        """Return R (n L,), zero in even harmonics: the excitation has none either, but for round-off."""
        result = super().residual(x, values, load).reshape(self._shape)
        result[:, self._even] = 0.0
        return result.reshape(-1)

    def blocks(self, x: Array, values: Array, out: Array) -> Array:
        """Return the derivative of even harmonics of R by even ones of x, and add that of odd by odd ones to ``out``.

        They have the sizes n L' and n (L - L'), L' = 2 (H // 2) + 1.
        """
        even = np.zeros((self._shape[0] * self._even.size,) * 2)
        by_odd, by_even = (_by_signals(matrix, self._shape[0]) for matrix in (out, even))
        stiffness = self.linear.dynamic_stiffness(values, *self._none)
        by_even[:, 0, :, 0] += stiffness[0].real
        _add_pairs(by_odd, stiffness[1::2])
        _add_pairs(by_even[:, 1:, :, 1:], stiffness[2::2])
        if self.force:
            by_q, by_r = self.force.derivatives(x.reshape(self._shape), values)
            self._odd_by_q.add(by_odd, by_q)
            self._even_by_q.add(by_even, by_q)
            if by_r.size:
                self._odd_by_r.add(by_odd, by_r)
                self._even_by_r.add(by_even, 2.0 * by_r)  # by its own phase, of which half a period has 2 pi
        return even


class OddMultiplication(Multiplication):
    """Multiplication of odd signals by functions of half the period, in blocks of odd harmonics alone."""

    @built_once
    def _blocks(self) -> Blocks:
        """Blocks (count, L', L') of samples (n_samples, count), L' the number of coefficients of odd harmonics."""
        basis, odd = self._basis, odd_positions(self._basis.n_harmonics)
        if self._is_small(odd.size):
            return Table(basis, self._derivative, odd)
        return OddToeplitzHankel(basis, self._derivative)


class OddToeplitzHankel(ToeplitzHankel):
    """The same by Fourier transforms, of blocks with the rows and columns of harmonics 1, 3, 5, ... alone.

    In samples over half a period ``Z_(k-h)`` and ``Z_(k+h)``, of even order, are means with half the order.
    """

    def __init__(self, basis: FourierBasis, derivative: bool) -> None:
        count = (basis.n_harmonics + 1) // 2
        self._n_harmonics = count
        self._folded = np.arange(1 - count, 2 * count) % basis.n_samples
        self._by_phase = 1j * np.arange(1, 2 * count, 2) if derivative else None

    def __call__(self, samples: Array) -> Array:
        """Return the blocks."""
        count = self._n_harmonics
        blocks = np.empty((samples.shape[1], 2 * count, 2 * count))
        self._write(blocks.view(complex), self._means(samples)[:, self._folded], count)
        return blocks


def _by_signals(matrix: Array, n: int) -> Array:
    """Return a matrix (n l, n l) as a view (n, l, n, l)."""
    view = matrix.view()
    size = matrix.shape[0] // n
    view.shape = (n, size, n, size)  # unlike reshape, this never copies
    return view


def _add_pairs(matrix: Array, stiffness: ComplexArray) -> None:
    """Add dynamic stiffnesses (k, n, n) to the blocks of their harmonics in a matrix (n, 2k, n, 2k).

    A complex block Z applied to a - i b has the cosine part Zr a + Zi b and the sine part Zr b - Zi a.
    """
    count, n = stiffness.shape[:2]
    by_dof, by_row, to_dof, to_column = matrix.strides
    strides = (2 * (by_row + to_column), by_dof, to_dof, by_row, to_column)
    pairs = as_strided(matrix, (count, n, n, 2, 2), strides)
    pairs[..., 0, 0] += stiffness.real
    pairs[..., 1, 1] += stiffness.real
    pairs[..., 0, 1] += stiffness.imag
    pairs[..., 1, 0] -= stiffness.imag
