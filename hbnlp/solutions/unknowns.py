"""What a point of a curve of solutions consists of, and by which sizes its changes are measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.continuation.curve import TINY
from hbnlp.core.types import Array


@dataclass(frozen=True)
class Free:
    """A scalar among the unknowns: a parameter of the system, or the factor on its excitation.

    Attributes
    ----------
    name : str or None
        The parameter; None is the factor on the excitation.
    floor : float
        Changes are measured relative to the value, or to this where that is smaller.
    """

    name: str | None
    floor: float = TINY


@dataclass(frozen=True)
class Unknowns:
    """The layout of ``y = (coefficients, unknowns of the conditions, free scalars)``; the last entry is continued in.

    Attributes
    ----------
    n_coefficients : int
        Those of the displacements, harmonics of one after another's.
    n_added : int
        Unknowns that a condition brings along, of the size of one: a null vector.
    free : tuple of Free
        The scalars, as many as conditions and one more.
    floor : float
        Coefficients are measured relative to their norm, or to this where it is smaller: a curve may begin at rest.
    """

    n_coefficients: int
    n_added: int
    free: tuple[Free, ...]
    floor: float = TINY

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.n_coefficients + self.n_added + len(self.free)

    def coefficients(self, y: Array) -> Array:
        """Return the coefficients (n_coefficients,)."""
        return y[: self.n_coefficients]

    def added(self, y: Array) -> Array:
        """Return the unknowns of the conditions (n_added,)."""
        return y[self.n_coefficients : self.n_coefficients + self.n_added]

    def scalars(self, y: Array) -> Array:
        """Return the free scalars (len(free),)."""
        return y[self.n_coefficients + self.n_added :]

    def joined(self, x: Array, scalars: ArrayLike, added: ArrayLike = ()) -> Array:
        """Return the point y of its parts."""
        return np.concatenate([x, np.asarray(added, dtype=float), np.asarray(scalars, dtype=float)])

    def fixing_last(self) -> Array:
        """Return the row that fixes what is continued in."""
        row = np.zeros(self.size)
        row[-1] = 1.0
        return row

    def size_of(self, y: Array) -> float:
        """Return the size by which changes of the coefficients are measured."""
        return max(float(np.linalg.norm(self.coefficients(y))), self.floor)

    def scale(self, y: Array) -> Array:
        """Return the sizes (size,) by which changes of y are measured."""
        scale = np.ones(y.size)
        scale[: self.n_coefficients] = self.size_of(y)
        for i, scalar in enumerate(self.free, start=y.size - len(self.free)):
            scale[i] = max(abs(y[i]), scalar.floor)
        return scale
