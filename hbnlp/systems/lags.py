"""Lag states in the frequency domain: poles and residues, so that they never become unknowns."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import to_complex
from hbnlp.systems.signals import ALIASING_TOL, excitation_signals
from hbnlp.systems.system import System

LARGEST_CONDITION = 1e10
FIRST_HARMONICS, MOST_HARMONICS = 128, 4096
"""Of a prescribed motion without a highest harmonic: so many are added up at first, and at most."""


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
        self._inputs = np.linalg.solve(self.vectors, np.hstack([drive, motion]).astype(complex))

    def residues(self, output: Array) -> ComplexArray:
        """Return the residues (m, k, n + n_u) of ``output (s - A)^-1 [B, B_u]``; ``output`` is (k, m)."""
        return np.asarray((output @ self.vectors).T[:, :, None] * self._inputs[:, None, :])

    def weights(self, s: ComplexArray) -> ComplexArray:
        """Return ``1 / (s - pole)``, (len(s), m): the factors of the residues."""
        return np.asarray(1.0 / (s[:, None] - self.poles))


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

    Where the harmonics of u do not end, ``x = B_u u' + A B_u u + w`` leaves ``w' = A w + A^2 B_u u``, whose harmonics
    fall by two orders faster than those of x; they are added up until the sum stays.

    Raises
    ------
    ValueError
        If the motion is not smooth enough for that.
    """
    if not system.n_lags or not system.n_inputs:
        return np.zeros(system.n_lags)
    omega = float(values[system.parameters.index("omega")])
    motion = excitation_signals(system)[1]

    def harmonics(n_harmonics: int) -> tuple[ComplexArray, ComplexArray]:
        return np.asarray(1j * omega * np.arange(n_harmonics + 1)), to_complex(motion.coefficients(values, n_harmonics))

    if motion.highest is not None:
        s, amplitudes = harmonics(motion.highest)
        return periodic_lag_states(system, s, (s**2 * (system.lag_motion @ amplitudes)).T)
    now = [e.full() for e in _motion_at(system)(0.0, values)]
    twice = system.lag_state @ system.lag_state @ system.lag_motion
    earlier: Array | None = None
    n_harmonics = FIRST_HARMONICS
    while n_harmonics <= MOST_HARMONICS:
        s, amplitudes = harmonics(n_harmonics)
        oscillating = now[0][:, 0] - amplitudes[:, 0].real
        parts = [system.lag_motion @ now[1][:, 0], system.lag_state @ (system.lag_motion @ oscillating)]
        parts.append(periodic_lag_states(system, s, (twice @ amplitudes).T))
        later: Array = np.sum(parts, axis=0)
        if earlier is not None and np.max(np.abs(later - earlier)) <= ALIASING_TOL * np.max(np.abs(parts)):
            return later
        earlier, n_harmonics = later, 2 * n_harmonics
    raise ValueError(
        f"the lag states at tau = 0 are not known to {ALIASING_TOL:.0e} from {MOST_HARMONICS} harmonics of motion: it "
        "is not smooth enough; smooth it"
    )


def _motion_at(system: System) -> ca.Function:
    """Return the function (tau, p) -> u, u'."""
    signals = [ca.densify(each) for each in (system.motion, system.motion_derivatives[0])]
    return ca.Function("motion_at", [system.tau, system.p], signals)
