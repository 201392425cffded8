"""The membrane that the flow deflects: what is asked of its structure, and the monolithic coupling.

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
from dataclasses import KW_ONLY, dataclass
from typing import Protocol

import numpy as np

from hbnlp.core.checks import finite_array, real_number, refused, whole_number
from hbnlp.core.types import Array
from hbnlp.dns.errors import FlowError
from hbnlp.dns.motion import Motion
from hbnlp.dns.plate import Shape

# three Gauss points integrate the change of a fifth-degree force law exactly, and others to the sixth power of the step
_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)
_NEWTON_STEPS = 30
_NEWTON_TOLERANCE = 1e-12


class Structure(Protocol):
    """What is needed of a membrane in sine modes; the models of `hbnlp.wing.membrane` have it."""

    @property
    def mass_ratio(self) -> float:
        """Mass ratio mu = rho_s h / (rho c)."""

    @property
    def n_modes(self) -> int:
        """Number of sine modes."""

    def restoring_force(self, W: Array, /) -> Array:
        """S_k(W), shape (n_modes,)."""

    def tangent_stiffness(self, W: Array, /) -> Array:
        """Derivative of S with respect to W, shape (n_modes, n_modes)."""


@dataclass(frozen=True)
class Membrane:
    """A membrane wing from (0, 0) to (1, 0) in the frame, pinned at both ends.

    Parameters
    ----------
    structure : Structure
        Mass ratio, modes and restoring force, e.g. `hbnlp.NonlinearMembrane`.
    deflection, rate : ndarray of shape (n_modes,), optional
        Initial W and W', zero by default.

    Raises
    ------
    ValueError
        If the mass ratio is negative, or something is not of the shape that the number of modes asks for.
    """

    structure: Structure
    _: KW_ONLY
    deflection: Array | None = None
    rate: Array | None = None

    def __post_init__(self) -> None:
        structure = self.structure
        for part in ("mass_ratio", "n_modes", "restoring_force", "tangent_stiffness"):
            if isinstance(structure, type) or not hasattr(structure, part):
                raise refused(TypeError, "structure", structure, "a membrane, such as hbnlp.NonlinearMembrane(...)")
        n_modes = whole_number("n_modes of the structure", structure.n_modes, least=1)
        real_number("mass_ratio of the structure", structure.mass_ratio, least=0.0)
        for name, value in (("deflection", self.deflection), ("rate", self.rate)):
            if value is not None:
                finite_array(name, value, (n_modes,))
        rest = np.zeros(n_modes)
        for law, needed in (("restoring_force", (n_modes,)), ("tangent_stiffness", (n_modes, n_modes))):
            given = np.shape(getattr(structure, law)(rest))
            if given != needed:
                raise ValueError(
                    f"{law} of the structure returns the shape {given} for {n_modes} modes; {needed} is needed"
                )

    @property
    def n_modes(self) -> int:
        """Number of sine modes."""
        return self.structure.n_modes


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
        self._structure = membrane.structure
        self._inertia = inertial_load(membrane.structure.mass_ratio, membrane.n_modes, motion)
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
        mass = 2.0 * self._structure.mass_ratio / self._dt
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
        structure = self._structure
        force, tangent = np.zeros_like(start), np.zeros((start.size, start.size))
        for node, weight in zip(0.5 * (1.0 + _GAUSS_NODES), 0.5 * _GAUSS_WEIGHTS, strict=True):
            point = start + node * change
            force += weight * structure.restoring_force(point)
            tangent += weight * node * structure.tangent_stiffness(point)
        return force, tangent
