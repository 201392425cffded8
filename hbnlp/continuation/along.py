"""A curve in those of its unknowns alone that vary along it."""

from __future__ import annotations

import numpy as np

from hbnlp.continuation.curve import Curve, null_vector
from hbnlp.core.types import Array


class Along:
    """A `Curve` without the unknowns that are zero on another one by symmetry: the same where there are none.

    Parameters
    ----------
    curve : Curve
    """

    parts = None

    def __init__(self, curve: Curve) -> None:
        self._curve = curve
        self._places = curve.parts.along if curve.parts is not None else np.arange(curve.size + 1)
        self.size = self._places.size - 1

    def part(self, y: Array) -> Array:
        """Return the unknowns of a point or direction that vary."""
        return y[self._places]

    def whole(self, part: Array) -> Array:
        """Return all unknowns of a point or direction."""
        y = np.zeros(self._curve.size + 1)
        y[self._places] = part
        return y

    def residual(self, y: Array) -> Array:
        """Return R(y), (size,)."""
        return self._curve.residual(self.whole(y))[self._places[:-1]]

    def jacobian(self, y: Array, out: Array) -> None:
        """Write dR/dy into an array (size, size + 1) of zeros."""
        if self._curve.parts is None:
            self._curve.jacobian(y, out)
        else:
            self._curve.parts.blocks(self.whole(y), out)

    def scale(self, y: Array) -> Array:
        """Return the sizes (size + 1,) by which changes of y are measured."""
        return self.part(self._curve.scale(self.whole(y)))

    def term_size(self, y: Array) -> float:
        """Return the size of the terms whose sum is R."""
        return self._curve.term_size(self.whole(y))

    def carried_from(self, other: Along, y: Array) -> Array:
        """Return a point or direction of another such curve in this one's unknowns."""
        return self.part(self._curve.carried_from(other._curve, other.whole(y)))


def tangent_at(curve: Curve, y: Array, scale: Array) -> Array:
    """Return the tangent at a point, also at a fold, where R_x alone is singular; of unit length in the scale."""
    seen = Along(curve)
    matrix = np.zeros((seen.size, seen.size + 1))
    seen.jacobian(seen.part(y), matrix)
    return seen.whole(null_vector(matrix * seen.part(scale))) * scale
