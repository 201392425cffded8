"""The harmonics of a system's named outputs as numbers, projected from samples of the motion.

Outputs that are polynomials of the motion have a highest harmonic, and so a number of samples that is exact; all others
are `SettledOutputs`.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.balance.linear_terms import LinearBalance
from hbnlp.balance.output_groups import alike_outputs
from hbnlp.balance.sampling import Sampling
from hbnlp.balance.settled_outputs import SettledOutputs
from hbnlp.core.kept import built_once
from hbnlp.core.native import PerThread, bound
from hbnlp.core.types import Array
from hbnlp.fourier import FourierBasis, differentiated
from hbnlp.systems.system import System

AT_ONCE = 20_000
"""Samples of several solutions that are held together."""


class Outputs:
    """Coefficients of all outputs at solutions of one balance, whose linear terms know the lag states."""

    def __init__(self, system: System, sampling: Sampling, linear: LinearBalance) -> None:
        self._count, self._length = len(system.output_names), 2 * sampling.n_harmonics + 1
        self._settled = SettledOutputs(system, sampling, linear)
        self._polynomials = [
            (indices, _Polynomials(system, function, sampling.outputs(spectrum), sampling.periods, linear))
            for spectrum, indices, function in alike_outputs(system)
            if not set(indices) <= set(self._settled.indices)
        ]

    def coefficients(self, motions: Array, values: Array) -> Array:
        """Return the coefficients (n_points, n_outputs, L).

        Parameters
        ----------
        motions : array (n_points, n, L)
            Coefficients of the displacements.
        values : array (n_points, n_parameters)
        """
        result = np.zeros((len(motions), self._count, self._length))
        for indices, polynomials in self._polynomials:
            result[:, indices] = polynomials.coefficients(motions, values)
        if self._settled.indices:
            for k, (motion, point) in enumerate(zip(motions, values, strict=True)):
                result[k, self._settled.indices] = self._settled.at(motion, point)
        return result


class _Polynomials:
    """Outputs of which a number of samples is exact."""

    def __init__(
        self, system: System, function: ca.Function, basis: FourierBasis, periods: int, linear: LinearBalance
    ) -> None:
        self._function, self._basis, self._periods, self._linear = function, basis, periods, linear
        self._omega = system.parameters.index("omega")
        self._memory = PerThread(lambda: _Memory(system, periods * basis.theta, self._mapped))

    def coefficients(self, motions: Array, values: Array) -> Array:
        """Return the coefficients (n_points, n_outputs, L) of these outputs."""
        at_once = max(1, AT_ONCE // self._basis.n_samples)
        parts = [slice(begin, begin + at_once) for begin in range(0, max(len(motions), 1), at_once)]
        return np.concatenate([self._basis.projected(self._samples(motions[part], values[part])) for part in parts])

    @built_once
    def _mapped(self) -> ca.Function:
        return self._function.map(self._basis.n_samples)

    def _samples(self, motions: Array, values: Array) -> Array:
        """Return the samples (n_points, n_outputs, n_samples)."""
        memory = self._memory()
        rate = values[:, self._omega, None, None] / self._periods
        first = rate * differentiated(motions)
        signals = [self._basis.sampled(each) for each in (motions, first, rate * differentiated(first))]
        if memory.lags.size:
            states = [self._linear.lag_states(*point) for point in zip(motions, values, strict=True)]
            signals.append(self._basis.sampled(np.stack(states)))
        samples = np.empty((len(motions), *memory.outputs.T.shape))
        for i, point in enumerate(values):
            for mine, signal in zip(memory.signals, signals, strict=False):  # without lags there are no lag states
                mine[:] = signal[i].T
            memory.parameters[:] = point
            memory.evaluate()
            samples[i] = memory.outputs.T
        return samples


class _Memory:
    """Where one thread evaluates the outputs at the samples of one solution."""

    def __init__(self, system: System, tau: Array, mapped: ca.Function) -> None:
        count, n = tau.size, system.n_dof
        self.signals = [np.zeros((count, width)) for width in (n, n, n, system.n_lags)]
        self.lags = self.signals[-1]
        self.parameters = np.zeros((count, len(system.parameters.names)))
        self.outputs = np.zeros((count, mapped.size1_out(0)))
        arguments = [*self.signals, tau[:, None].copy(), self.parameters]
        self.evaluate = bound(mapped, arguments, [self.outputs])
