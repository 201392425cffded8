"""Real least squares with columns scaled to unit length, also of complex equations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbnlp.core.types import Array


def least_squares(matrix: Array, right: Array) -> Array:
    """Return the least-squares solution of ``matrix @ x = right``, (n, k), of the right-hand sides (m, k)."""
    scale = np.linalg.norm(matrix, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    return np.asarray(np.linalg.lstsq(matrix / scale, right, rcond=None)[0] / scale[:, None])


def real_least_squares(matrix: NDArray[Any], right: NDArray[Any]) -> Array:
    """Return the real least-squares solution, (n, k), of complex equations."""
    return least_squares(real_and_imaginary(matrix), real_and_imaginary(right))


def real_and_imaginary(array: NDArray[Any]) -> Array:
    """Return real parts over imaginary parts, (2 m, ...)."""
    return np.concatenate([array.real, array.imag])
