"""Lag states in the frequency domain: poles and residues, so that they never become unknowns."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.core.kept import by_one_thread
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import to_complex
from hbnlp.systems.signals import excitation_signals
from hbnlp.systems.system import System

LARGEST_CONDITION = 1e10


class Lags:
    """``x = (s - A)^-1 [B, B_u] (s^2 [q; u])`` with A diagonalised once.

    Parameters
    ----------
    state, drive, motion : array (m, m), (m, n), (m, n_u)
        A, B and B_u.

    Raises
    ------
    ValueError
        If A has (nearly) coinciding poles without as many eigenvectors.
    """

    def __init__(self, state: Array, drive: Array, motion: Array) -> None:
        self.n_lags = state.shape[0]
        poles, vectors = np.linalg.eig(state)
        condition = np.linalg.cond(vectors) if self.n_lags else 1.0
        if condition > LARGEST_CONDITION:
            raise ValueError(
                f"lag_state cannot be diagonalised (its eigenvectors have condition number {condition:.1e}, at most "
                f"{LARGEST_CONDITION:.0e} is accepted): poles coincide; move them apart by a relative 1e-4"
            )
        self.poles, self.vectors = poles.astype(complex), vectors.astype(complex)
        self.inputs = np.linalg.solve(self.vectors, np.hstack([drive, motion]).astype(complex))

    def residues(self, output: Array) -> ComplexArray:
        """Return the residues (m, k, n + n_u) of ``output (s - A)^-1 [B, B_u]``; ``output`` is (k, m)."""
        return np.asarray((output @ self.vectors).T[:, :, None] * self.inputs[:, None, :])

    def weights(self, s: ComplexArray) -> ComplexArray:
        """Return ``1 / (s - pole)``, (len(s), m): the factors of the residues."""
        return np.asarray(1.0 / (s[:, None] - self.poles))

    def states(self, s: ComplexArray, accelerations: ComplexArray) -> ComplexArray:
        """Return the amplitudes x (m, len(s)) for those of ``s^2 [q; u]``, (n + n_u, len(s))."""
        return np.asarray(self.vectors @ (self.weights(s).T * (self.inputs @ accelerations)))


def periodic_lag_states(system: System, s: ComplexArray, drive: ComplexArray) -> Array:
    """Return x(0) of ``x' = A x + sum_h drive_h exp(s_h t)``, drive (n_harmonics, m)."""
    if not system.n_lags:
        return np.zeros(0)
    # no constant part: the drives are accelerations of a periodic motion
    resolvents = s[1:, None, None] * np.eye(system.n_lags) - system.lag_state
    response: Array = np.linalg.solve(resolvents, drive[1:, :, None])[..., 0].real.sum(axis=0)
    return response


def lag_states_of_motion(system: System, values: Array) -> Array:
    """Return x(0) of ``x' = A x + B_u u''`` for the prescribed motion u at parameter values.

    Where the harmonics of u do not end, ``x = B_u u' + A B_u u + w`` leaves ``w' = A w + A^2 B_u u``, and w(0) is an
    integral of u over the period, each eigenvector of A by itself.

    Raises
    ------
    ValueError
        If the motion is not smooth enough between its switches.
    """
    if not system.n_lags or not system.n_inputs:
        return np.zeros(system.n_lags)
    omega = float(values[system.parameters.index("omega")])
    motion = excitation_signals(system)[1]
    if motion.highest is not None:
        s = 1j * omega * np.arange(motion.highest + 1)
        amplitudes = to_complex(motion.coefficients(values, motion.highest))
        return periodic_lag_states(system, np.asarray(s), (s**2 * (system.lag_motion @ amplitudes)).T)
    lags = Lags(system.lag_state, system.lag_input, system.lag_motion)
    poles = lags.poles[:, None] / omega
    # w(0) = int exp(pole (2 pi - theta)) / (1 - exp(2 pi pole)) ..., written so that nothing overflows
    toward = np.where(poles.real > 0.0, 0.0, 2.0 * np.pi)
    side = np.where(poles.real > 0.0, -1.0, 1.0)
    fading = side / -np.expm1(2.0 * np.pi * side * poles)

    def kernel(theta: Array) -> ComplexArray:
        return np.asarray(fading * np.exp(poles * (toward - theta)))

    integrals = motion.integrals(values, kernel) / omega
    by_motion = np.linalg.solve(lags.vectors, system.lag_motion.astype(complex))
    memory = (lags.vectors @ (lags.poles**2 * np.sum(by_motion * integrals, axis=1))).real
    now, rate = (e.full()[:, 0] for e in _motion_at(system)(0.0, values))
    return np.asarray(system.lag_motion @ rate + system.lag_state @ (system.lag_motion @ now) + memory)


@by_one_thread
def _motion_at(system: System) -> ca.Function:
    """Return the function (tau, p) -> u, u'."""
    signals = [ca.densify(each) for each in (system.motion, system.motion_derivatives[0])]
    return ca.Function("motion_at", [system.tau, system.p], signals)
