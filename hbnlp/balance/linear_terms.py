"""The linear part of the balance: matrices times coefficients, and the lag states eliminated exactly per harmonic.

With the coefficients X (n, L) of q, the differentiation matrix d of `fourier`, ``w = omega / periods`` and, for
harmonic h, ``s = i h w`` and ``T(s) = L_x (s - A)^-1 [B, B_u]``::

    K X + w D X d' + w^2 M X d'd' - lag(X) - F - (K_u U + w D_u U d' + w^2 M_u U d'd'),
    lag of harmonic h = s^2 (T_q q_h + T_u u_h)
"""

from __future__ import annotations

import numpy as np

from hbnlp.balance.laws import CompiledLaws, Laws, LawsAt
from hbnlp.balance.pattern import Pattern
from hbnlp.balance.sampling import Sampling
from hbnlp.core.native import PerThread
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import to_complex
from hbnlp.systems.lags import Lags
from hbnlp.systems.system import System


class LinearBalance:
    """The linear terms of the residual and their derivatives by any parameter.

    What belongs to a thread's last parameter point is kept, so that a residual and its derivatives there share it, and
    of that what belongs to the laws until a parameter other than omega changes.
    """

    def __init__(self, system: System, sampling: Sampling) -> None:
        self._omega = system.parameters.index("omega")
        self._shape = (system.n_dof, system.n_inputs)
        self._operators = Operators(system, sampling)
        self._compiled = CompiledLaws(system, sampling)
        self._everywhere = Pattern(np.ones((system.n_dof, system.n_dof), dtype=bool), sampling.n_harmonics)
        self._last: PerThread[list[LinearPoint]] = PerThread(list)

    def residual(self, coefficients: Array, values: Array, load: float) -> Array:
        """Return the linear terms (n, L), the excitation multiplied by ``load``."""
        at = self._at(values)
        result, viscous, inertial = at.terms(coefficients)
        result += viscous
        result += inertial
        result -= load * at.excitation
        return result

    def add_jacobian(self, matrix: Array, values: Array) -> None:
        """Add their derivative by the coefficients to ``matrix`` (n L, n L)."""
        at = self._at(values)
        lag = at.transfer if self._operators.lags.n_lags else None
        at.of_laws.pattern.add(matrix, at.law.stiffness, at.law.damping, at.law.mass, at.rate, lag)

    def dynamic_stiffness(self, values: Array, stiffness: Array, damping: Array) -> ComplexArray:
        """Return the dynamic stiffness (H+1, n, n) of harmonics 0 to H, with more stiffness and damping by phase."""
        at = self._at(values)
        orders = np.arange(self._operators.orders.size + 1.0)[:, None, None]
        law = at.law
        blocks = np.empty((orders.size, *stiffness.shape), dtype=complex)
        np.subtract(law.stiffness + stiffness, (at.rate * orders) ** 2 * law.mass, out=blocks.real)
        np.multiply(orders, at.rate * law.damping + damping, out=blocks.imag)
        if self._operators.lags.n_lags:
            blocks[1:] -= at.transfer[..., : self._shape[0]]
        return blocks

    def excitation(self, values: Array) -> Array:
        """Return the coefficients (n, L) of forcing and prescribed motion, through their lag states, too."""
        return self._at(values).excitation

    def lag_states(self, coefficients: Array, values: Array) -> Array:
        """Return the coefficients (m, L) of the lag states."""
        at, lags = self._at(values), self._operators.lags
        result = np.zeros((lags.n_lags, coefficients.shape[1]))
        if lags.n_lags:
            signals = to_complex(np.vstack([coefficients, at.law.motion]))[:, 1:]
            amplitudes = lags.states(at.s, at.s**2 * signals)
            result[:, 1::2], result[:, 2::2] = amplitudes.real, -amplitudes.imag
        return result

    def term_size(self, coefficients: Array, values: Array) -> float:
        """Return the size of the terms that the residual balances: their largest entry."""
        at = self._at(values)
        terms = [*at.terms(coefficients), at.excitation]
        return max(float(max(term.max(), -term.min())) for term in terms)

    def residual_slope(self, coefficients: Array, values: Array, index: int, load: float) -> Array:
        """Return the derivative of the linear terms by parameter ``index``, (n, L)."""
        at, by = self._at(values), self._operators
        (n, n_inputs), law, rate = self._shape, at.law, at.rate
        result, load_slope = np.zeros(coefficients.shape), np.zeros(coefficients.shape)
        first, second = by.first(coefficients), by.second(coefficients)
        slope = at.of_laws.slope(index) if self._compiled.followed[index] else None
        if slope is not None:
            result += slope.stiffness @ coefficients + rate * (slope.damping @ first) + rate**2 * (slope.mass @ second)
            load_slope += slope.forcing
            if n_inputs:
                load_slope += by.motion_load(slope, law.motion, rate) + by.motion_load(law, slope.motion, rate)
        if index == self._omega:
            result += ((1.0 / by.periods) * law.damping) @ first + ((2.0 * rate / by.periods) * law.mass) @ second
            if n_inputs:
                turned, twice = by.first(law.motion), by.second(law.motion)
                load_slope += (law.input_damping @ turned + 2.0 * rate * (law.input_mass @ twice)) / by.periods
        if by.lags.n_lags:
            transfer = self._transfer_slope(at, index)
            result -= by.lagging(transfer[..., :n], coefficients)
            if n_inputs:
                load_slope += by.lagging(transfer[..., n:], law.motion)
                if slope is not None:
                    load_slope += by.lagging(at.transfer[..., n:], slope.motion)
        result -= load * load_slope
        return result

    def add_jacobian_slope(self, matrix: Array, values: Array, index: int) -> None:
        """Add the derivative of the Jacobian by parameter ``index`` to ``matrix`` (n L, n L)."""
        at, periods = self._at(values), self._operators.periods
        none = np.zeros_like(at.law.stiffness)
        if self._compiled.followed[index]:
            slope = at.of_laws.slope(index)
            self._everywhere.add(matrix, slope.stiffness, slope.damping, slope.mass, at.rate)
        if index == self._omega:
            damping, mass = at.law.damping / periods, (2.0 * at.rate / periods) * at.law.mass
            self._everywhere.add(matrix, none, damping, mass, 1.0)
        if self._operators.lags.n_lags:
            self._everywhere.add(matrix, none, none, none, at.rate, self._transfer_slope(at, index))

    def _transfer_slope(self, at: LinearPoint, index: int) -> ComplexArray:
        """Return the derivative of s^2 T(s) by parameter ``index``, (H, n, n + n_u)."""
        lags, orders = self._operators.lags, self._operators.orders[:, None]
        s = at.s[:, None]
        weights = lags.weights(s[:, 0])
        result = np.zeros((s.size, self._shape[0], sum(self._shape)), dtype=complex)
        if self._compiled.followed[index]:
            result += _summed(s**2 * weights, lags.residues(at.of_laws.slope(index).lag_output))
        if index == self._omega:
            by_s = (2.0 - s * weights) * (s * weights)
            result += _summed(orders * by_s, at.of_laws.residues)
        return result

    def _at(self, values: Array) -> LinearPoint:
        """Return what belongs to a parameter point, replaced as a whole when the thread asks for another.

        So an interrupt leaves nothing half done, and threads at different points do not take turns in making them.
        """
        last, omega = self._last(), float(values[self._omega])
        key = values[self._compiled.followed].tobytes()
        if last and last[0].of_laws.key == key:
            if last[0].omega == omega:
                return last[0]
            of_laws = last[0].of_laws
        else:
            of_laws = LawsAt(self._compiled, self._operators.lags, values)
        last[:] = [LinearPoint(self._operators, of_laws, omega)]
        return last[0]


class Operators:
    """What acts on coefficients, whatever the parameters: derivatives by phase and lag states."""

    def __init__(self, system: System, sampling: Sampling) -> None:
        h, self.periods = np.arange(1, sampling.n_harmonics + 1), sampling.periods
        self.lags = Lags(system.lag_state, system.lag_input, system.lag_motion)
        self.orders = 1j * h / self.periods
        # a derivative by phase exchanges cosine and sine of a harmonic
        self._exchanged = np.append(0, np.stack([2 * h, 2 * h - 1], axis=1))
        self._slopes = np.append(0.0, np.stack([h, -h], axis=1))
        self._curvatures = -np.append(0.0, np.repeat(h, 2) ** 2)

    def first(self, coefficients: Array) -> Array:
        """Return the derivative by phase."""
        return np.asarray(coefficients.take(self._exchanged, axis=1) * self._slopes)

    def second(self, coefficients: Array) -> Array:
        """Return the second derivative by phase."""
        return np.asarray(coefficients * self._curvatures)

    def motion_load(self, law: Laws, motion: Array, rate: float) -> Array:
        """Return the coefficients of K_u u + D_u u' + M_u u''."""
        load = law.input_stiffness @ motion + rate * (law.input_damping @ self.first(motion))
        return np.asarray(load + rate**2 * (law.input_mass @ self.second(motion)))

    def lagging(self, transfer: ComplexArray, signal: Array) -> Array:
        """Return the coefficients of ``transfer_h signal_h``; there is no static part."""
        # pairs (cosine, sine) as complex numbers are conjugates of the amplitudes
        pairs = np.ascontiguousarray(signal[:, 1:]).view(complex)
        result = np.zeros((transfer.shape[1], signal.shape[1]))
        result[:, 1:].view(complex)[:] = (transfer.conj() @ pairs.T[..., None])[..., 0].T
        return result


class LinearPoint:
    """The linear terms at one parameter point, of which nothing changes.

    Attributes
    ----------
    s : array (H,), complex
        The derivative by time of the harmonics h >= 1.
    transfer : array (H, n, n + n_u), complex
        ``s^2 T(s)`` of these; empty where there are no lag states.
    excitation : array (n, L)
        Coefficients of forcing and prescribed motion, through their lag states, too.
    """

    def __init__(self, operators: Operators, of_laws: LawsAt, omega: float) -> None:
        self._operators = operators
        self.of_laws, self.law = of_laws, of_laws.laws
        self.omega, self.rate = omega, omega / operators.periods
        self.s = np.asarray(omega * operators.orders)
        # at once, not when asked for: each thread has its own points, and none is to wait for what another one builds
        self.transfer = np.zeros((0, *self.law.mass.shape), dtype=complex)
        if operators.lags.n_lags:
            self.transfer = _summed((self.s**2)[:, None] * operators.lags.weights(self.s), of_laws.residues)
        self.excitation = self._load_with_motion() if self.law.motion.size else self.law.forcing

    def _load_with_motion(self) -> Array:
        law, by = self.law, self._operators
        load = law.forcing + by.motion_load(law, law.motion, self.rate)
        if by.lags.n_lags:
            load += by.lagging(self.transfer[..., law.forcing.shape[0] :], law.motion)
        return load

    def terms(self, coefficients: Array) -> tuple[Array, Array, Array]:
        """Return the terms of displacements, velocities and accelerations, the lag states among the last."""
        law, by = self.law, self._operators
        elastic = law.stiffness @ coefficients
        viscous = (self.rate * law.damping) @ by.first(coefficients)
        inertial = (self.rate**2 * law.mass) @ by.second(coefficients)
        if by.lags.n_lags:
            inertial -= by.lagging(self.transfer[..., : coefficients.shape[0]], coefficients)
        return elastic, viscous, inertial


def _summed(weights: ComplexArray, residues: ComplexArray) -> ComplexArray:
    """Return the sums of weights (k, m) times residues (m, ...), for each row of weights."""
    return np.asarray(
        (weights @ residues.reshape(residues.shape[0], -1)).reshape(weights.shape[0], *residues.shape[1:])
    )
