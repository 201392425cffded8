"""The membrane that the flow deflects: full nonlinear force law, and its monolithic coupling.

    2 mu W_k'' + S_k(W) = dCp_k + C_f,k,        C_f = 2 mu (alpha'' x - z'')

Within a time step the fluid answers the rates W' at its end by an affine load, dCp_k = load + response @ W'
(``response`` holds the added mass over dt). The structure's step, the average vector field method, which keeps its
energy balance exactly, is solved by Newton with that load inside, so that no ratio of masses can make it unstable.

References
----------
Quispel and McLaren (2008), doi:10.1088/1751-8113/41/4/045206.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hbnlp.dns._types import Array, FlowError
from hbnlp.dns.motion import Motion
from hbnlp.dns.plate import Shape

# three Gauss points integrate the change of a fifth-degree force law exactly, and others to the sixth power of the step
_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)
_NEWTON_STEPS = 30
_NEWTON_TOLERANCE = 1e-12
# near the root of double precision for deflections of order 0.1
_DIFFERENCE = 1e-8


class ForceLaw(Protocol):
    """Restoring force of a membrane in sine modes."""

    def restoring(self, deflection: Array) -> Array:
        """S_k(W), shape (n_modes,)."""

    def tangent(self, deflection: Array) -> Array:
        """Derivative of S with respect to W, shape (n_modes, n_modes)."""


@dataclass(frozen=True, kw_only=True)
class Membrane:
    """A membrane wing from (0, 0) to (1, 0) in the frame, pinned at both ends.

    Parameters
    ----------
    mass_ratio : float
        mu = rho_s h / (rho c).
    law : ForceLaw
        Restoring force: `NonlinearTension`, `LinearTension`, or any function in `Restoring`.
    n_modes : int
        Number of sine modes.
    deflection, rate : ndarray of shape (n_modes,), optional
        Initial W and W', zero by default.
    """

    mass_ratio: float
    law: ForceLaw
    n_modes: int = 10
    deflection: Array | None = None
    rate: Array | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass_ratio) and self.mass_ratio >= 0.0):
            raise ValueError(f"mass_ratio is {self.mass_ratio}; it must be finite and not negative")
        for name, value in (("deflection", self.deflection), ("rate", self.rate)):
            if value is not None and (np.shape(value) != (self.n_modes,) or not np.isfinite(value).all()):
                raise ValueError(
                    f"{name} has shape {np.shape(value)}; finite values of shape ({self.n_modes},) are needed"
                )
        try:
            given = np.shape(self.law.restoring(np.zeros(self.n_modes)))
        except ValueError as error:
            raise ValueError(
                f"law does not take {self.n_modes} modes, the n_modes of this membrane: {error}"
            ) from error
        if given != (self.n_modes,):
            raise ValueError(f"law returns a force of shape {given}; ({self.n_modes},) is needed")


@dataclass(frozen=True, kw_only=True)
class NonlinearTension:
    """Exact tension of a stretched membrane, -c_T w_xx (1 + w_x^2)^(-3/2).

    c_T = 2 Eh (delta0 + delta) with delta the exact arc length less one. The force derives from the potential V = 2 Eh
    (delta0 + delta)^2: integrating by parts, S_k = 2 c_T d(delta)/dW_k = dV/dW_k.

    Parameters
    ----------
    stretching : float
        Eh, Young's modulus times thickness over rho U^2 c.
    prestrain : float
        delta0.
    n_modes : int
        Number of sine modes.
    points : int
        Quadrature points along the chord; the midpoint rule converges spectrally here, as the integrand is smooth and
        periodic.
    """

    stretching: float
    prestrain: float
    n_modes: int = 10
    points: int = 128

    def __post_init__(self) -> None:
        if not self.stretching >= 0.0:
            raise ValueError(f"stretching is {self.stretching}; it must not be negative")
        if not self.n_modes >= 1:
            raise ValueError(f"n_modes is {self.n_modes}; at least 1 is needed")
        if self.points < 4 * self.n_modes:
            raise ValueError(f"points is {self.points}; at least four a mode, {4 * self.n_modes}, are needed")
        x = (np.arange(self.points) + 0.5) / self.points
        k = np.pi * np.arange(1, self.n_modes + 1)
        object.__setattr__(self, "_slopes", k * np.cos(np.outer(x, k)))

    def strain(self, deflection: Array) -> float:
        """Strain delta by the deflection: arc length less one."""
        slope = self._slope_matrix() @ deflection
        # sqrt(1 + s^2) - 1 without cancellation
        return float(np.mean(slope**2 / (np.sqrt(1.0 + slope**2) + 1.0)))

    def energy(self, deflection: Array) -> float:
        """Potential V(W), with the kinetic energy mu |W'|^2 in the same units."""
        return 2.0 * self.stretching * (self.prestrain + self.strain(deflection)) ** 2

    def restoring(self, deflection: Array) -> Array:
        """S_k(W), shape (n_modes,)."""
        slopes = self._slope_matrix()
        slope = slopes @ deflection
        gradient = slopes.T @ (slope / np.sqrt(1.0 + slope**2)) / self.points
        return 4.0 * self.stretching * (self.prestrain + self.strain(deflection)) * gradient

    def tangent(self, deflection: Array) -> Array:
        """Derivative of S, shape (n_modes, n_modes)."""
        slopes = self._slope_matrix()
        slope = slopes @ deflection
        root = np.sqrt(1.0 + slope**2)
        gradient = slopes.T @ (slope / root) / self.points
        curvature = (slopes.T * root**-3) @ slopes / self.points
        tension = self.prestrain + self.strain(deflection)
        return np.asarray(4.0 * self.stretching * (np.outer(gradient, gradient) + tension * curvature))

    def _slope_matrix(self) -> Array:
        matrix: Array = self._slopes  # type: ignore[attr-defined]
        return matrix


@dataclass(frozen=True)
class LinearTension:
    """Constant tension c_T: S_k = k^2 pi^2 c_T W_k."""

    tension: float
    n_modes: int = 10

    def restoring(self, deflection: Array) -> Array:
        """S_k(W), shape (n_modes,)."""
        return self._stiffness() * deflection

    def tangent(self, deflection: Array) -> Array:
        """Derivative of S, shape (n_modes, n_modes)."""
        del deflection
        return np.diag(self._stiffness())

    def energy(self, deflection: Array) -> float:
        """Potential V(W)."""
        return 0.5 * float(self._stiffness() @ deflection**2)

    def _stiffness(self) -> Array:
        return np.asarray(self.tension * (np.pi * np.arange(1, self.n_modes + 1)) ** 2)


@dataclass(frozen=True)
class Restoring:
    """A force law given by its force alone; its tangent, which only steers Newton's iteration, is differenced.

    Parameters
    ----------
    force : callable
        ``force(W) -> S(W)``, each of shape (n_modes,).
    """

    force: Callable[[Array], Array]

    def restoring(self, deflection: Array) -> Array:
        """S_k(W), shape (n_modes,)."""
        return np.asarray(self.force(deflection), dtype=float)

    def tangent(self, deflection: Array) -> Array:
        """Forward differences of S, shape (n_modes, n_modes)."""
        base = self.restoring(deflection)
        columns = [self.restoring(deflection + shift) - base for shift in _DIFFERENCE * np.eye(deflection.size)]
        return np.column_stack(columns) / _DIFFERENCE


def inertial_load(mass_ratio: float, n_modes: int, motion: Motion) -> Callable[[float], Array]:
    """Sine coefficients of C_f = 2 mu (alpha'' x - z'') as a function of time."""
    k = np.arange(1, n_modes + 1)
    of_x = -2.0 * (-1.0) ** k / (k * np.pi)
    of_one = 2.0 * (1.0 - (-1.0) ** k) / (k * np.pi)

    def load(time: float) -> Array:
        return np.asarray(2.0 * mass_ratio * (motion.pitch(time)[2] * of_x - motion.heave(time)[2] * of_one))

    return load


class MembraneShape(Shape):
    """Deflection decided by membrane and fluid together.

    Parameters
    ----------
    membrane : Membrane
        The membrane.
    motion : Motion
        Motion of the frame, for the inertial load.
    dt : float
        Time step.
    """

    def __init__(self, membrane: Membrane, motion: Motion, dt: float) -> None:
        self._membrane = membrane
        self._inertia = inertial_load(membrane.mass_ratio, membrane.n_modes, motion)
        self._dt = dt
        start = [
            np.zeros(membrane.n_modes) if value is None else np.array(value, dtype=float)
            for value in (membrane.deflection, membrane.rate)
        ]
        self.current = self.estimate = (start[0], start[1])
        self._last_rate = start[1]
        self._forcing = np.zeros(membrane.n_modes)

    def prepare(self, time: float) -> None:
        """Extrapolate the deflection."""
        deflection, rate = self.current
        self.estimate = (deflection + self._dt * (1.5 * rate - 0.5 * self._last_rate), 2.0 * rate - self._last_rate)
        self._forcing = self._inertia(time - 0.5 * self._dt)

    def rates(self, load: Array, response: Array) -> Array:
        """Solve the structure's step with the fluid's affine answer inside."""
        deflection, rate = self.current
        mass = 2.0 * self._membrane.mass_ratio / self._dt
        forcing = load + self._forcing + mass * rate
        linear = mass * np.eye(rate.size) - response
        new = self.estimate[1].copy()
        scale = 1.0 + float(np.abs(forcing).max())
        worst = math.inf
        for _ in range(_NEWTON_STEPS):
            change = 0.5 * self._dt * (rate + new)
            force, tangent = self._mean_force(deflection, change)
            residual = linear @ new + force - forcing
            worst = float(np.abs(residual).max())
            if not math.isfinite(worst):
                break
            correction = np.linalg.solve(linear + 0.5 * self._dt * tangent, residual)
            new = new - correction
            if np.abs(linear @ correction).max() < _NEWTON_TOLERANCE * scale:
                self.estimate = (deflection + 0.5 * self._dt * (rate + new), new)
                return new
        raise FlowError(
            f"the membrane's step did not converge in {_NEWTON_STEPS} Newton iterations (residual {worst:.2e}): "
            "take a smaller dt, and check that the force law and its tangent agree"
        )

    def accept(self) -> None:
        """Make the estimate the current state and keep the old rate for extrapolation."""
        self._last_rate = self.current[1]
        super().accept()

    def state(self) -> dict[str, Array]:
        """Arrays that a restart needs."""
        return {**super().state(), "W_rate_before": self._last_rate}

    def restore(self, arrays: dict[str, Array], time: float) -> None:
        """Set the state from arrays as `state` returned them; an empty dict keeps the initial deflection."""
        super().restore(arrays, time)
        if arrays:
            self._last_rate = arrays["W_rate_before"]

    def _mean_force(self, start: Array, change: Array) -> tuple[Array, Array]:
        """Mean of S along the straight path from start to start + change, and its derivative with respect to change."""
        law = self._membrane.law
        force, tangent = np.zeros_like(start), np.zeros((start.size, start.size))
        for node, weight in zip(0.5 * (1.0 + _GAUSS_NODES), 0.5 * _GAUSS_WEIGHTS, strict=True):
            point = start + node * change
            force += weight * law.restoring(point)
            tangent += weight * node * law.tangent(point)
        return force, tangent
