"""The curves of odd motions: even harmonics are zero, and so is what they leave in these.

Their Jacobian has two blocks: the curve runs in odd harmonics, and in even ones curves cross that lack the symmetry.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.odd import even_positions
from hbnlp.continuation.curve import Parts
from hbnlp.core.types import Array
from hbnlp.solutions.equations import Equations, by_scalar


class OddEquations(Equations):
    """`Equations` whose solutions are odd motions all, with the odd and the even harmonics as `Parts`."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        if self.condition is None:
            self.terms = self.problem.odd_assembly
        is_even = np.zeros(self.problem.shape, dtype=bool)
        is_even[:, even_positions(self.problem.n_harmonics)] = True
        x = is_even.ravel()
        # a null vector has the harmonics of the motion
        added = x if self.unknowns.n_added else ()
        across = self.unknowns.joined(x, np.zeros(len(self._indices)), added).astype(bool)
        self.parts: Parts = Parts(np.flatnonzero(~across), np.flatnonzero(across), self._blocks)

    def point(self, coefficients: ArrayLike, last: float) -> Array:
        """Return the unknowns of a solution, coefficients of any number of harmonics, at a value of its free scalar."""
        return self._without_even(super().point(coefficients, last))

    def residual(self, y: Array) -> Array:
        """Return R(y), (size,)."""
        return self._without_even(super().residual(y))

    def _without_even(self, y: Array) -> Array:
        """Return a point or residual whose even harmonics are zero; it is overwritten."""
        y[self.parts.across] = 0.0
        return y

    def _blocks(self, y: Array, out: Array) -> Array:
        """Return the block of even harmonics, and write that of odd ones with the scalars' columns; see `Parts`."""
        along, across = self.parts.along, self.parts.across
        if self.condition is not None:
            whole = np.zeros((self.size, self.size + 1))
            self.jacobian(y, whole)
            out[:] = whole[np.ix_(along[:-1], along)]
            return whole[np.ix_(across, across)]
        at = self._at(y)
        count = out.shape[0]
        out[:, count] = by_scalar(self.terms, at, self._indices[0])[along[:-1]]
        return self.problem.odd_assembly.blocks(at.x, at.values, out[:, :count])
