"""Lag states in the frequency domain: poles and residues, so that they never become unknowns."""

from __future__ import annotations

import numpy as np

from hbnlp.core.types import Array, ComplexArray
from hbnlp.systems.system import System

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
        poles, vectors = np.linalg.eig(state)
        condition = np.linalg.cond(vectors) if self.n_lags else 1.0
        if condition > LARGEST_CONDITION:
            raise ValueError(
                f"lag_state cannot be diagonalised (its eigenvectors have condition number {condition:.1e}, at most "
                f"{LARGEST_CONDITION:.0e} is accepted): poles coincide; move them apart by a relative 1e-4"
            )
        self.poles, self.vectors = poles.astype(complex), vectors.astype(complex)
        self._inputs = np.linalg.solve(self.vectors, np.hstack([drive, motion]).astype(complex))

    def residues(self, output: Array) -> ComplexArray:
        """Return the residues (m, k, n + n_u) of ``output (s - A)^-1 [B, B_u]``; ``output`` is (k, m)."""
        return np.asarray((output @ self.vectors).T[:, :, None] * self._inputs[:, None, :])

    def weights(self, s: ComplexArray) -> ComplexArray:
        """Return ``1 / (s - pole)``, (len(s), m): the factors of the residues."""
        return np.asarray(1.0 / (s[:, None] - self.poles))

    def states(self, s: ComplexArray, accelerations: ComplexArray) -> ComplexArray:
        """Return the amplitudes x (m, len(s)) for those of ``s^2 [q; u]``, (n + n_u, len(s))."""
        return np.asarray(self.vectors @ (self.weights(s).T * (self._inputs @ accelerations)))


def periodic_lag_states(system: System, s: ComplexArray, drive: ComplexArray) -> Array:
    """Return x(0) of ``x' = A x + sum_h drive_h exp(s_h t)``, drive (n_harmonics, m)."""
    if not system.n_lags:
        return np.zeros(0)
    # no constant part: the drives are accelerations of a periodic motion
    resolvents = s[1:, None, None] * np.eye(system.n_lags) - system.lag_state
    response: Array = np.linalg.solve(resolvents, drive[1:, :, None])[..., 0].real.sum(axis=0)
    return response
