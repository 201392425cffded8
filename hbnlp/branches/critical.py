"""The Floquet multiplier that belongs to a fold or branch point."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from scipy.linalg import eig

from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.curve import null_vector
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import to_complex
from hbnlp.solutions.attaching import attached
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.stability.spectra import NEGLIGIBLE
from hbnlp.systems.lags import periodic_lag_states
from hbnlp.systems.system import System


def with_multiplier(point: SpecialPoint, evaluator: FloquetEvaluator) -> SpecialPoint:
    """Return a fold or branch point with the Floquet multiplier that belongs to it: +1 but for the truncation.

    At a fold or branch point of the equations of motion the null vector of the balance is a periodic solution of the
    linearised equations, an eigenvector of the monodromy matrix. The multiplier is that of the eigenvector which the
    null vector's state, expanded in eigenvectors, holds most of; the one nearest to +1 may be that of a slow lag state.
    """
    solution = point.solution
    problem = attached(solution)
    values = problem.values(solution.parameters)
    result = evaluator(solution.coefficients, values)
    if not np.isfinite(result.monodromy).all():
        return point
    null = null_vector(problem.assembly.jacobian(solution.coefficients.ravel(), values)).reshape(problem.shape)
    rate = solution.omega / solution.periods
    state = _periodic_state(evaluator.system, to_complex(null), rate)
    decomposition: Any = eig(result.monodromy, left=True, right=True)
    found, left, right = decomposition
    matters = np.abs(found) > NEGLIGIBLE
    left, right = left[:, matters], right[:, matters]
    shares = np.abs(left.conj().T @ state) / np.maximum(np.abs(np.sum(left.conj() * right, axis=0)), 1e-300)
    n = evaluator.system.n_dof
    sizes = np.hypot(np.linalg.norm(right[:n], axis=0), np.linalg.norm(right[n : 2 * n], axis=0) / rate)
    critical = found[matters][np.argmax(shares * sizes)]
    nearest = result.multipliers[np.argmin(np.abs(result.multipliers - critical))]
    return dataclasses.replace(point, multiplier=complex(nearest))


def _periodic_state(system: System, amplitudes: ComplexArray, rate: float) -> Array:
    """Return the state (q, q', x) at theta = 0 of a periodic solution of the linearised equations."""
    s: ComplexArray = np.asarray(1j * rate * np.arange(amplitudes.shape[1]), dtype=complex)
    lags = periodic_lag_states(system, s, (system.lag_input @ (s**2 * amplitudes)).T)
    return np.concatenate([amplitudes.real.sum(axis=1), (s * amplitudes).real.sum(axis=1), lags])
