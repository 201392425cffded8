"""Gauss-Legendre collocation of linear periodic second-order systems with lag states: the step maps of one mesh.

The equations, linear with coefficients that depend on time, are::

    M q'' + D(t) q' + K(t) q = L_x x,      x' = A x + B q''

With ``xi_j = q(t + c_j h) - q(t) - c_j h q'(t)`` at the m Gauss nodes of an interval of length h as the unknowns,
velocities and accelerations at the nodes are linear in xi, K(t) stays in the diagonal blocks, and the lag states are
eliminated (A is constant: once a mesh). What is left is one dense system of n m equations an interval, for all initial
states (q, q', x).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from hbnlp.core.types import Array, ComplexArray
from hbnlp.systems.plant import Plant

# Bytes of the matrices solved in one call. Measured: beyond a megabyte, fresh memory costs as much as LAPACK.
_BATCH = 500_000


@dataclass(frozen=True)
class Gauss:
    """Gauss's collocation method on [0, 1] (Butcher's tableau), diagonalised.

    Attributes
    ----------
    c, b : (m,)
        Nodes and weights.
    inverse, inverse_squared : (m, m)
        Of the matrix a of integrals of the Lagrange polynomials from 0 to the nodes. (a is applied twice to get
        displacements, as for a first-order system: only so is the method A-stable.)
    alpha : (m / 2 rounded up,), complex
        Eigenvalues of a, one of each conjugate pair.
    right, left : (m, len(alpha)), (len(alpha), m), complex
        Such that ``a^k = Re(right diag(alpha^k) left)``.

    References
    ----------
    E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.5, doi:10.1007/978-3-642-05221-7
    """

    c: Array
    b: Array
    inverse: Array
    inverse_squared: Array
    alpha: ComplexArray
    right: ComplexArray
    left: ComplexArray

    @staticmethod
    @lru_cache(maxsize=16)
    def of(nodes: int) -> Gauss:
        """Return the method with this number of nodes, of order ``2 * nodes``."""
        z, weights = legendre.leggauss(nodes)
        integrals = legendre.legval(z, legendre.legint(np.eye(nodes), lbnd=-1.0, scl=0.5))
        a = np.linalg.solve(legendre.legvander(z, nodes - 1).T, integrals).T
        alpha, right = np.linalg.eig(a.astype(complex))
        left = np.linalg.inv(right)
        one = alpha.imag >= -1e-12
        twice = np.where(alpha.imag > 1e-12, 2.0, 1.0)[one]
        inverse = np.linalg.inv(a)
        return Gauss(
            c=(z + 1.0) / 2.0,
            b=(weights / 2.0).astype(float),
            inverse=inverse,
            inverse_squared=inverse @ inverse,
            alpha=alpha[one],
            right=right[:, one] * twice,
            left=left[one],
        )


class StepMaps:
    """Step maps of a plant over intervals of one length.

    A map is ``free + gain @ solve(system + time-dependent part, load + time-dependent part)``; the four constant
    matrices are made here, once a mesh.
    """

    def __init__(self, plant: Plant, gauss: Gauss, step: float) -> None:
        n, n_lags = plant.lag_output.shape
        m, n_state = len(gauss.c), 2 * n + n_lags
        self.shape = (m, n, n_state)
        self._to_velocity = gauss.inverse / step
        to_acceleration = gauss.inverse_squared / step**2
        self._drift = step * gauss.c[:, None, None]
        eye = np.eye(n)

        system = np.multiply.outer(to_acceleration, plant.mass)
        system += np.multiply.outer(self._to_velocity, plant.damping)
        np.einsum("jjrc->jrc", system)[...] += plant.stiffness  # a view of the diagonal blocks
        load = np.zeros((m, n, n_state))
        load[:, :, :n] = -plant.stiffness
        load[:, :, n : 2 * n] = -plant.damping - self._drift * plant.stiffness
        free = np.eye(n_state)
        free[:n, n : 2 * n] = step * eye
        gain = np.zeros((n_state, m, n))
        gain[:n] = eye[:, None, :] * (gauss.b @ gauss.inverse)[:, None]
        gain[n : 2 * n] = eye[:, None, :] * (step * gauss.b @ to_acceleration)[:, None]
        if n_lags:
            # x at node j is Re sum_i right_ji (I - h alpha_i A)^-1 [sum_k left_ik x(0) + B (left xi)_i / (h alpha_i)].
            inverse = np.linalg.inv(np.eye(n_lags) - step * gauss.alpha[:, None, None] * plant.lag_state)
            driven = inverse @ plant.lag_input
            ones = gauss.left.sum(axis=1)
            load[:, :, 2 * n :] = np.tensordot(gauss.right * ones, plant.lag_output @ inverse, 1).real
            paths = (gauss.right / (step * gauss.alpha))[:, None, :] * gauss.left.T
            system -= np.tensordot(paths, plant.lag_output @ driven, 1).real
            # x(h) = x(0) + h sum_j b_j x'_j, with h x' of the nodes in the same diagonal form.
            ends = gauss.b @ gauss.right
            free[2 * n :, 2 * n :] += step * np.tensordot(ends * ones, inverse @ plant.lag_state, 1).real
            paths = (ends / (step * gauss.alpha**2))[:, None] * gauss.left
            gain[2 * n :] = np.tensordot(paths.T, driven, 1).real.transpose(1, 0, 2)
        self._system = np.ascontiguousarray(system.transpose(0, 2, 1, 3))
        self._load = load
        self._free = free
        self._gain = gain.reshape(n_state, m * n)

    @property
    def batch(self) -> int:
        """Number of intervals whose matrices fit the cache together."""
        m, n, _ = self.shape
        return int(max(1, _BATCH // (8 * (m * n) ** 2)))

    def __call__(self, stiffness: Array, damping: Array | None) -> Array:
        """Return the maps (k, n_state, n_state) of k intervals.

        Parameters
        ----------
        stiffness, damping : (k * m, n, n)
            What is added to K and D at the nodes; damping may be None.
        """
        m, n, n_state = self.shape
        k = len(stiffness) // m
        stiffness = stiffness.reshape(k, m, n, n)
        system = np.empty((k, m, n, m, n))
        system[:] = self._system
        np.einsum("kjrjc->kjrc", system)[...] += stiffness
        load = np.empty((k, m, n, n_state))
        load[:] = self._load
        load[..., :n] -= stiffness
        load[..., n : 2 * n] -= self._drift * stiffness
        if damping is not None:
            damping = damping.reshape(k, m, n, n)
            system += damping[:, :, :, None, :] * self._to_velocity[:, None, :, None]
            load[..., n : 2 * n] -= damping
        unknowns = np.linalg.solve(system.reshape(k, m * n, m * n), load.reshape(k, m * n, n_state))
        maps: Array = self._gain @ unknowns
        maps += self._free
        return maps
