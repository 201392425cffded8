"""Strain of a membrane by its shape, in sine modes: of small slopes, or of the exact arc.

The elongation ``delta(W)`` is the strain by which the displaced membrane is longer than the chord. Its gradient is
split into what is linear in W, ``k^2 pi^2 / 2 W_k`` whatever the strain, and what large slopes add.

``W`` are CasADi expressions (N, 1), or an array (N,) or (N, n_times).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, final

import casadi as ca
import numpy as np

from hbnlp.core.types import Array

_CASADI = (ca.SX, ca.MX, ca.DM)


class Strain(ABC):
    """Elongation of a membrane with its first and second derivatives.

    Parameters
    ----------
    wave_numbers : ndarray, shape (N,)
        k pi of the sine modes.
    """

    def __init__(self, wave_numbers: Array) -> None:
        self.wave_numbers = wave_numbers

    @abstractmethod
    def elongation(self, W: Any) -> Any:
        """Return delta, (1, 1) or (n_times,)."""

    @abstractmethod
    def gradient_of_slopes(self, W: Any) -> Any:
        """Return what large slopes add to the linear gradient, of the shape of W: cubic in W where slopes are small."""

    @abstractmethod
    def curvature(self, W: Array) -> Array:
        """Return d2(delta)/dW_j dW_k of an array (N,), (N, N)."""

    def linear_gradient(self, W: Any) -> Any:
        """Return k^2 pi^2 / 2 W_k, of the shape of W."""
        return _times(np.diag(self.wave_numbers**2 / 2.0), W)

    def gradient(self, W: Any) -> Any:
        """Return d(delta)/dW_k, of the shape of W."""
        return self.linear_gradient(W) + self.gradient_of_slopes(W)


@final
class SmallSlopes(Strain):
    """Strain of small slopes, ``delta = 1/2 int w_x^2 dx = pi^2/4 sum m^2 W_m^2``."""

    def elongation(self, W: Any) -> Any:
        """Return pi^2/4 sum m^2 W_m^2."""
        return _row(self.wave_numbers**2 / 4.0, W**2)

    def gradient_of_slopes(self, W: Any) -> Any:
        """Return zeros, exact also as expressions."""
        return 0.0 * W

    def curvature(self, W: Array) -> Array:  # noqa: ARG002
        """Return k^2 pi^2 / 2 on the diagonal, whatever W."""
        return np.diag(self.wave_numbers**2 / 2.0)


@final
class ExactArc(Strain):
    """Strain of the exact arc, ``delta = int sqrt(1 + w_x^2) dx - 1``, by the midpoint rule.

    Parameters
    ----------
    wave_numbers : ndarray, shape (N,)
        k pi of the sine modes.
    n_nodes : int
        Number of midpoints, more than N: the rule is then exact for the products of two modes' slopes.

    Attributes
    ----------
    slopes : ndarray, shape (n_nodes, N)
        Slopes k pi cos(k pi x) of the modes at the nodes.
    """

    def __init__(self, wave_numbers: Array, n_nodes: int) -> None:
        super().__init__(wave_numbers)
        x = (np.arange(n_nodes) + 0.5) / n_nodes
        self.slopes: Array = wave_numbers * np.cos(np.multiply.outer(x, wave_numbers))

    def elongation(self, W: Any) -> Any:
        """Return int sqrt(1 + w_x^2) dx - 1, without cancellation at small slopes."""
        squared = _times(self.slopes, W) ** 2
        return _row(np.full(len(self.slopes), 1.0 / len(self.slopes)), squared / (1.0 + (1.0 + squared) ** 0.5))

    def gradient_of_slopes(self, W: Any) -> Any:
        """Return int w_x ((1 + w_x^2)^(-1/2) - 1) k pi cos(k pi x) dx, without cancellation at small slopes."""
        slope = _times(self.slopes, W)
        squared = slope**2
        stretched = 1.0 + squared
        return _times(-self.slopes.T / len(self.slopes), slope * squared / (stretched + stretched**0.5))

    def curvature(self, W: Array) -> Array:
        """Return int (1 + w_x^2)^(-3/2) jk pi^2 cos(j pi x) cos(k pi x) dx."""
        slope = self.slopes @ W
        return np.asarray((self.slopes.T * (1.0 + slope**2) ** -1.5) @ self.slopes / len(self.slopes))


def _times(matrix: Array, W: Any) -> Any:
    return ca.sparsify(ca.DM(matrix)) @ W if isinstance(W, _CASADI) else matrix @ np.asarray(W, dtype=float)


def _row(weights: Array, values: Any) -> Any:
    return _times(weights[np.newaxis, :], values) if isinstance(values, _CASADI) else weights @ np.asarray(values)
