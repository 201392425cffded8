"""Harmonics of outputs that are no polynomials of the motion: sampled until they stay.

They are sampled at twice the phases again and again; one that switches, or does not settle, is put on panels between
switches.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import casadi as ca
import numpy as np

from hbnlp.balance.linear_terms import LinearBalance
from hbnlp.balance.output_groups import TAU, alike_outputs, arguments_of_outputs
from hbnlp.balance.sampling import ALIASING_TOL, Sampling
from hbnlp.core.errors import AliasingWarning
from hbnlp.core.kept import built_once
from hbnlp.core.types import Array
from hbnlp.fourier import FourierBasis, basis_values, differentiated
from hbnlp.systems.chunks import in_chunks, of_columns
from hbnlp.systems.quadrature import find_breaks, resolve
from hbnlp.systems.signals import excitation_signals
from hbnlp.systems.spectrum import Spectrum
from hbnlp.systems.switches import switches
from hbnlp.systems.system import System

SMOOTH_SAMPLES = 2048
"""Up to these samples are doubled; what has not settled then is put on panels."""


class SettledOutputs:
    """The harmonics of outputs that are no polynomials of the motion, in numbers.

    Attributes
    ----------
    indices : list of int
        Which outputs these are; all of them where the prescribed motion has no highest harmonic, as the samples that a
        program takes of it are chosen at the default values of the parameters.
    """

    def __init__(self, system: System, sampling: Sampling, linear: LinearBalance) -> None:
        self._system, self._sampling, self._linear = system, sampling, linear
        self.indices = [i for spectrum, some, _ in alike_outputs(system) if spectrum is None for i in some]
        if excitation_signals(system)[1].highest is None:
            self.indices = list(range(len(system.output_names)))

    def at(self, motion: Array, values: Array) -> Array:
        """Return the coefficients (len(indices), 2H+1) at those of a motion (n, 2H+1) and parameters."""
        coefficients = self._signals(motion, values)
        n = self._system.n_dof
        places = [n, 2 * n, 3 * n]

        def evaluated(function: ca.Function, theta: Array) -> Array:
            signals = coefficients @ basis_values(theta, self._sampling.n_harmonics).T
            tau = (self._sampling.periods * theta)[None, :]
            return in_chunks(function, *np.split(signals, places), tau, values)

        def outputs(theta: Array) -> Array:
            return evaluated(self._values, theta)

        if self._with_phase:
            self._check_period(outputs)
        if not self._n_switches:
            settled = self._by_doubling(outputs)
            if settled is not None:
                return settled
        breaks = find_breaks(lambda theta: evaluated(self._switching, theta))
        rule, samples, error = resolve(outputs, breaks, self._sampling.n_harmonics)
        if error > ALIASING_TOL:
            names = ", ".join(self._system.output_names[i] for i in self.indices)
            warnings.warn(
                f"the harmonics of the outputs {names} are known to {error:.1e} only: one of them is singular",
                AliasingWarning,
                stacklevel=2,
            )
        return np.asarray(samples @ rule.projection(self._sampling.n_harmonics).T)

    def _check_period(self, outputs: Callable[[Array], Array]) -> None:
        phases = np.random.default_rng(11).uniform(0.0, 2.0 * np.pi, 16)
        now, later = np.hsplit(outputs(np.concatenate([phases, phases + 2.0 * np.pi])), 2)
        differ = np.any(np.abs(later - now) > 1e-6 * np.max(np.abs(now), axis=1, keepdims=True), axis=1)
        if np.any(differ):
            names = ", ".join(self._system.output_names[self.indices[i]] for i in np.flatnonzero(differ))
            warnings.warn(
                f"the outputs {names} do not repeat themselves with the motion, and so have no harmonics; write them "
                "with sines and cosines of whole multiples of tau = omega t",
                AliasingWarning,
                stacklevel=3,
            )

    def _by_doubling(self, outputs: Callable[[Array], Array]) -> Array | None:
        """Return the coefficients from as many equidistant samples as they need, or None if these are too many."""
        count, coarse = self._sampling.outputs(Spectrum(7, 0)).n_samples, None
        while count <= max(SMOOTH_SAMPLES, 2 * self._sampling.n_samples):
            basis = self._bases.setdefault(count, FourierBasis(self._sampling.n_harmonics, count))
            samples = outputs(basis.theta)
            fine: Array = samples @ basis.projection.T
            size = np.mean(np.abs(samples), axis=1)
            if coarse is not None and np.all(np.max(np.abs(fine - coarse), axis=1) <= ALIASING_TOL * size):
                return fine
            coarse, count = fine, 2 * count
        return None

    def _signals(self, coefficients: Array, values: Array) -> Array:
        """Return the coefficients (3 n + m, 2H+1) of q, q', q'' and x."""
        rate = values[self._system.parameters.index("omega")] / self._sampling.periods
        first = rate * differentiated(coefficients)
        second = rate * differentiated(first)
        return np.concatenate([coefficients, first, second, self._linear.lag_states(coefficients, values)])

    @built_once
    def _bases(self) -> dict[int, FourierBasis]:
        return {}

    @built_once
    def _arguments(self) -> list[ca.SX]:
        return arguments_of_outputs(self._system)

    @built_once
    def _expression(self) -> ca.SX:
        return ca.densify(self._system.outputs(*self._arguments)[self.indices])

    @built_once
    def _values(self) -> ca.Function:
        return self._in_chunk("outputs", self._expression)

    @built_once
    def _switching(self) -> ca.Function:
        return self._in_chunk("switches", ca.densify(switches(self._expression)))

    @built_once
    def _with_phase(self) -> bool:
        return bool(ca.depends_on(self._expression, self._arguments[TAU]))

    @property
    def _n_switches(self) -> int:
        return int(self._switching.size1_out(0))

    def _in_chunk(self, name: str, expression: ca.SX) -> ca.Function:
        return of_columns(ca.Function(name, self._arguments, [expression]), [TAU + 1])
