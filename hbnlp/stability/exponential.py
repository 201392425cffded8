"""Exponential Gauss collocation: step maps that are exact for the mean of the linearised equations.

With the mean of the force's derivatives in the constant matrix J, only the rest S(t) is left to approximate::

    z' = J z - G g(t),      g(t) = S(t) C z

G are the columns by which the rows of f act that vary, C takes the displacements and velocities by which they do.
The values of g at the m Gauss nodes of an interval are the unknowns, for all initial states at once. Modes of J that g
does not reach, and those that decay within an interval, cost no intervals: their exponentials are exact.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from hbnlp.core.types import Array, ComplexArray, IntArray
from hbnlp.stability.collocation import Gauss
from hbnlp.stability.spectra import NEGLIGIBLE
from hbnlp.systems.plant import Plant

# Part of the tolerance that rounding may take; it takes more where J is defective, or nearly so.
_ROUNDING = 1e-3
_BY_PARTS = 20.0  # beyond this product of eigenvalue and length, integrals are summed by parts
_QUADRATURE = 32
_BATCH = 500_000  # bytes of the matrices solved in one call, as in collocation.py


class MeanModes:
    """The equations with the mean of the force's derivatives, diagonalised once a solution.

    Attributes
    ----------
    exponents : (n_modes,), complex
        Eigenvalues of J, one of each conjugate pair.
    rows, columns : IntArray
        Rows of f that vary, and states (q, q') by which they do.
    right, left : (n_state, n_modes), (n_modes, n_state), complex
        Eigenvectors, those of pairs doubled, and their dual ones: matrices are real parts of products.
    driven : (n_modes, n_rows), complex
        left G.
    rounding : float
        What rounding in the eigenvectors may add to the error of multipliers.
    """

    def __init__(
        self, plant: Plant, basis: tuple[ComplexArray, ComplexArray, ComplexArray], rows: IntArray, columns: IntArray
    ) -> None:
        exponents, right, left = basis
        self.rows, self.columns, self.rounding = rows, columns, 0.0
        one = exponents.imag >= 0.0
        twice = np.where(exponents.imag > 0.0, 2.0, 1.0)[one]
        self.exponents: ComplexArray = exponents[one].astype(complex)
        self.right, self.left = right[:, one] * twice, left[one]
        acceleration = np.linalg.inv(plant.mass)[:, self.rows]
        gain = np.concatenate([np.zeros_like(acceleration), acceleration, plant.lag_input @ acceleration])
        self.driven = self.left @ gain

    def fastest(self, period: float) -> float:
        """Return the highest frequency of the modes that have not decayed after a period, with a reserve."""
        lasting = self.exponents[self.exponents.real * period > np.log(1e-3 * NEGLIGIBLE)]
        return float(np.abs(lasting.imag).max(initial=0.0))

    @staticmethod
    def of(plant: Plant, state_matrix: Array, varying: Array, tol: float) -> MeanModes | None:
        """Return the modes, or None where collocation of the whole equations is the method to use.

        They are used where what varies touches fewer than half of the states, by rows and by columns, and J has
        eigenvectors to compute with.

        Parameters
        ----------
        plant : Plant
        state_matrix : (n_state, n_state)
            J.
        varying : (n, n) or (n, 2n)
            Which entries of f_q, or of f_q and f_v, vary (not zero).
        tol : float
            Of the multipliers.
        """
        rows, columns = np.flatnonzero(varying.any(axis=1)), np.flatnonzero(varying.any(axis=0))
        if 2 * max(rows.size, columns.size) >= len(state_matrix):
            return None
        exponents, right = np.linalg.eig(state_matrix)
        try:
            left = np.linalg.inv(right)
        except np.linalg.LinAlgError:
            return None
        rounding = float(np.finfo(float).eps) * _condition(right, left)
        if not rounding < _ROUNDING * tol:
            return None
        # of a Jordan block eigenvectors may be so small in one state that its scale hides what they lack
        defect = np.abs((right * exponents) @ left - state_matrix)
        if not (defect <= 1e-8 * ((np.abs(right) * np.abs(exponents)) @ np.abs(left))).all():
            return None
        modes = MeanModes(plant, (exponents.astype(complex), right.astype(complex), left), rows, columns)
        modes.rounding = rounding
        return modes


def _condition(right: ComplexArray, left: ComplexArray) -> float:
    """Return a bound of the condition of eigenvectors that no units of states or scales of vectors change.

    It is the spectral radius of abs(left) abs(right), bounded by Collatz's quotients.

    References
    ----------
    F. L. Bauer, Optimally scaled matrices, Numer. Math. 5 (1963), doi:10.1007/BF01385880
    """
    matrix = np.abs(left) @ np.abs(right)
    vector = np.ones(len(matrix))
    for _ in range(8):
        vector = matrix @ vector
        vector /= vector.max()
    return float((matrix @ vector / vector).max())


class ExponentialMaps:
    """Step maps over intervals of one length, exact for the mean.

    Parameters
    ----------
    modes : MeanModes
    mean : pair of (n, n)
        Means of f_q and f_v, which are in the modes already; that of f_v may be None.
    gauss : Gauss
    step : float
        Length of an interval.
    """

    def __init__(self, modes: MeanModes, mean: tuple[Array, Array | None], gauss: Gauss, step: float) -> None:
        self._modes, self._mean = modes, mean[0]
        self._mean_damping = np.zeros_like(mean[0]) if mean[1] is None else mean[1]
        m, n_rows, n_columns = len(gauss.c), len(modes.rows), len(modes.columns)
        decay, forced = _integrals(modes.exponents * step, gauss)
        seen = modes.right[modes.columns]
        # C z at the nodes, of the initial state and of g; then the state at the end.
        self._free_seen = np.einsum("ci,ji,is->jcs", seen, decay[:, :-1].T, modes.left, optimize=True).real
        inner = (seen[:, None, :] * modes.driven.T[None]).reshape(-1, len(modes.exponents))
        paths = (inner @ (step * forced[:, :-1]).reshape(len(modes.exponents), -1)).real
        self._paths = np.ascontiguousarray(paths.reshape(n_columns, n_rows, m, m).transpose(2, 0, 3, 1))
        self._free = ((modes.right * decay[:, -1]) @ modes.left).real
        ends = (step * forced[:, -1])[:, :, None] * modes.driven[:, None, :]
        self._gain = (modes.right @ ends.reshape(len(modes.exponents), -1)).real
        self.shape = (m, n_rows, n_columns)

    @property
    def batch(self) -> int:
        """Number of intervals whose matrices fit the cache together."""
        m, n_rows, _ = self.shape
        return int(max(1, _BATCH // (8 * (m * n_rows) ** 2)))

    def __call__(self, stiffness: Array, damping: Array | None) -> Array:
        """Return the maps (k, n_state, n_state) of k intervals; arguments as of `StepMaps`."""
        m, n_rows, n_columns = self.shape
        k = len(stiffness) // m
        varying = stiffness - self._mean
        if damping is not None:
            varying = np.concatenate([varying, damping - self._mean_damping], axis=2)
        varying = varying[:, self._modes.rows[:, None], self._modes.columns].reshape(k, m, n_rows, n_columns)
        system = (varying @ self._paths.reshape(m, n_columns, -1)).reshape(k, m * n_rows, m * n_rows)
        np.einsum("kii->ki", system)[...] += 1.0
        load = (varying @ self._free_seen).reshape(k, m * n_rows, -1)
        maps: Array = -(self._gain @ np.linalg.solve(system, load))
        maps += self._free
        return maps


def _integrals(z: ComplexArray, gauss: Gauss) -> tuple[ComplexArray, ComplexArray]:
    """Return exp(z c) and the integrals over s from 0 to c of exp(z (c - s)) l_k(s), for c at the nodes and 1.

    l_k are the Lagrange polynomials of the nodes; (n, m + 1) and (n, m + 1, m).
    """
    ends, values, derivatives, sigma, weights = _polynomials(len(gauss.c))
    growth = np.exp(np.multiply.outer(z, ends))
    integrals = np.empty((len(z), len(ends), len(gauss.c)), dtype=complex)
    small = np.abs(z) <= _BY_PARTS
    kernel = np.exp(z[small, None, None] * (ends[:, None] * (1.0 - sigma))) * (ends[:, None] * weights)
    integrals[small] = np.einsum("njs,jsk->njk", kernel, values, optimize=True)
    large = z[~small]
    powers = large[:, None] ** -(1.0 + np.arange(len(gauss.c)))
    at_start = powers @ derivatives[:, 0]
    at_ends = np.tensordot(powers, derivatives[:, 1:], 1)
    integrals[~small] = growth[~small][:, :, None] * at_start[:, None, :] - at_ends
    return growth, integrals


@lru_cache(maxsize=16)
def _polynomials(nodes: int) -> tuple[Array, Array, Array, Array, Array]:
    """Return nodes and 1; l_k at points of quadrature below each; derivatives of l_k at 0 and at each; the rule."""
    c = Gauss.of(nodes).c
    ends = np.append(c, 1.0)
    x, w = legendre.leggauss(_QUADRATURE)
    sigma, weights = (x + 1.0) / 2.0, w / 2.0
    coefficients = np.linalg.inv(legendre.legvander(2.0 * c - 1.0, nodes - 1))
    values = legendre.legval(2.0 * np.multiply.outer(ends, sigma) - 1.0, coefficients).transpose(1, 2, 0)
    points = 2.0 * np.append(0.0, ends) - 1.0
    derivatives = np.array([legendre.legval(points, legendre.legder(coefficients, d, scl=2.0)).T for d in range(nodes)])
    return ends, np.ascontiguousarray(values), derivatives, sigma, weights
