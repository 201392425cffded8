"""Where the linear terms stand in the Jacobian of a balance, and how they get there."""

from __future__ import annotations

import numpy as np

from hbnlp.core.types import Array, BoolArray, ComplexArray
from hbnlp.fourier import n_coefficients


class Pattern:
    """Where the linear terms stand in a Jacobian (n L, n L): a few entries of each block of two degrees of freedom.

    A complex block Z of harmonic h applied to a - i b has the cosine part Zr a + Zi b and the sine part Zr b - Zi a.
    """

    def __init__(self, used: BoolArray, n_harmonics: int) -> None:
        self._i, self._j = np.nonzero(used)
        self._orders = np.arange(1, n_harmonics + 1)
        length = n_coefficients(n_harmonics)
        cosine, sine = 2 * self._orders - 1, 2 * self._orders
        pairs = ((np.zeros(1, dtype=int),) * 2, (cosine, cosine), (sine, sine), (cosine, sine), (sine, cosine))
        self._rows = np.concatenate([np.add.outer(self._i * length, rows).ravel() for rows, _ in pairs])
        self._columns = np.concatenate([np.add.outer(self._j * length, columns).ravel() for _, columns in pairs])

    def add(
        self,
        matrix: Array,
        stiffness: Array,
        damping: Array,
        mass: Array,
        rate: float,
        lag: ComplexArray | None = None,
    ) -> None:
        """Add K + rate D d/dtheta + rate^2 M d^2/dtheta^2 acting on coefficients, less ``lag`` (H, n, n or more)."""
        i, j = self._i, self._j
        order = rate * self._orders
        static = stiffness[i, j]
        real = static[:, None] - mass[i, j][:, None] * order**2
        imaginary = damping[i, j][:, None] * order
        if lag is not None:
            blocks = lag[:, i, j].T
            real -= blocks.real
            imaginary -= blocks.imag
        real, imaginary = real.ravel(), imaginary.ravel()
        matrix[self._rows, self._columns] += np.concatenate([static, real, real, imaginary, -imaginary])
