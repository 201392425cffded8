"""A constant part of the linearised equations, diagonalised: what exponential collocation takes as exact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hbnlp.core.types import Array, ComplexArray, IntArray
from hbnlp.stability.spectra import NEGLIGIBLE
from hbnlp.systems.plant import Plant

# Part of the tolerance that rounding may take; it takes more where J is defective, or nearly so.
_ROUNDING = 1e-3


class ConstantPart(NamedTuple):
    """A constant part of the equations: its modes, its entries of f_q and f_v, and what tells whose it is."""

    modes: Modes
    entries: Array
    key: bytes


class Modes:
    """The equations with a constant in place of the force's derivatives, z' = J z, diagonalised.

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
        self,
        plant: Plant,
        basis: tuple[ComplexArray, ComplexArray, ComplexArray],
        rows: IntArray,
        columns: IntArray,
        rounding: float = 0.0,
    ) -> None:
        exponents, right, left = basis
        self.rows, self.columns, self.rounding = rows, columns, rounding
        one = exponents.imag >= 0.0
        twice = np.where(exponents.imag > 0.0, 2.0, 1.0)[one]
        self.exponents: ComplexArray = exponents[one].astype(complex)
        self.right, self.left = right[:, one] * twice, left[one]
        acceleration = np.linalg.inv(plant.mass)[:, self.rows]
        gain = np.concatenate([np.zeros_like(acceleration), acceleration, plant.lag_input @ acceleration])
        self.driven = self.left @ gain

    def coupling(self, period: float) -> Array:
        """Return how much the columns feed themselves by the rows, (n_modes, n_rows, n_columns), in a period.

        It is zero for a mode that has decayed after one.
        """
        lasting = self.exponents.real * period > np.log(1e-3 * NEGLIGIBLE)
        driven, seen = np.abs(self.driven) * (period * lasting)[:, None], np.abs(self.right[self.columns])
        coupling: Array = driven[:, :, None] * seen.T[:, None, :]
        return coupling

    @staticmethod
    def of(plant: Plant, state_matrix: Array, rows: IntArray, columns: IntArray, tol: float) -> Modes | None:
        """Return the modes, or None where J has no eigenvectors to compute with.

        Parameters
        ----------
        plant : Plant
        state_matrix : (n_state, n_state)
            J.
        rows, columns : IntArray
            Where what is left of f_q and f_v, side by side, may differ from zero.
        tol : float
            Of the multipliers.
        """
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
        return Modes(plant, (exponents.astype(complex), right.astype(complex), left), rows, columns, rounding)


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
