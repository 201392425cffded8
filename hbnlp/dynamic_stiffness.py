"""The linear part of the balance, harmonic by harmonic, with the lag states eliminated exactly.

With ``s = i h omega / periods`` and ``T(s) = L_x (s - A)^-1 [B, B_u]``::

    Z_h = K + s D + s^2 (M - T_q),        E_h = F_h + (K_u + s D_u + s^2 (M_u + T_u)) u_h
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from hbnlp.fourier import Array, ComplexArray, FourierBasis, n_coefficients, to_complex
from hbnlp.lags import Lags
from hbnlp.system import System


class Laws(NamedTuple):
    """All that depends on the parameters alone, or its derivative by one of them."""

    mass: Array
    damping: Array
    stiffness: Array
    lag_output: Array
    input_stiffness: Array
    input_damping: Array
    input_mass: Array
    forcing: ComplexArray  # amplitudes (H+1, n)
    motion: ComplexArray  # amplitudes (H+1, n_u)


class DynamicStiffness:
    """Z and E of a system, and their derivatives by any parameter, as complex arrays.

    The matrices and the amplitudes of forcing and motion are kept until a parameter other than omega changes.
    """

    def __init__(self, system: System, n_harmonics: int, periods: int) -> None:
        self.system = system
        self.n_harmonics = n_harmonics
        self.periods = periods
        self.omega = system.parameters.index("omega")
        self.lags = Lags(system.lag_state, system.lag_input, system.lag_motion)
        # forcing and motion are seldom evaluated: so many samples that their higher harmonics do not fold back
        self.excitation_basis = FourierBasis(n_harmonics, max(128, 8 * n_coefficients(n_harmonics) * periods))
        self._matrices = [system.mass, system.damping, system.stiffness, system.lag_output]
        self._matrices += [system.input_stiffness, system.input_damping, system.input_mass]
        self._signals = [system.forcing, system.motion]
        fixed = np.arange(len(system.parameters.names)) != self.omega
        if any(ca.depends_on(e, system.p[self.omega]) for e in [*self._matrices, *self._signals]):
            fixed[:] = True
        self._fixed = fixed
        self._key: bytes | None = None
        self._derivatives: dict[int, Laws] = {}

    def __call__(self, values: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return Z (H+1, n, n) and E (H+1, n) at the parameter values."""
        law = self.laws(values)
        s = self._s(values[self.omega])
        mass, input_mass = law.mass, law.input_mass
        if self.lags.n_lags:
            lag = self.lags.transfer(law.lag_output, s[:, 0, 0])
            n = self.system.n_dof
            mass, input_mass = mass - lag[..., :n], input_mass + lag[..., n:]
        dynamic = law.stiffness + s * (law.damping + s * mass)
        if not self.system.n_inputs:
            return dynamic, law.forcing
        motion = law.input_stiffness + s * (law.input_damping + s * input_mass)
        return dynamic, law.forcing + (motion @ law.motion[..., None])[..., 0]

    def derivative(self, values: Array, index: int) -> tuple[ComplexArray, ComplexArray]:
        """Return the derivatives of Z and E by parameter ``index``."""
        law, slope = self.laws(values), self._law_derivatives(values, index)
        n, s = self.system.n_dof, self._s(values[self.omega])
        lag = self.lags.transfer(law.lag_output, s[:, 0, 0])
        lag_slope = self.lags.transfer(slope.lag_output, s[:, 0, 0])
        mass, input_mass = law.mass - lag[..., :n], law.input_mass + lag[..., n:]

        dynamic = slope.stiffness + s * (slope.damping + s * (slope.mass - lag_slope[..., :n]))
        motion = law.input_stiffness + s * (law.input_damping + s * input_mass)
        motion_slope = slope.input_stiffness + s * (slope.input_damping + s * (slope.input_mass + lag_slope[..., n:]))
        if index == self.omega:
            by_omega = self._s(1.0)
            lag_by_s = self.lags.transfer(law.lag_output, s[:, 0, 0], order=1)
            dynamic = dynamic + by_omega * (law.damping + s * (2.0 * mass - s * lag_by_s[..., :n]))
            motion_slope = motion_slope + by_omega * (law.input_damping + s * (2.0 * input_mass + s * lag_by_s[..., n:]))
        excitation = motion_slope @ law.motion[..., None] + motion @ slope.motion[..., None]
        return dynamic, slope.forcing + excitation[..., 0]

    def lag_amplitudes(self, values: Array, amplitudes: ComplexArray) -> ComplexArray:
        """Return the amplitudes (H+1, m) of the lag states for those of the displacements, (H+1, n)."""
        s = self._s(values[self.omega])
        driven = np.hstack([amplitudes, self.laws(values).motion])
        resolvent = self.lags.transfer(np.eye(self.lags.n_lags), s[:, 0, 0])
        return (s**2 * resolvent @ driven[..., None])[..., 0]

    def laws(self, values: Array) -> Laws:
        """Return matrices and amplitudes at the parameter values."""
        key = values[self._fixed].tobytes()
        if key != self._key:
            matrices, signals = self._functions
            forcing, motion = signals(self._tau, self._repeated(values))
            self._laws = Laws(*(np.array(e) for e in matrices(values)), self._amplitudes(forcing), self._amplitudes(motion))
            self._derivatives = {}
            self._key = key
        return self._laws

    def _law_derivatives(self, values: Array, index: int) -> Laws:
        if index not in self._derivatives:
            matrices, signals = self._derivative_functions
            unit = (np.arange(values.size) == index).astype(float)
            forcing, motion = signals(self._tau, self._repeated(values), self._repeated(unit))
            slopes = (np.array(e) for e in matrices(values, unit))
            self._derivatives[index] = Laws(*slopes, self._amplitudes(forcing), self._amplitudes(motion))
        return self._derivatives[index]

    @cached_property
    def _functions(self) -> tuple[ca.Function, ca.Function]:
        signals = ca.Function("signals", [self.system.tau, self.system.p], [ca.densify(e) for e in self._signals])
        return self.system.matrices, signals.map(self.excitation_basis.n_samples)

    @cached_property
    def _derivative_functions(self) -> tuple[ca.Function, ca.Function]:
        p, direction = self.system.p, ca.SX.sym("direction", self.system.p.numel())

        def along(expression: ca.SX) -> ca.SX:
            return ca.densify(ca.reshape(ca.jtimes(ca.vec(ca.densify(expression)), p, direction), *expression.shape))

        matrices = ca.Function("matrices_along", [p, direction], [along(e) for e in self._matrices])
        signals = ca.Function("signals_along", [self.system.tau, p, direction], [along(e) for e in self._signals])
        return matrices, signals.map(self.excitation_basis.n_samples)

    @property
    def _tau(self) -> Array:
        return self.periods * self.excitation_basis.theta[None, :]

    def _repeated(self, column: Array) -> Array:
        return np.repeat(column[:, None], self.excitation_basis.n_samples, axis=1)

    def _amplitudes(self, samples: ca.DM) -> ComplexArray:
        return to_complex((self.excitation_basis.projection @ np.array(samples).T).T).T

    def _s(self, omega: float) -> ComplexArray:
        return (1j * omega / self.periods * np.arange(self.n_harmonics + 1))[:, None, None]
