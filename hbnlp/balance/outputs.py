"""The harmonics of a system's named outputs as numbers, projected from samples of the motion."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from hbnlp.balance.linear_terms import LinearBalance
from hbnlp.balance.sampling import Sampling
from hbnlp.core.types import Array
from hbnlp.fourier import differentiated
from hbnlp.systems.system import System

AT_ONCE = 20_000
"""Samples of several solutions that are evaluated together."""


class Outputs:
    """Coefficients of all outputs at solutions of one balance, whose linear terms know the lag states."""

    def __init__(self, system: System, sampling: Sampling, linear: LinearBalance) -> None:
        self._system, self._linear = system, linear
        self._basis, self._periods = sampling.outputs, sampling.periods
        self._omega = system.parameters.index("omega")

    def coefficients(self, motions: Array, values: Array) -> Array:
        """Return the coefficients (n_points, n_outputs, L) at motions (n_points, n, L) and parameters (n_points, p)."""
        at_once = max(1, AT_ONCE // self._basis.n_samples)
        parts = [slice(begin, begin + at_once) for begin in range(0, len(motions), at_once)]
        return np.concatenate([self._projected(motions[part], values[part]) for part in parts])

    def _projected(self, motions: Array, values: Array) -> Array:
        count, n_samples = len(motions), self._basis.n_samples
        rate = values[:, self._omega, None, None] / self._periods
        first = rate * differentiated(motions)
        signals = [motions, first, rate * differentiated(first)]
        signals.append(np.stack([self._linear.lag_states(*point) for point in zip(motions, values, strict=True)]))
        # point by point, CasADi's columns are samples
        columns = [self._basis.sampled(each).transpose(1, 0, 2).reshape(-1, count * n_samples) for each in signals]
        tau = np.tile(self._periods * self._basis.theta, count)
        function = self._one if count == 1 else self._system.outputs.map(count * n_samples)
        samples = function(*columns, tau[None, :], np.repeat(values.T, n_samples, axis=1)).full()
        return self._basis.projected(samples.reshape(-1, count, n_samples).transpose(1, 0, 2))

    @cached_property
    def _one(self) -> ca.Function:
        return self._system.outputs.map(self._basis.n_samples)
