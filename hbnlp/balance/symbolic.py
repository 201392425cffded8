"""The balance as CasADi expressions: unknowns, parameters, residual and outputs, for programs made of them."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.balance.output_groups import alike_outputs
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
        """Coefficients (n_outputs, 2H+1) of all outputs, projected from samples of the signals."""
        lags = self._lag_states if self._system.n_lags else ca.MX(self._coefficients.shape[0], 0)
        rows: list[ca.MX] = [ca.MX()] * len(self._system.output_names)
        for spectrum, indices, function in alike_outputs(self._system):
            basis = self._sampling.outputs(spectrum)
            signals = self._sampled(basis, *self._motion, lags)
            samples = function.map(basis.n_samples)(*signals, *self._phases_and_parameters(basis))
            for index, row in zip(indices, ca.vertsplit(samples @ ca.DM(basis.projection.T)), strict=True):
                rows[index] = row
        return ca.vertcat(*rows) if rows else ca.MX(0, self._coefficients.shape[0])

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
            balance -= self._lag_states @ lag_output.T
        return balance - self._excitation[0]

    @built_once
    def _excitation(self) -> tuple[ca.MX, ca.MX]:
        """Coefficients (2H+1, n) of the load and (2H+1, m) of B_u u''."""
        own, rate = self._sampling.n_harmonics_of_excitation, self._rate
        over_periods = ca.DM(self._sampling.over_periods(np.eye(n_coefficients(own))).T)
        forcing, motion = ((over_periods @ e.symbolic(self.p, own).T) for e in excitation_signals(self._system))
        by_phase = ca.sparsify(ca.DM(differentiation(self._sampling.n_harmonics)))
        first = rate * (by_phase @ motion)
        second = rate * (by_phase @ first)
        by_motion, by_first, by_second = self._system.matrices(self.p)[4:]
        load = forcing + motion @ by_motion.T + first @ by_first.T + second @ by_second.T
        return load, second @ ca.DM(self._system.lag_motion.T)

    @built_once
    def _lag_states(self) -> ca.MX:
        """Coefficients (2H+1, m) of x, from (s - A) x = B q'' + B_u u'' in A's eigenvectors."""
        system, rate = self._system, self._rate
        lags = Lags(system.lag_state, system.lag_input, system.lag_motion)
        drive = self._motion[2] @ ca.DM(system.lag_input.T) + self._excitation[1]
        inverse = np.linalg.inv(lags.vectors)
        drive_r, drive_i = drive @ ca.DM(inverse.real.T), drive @ ca.DM(inverse.imag.T)
        rows = []
        for h in range(self._sampling.n_harmonics + 1):
            # an amplitude a - i b: its real and imaginary parts in eigenvector coordinates, each times 1 / (s - pole)
            cosine = 2 * h - 1 if h else 0
            real, imaginary = drive_r[cosine, :], drive_i[cosine, :]
            if h:
                real, imaginary = real + drive_i[2 * h, :], imaginary - drive_r[2 * h, :]
            over_r, over_i = ca.DM(-lags.poles.real[None, :]), h * rate - ca.DM(lags.poles.imag[None, :])
            size = over_r**2 + over_i**2
            state_r = (real * over_r + imaginary * over_i) / size
            state_i = (imaginary * over_r - real * over_i) / size
            vectors_r, vectors_i = ca.DM(lags.vectors.real.T), ca.DM(lags.vectors.imag.T)
            rows.append(state_r @ vectors_r - state_i @ vectors_i)
            if h:
                rows.append(-(state_r @ vectors_i + state_i @ vectors_r))
        return ca.vertcat(*rows)
