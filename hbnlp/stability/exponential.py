"""Exponential Gauss collocation: step maps that are exact for a constant part of the linearised equations.

With constants in place of the force's derivatives in the matrix J, only the rest S(t) is left to approximate::

    z' = J z - G g(t),      g(t) = S(t) C z

G are the columns by which the rows of f act that vary, C takes the displacements and velocities by which they do.
The values of g at the m Gauss nodes of an interval are the unknowns, for all initial states at once. Modes of J that g
does not reach, and those that decay within an interval, cost no intervals: their exponentials are exact.

Between the nodes the polynomial g misses S C z by a defect. What this changes at the end of the interval, to first
order, is solved for with the same matrix: each map comes with a second one, more accurate.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from hbnlp.core.types import Array, ComplexArray
from hbnlp.stability.integrals import Polynomials
from hbnlp.stability.modes import Modes

_BATCH = 500_000  # bytes of the matrices solved in one call, as in collocation.py
_LARGE = 32  # unknowns; measured: beyond, LAPACK's inverse and a product are faster than numpy's solution


class ExponentialMaps:
    """Step maps over intervals of one length, exact for the constant part.

    Parameters
    ----------
    modes : Modes
    nodes : int
        m, Gauss nodes an interval.
    step : float
        Length of an interval.
    """

    def __init__(self, modes: Modes, nodes: int, step: float) -> None:
        self._polynomials, self._columns = Polynomials.of(nodes), modes.columns
        places = len(self._polynomials.places)
        m, n_rows, n_columns = nodes, len(modes.rows), len(modes.columns)
        growth, forced = self._polynomials.integrals(modes.exponents * step)
        forced = (step * forced).reshape(len(growth), -1)
        seen = modes.right[modes.columns]
        # C z at all places: of the initial state; of g, and of what is beside it.
        free_seen = _real_product((growth.T[:, None, :] * seen).reshape(-1, len(growth)), modes.left)
        free_seen = free_seen.reshape(places, n_columns, -1)
        inner = (seen[:, None, :] * modes.driven.T).reshape(-1, len(growth))
        paths = _real_product(inner, forced).reshape(n_columns, n_rows, places, places).transpose(2, 0, 3, 1)
        self._paths = np.ascontiguousarray(paths[:m, :, :m]).reshape(m, n_columns, -1)
        beside = paths[:m, :, m:].reshape(m, n_columns, -1)
        self._known = np.concatenate([free_seen[:m], beside], axis=2)
        self._free_seen = free_seen[m:]
        self._paths_to_defects = paths[m:, :, :m].reshape(-1, m * n_rows)
        # The state at the end: of the initial state, of what is beside g; and, subtracted, of g.
        ends = forced.reshape(len(growth), places, places)[:, -1, :, None] * modes.driven[:, None, :]
        gain = _real_product(modes.right, ends.reshape(len(growth), -1))
        self._gain = np.ascontiguousarray(gain[:, : m * n_rows])
        self._free = np.hstack([_real_product(modes.right * growth[:, -1], modes.left), gain[:, m * n_rows :]])
        self.shape = (m, n_rows, n_columns)

    @property
    def batch(self) -> int:
        """Number of intervals whose matrices fit the cache together."""
        m, n_rows, _ = self.shape
        return int(max(1, _BATCH // (8 * (m * n_rows) ** 2)))

    def __call__(self, varying: Array) -> Array:
        """Return the maps of k intervals and, beside each, the one corrected for its defect: (k, 2, n_state, n_state).

        Parameters
        ----------
        varying : (k, m + 3, n_rows, n_columns)
            S at the places of the polynomials.
        """
        m, n_rows, n_columns = self.shape
        k, n_state = len(varying), len(self._gain)
        at_nodes, at_defects = varying[:, :m], varying[:, m:]
        system = (at_nodes @ self._paths).reshape(k, m * n_rows, m * n_rows)
        np.einsum("kii->ki", system)[...] += 1.0
        unknowns = _solved(system, (at_nodes @ self._known).reshape(k, m * n_rows, -1))
        ends = self._free - self._gain @ unknowns
        maps, of_defects = ends[..., :n_state], ends[..., n_state:]
        g = unknowns[..., :n_state]
        seen = self._free_seen - (self._paths_to_defects @ g).reshape(k, -1, n_columns, n_state)
        defects = self._polynomials.at_defects @ g.reshape(k, m, -1)
        defects = defects.reshape(k, -1, n_rows, n_state) - at_defects @ seen
        return np.stack([maps, maps + of_defects @ defects.reshape(k, -1, n_state)], axis=1)


def _solved(matrices: Array, right: Array) -> Array:
    """Return solutions of k systems (k, n, n) for as many or more right-hand sides (k, n, columns)."""
    if matrices.shape[1] < _LARGE:
        return np.linalg.solve(matrices, right).astype(float, copy=False)
    inverses = np.empty_like(matrices)
    for matrix, inverse in zip(matrices, inverses, strict=True):
        # LAPACK's order is by columns: of the transposed matrix, without a copy
        factors, pivots, _ = lapack.dgetrf(matrix.T, overwrite_a=True)
        inverse.T[:], singular = lapack.dgetri(factors, pivots, overwrite_lu=True)
        if singular:
            raise np.linalg.LinAlgError("Singular matrix")
    return inverses @ right


def _real_product(one: ComplexArray, other: ComplexArray) -> Array:
    """Return the real part of a product of complex matrices."""
    product: Array = one.real @ other.real
    product -= one.imag @ other.imag
    return product
