"""The balance as CasADi expressions: unknowns, parameters, residual and outputs, for programs made of them."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.balance.output_groups import alike_outputs, derivative_by_lags
from hbnlp.balance.sampling import Sampling
from hbnlp.core.kept import built_once
from hbnlp.fourier import FourierBasis, differentiation, n_coefficients
from hbnlp.systems.lags import Lags
from hbnlp.systems.signals import excitation_signals
from hbnlp.systems.system import System


class Symbols:
    """Residual and outputs of a balance as expressions of its unknowns and the system's parameters.

    Parameters
    ----------
    system : System
    sampling : Sampling

    Attributes
    ----------
    x : casadi.MX
        Unknowns (n (2H+1),), the array (n, 2H+1) of coefficients row by row.
    p : casadi.MX
        Parameters in the order of ``system.parameters.names``.
    """

    def __init__(self, system: System, sampling: Sampling) -> None:
        self._system, self._sampling = system, sampling
        length = n_coefficients(sampling.n_harmonics)
        self.x = ca.MX.sym("x", system.n_dof * length)
        self.p = ca.MX.sym("p", len(system.parameters.names))
        self._coefficients = ca.reshape(self.x, length, system.n_dof)

    def symbol(self, name: str) -> ca.MX:
        """Return the symbol of a parameter."""
        return self.p[self._system.parameters.index(name)]

    @built_once
    def residual(self) -> ca.MX:
        """The residual, of the size and order of x."""
        system, basis = self._system, self._sampling.force
        if not system.is_nonlinear:
            return ca.vec(self._linear_terms)
        q, v = self._sampled(basis, *self._motion[:2])
        force = system.compiled_force.value.map(basis.n_samples)
        samples = force(q, v, *self._phases_and_parameters(basis))
        return ca.vec(self._linear_terms + ca.DM(basis.projection) @ samples.T)

    @built_once
    def outputs(self) -> ca.MX:
        """Coefficients (n_outputs, 2H+1) of all outputs, projected from samples of the signals.

        What is linear in the lag states, as lift is, takes no samples of these: they are many.
        """
        length = self._coefficients.shape[0]
        rows: list[ca.MX] = [ca.MX()] * len(self._system.output_names)
        for spectrum, indices, function in alike_outputs(self._system):
            basis = self._sampling.outputs(spectrum)
            by_lags = derivative_by_lags(function) if self._system.n_lags else None
            sampled = self._system.n_lags and by_lags is None
            lags = self._lag_states if sampled else ca.MX(length, self._system.n_lags)
            signals = self._sampled(basis, *self._motion, lags)
            samples = function.map(basis.n_samples)(*signals, *self._phases_and_parameters(basis))
            found = samples @ ca.DM(basis.projection.T)
            if by_lags is not None:
                found += self._lagged(by_lags(self.p)).T
            for index, row in zip(indices, ca.vertsplit(found), strict=True):
                rows[index] = row
        return ca.vertcat(*rows) if rows else ca.MX(0, length)

    @built_once
    def _motion(self) -> tuple[ca.MX, ca.MX, ca.MX]:
        """Coefficients (2H+1, n) of displacements, velocities and accelerations."""
        by_phase = ca.sparsify(ca.DM(differentiation(self._sampling.n_harmonics)))
        first = self._rate * (by_phase @ self._coefficients)
        return self._coefficients, first, self._rate * (by_phase @ first)

    @property
    def _rate(self) -> ca.MX:
        return self.symbol("omega") / self._sampling.periods

    def _sampled(self, basis: FourierBasis, *signals: ca.MX) -> list[ca.MX]:
        sampling = ca.DM(basis.sampling)
        return [(sampling @ each).T for each in signals]

    def _phases_and_parameters(self, basis: FourierBasis) -> tuple[ca.DM, ca.MX]:
        return ca.DM(self._sampling.periods * basis.theta[None, :]), ca.repmat(self.p, 1, basis.n_samples)

    @built_once
    def _linear_terms(self) -> ca.MX:
        """Coefficients (2H+1, n) of M q'' + D q' + K q - L_x x - excitation."""
        mass, damping, stiffness, lag_output = self._system.matrices(self.p)[:4]
        displacements, first, second = self._motion
        balance = second @ mass.T + first @ damping.T + displacements @ stiffness.T
        if self._system.n_lags:
            balance -= self._lagged(lag_output)
        return balance - self._excitation[0]

    @built_once
    def _excitation(self) -> tuple[ca.MX, ca.MX]:
        """Coefficients (2H+1, n) of the load and (2H+1, n_u) of u''."""
        own, rate = self._sampling.n_harmonics_of_excitation, self._rate
        over_periods = ca.DM(self._sampling.over_periods(np.eye(n_coefficients(own))).T)
        forcing, motion = ((over_periods @ e.symbolic(self.p, own).T) for e in excitation_signals(self._system))
        by_phase = ca.sparsify(ca.DM(differentiation(self._sampling.n_harmonics)))
        first = rate * (by_phase @ motion)
        second = rate * (by_phase @ first)
        by_motion, by_first, by_second = self._system.matrices(self.p)[4:]
        load = forcing + motion @ by_motion.T + first @ by_first.T + second @ by_second.T
        return load, second

    @built_once
    def _lag_states(self) -> ca.MX:
        """Coefficients (2H+1, m) of x."""
        return self._lagged(ca.MX(ca.DM.eye(self._system.n_lags)))

    @built_once
    def _lags(self) -> Lags:
        return Lags(self._system.lag_state, self._system.lag_input, self._system.lag_motion)

    def _lagged(self, output: ca.MX) -> ca.MX:
        """Coefficients (2H+1, k) of C x with a matrix C (k, m): harmonic by harmonic C (s - A)^-1 [B, B_u] s^2 [q; u].

        The transfer matrices, formed in A's eigenvectors, hold parameters alone: numbers, where the frequency is one.
        """
        lags, rate = self._lags, self._rate
        accelerations = ca.horzcat(self._motion[2], self._excitation[1])
        in_r, in_i = ca.DM(lags.inputs.real), ca.DM(lags.inputs.imag)
        out_r, out_i = output @ ca.DM(lags.vectors.real), output @ ca.DM(lags.vectors.imag)
        rows = []
        for h in range(self._sampling.n_harmonics + 1):
            over_r, over_i = ca.DM(-lags.poles.real[None, :]), h * rate - ca.DM(lags.poles.imag[None, :])
            weight_r, weight_i = over_r / (over_r**2 + over_i**2), -over_i / (over_r**2 + over_i**2)
            weight_r, weight_i = (ca.repmat(each, output.shape[0], 1) for each in (weight_r, weight_i))
            by_r, by_i = out_r * weight_r - out_i * weight_i, out_r * weight_i + out_i * weight_r
            transfer_r, transfer_i = by_r @ in_r - by_i @ in_i, by_r @ in_i + by_i @ in_r
            cosine = accelerations[2 * h - 1 if h else 0, :]
            if not h:
                rows.append(cosine @ transfer_r.T)
                continue
            sine = accelerations[2 * h, :]  # the amplitude is cosine - i sine
            rows.append(cosine @ transfer_r.T + sine @ transfer_i.T)
            rows.append(sine @ transfer_r.T - cosine @ transfer_i.T)
        return ca.vertcat(*rows)
