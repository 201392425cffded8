"""The linear part of the balance: matrices times coefficients, and the lag states eliminated exactly per harmonic.

With the coefficients X (n, L) of q, the differentiation matrix d of `fourier`, ``w = omega / periods`` and, for
harmonic h, ``s = i h w`` and ``T(s) = L_x (s - A)^-1 [B, B_u]``::

    K X + w D X d' + w^2 M X d'd' - lag(X) - F - (K_u U + w D_u U d' + w^2 M_u U d'd'),
    lag of harmonic h = s^2 (T_q q_h + T_u u_h)
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from hbnlp.core.types import Array, BoolArray, ComplexArray
from hbnlp.fourier import FourierBasis, differentiation, n_coefficients, to_complex
from hbnlp.systems.lags import Lags
from hbnlp.systems.system import System


class Laws(NamedTuple):
    """All that depends on the parameters alone, or its derivative by one of them."""

    mass: Array
    damping: Array
    stiffness: Array
    lag_output: Array
    input_stiffness: Array
    input_damping: Array
    input_mass: Array
    forcing: Array  # coefficients (n, L)
    motion: Array  # coefficients (n_u, L)


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


class LinearBalance:
    """The linear terms of the residual and their derivatives by any parameter.

    Matrices, forcing and motion are kept until a parameter other than omega changes.
    """

    def __init__(self, system: System, n_harmonics: int, periods: int) -> None:
        self.system = system
        self.periods = periods
        self.omega = system.parameters.index("omega")
        self.lags = Lags(system.lag_state, system.lag_input, system.lag_motion)
        length = n_coefficients(n_harmonics)
        self._shape = (system.n_dof, length)
        self._moves = system.n_inputs > 0
        # forcing and motion are seldom evaluated: so many samples that their higher harmonics do not fold back
        self.excitation_basis = FourierBasis(n_harmonics, max(128, 8 * length * periods))
        self._first = differentiation(n_harmonics)
        self._second = self._first @ self._first
        self._orders = 1j * np.arange(1, n_harmonics + 1) / periods
        # coefficients to amplitudes a - i b of the harmonics h >= 1, and back as a real part
        h = np.arange(n_harmonics)
        self._to_amplitudes = np.zeros((length, n_harmonics), dtype=complex)
        self._to_amplitudes[2 * h + 1, h], self._to_amplitudes[2 * h + 2, h] = 1.0, -1j
        self._to_coefficients = self._to_amplitudes.conj().T
        self._n_harmonics = n_harmonics
        self._everywhere = Pattern(np.ones((system.n_dof, system.n_dof), dtype=bool), n_harmonics)
        self._matrices = [system.mass, system.damping, system.stiffness, system.lag_output]
        self._matrices += [system.input_stiffness, system.input_damping, system.input_mass]
        self._signals = [system.forcing, system.motion]
        self._fixed = np.arange(len(system.parameters.names)) != self.omega
        if any(ca.depends_on(e, system.p[self.omega]) for e in [*self._matrices, *self._signals]):
            self._fixed[:] = True
        self._key: bytes | None = None
        self._slopes: dict[int, Laws] = {}
        self._transfer: tuple[float, ComplexArray] | None = None
        self._excitation: tuple[float, Array] | None = None

    # -- residual and Jacobian --------------------------------------------------------------------------------------

    def residual(self, coefficients: Array, values: Array, load: float) -> Array:
        """Return the linear terms (n, L), the excitation multiplied by ``load``."""
        result, viscous, inertial = self._terms(coefficients, values)
        result += viscous
        result += inertial
        result -= load * self.excitation(values)
        return result

    def add_jacobian(self, matrix: Array, values: Array) -> None:
        """Add their derivative by the coefficients to ``matrix`` (n L, n L)."""
        law = self.laws(values)
        lag = self._lag_transfer(values) if self.lags.n_lags else None
        self._pattern.add(matrix, law.stiffness, law.damping, law.mass, values[self.omega] / self.periods, lag)

    def excitation(self, values: Array) -> Array:
        """Return the coefficients (n, L) of forcing and prescribed motion, through their lag states, too."""
        law = self.laws(values)
        if not self._moves:
            return law.forcing
        omega = values[self.omega]
        if self._excitation is None or self._excitation[0] != omega:
            load = law.forcing + self._motion_load(law, law.motion, omega / self.periods)
            if self.lags.n_lags:
                load += self._lagging(self._lag_transfer(values)[..., self._shape[0] :], law.motion)
            self._excitation = (omega, load)
        return self._excitation[1]

    def term_size(self, coefficients: Array, values: Array) -> float:
        """Return the size of the terms that the residual balances: their largest entry."""
        terms = [*self._terms(coefficients, values), self.excitation(values)]
        return max(float(max(term.max(), -term.min())) for term in terms)

    def _terms(self, coefficients: Array, values: Array) -> tuple[Array, Array, Array]:
        law = self.laws(values)
        rate = values[self.omega] / self.periods
        elastic = law.stiffness @ coefficients
        viscous = (rate * law.damping) @ (coefficients @ self._first.T)
        inertial = (rate**2 * law.mass) @ (coefficients @ self._second.T)
        if self.lags.n_lags:
            inertial -= self._lagging(self._lag_transfer(values)[..., : self._shape[0]], coefficients)
        return elastic, viscous, inertial

    def _lag_transfer(self, values: Array) -> ComplexArray:
        """Return s^2 T(s) of the harmonics h >= 1, (H, n, n + n_u), kept for the last omega."""
        omega = values[self.omega]
        if self._transfer is None or self._transfer[0] != omega:
            s = omega * self._orders
            self._transfer = (omega, _summed((s**2)[:, None] * self.lags.weights(s), self._residues))
        return self._transfer[1]

    def _lagging(self, transfer: ComplexArray, signal: Array) -> Array:
        """Return the coefficients of ``transfer_h signal_h``; there is no static part."""
        amplitudes = (signal @ self._to_amplitudes).T[..., None]
        return np.asarray(((transfer @ amplitudes)[..., 0].T @ self._to_coefficients).real)

    # -- derivatives by a parameter ---------------------------------------------------------------------------------

    def residual_slope(self, coefficients: Array, values: Array, index: int, load: float) -> Array:
        """Return the derivative of the linear terms by parameter ``index``, (n, L)."""
        law, n = self.laws(values), self._shape[0]
        rate = values[self.omega] / self.periods
        result, load_slope = np.zeros(self._shape), np.zeros(self._shape)
        first, second = coefficients @ self._first.T, coefficients @ self._second.T
        if self._matters(index):
            slope = self._law_slopes(values, index)
            result += slope.stiffness @ coefficients + rate * (slope.damping @ first) + rate**2 * (slope.mass @ second)
            load_slope += slope.forcing
            if self._moves:
                load_slope += self._motion_load(slope, law.motion, rate) + self._motion_load(law, slope.motion, rate)
        if index == self.omega:
            result += ((1.0 / self.periods) * law.damping) @ first + ((2.0 * rate / self.periods) * law.mass) @ second
            if self._moves:
                turned, twice = law.motion @ self._first.T, law.motion @ self._second.T
                load_slope += (law.input_damping @ turned + 2.0 * rate * (law.input_mass @ twice)) / self.periods
        if self.lags.n_lags:
            transfer = self._lag_transfer_slope(values, index)
            result -= self._lagging(transfer[..., :n], coefficients)
            if self._moves:
                load_slope += self._lagging(transfer[..., n:], law.motion)
                if self._matters(index):
                    moved = self._law_slopes(values, index).motion
                    load_slope += self._lagging(self._lag_transfer(values)[..., n:], moved)
        result -= load * load_slope
        return result

    def add_jacobian_slope(self, matrix: Array, values: Array, index: int) -> None:
        """Add the derivative of the Jacobian by parameter ``index`` to ``matrix`` (n L, n L)."""
        law, rate = self.laws(values), values[self.omega] / self.periods
        if self._matters(index):
            slope = self._law_slopes(values, index)
            self._everywhere.add(matrix, slope.stiffness, slope.damping, slope.mass, rate)
        if index == self.omega:
            none = np.zeros_like(law.stiffness)
            self._everywhere.add(matrix, none, law.damping / self.periods, (2.0 * rate / self.periods) * law.mass, 1.0)
        if self.lags.n_lags:
            none = np.zeros_like(law.stiffness)
            self._everywhere.add(matrix, none, none, none, rate, self._lag_transfer_slope(values, index))

    def _motion_load(self, law: Laws, motion: Array, rate: float) -> Array:
        load = law.input_stiffness @ motion + rate * (law.input_damping @ (motion @ self._first.T))
        return np.asarray(load + rate**2 * (law.input_mass @ (motion @ self._second.T)))

    def _lag_transfer_slope(self, values: Array, index: int) -> ComplexArray:
        """Return the derivative of s^2 T(s) by parameter ``index``, (H, n, n + n_u)."""
        s = (values[self.omega] * self._orders)[:, None]
        weights = self.lags.weights(s[:, 0])
        result = np.zeros((s.size, self._shape[0], self._shape[0] + self.system.n_inputs), dtype=complex)
        if self._matters(index):
            residues = self.lags.residues(self._law_slopes(values, index).lag_output)
            result += _summed(s**2 * weights, residues)
        if index == self.omega:
            by_s = (2.0 - s * weights) * (s * weights)
            result += _summed(self._orders[:, None] * by_s, self._residues)
        return result

    def _matters(self, index: int) -> bool:
        """Return whether matrices, forcing or motion depend on the parameter (omega seldom does)."""
        return bool(self._fixed[index])

    # -- amplitudes of the lag states -------------------------------------------------------------------------------

    def lag_amplitudes(self, coefficients: Array, values: Array) -> ComplexArray:
        """Return the complex amplitudes (H+1, m) of the lag states."""
        s = np.append(0.0, values[self.omega] * self._orders)
        driven = to_complex(np.vstack([coefficients, self.laws(values).motion])).T
        resolvent = _summed(self.lags.weights(s), self.lags.residues(np.eye(self.lags.n_lags)))
        return np.asarray((s**2)[:, None] * (resolvent @ driven[..., None])[..., 0])

    # -- what depends on the parameters -----------------------------------------------------------------------------

    def laws(self, values: Array) -> Laws:
        """Return matrices and coefficients of forcing and motion at the parameter values."""
        key = values[self._fixed].tobytes()
        if key != self._key:
            self._key = None  # an interrupt on the way leaves nothing that looks whole
            matrices, signals = self._functions
            forcing, motion = signals(self._tau, self._repeated(values))
            numbers = [e.full() for e in matrices(values)]
            self._laws = Laws._make([*numbers, self._coefficients(forcing), self._coefficients(motion)])
            every = np.full(self._laws.mass.shape, bool(self.lags.n_lags))
            used = every | (self._laws.stiffness != 0.0) | (self._laws.damping != 0.0) | (self._laws.mass != 0.0)
            self._pattern = Pattern(used, self._n_harmonics)
            self._residues = self.lags.residues(self._laws.lag_output)
            self._slopes, self._transfer, self._excitation = {}, None, None
            self._key = key
        return self._laws

    def _law_slopes(self, values: Array, index: int) -> Laws:
        self.laws(values)
        if index not in self._slopes:
            matrices, signals = self._slope_functions
            unit = (np.arange(values.size) == index).astype(float)
            forcing, motion = signals(self._tau, self._repeated(values), self._repeated(unit))
            numbers = [e.full() for e in matrices(values, unit)]
            self._slopes[index] = Laws._make([*numbers, self._coefficients(forcing), self._coefficients(motion)])
        return self._slopes[index]

    @cached_property
    def _functions(self) -> tuple[ca.Function, ca.Function]:
        signals = ca.Function("signals", [self.system.tau, self.system.p], [ca.densify(e) for e in self._signals])
        return self.system.matrices, signals.map(self.excitation_basis.n_samples)

    @cached_property
    def _slope_functions(self) -> tuple[ca.Function, ca.Function]:
        p, direction = self.system.p, ca.SX.sym("direction", self.system.p.numel())

        def along(expression: ca.SX) -> ca.SX:
            slope = ca.jtimes(ca.vec(ca.densify(expression)), p, direction)
            return ca.densify(ca.reshape(slope, *expression.shape))

        matrices = ca.Function("matrices_along", [p, direction], [along(e) for e in self._matrices])
        signals = ca.Function("signals_along", [self.system.tau, p, direction], [along(e) for e in self._signals])
        return matrices, signals.map(self.excitation_basis.n_samples)

    @property
    def _tau(self) -> Array:
        return self.periods * self.excitation_basis.theta[None, :]

    def _repeated(self, column: Array) -> Array:
        return np.repeat(column[:, None], self.excitation_basis.n_samples, axis=1)

    def _coefficients(self, samples: ca.DM) -> Array:
        return np.asarray(samples.full() @ self.excitation_basis.projection.T)


def _summed(weights: ComplexArray, residues: ComplexArray) -> ComplexArray:
    """Return the sums of weights (k, m) times residues (m, ...), for each row of weights."""
    return np.asarray(
        (weights @ residues.reshape(residues.shape[0], -1)).reshape(weights.shape[0], *residues.shape[1:])
    )
