"""The constant matrices of a system at one parameter point, and the matrix of its linear state equation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hbnlp.core.types import Array


class Plant(NamedTuple):
    """The constant part of the linear equations: M, D, K (n, n), L_x (n, n_lags), A (n_lags, n_lags), B (n_lags, n)."""

    mass: Array
    damping: Array
    stiffness: Array
    lag_output: Array
    lag_state: Array
    lag_input: Array

    def state_matrix(self, stiffness: Array, damping: Array) -> Array:
        """Return the matrix of the state (q, q', x), with matrices (n, n) added to K and D."""
        n, m = self.lag_output.shape
        load = np.hstack([-(self.stiffness + stiffness), -(self.damping + damping), self.lag_output])
        acceleration = np.linalg.solve(self.mass, load)
        state = np.zeros((2 * n + m, 2 * n + m))
        state[:n, n : 2 * n] = np.eye(n)
        state[n : 2 * n] = acceleration
        state[2 * n :] = self.lag_input @ acceleration
        state[2 * n :, 2 * n :] += self.lag_state
        return state


def check_mass(mass: Array) -> None:
    """Raise a ValueError if a mass matrix (n, n) is singular: there is no acceleration to solve for then."""
    if np.linalg.slogdet(mass)[0] == 0.0:
        bare = np.flatnonzero(~mass.any(axis=1)).tolist()
        where = f" (row {bare[0]} is zero)" if bare else ""
        raise ValueError(
            f"the mass matrix is singular{where}; every degree of freedom needs some mass: "
            "give it a small one, or eliminate it from the equations"
        )
