"""The truncated Fourier basis: sample, project, differentiate.

Every periodic signal is ``a(theta) = a_0 + sum_h a_{2h-1} cos(h theta) + a_{2h} sin(h theta)``, h = 1..H, and its
``2H + 1`` coefficients are kept in that order along the last axis of an array. The complex amplitude of harmonic h is
``a_{2h-1} - i a_{2h}``, so that the signal is ``Re sum_h amplitude_h exp(i h theta)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from hbnlp.core.kept import built_once
from hbnlp.core.sending import FieldsAlone
from hbnlp.core.types import Array, ComplexArray

LARGEST_MATRIX = 80_000
"""Entries up to which a product with a basis' matrix is quicker than a transform: H = 100 with 4 H + 1 samples."""


def n_coefficients(n_harmonics: int) -> int:
    """Return ``2H + 1``, the number of real coefficients of a signal."""
    return 2 * n_harmonics + 1


def basis_values(theta: ArrayLike, n_harmonics: int) -> Array:
    """Return the basis functions at phases ``theta``: array (len(theta), 2H+1)."""
    phase = np.multiply.outer(np.asarray(theta, dtype=float), np.arange(1, n_harmonics + 1))
    values = np.empty((*phase.shape[:-1], n_coefficients(n_harmonics)))
    values[..., 0] = 1.0
    values[..., 1::2] = np.cos(phase)
    values[..., 2::2] = np.sin(phase)
    return values


def basis_derivatives(theta: ArrayLike, n_harmonics: int, order: int = 1) -> Array:
    """Return the ``order``-th derivatives of the basis functions by phase: array (len(theta), 2H+1)."""
    values = basis_values(theta, n_harmonics)
    for _ in range(order):
        # differentiation is antisymmetric: on basis functions it has the other sign than on coefficients
        values = -differentiated(values)
    return values


def differentiated(coefficients: Array) -> Array:
    """Return the coefficients (..., 2H+1) of the derivative by phase."""
    orders = np.arange(1, (coefficients.shape[-1] + 1) // 2)
    result = np.zeros_like(coefficients)
    np.multiply(orders, coefficients[..., 2::2], out=result[..., 1::2])
    np.multiply(-orders, coefficients[..., 1::2], out=result[..., 2::2])
    return result


def differentiation(n_harmonics: int) -> Array:
    """Return the matrix (2H+1, 2H+1) that takes coefficients to those of the derivative by phase."""
    matrix = np.zeros((n_coefficients(n_harmonics), n_coefficients(n_harmonics)))
    for h in range(1, n_harmonics + 1):
        matrix[2 * h - 1, 2 * h] = h
        matrix[2 * h, 2 * h - 1] = -h
    return matrix


def to_complex(coefficients: ArrayLike) -> ComplexArray:
    """Return complex amplitudes (..., H+1), ``a_0`` and ``a_{2h-1} - i a_{2h}``, of real coefficients (..., 2H+1)."""
    a = np.asarray(coefficients, dtype=float)
    amplitudes = np.empty((*a.shape[:-1], (a.shape[-1] + 1) // 2), dtype=complex)
    amplitudes[..., 0] = a[..., 0]
    amplitudes[..., 1:] = a[..., 1::2] - 1j * a[..., 2::2]
    return amplitudes


def to_real(amplitudes: ArrayLike) -> Array:
    """Return real coefficients (..., 2H+1) of complex amplitudes (..., H+1); the inverse of `to_complex`."""
    c = np.asarray(amplitudes, dtype=complex)
    a = np.empty((*c.shape[:-1], 2 * c.shape[-1] - 1))
    a[..., 0] = c[..., 0].real
    a[..., 1::2] = c[..., 1:].real
    a[..., 2::2] = -c[..., 1:].imag
    return a


def resize(coefficients: ArrayLike, n_harmonics: int) -> Array:
    """Return coefficients (..., 2H+1) with harmonics dropped, or padded by zeros, to ``n_harmonics``."""
    a = np.asarray(coefficients, dtype=float)
    size = n_coefficients(n_harmonics)
    resized = np.zeros((*a.shape[:-1], size))
    kept = min(size, a.shape[-1])
    resized[..., :kept] = a[..., :kept]
    return resized


def padded(amplitudes: ComplexArray, n_harmonics: int) -> ComplexArray:
    """Return complex amplitudes (..., H+1) with zeros for the harmonics up to ``n_harmonics`` that they do not have."""
    result = np.zeros((*amplitudes.shape[:-1], n_harmonics + 1), dtype=complex)
    result[..., : amplitudes.shape[-1]] = amplitudes
    return result


def of_equal_length(*arrays: Array | ComplexArray) -> list[Any]:
    """Return arrays (..., L) with the last axis of the longest: zeros stand for harmonics that some do not have."""
    most = max(each.shape[-1] for each in arrays)
    return [np.pad(each, [(0, 0)] * (each.ndim - 1) + [(0, most - each.shape[-1])]) for each in arrays]


def stretch(coefficients: ArrayLike, factor: int) -> Array:
    """Return the coefficients of the same signal over ``factor`` periods: harmonic h becomes harmonic h * factor."""
    c = to_complex(coefficients)
    stretched = np.zeros((*c.shape[:-1], factor * (c.shape[-1] - 1) + 1), dtype=complex)
    stretched[..., ::factor] = c
    return to_real(stretched)


def shift(coefficients: ArrayLike, phase: float) -> Array:
    """Return the coefficients of ``a(theta + phase)``."""
    c = to_complex(coefficients)
    return to_real(c * np.exp(1j * phase * np.arange(c.shape[-1])))


def decibels(gain: ArrayLike) -> Array:
    """Return 20 log10 of the modulus of a gain."""
    return np.asarray(20.0 * np.log10(np.abs(np.asarray(gain))))


@dataclass(frozen=True)
class FourierBasis(FieldsAlone):
    """``n_harmonics`` harmonics seen at ``n_samples`` equidistant phases of one period.

    Sampling and projection are exact inverses for signals within the basis when ``n_samples >= 2H + 1``. A product of
    d + 1 such signals is projected without aliasing when ``n_samples >= (d + 2) H + 1 - H = (d + 1) H + 1``.
    """

    n_harmonics: int
    n_samples: int

    def __post_init__(self) -> None:
        if self.n_samples < n_coefficients(self.n_harmonics):
            raise ValueError(
                f"{self.n_samples} samples cannot hold {self.n_harmonics} harmonics: "
                f"at least 2H + 1 = {n_coefficients(self.n_harmonics)} are needed"
            )

    @built_once
    def theta(self) -> Array:
        """Phases of the samples, (n_samples,)."""
        return 2.0 * np.pi * np.arange(self.n_samples) / self.n_samples

    @built_once
    def sampling(self) -> Array:
        """Matrix (n_samples, 2H+1) from coefficients to samples."""
        values = np.ones((self.n_samples, n_coefficients(self.n_harmonics)))
        # h theta within one period: of large phases sine and cosine would lose digits
        turns = np.multiply.outer(np.arange(self.n_samples), np.arange(1, self.n_harmonics + 1)) % self.n_samples
        values[:, 1::2], values[:, 2::2] = np.cos(self.theta)[turns], np.sin(self.theta)[turns]
        return values

    @built_once
    def derivative_sampling(self) -> Array:
        """Matrix (n_samples, 2H+1) from coefficients to samples of the derivative by phase."""
        return -differentiated(self.sampling)

    @built_once
    def projection(self) -> Array:
        """Matrix (2H+1, n_samples) from samples to coefficients (discrete Fourier sums)."""
        matrix = 2.0 / self.n_samples * self.sampling.T
        matrix[0] *= 0.5
        return matrix

    def sampled(self, coefficients: Array) -> Array:
        """Return the samples (..., n_samples) of signals given by coefficients (..., 2H+1)."""
        if self.is_small:
            return np.asarray(coefficients @ self.sampling.T)
        spectrum = 0.5 * to_complex(coefficients)
        spectrum[..., 0] *= 2.0
        return np.asarray(fft.irfft(spectrum, self.n_samples, norm="forward"))

    def projected(self, samples: Array) -> Array:
        """Return the coefficients (..., 2H+1) of samples (..., n_samples)."""
        if self.is_small:
            return np.asarray(samples @ self.projection.T)
        amplitudes = 2.0 * fft.rfft(samples, norm="forward")[..., : self.n_harmonics + 1]
        amplitudes[..., 0] *= 0.5
        return to_real(amplitudes)

    @built_once
    def is_small(self) -> bool:
        """Whether its matrices are quicker than a fast Fourier transform."""
        return self.n_samples * n_coefficients(self.n_harmonics) <= LARGEST_MATRIX
