"""Linear steady response of a system about rest to its own excitation."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.interrupts import check_interrupts
from hbnlp.core.kept import by_one_thread
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import to_complex
from hbnlp.systems.dependence import depends_on_omega
from hbnlp.systems.parameters import OMEGA
from hbnlp.systems.signals import PeriodicSignals, excitation_signals
from hbnlp.systems.system import System


def linear_response(
    system: System,
    output: str,
    omega: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    held: bool = False,
) -> ComplexArray:
    """Return the first harmonic of an output in the linear steady response to the system's own excitation.

    Parameters
    ----------
    system : System
    output : str
        Name of an output; a nonlinear one is linearised about rest.
    omega : array_like, any shape (...)
        Angular frequencies, positive.
    at : mapping of parameter names to values, optional
        Overrides of the defaults.
    held : bool
        Whether the degrees of freedom are held at zero, so that only the prescribed motion and the lag states act:
        the rigid wing beside the membrane wing.

    Returns
    -------
    ndarray of complex, shape (...)
        Amplitudes a_1 - i a_2 of ``a_1 cos(tau) + a_2 sin(tau)``.
    """
    index = system.output_index(output)
    given = np.asarray(omega, dtype=object)
    frequencies = system.parameters.series(OMEGA, given.ravel(), what=OMEGA).reshape(given.shape)
    slot = system.parameters.index(OMEGA)
    base = system.parameters.values(at, but=(OMEGA,))
    forcing, motion = excitation_signals(system)
    at_rest, slopes = _output_at_rest(system, index), _output_slopes(system, index)
    n, m = system.n_dof, system.n_lags
    matrix, varies = None, depends_on_omega(system)
    amplitudes = np.empty(frequencies.shape, dtype=complex)
    for position in np.ndindex(frequencies.shape):
        check_interrupts()
        values = base.copy()
        values[slot] = frequencies[position]
        s = 1j * values[slot]
        u = _first(motion, values)
        by_u, by_du, by_ddu = (e.full() for e in system.matrices(values)[4:])
        load, lag_load = (
            _first(forcing, values) + (by_u + s * by_du + s**2 * by_ddu) @ u,
            s**2 * (system.lag_motion @ u),
        )
        if held:
            lags = np.linalg.solve(s * np.eye(m) - system.lag_state, lag_load) if m else lag_load
            state = np.concatenate([np.zeros(2 * n), lags])
        else:
            acceleration = np.linalg.solve(system.state_matrices(values)[0], load)
            drive = np.concatenate([np.zeros(n), acceleration, system.lag_input @ acceleration + lag_load])
            if matrix is None or varies:
                matrix = system.linearisation(system.parameters.as_dict(values))
            state = np.linalg.solve(s * np.eye(2 * n + m) - matrix, drive)
        q, v, x = state[:n], state[n : 2 * n], state[2 * n :]
        signals = np.concatenate([q, v, s * v, x])
        amplitudes[position] = _first(at_rest, values)[0] + np.array(slopes(values))[0] @ signals
    return amplitudes


def _first(signals: PeriodicSignals, values: Array) -> ComplexArray:
    """Return the first-harmonic amplitudes of signals."""
    return to_complex(signals.coefficients(values, 1))[:, 1]


@by_one_thread
def _output_at_rest(system: System, index: int) -> PeriodicSignals:
    """Return an output as a signal while nothing moves but what is prescribed."""
    still = [ca.SX.zeros(size) for size in (system.n_dof, system.n_dof, system.n_dof, system.n_lags)]
    value = system.outputs(*still, system.tau, system.p)[index]
    name = f"output {system.output_names[index]!r}"
    return PeriodicSignals(name, value, system.tau, system.p, system.parameters)


@by_one_thread
def _output_slopes(system: System, index: int) -> ca.Function:
    """Return the function p -> derivatives (1, 3 n + m) of an output by q, q', q'' and x, at rest and tau = 0."""
    n, m = system.n_dof, system.n_lags
    signals = ca.SX.sym("signals", 3 * n + m)
    parts = ca.vertsplit(signals, [0, n, 2 * n, 3 * n, 3 * n + m])
    value = system.outputs(*parts, 0.0, system.p)[index]
    slopes = ca.Function("slopes", [signals, system.p], [ca.densify(ca.jacobian(value, signals))])
    rest = slopes(np.zeros(3 * n + m), system.p)
    return ca.Function("output_slopes", [system.p], [rest])
