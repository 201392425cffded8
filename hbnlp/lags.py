"""Lag states in the frequency domain: poles and residues, so that they never become unknowns."""

from __future__ import annotations

import numpy as np

from hbnlp.fourier import Array, ComplexArray

LARGEST_CONDITION = 1e10


class Lags:
    """``x = (s - A)^-1 [B, B_u] (s^2 [q; u])`` with A diagonalised once.

    A being real, a pair of poles ``a +- i b`` with residue C enters as ``2 (s - a) / d`` times Re C and ``-2 b / d`` times
    Im C, ``d = (s - a)^2 + b^2``: complex scalars times real matrices, one of each a state.

    Parameters
    ----------
    state, drive, motion : array (m, m), (m, n), (m, n_u)
        A, B and B_u.

    Raises
    ------
    ValueError
        If A has (nearly) coinciding poles without as many eigenvectors.
    """

    def __init__(self, state: Array, drive: Array, motion: Array) -> None:
        self.n_lags = state.shape[0]
        poles, vectors = np.linalg.eig(state)
        condition = np.linalg.cond(vectors) if self.n_lags else 1.0
        if condition > LARGEST_CONDITION:
            raise ValueError(
                f"lag_state cannot be diagonalised (its eigenvectors have condition number {condition:.1e}, at most "
                f"{LARGEST_CONDITION:.0e} is accepted): poles coincide; move them apart by a relative 1e-4"
            )
        self.poles, self.vectors = poles.astype(complex), vectors.astype(complex)
        self._inputs = np.linalg.solve(self.vectors, np.hstack([drive, motion]).astype(complex))
        self._single = np.flatnonzero(self.poles.imag == 0.0)
        self._upper = np.flatnonzero(self.poles.imag > 0.0)

    def residues(self, output: Array) -> Array:
        """Return the real matrices (m, k, n + n_u) of ``output (s - A)^-1 [B, B_u]``; ``output`` is (k, m)."""
        outputs = output @ self.vectors
        dyads = outputs.T[:, :, None] * self._inputs[:, None, :]
        return np.concatenate([dyads[self._single].real, dyads[self._upper].real, dyads[self._upper].imag])

    def weights(self, s: ComplexArray, order: int = 0) -> ComplexArray:
        """Return the factors (len(s), m) of the residues, or their derivatives by s (order 1)."""
        column = s[:, None]
        single = 1.0 / (column - self.poles[self._single].real)
        upper = self.poles[self._upper]
        shifted, frequency = column - upper.real, upper.imag
        size = 1.0 / (shifted**2 + frequency**2)
        if order == 0:
            return np.hstack([single, 2.0 * shifted * size, -2.0 * frequency * size])
        return np.hstack(
            [-(single**2), 2.0 * size - 4.0 * (shifted * size) ** 2, 4.0 * frequency * shifted * size**2]
        )
