"""Linear, quasi-linear and nonlinear membranes with pinned ends, in sine modes.

The displacement is ``w(x, t) = sum_k W_k(t) sin(k pi x)`` and the equation
``2 mu w_tt - c_T w_xx (1 + w_x^2)^(-3/2) = dCp`` [1]_, taken with the test functions ``2 sin(k pi x)``. As
``w_xx (1 + w_x^2)^(-3/2)`` is the derivative of ``w_x (1 + w_x^2)^(-1/2)``, one integration by parts leaves, for every
model::

    2 mu W_k'' + 2 c_T d(delta)/dW_k = dCp_k,      c_T = 2 Eh (delta0 + delta)

with the elongation ``delta = int sqrt(1 + w_x^2) dx - 1`` (nonlinear) or ``pi^2/4 sum m^2 W_m^2`` (quasi-linear); the
linear membrane keeps ``c_T0 = 2 Eh delta0``.

References
----------
.. [1] G. Nardini, S. J. Illingworth, R. D. Sandberg, "Linear and nonlinear lift frequency response of a pitching
   membrane wing at low Reynolds numbers".
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import real_number, whole_number
from hbnlp.core.types import Array

_CASADI = (ca.SX, ca.MX, ca.DM)


class MembraneProperties(Protocol):
    """What a membrane's laws need: numbers, or symbols of the same names."""

    @property
    def mass_ratio(self) -> Any:
        """The symbol or value of mu."""

    @property
    def stiffness(self) -> Any:
        """The symbol or value of Eh."""

    @property
    def prestrain(self) -> Any:
        """The symbol or value of delta0."""


@dataclass(frozen=True, kw_only=True)
class Membrane(ABC):
    """A membrane with pinned ends in sine modes; everything nondimensional (chord, stream velocity, density).

    Its laws take ``W``, the modal amplitudes: CasADi expressions (N, 1), or an array (N,) or (N, n_times); and ``p``,
    anything with the attributes ``mass_ratio``, ``stiffness`` and ``prestrain`` (numbers or symbols), by default the
    membrane itself.

    Parameters
    ----------
    mass_ratio : float
        mu = rho_s h / (rho c), not negative.
    stiffness : float
        Eh = E_s h / (rho U^2 c), positive.
    prestrain : float
        delta0, not negative; the tension at rest is c_T0 = 2 Eh delta0.
    n_modes : int
        Number N of sine modes.

    Raises
    ------
    ValueError, TypeError
        If a value is not of that kind.
    """

    mass_ratio: float = 0.5
    stiffness: float = 250.0
    prestrain: float = 0.002
    n_modes: int = 10

    def __post_init__(self) -> None:
        checked = {
            "mass_ratio": real_number("mass_ratio", self.mass_ratio, least=0.0),
            "stiffness": real_number("stiffness", self.stiffness, above=0.0),
            "prestrain": real_number("prestrain", self.prestrain, least=0.0),
            "n_modes": whole_number("n_modes", self.n_modes, least=1),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @cached_property
    def wave_numbers(self) -> Array:
        """Wave numbers k pi of the modes, k = 1..N, (N,)."""
        return np.pi * np.arange(1.0, self.n_modes + 1)

    # -- kinematics -------------------------------------------------------------------------------------------------

    def shape(self, x: ArrayLike) -> Array:
        """Return the modes sin(k pi x) at ``x`` (0 leading, 1 trailing edge), (len(x), N)."""
        return np.asarray(np.sin(np.multiply.outer(np.asarray(x, dtype=float), self.wave_numbers)))

    def displacement(self, W: ArrayLike, x: ArrayLike) -> Array:
        """Return w at ``x``, (len(x), ...), of amplitudes (N, ...)."""
        return np.asarray(self.shape(x) @ np.asarray(W, dtype=float))

    def camber(self, W: ArrayLike) -> Array:
        """Return the largest |w| along the chord, (...), of amplitudes (N, ...), to some 1e-8 of it."""
        amplitudes = np.asarray(W, dtype=float)
        columns = amplitudes.reshape(self.n_modes, -1)
        n_intervals = 16 * self.n_modes
        k = self.wave_numbers
        x = np.argmax(np.abs(self.displacement(columns, np.linspace(0.0, 1.0, n_intervals + 1))), axis=0) / n_intervals
        for _ in range(3):
            phase = np.multiply.outer(x, k)
            slope = np.sum(k * np.cos(phase) * columns.T, axis=1)
            curvature = -np.sum(k**2 * np.sin(phase) * columns.T, axis=1)
            step = np.divide(-slope, curvature, out=np.zeros_like(x), where=curvature != 0.0)
            x = np.clip(x + np.clip(step, -1.0 / n_intervals, 1.0 / n_intervals), 0.0, 1.0)
        return np.asarray(np.abs(np.sum(self.shape(x) * columns.T, axis=1)).reshape(amplitudes.shape[1:]))

    @abstractmethod
    def elongation(self, W: Any) -> Any:
        """Return delta, the strain by which the displaced membrane is longer than the chord."""

    @abstractmethod
    def _elongation_gradient(self, W: Any) -> Any:
        """Return d(delta)/dW_k, of the shape of W."""

    @abstractmethod
    def _elongation_curvature(self, W: Array) -> Array:
        """Return d2(delta)/dW_j dW_k of an array (N,), (N, N)."""

    # -- laws -------------------------------------------------------------------------------------------------------

    def tension(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return c_T = 2 Eh (delta0 + delta)."""
        p = self if p is None else p
        return 2.0 * p.stiffness * (p.prestrain + self.elongation(W))

    def restoring_force(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return 2 c_T d(delta)/dW_k, the loads dCp_k that hold the membrane in this shape, of the shape of W."""
        return 2.0 * self.tension(W, p) * self._elongation_gradient(W)

    def tangent_stiffness(self, W: ArrayLike, p: MembraneProperties | None = None) -> Array:
        """Return the restoring force's derivative at the shape ``W``, (N, N), of an array (N,) only."""
        p = self if p is None else p
        amplitudes = np.asarray(W, dtype=float)
        gradient = self._elongation_gradient(amplitudes)
        strain = p.prestrain + self.elongation(amplitudes)
        curvature = self._elongation_curvature(amplitudes)
        return np.asarray(4.0 * p.stiffness * (np.outer(gradient, gradient) + strain * curvature))

    def energy(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return 2 Eh (delta0 + delta)^2, the potential of the restoring force, beside mu sum W_k'^2 of the motion."""
        p = self if p is None else p
        return 2.0 * p.stiffness * (p.prestrain + self.elongation(W)) ** 2

    def mass_matrix(self, p: MembraneProperties | None = None) -> Any:
        """Return 2 mu I, (N, N)."""
        p = self if p is None else p
        return 2.0 * p.mass_ratio * ca.DM.eye(self.n_modes)

    def stiffness_matrix(self, p: MembraneProperties | None = None) -> Any:
        """Return k^2 pi^2 c_T0 on the diagonal, (N, N), the restoring force's derivative at W = 0."""
        p = self if p is None else p
        return 2.0 * p.stiffness * p.prestrain * ca.diag(ca.DM(self.wave_numbers**2))

    def nonlinear_force(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return the restoring force less that of `stiffness_matrix`, of the shape of W."""
        p = self if p is None else p
        return self.restoring_force(W, p) - 2.0 * p.stiffness * p.prestrain * _times(np.diag(self.wave_numbers**2), W)


@final
@dataclass(frozen=True, kw_only=True)
class LinearMembrane(Membrane):
    """The membrane of constant tension: ``2 mu W_k'' + k^2 pi^2 c_T0 W_k = dCp_k``.

    Its elongation is the quasi-linear one, of which its tension takes no notice.

    Everything is nondimensional (chord, stream velocity, density).

    Parameters
    ----------
    mass_ratio : float
        mu = rho_s h / (rho c), not negative.
    stiffness : float
        Eh = E_s h / (rho U^2 c), positive.
    prestrain : float
        delta0, not negative; the tension at rest is c_T0 = 2 Eh delta0.
    n_modes : int
        Number N of sine modes.
    """

    def elongation(self, W: Any) -> Any:
        """Return delta = pi^2/4 sum m^2 W_m^2."""
        return _row(self.wave_numbers**2 / 4.0, W**2)

    def tension(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return c_T0 = 2 Eh delta0, whatever W."""
        p = self if p is None else p
        return 2.0 * p.stiffness * p.prestrain + 0.0 * _row(np.zeros(self.n_modes), W)

    def tangent_stiffness(self, W: ArrayLike, p: MembraneProperties | None = None) -> Array:  # noqa: ARG002
        """Return k^2 pi^2 c_T0 on the diagonal, (N, N), whatever W."""
        p = self if p is None else p
        return np.diag(2.0 * p.stiffness * p.prestrain * self.wave_numbers**2)

    def energy(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return 2 Eh delta0 (delta0 + 2 delta), the potential of the restoring force."""
        p = self if p is None else p
        return 2.0 * p.stiffness * p.prestrain * (p.prestrain + 2.0 * self.elongation(W))

    def _elongation_gradient(self, W: Any) -> Any:
        return _times(np.diag(self.wave_numbers**2 / 2.0), W)

    def _elongation_curvature(self, W: Array) -> Array:  # noqa: ARG002
        return np.diag(self.wave_numbers**2 / 2.0)

    def nonlinear_force(self, W: Any, p: MembraneProperties | None = None) -> Any:  # noqa: ARG002
        """Return zeros."""
        return 0.0 * W


@final
@dataclass(frozen=True, kw_only=True)
class QuasiLinearMembrane(Membrane):
    """The membrane whose tension grows with the square of small slopes: ``2 mu W_k'' + k^2 pi^2 c_T W_k = dCp_k``.

    Its force is a cubic polynomial. It differs from the nonlinear membrane's at a relative order of slope^2.

    Everything is nondimensional (chord, stream velocity, density).

    Parameters
    ----------
    mass_ratio : float
        mu = rho_s h / (rho c), not negative.
    stiffness : float
        Eh = E_s h / (rho U^2 c), positive.
    prestrain : float
        delta0, not negative; the tension at rest is c_T0 = 2 Eh delta0.
    n_modes : int
        Number N of sine modes.
    """

    def elongation(self, W: Any) -> Any:
        """Return delta = pi^2/4 sum m^2 W_m^2."""
        return _row(self.wave_numbers**2 / 4.0, W**2)

    def _elongation_gradient(self, W: Any) -> Any:
        return _times(np.diag(self.wave_numbers**2 / 2.0), W)

    def _elongation_curvature(self, W: Array) -> Array:  # noqa: ARG002
        return np.diag(self.wave_numbers**2 / 2.0)


@final
@dataclass(frozen=True, kw_only=True)
class NonlinearMembrane(Membrane):
    """The membrane of exact arc length and curvature: ``2 mu w_tt - c_T w_xx (1 + w_x^2)^(-3/2) = dCp``.

    The integrals along the chord are midpoint sums. The integrands are even about both ends, so that the sums converge
    exponentially in the number of nodes, the faster the smaller the slopes. The default, ``4 N + 8`` and at least 32,
    leaves an error of 1e-12 of the force where amplitudes fall as k^-3 (those of a smooth load) up to slopes of 1, and
    of 1e-7 where they fall as k^-2.

    Ten modes against the exact circular arc of a uniform pressure: the tension is off by 4e-5 of it at a camber of 3 %,
    by 3e-4 at 17 %; both errors fall as N^-3, as the arc's curvature does not vanish at the ends and that of a sine
    series does.

    Everything is nondimensional (chord, stream velocity, density).

    Parameters
    ----------
    mass_ratio : float
        mu = rho_s h / (rho c), not negative.
    stiffness : float
        Eh = E_s h / (rho U^2 c), positive.
    prestrain : float
        delta0, not negative; the tension at rest is c_T0 = 2 Eh delta0.
    n_modes : int
        Number N of sine modes.
    n_nodes : int or None
        Number of nodes, more than ``n_modes``; None is the default above.
    """

    n_nodes: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.n_nodes is not None:
            advice = f", more than the {self.n_modes} modes, or None for the default"
            n_nodes = whole_number("n_nodes", self.n_nodes, least=self.n_modes + 1, advice=advice)
            object.__setattr__(self, "n_nodes", n_nodes)

    @cached_property
    def _slopes(self) -> Array:
        """Slopes k pi cos(k pi x) of the modes at the nodes, (n_nodes, N)."""
        n_nodes = max(32, 4 * self.n_modes + 8) if self.n_nodes is None else self.n_nodes
        x = (np.arange(n_nodes) + 0.5) / n_nodes
        return np.asarray(self.wave_numbers * np.cos(np.multiply.outer(x, self.wave_numbers)))

    def elongation(self, W: Any) -> Any:
        """Return delta = int sqrt(1 + w_x^2) dx - 1, without cancellation at small slopes."""
        squared = _times(self._slopes, W) ** 2
        return _row(np.full(len(self._slopes), 1.0 / len(self._slopes)), squared / (1.0 + (1.0 + squared) ** 0.5))

    def _elongation_gradient(self, W: Any) -> Any:
        slope = _times(self._slopes, W)
        return _times(self._slopes.T / len(self._slopes), slope / (1.0 + slope**2) ** 0.5)

    def _elongation_curvature(self, W: Array) -> Array:
        slope = self._slopes @ W
        return np.asarray((self._slopes.T * (1.0 + slope**2) ** -1.5) @ self._slopes / len(self._slopes))


def _times(matrix: Array, W: Any) -> Any:
    return ca.sparsify(ca.DM(matrix)) @ W if isinstance(W, _CASADI) else matrix @ np.asarray(W, dtype=float)


def _row(weights: Array, values: Any) -> Any:
    return _times(weights[np.newaxis, :], values) if isinstance(values, _CASADI) else weights @ np.asarray(values)
