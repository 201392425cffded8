"""Harmonics of the outputs at given solutions, whatever the outputs are of the motion.

Polynomials of the motion have a highest harmonic, and so a number of samples that is exact. Any other output is sampled
at twice the phases until its harmonics stay; one that switches, or does not settle, is put on panels between switches.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import casadi as ca
import numpy as np

from hbnlp.balance.sampling import ALIASING_TOL, OUTPUT_SAMPLES, Sampling
from hbnlp.core.errors import AliasingWarning
from hbnlp.core.kept import built_once, by_one_thread
from hbnlp.core.types import Array
from hbnlp.fourier import FourierBasis, basis_values, differentiation, to_complex, to_real
from hbnlp.systems.chunks import in_chunks, of_columns
from hbnlp.systems.quadrature import find_breaks, resolve
from hbnlp.systems.signals import excitation_signals
from hbnlp.systems.spectrum import Spectrum, spectra
from hbnlp.systems.switches import switches
from hbnlp.systems.system import System

SMOOTH_SAMPLES = 2048
"""Up to these samples are doubled; what has not settled then is put on panels."""
TAU = 4
"""The place of the phase among the arguments of the outputs, behind q, q', q'' and x."""


@by_one_thread
def alike_outputs(system: System) -> list[tuple[Spectrum | None, list[int], ca.Function]]:
    """Return the outputs that take the same samples: their spectrum, their indices, and the function of just these.

    They are at most two: outputs that are polynomials of the motion, with the largest of their degrees and harmonics,
    and all others, for which the spectrum is None.
    """
    arguments = _arguments(system)
    values = system.outputs(*arguments)
    each = spectra(system.outputs, TAU, range(TAU))[0]
    result: list[tuple[Spectrum | None, list[int], ca.Function]] = []
    known = [i for i, spectrum in enumerate(each) if spectrum is not None]
    others = [i for i, spectrum in enumerate(each) if spectrum is None]
    for indices in (known, others):
        if not indices:
            continue
        read = [spectrum for i in indices if (spectrum := each[i]) is not None]
        largest = Spectrum(max(e.degree for e in read), max(e.highest for e in read)) if read else None
        result.append((largest, indices, ca.Function("outputs", arguments, [ca.densify(values[indices])])))
    return result


@by_one_thread
def warn_of_switches(system: System, name: str) -> None:
    """Warn where an output has switches, whose places a program does not know."""
    index, arguments = system.output_index(name), _arguments(system)
    if switches(system.outputs(*arguments)[index]).numel():
        warnings.warn(
            f"output {name!r} switches, and a program takes its harmonics from {OUTPUT_SAMPLES} samples: those of a "
            "kink are exact to about 1e-6 of its size, of a step to 1e-3; those of solutions and branches are exact",
            AliasingWarning,
            stacklevel=3,
        )


def _arguments(system: System) -> list[ca.SX]:
    return [ca.SX.sym("argument", system.outputs.size1_in(i)) for i in range(system.outputs.n_in())]


class OutputHarmonics:
    """The harmonics of outputs that are no polynomials of the motion, in numbers.

    Attributes
    ----------
    indices : list of int
        Which outputs these are; all of them where the prescribed motion has no highest harmonic, as the samples that a
        program takes of it are chosen at the default values of the parameters.
    """

    def __init__(self, system: System, sampling: Sampling) -> None:
        self._system, self._sampling = system, sampling
        self._motion = excitation_signals(system)[1]
        self.indices = [i for spectrum, some, _ in alike_outputs(system) if spectrum is None for i in some]
        if self._motion.highest is None:
            self.indices = list(range(len(system.output_names)))

    def at(self, x: Array, values: Array) -> Array:
        """Return the coefficients (len(indices), 2H+1) at unknowns and parameters."""
        coefficients = self._signals(x.reshape(self._system.n_dof, -1), values)
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
        system, sampling = self._system, self._sampling
        rate = values[system.parameters.index("omega")] / sampling.periods
        first = rate * (coefficients @ differentiation(sampling.n_harmonics).T)
        second = rate * (first @ differentiation(sampling.n_harmonics).T)
        drive = system.lag_input @ second
        if system.n_inputs and system.n_lags:
            motion = self._motion.coefficients(values, sampling.n_harmonics_of_excitation)
            turned = (system.lag_motion @ sampling.over_periods(motion)) @ differentiation(sampling.n_harmonics).T
            drive = drive + rate**2 * (turned @ differentiation(sampling.n_harmonics).T)
        s = 1j * rate * np.arange(sampling.n_harmonics + 1)
        lags = np.zeros((system.n_lags, s.size), dtype=complex)
        if system.n_lags:
            resolvents = s[1:, None, None] * np.eye(system.n_lags) - system.lag_state
            lags[:, 1:] = np.linalg.solve(resolvents, to_complex(drive).T[1:, :, None])[..., 0].T
        return np.concatenate([coefficients, first, second, to_real(lags)])

    @built_once
    def _bases(self) -> dict[int, FourierBasis]:
        return {}

    @built_once
    def _arguments(self) -> list[ca.SX]:
        return _arguments(self._system)

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
