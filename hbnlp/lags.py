"""Lag states in the frequency domain: poles and residues, so that they never become unknowns."""

from __future__ import annotations

import numpy as np

from hbnlp.fourier import Array, ComplexArray

LARGEST_CONDITION = 1e10


class Lags:
    """``x = (s - A)^-1 [B, B_u] (s^2 [q; u])`` with A diagonalised once.

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
        inputs = np.hstack([drive, motion]).astype(complex)
        self.poles = np.zeros(0, dtype=complex)
        self.vectors = np.zeros((0, 0), dtype=complex)
        if self.n_lags:
            poles, vectors = np.linalg.eig(state)
            condition = np.linalg.cond(vectors)
            if condition > LARGEST_CONDITION:
                raise ValueError(
                    f"lag_state cannot be diagonalised (its eigenvectors have condition number {condition:.1e}, at most "
                    f"{LARGEST_CONDITION:.0e} is accepted): poles coincide; move them apart by a relative 1e-4"
                )
            self.poles, self.vectors = poles.astype(complex), vectors.astype(complex)
        self.inputs = np.linalg.solve(self.vectors, inputs) if self.n_lags else inputs

    def transfer(self, output: Array, s: ComplexArray, order: int = 0) -> ComplexArray:
        """Return ``output (s - A)^-1 [B, B_u]``, or its ``order``-th derivative by s (0 or 1), for each s.

        ``output`` is (k, m); the result is (len(s), k, n + n_u).
        """
        weights = 1.0 / (s[:, None] - self.poles)
        if order == 1:
            weights = -(weights**2)
        return ((output @ self.vectors) * weights[:, None, :]) @ self.inputs
