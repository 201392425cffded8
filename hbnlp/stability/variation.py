"""The equations linearised about a periodic solution: constant matrices, and the derivatives of f over the period.

For a smooth force the derivatives f_q(t), f_v(t) are short Fourier series. They are fitted once to few samples (and are
exact for a polynomial force), so that a finer mesh in time costs no further evaluation of f. Where a series has the
harmonics r, 2r, ... only (r = 2 for symmetric solutions), the linearised equations repeat r times in a period.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from math import gcd
from typing import Literal, NamedTuple

import numpy as np

from hbnlp.core.errors import NonFiniteError
from hbnlp.core.kept import Kept
from hbnlp.core.native import PerThread, bound
from hbnlp.core.types import Array, IntArray
from hbnlp.fourier import basis_derivatives, basis_values, to_real
from hbnlp.stability.grading import Entries
from hbnlp.systems.plant import Plant, check_mass
from hbnlp.systems.spectrum import spectra
from hbnlp.systems.system import System

# Harmonics smaller than this, relative to the largest, are rounding.
_ROUNDING = 1e-12
# Harmonics smaller than this need not be resolved: two meshes tell whether they matter.
_SMALL = 1e-6
_MOST_SAMPLES = 1024
_BLOCK = 256  # phases at which the derivatives of f are evaluated together where there is no series
_JUMP = 1e-8  # part of what the motion changes of f that its series may miss between samples
_LITTLE = 1e-5  # part of f; rounding might look like a jump of what changes less
_NAMES = {"derivatives": "a derivative of nonlinear_force", "value": "nonlinear_force"}
# Numbers of samples whose memory is kept: those of a mesh and of the next ones.
_MOST_SAMPLERS = 16

# (places in an interval, intervals in the repeating part, first, last) -> entries there in intervals first..last-1
PlaceValues = Callable[[tuple[float, ...], int, int, int], Array]


class Variation(NamedTuple):
    """The entries of f_q and f_v that may differ from zero, over a period.

    Attributes
    ----------
    mean : (n_entries,)
        Their means.
    repeats : int
        How often they repeat in the period.
    at : callable or None
        Their values ((last - first) * n_places, n_entries) on a uniform mesh; None where they are constant, and where
        their Fourier series does not converge.
    bandwidth : int
        The highest harmonic that is not small: a mesh has to resolve it.
    entries : callable or None
        Where it does not: f's derivatives themselves and f, (count, n_entries + n) at phases (count,).
    weights : (n_entries,) or None
        Factors with which the entries are compared with each other: 1 for f_q, the motion's frequency for f_v; where
        ``entries`` are given, those of f follow, such that its largest value is that of the derivatives.
    amplitudes : (n, n_entries) or None
        Of the harmonics ``repeats``, ``2 repeats``, ... , 0 where an entry is constant; where there is a series.
    """

    mean: Array
    repeats: int
    at: PlaceValues | None
    bandwidth: int = 0
    entries: Entries | None = None
    weights: Array | None = None
    amplitudes: Array | None = None


class Linearisation:
    """A system linearised about solutions of ``n_harmonics`` harmonics; compiled once.

    ``places`` are the rows and columns of the entries in f_q and f_v side by side.

    Parameters
    ----------
    system : System
    periods : int
        Forcing periods in one period of the solution.
    n_harmonics : int
    tol : float
        Where a Fourier series is cut off, relative to its largest term.
    """

    def __init__(self, system: System, periods: int, n_harmonics: int, *, tol: float) -> None:
        self.system, self.periods, self.n_harmonics = system, periods, n_harmonics
        self._tol = tol
        self._omega = system.parameters.index("omega")
        force = system.compiled_force
        self._places = [rows * system.n_dof + columns for rows, columns in (force.places_q, force.places_v)]
        rows, columns = (np.concatenate(both) for both in zip(force.places_q, force.places_v, strict=True))
        columns[len(self._places[0]) :] += system.n_dof
        self.places: tuple[IntArray, IntArray] = (rows, columns)
        self._n_entries = force.derivatives.nnz_out(0)
        self._polynomial = None not in spectra(force.value, tau=2, motion=(0, 1))[0]
        self._memory = PerThread(lambda: _Memory(system))

    def plant(self, values: Array) -> Plant:
        """Return the constant matrices at the parameter values; a singular mass matrix is a ValueError."""
        mass, damping, stiffness, lag_output = self._memory().matrices(values)
        check_mass(mass)
        return Plant(mass, damping, stiffness, lag_output, self.system.lag_state, self.system.lag_input)

    def matrices(self, entries: Array) -> tuple[Array, Array | None]:
        """Return f_q and f_v (count, n, n) of their entries (count, n_entries); None for an f that has no f_v."""
        n, split = self.system.n_dof, len(self._places[0])
        by_q = _filled(self._places[0], entries[:, :split], n)
        return by_q, _filled(self._places[1], entries[:, split:], n) if len(self._places[1]) else None

    def variation(self, coefficients: Array, values: Array) -> Variation:
        """Return f_q and f_v over the period about a solution (n_dof, 2H+1)."""
        if not self._n_entries:
            return Variation(np.zeros(0), 1, None)
        # as terms of the same equation: f_v times the frequency is of the units of f_q, and of its size
        weights = np.ones(self._n_entries)
        weights[len(self._places[0]) :] = values[self._omega] / self.periods
        count = 6 * self.n_harmonics + 6
        while True:
            theta, sampling, slope, check = _equidistant(count, self.n_harmonics)
            entries = self._sample(theta, sampling, slope, coefficients, values)
            amplitudes = np.fft.rfft(entries[:count], axis=0)[: count // 2] * (2.0 / count)
            amplitudes[0] *= 0.5
            series, scale = to_real(amplitudes.T).T, np.abs(entries * weights).max()
            known = np.abs((check @ series - entries[count:]) * weights).max() <= self._tol * scale
            if known and (self._polynomial or self._jumps_nowhere(count, coefficients, values)):
                break
            if count > _MOST_SAMPLES:
                return self._on_demand(coefficients, values, weights)
            count *= 2
        sizes = np.abs(amplitudes[1:] * weights).max(axis=1)
        present = np.flatnonzero(sizes > _ROUNDING * scale) + 1
        if not len(present):
            return Variation(series[0], 1, None)
        repeats, highest = gcd(*present.tolist()), int(present[-1])
        series = to_real(amplitudes[: highest + 1 : repeats].T).T

        def at(places: tuple[float, ...], intervals: int, first: int, last: int) -> Array:
            basis = _basis_at(places, intervals, highest // repeats)
            values: Array = basis[first * len(places) : last * len(places)] @ series
            return values

        bandwidth = int(np.flatnonzero(sizes > _SMALL * scale).max(initial=0)) + 1
        moduli = np.abs(amplitudes[repeats : highest + 1 : repeats])
        moduli[:, moduli.max(axis=0) * weights <= _ROUNDING * scale] = 0.0
        return Variation(series[0], repeats, at, bandwidth, weights=weights, amplitudes=moduli)

    def _jumps_nowhere(self, count: int, coefficients: Array, values: Array) -> bool:
        """Return whether f itself is a series of so many samples: where it jumps, its derivatives may hide between."""
        theta, sampling, slope, check = _equidistant(count, self.n_harmonics)
        forces = self._forces(theta, sampling, slope, coefficients, values)
        amplitudes = np.fft.rfft(forces[:count], axis=0)[: count // 2] * (2.0 / count)
        amplitudes[0] *= 0.5
        missed = np.abs(check @ to_real(amplitudes.T).T - forces[count:]).max(axis=0)
        return bool((missed <= _JUMP * np.abs(forces).max(axis=0) + _ROUNDING).all())

    def _on_demand(self, coefficients: Array, values: Array, weights: Array) -> Variation:
        """Return the evaluation at any phases, for a force whose series does not converge."""

        def entries(theta: Array) -> Array:
            # a number of samples is compiled once, and these are of many
            blocks = [theta[i : i + _BLOCK] for i in range(0, theta.size, _BLOCK)]
            padded = (np.append(block, np.full(_BLOCK - block.size, block[0])) for block in blocks)
            found = []
            for block in padded:
                sampling = _sampling(block, self.n_harmonics)
                derivatives = self._sample(block, *sampling, coefficients, values).copy()
                found.append(np.hstack([derivatives, self._forces(block, *sampling, coefficients, values)]))
            return np.concatenate(found)[: theta.size]

        some = entries(2.0 * np.pi / _MOST_SAMPLES * np.arange(_MOST_SAMPLES, dtype=float))
        derivatives, forces = some[:, : self._n_entries], np.abs(some[:, self._n_entries :]).max(axis=0)
        weights = np.concatenate([weights, np.abs(derivatives * weights).max() / np.maximum(forces, _LITTLE)])
        return Variation(derivatives.mean(axis=0), 1, None, entries=entries, weights=weights)

    def _forces(self, theta: Array, sampling: Array, slope: Array, coefficients: Array, values: Array) -> Array:
        """Return f at phases theta, relative to its largest value, without what jumps with tau alone.

        The latter is what it would be if the motion stood still; it may change f, not its derivatives.
        """
        forces = self._sample(theta, sampling, slope, coefficients, values, "value").copy()
        size = np.abs(forces).max(axis=0)
        still, slope_then = np.broadcast_to(sampling[0], sampling.shape), np.broadcast_to(slope[0], slope.shape)
        with suppress(NonFiniteError):  # the force need not be defined there
            forces -= self._sample(theta, still, slope_then, coefficients, values, "value")
        forces /= np.where(size > 0.0, size, 1.0)
        return forces

    def _sample(
        self,
        theta: Array,
        sampling: Array,
        slope: Array,
        coefficients: Array,
        values: Array,
        what: Literal["derivatives", "value"] = "derivatives",
    ) -> Array:
        """Return the entries of f_q and f_v, or f, (len(theta), ...), valid until the next call.

        Raises
        ------
        NonFiniteError
            If one of them is not finite.
        """
        evaluate, (q, v, tau, p, entries) = self._memory().sampler(len(theta), what)
        np.matmul(sampling, coefficients.T, out=q)
        np.matmul(slope, coefficients.T * (values[self._omega] / self.periods), out=v)
        np.multiply(theta, self.periods, out=tau[:, 0])
        p[:] = values
        evaluate()
        if not np.isfinite(entries).all():
            where = theta[~np.isfinite(entries).all(axis=1)][0]
            raise NonFiniteError(
                f"{_NAMES[what]} is not finite at theta = {where:.6g} of the solution; smooth it there"
            )
        return entries


class _Memory:
    """Where one thread evaluates the matrices of a system, and the derivatives of f at some numbers of samples."""

    def __init__(self, system: System) -> None:
        self._system = system
        n, m = system.n_dof, system.n_lags
        self._values = np.zeros(len(system.parameters.names))
        self._matrices = [np.zeros(shape) for shape in ((n, n), (n, n), (n, n), (m, n))]
        inputs = [np.zeros((system.n_inputs, n)) for _ in range(3)]
        self._evaluate = bound(system.matrices, [self._values], [*self._matrices, *inputs])
        self._samplers: Kept[tuple[Callable[[], None], list[Array]]] = Kept(_MOST_SAMPLERS)

    def matrices(self, values: Array) -> list[Array]:
        """Return M, D, K and L_x at parameter values."""
        self._values[:] = values
        self._evaluate()
        return [matrix.T.copy() for matrix in self._matrices]

    def sampler(self, count: int, what: Literal["derivatives", "value"]) -> tuple[Callable[[], None], list[Array]]:
        """Return what evaluates f or the entries of f_q and f_v, and arrays (count, ...) of q, v, tau, p and these."""

        def build() -> tuple[Callable[[], None], list[Array]]:
            force, system = self._system.compiled_force, self._system
            function = force.derivatives if what == "derivatives" else force.value
            widths = (system.n_dof, system.n_dof, 1, self._values.size, function.nnz_out(0))
            arrays = [np.zeros((count, width)) for width in widths]
            return bound(function.map(count), arrays[:4], arrays[4:]), arrays

        return self._samplers.get((what, count), build)


def _filled(places: IntArray, part: Array, n: int) -> Array:
    matrices = np.zeros((len(part), n * n))
    matrices[:, places] = part
    return matrices.reshape(-1, n, n)


def _sampling(theta: Array, n_harmonics: int) -> tuple[Array, Array]:
    return basis_values(theta, n_harmonics), basis_derivatives(theta, n_harmonics)


@lru_cache(maxsize=32)
def _equidistant(count: int, n_harmonics: int) -> tuple[Array, Array, Array, Array]:
    """Return ``count`` equidistant phases and three between, to see aliasing; their bases; the fitted basis there."""
    between = np.array([0.5, count // 3 + 0.36, 2 * count // 3 + 0.59])
    theta = 2.0 * np.pi / count * np.concatenate([np.arange(count), between])
    return theta, *_sampling(theta, n_harmonics), basis_values(theta[count:], count // 2 - 1)


@lru_cache(maxsize=32)
def _basis_at(places: tuple[float, ...], intervals: int, n_harmonics: int) -> Array:
    phases = 2.0 * np.pi / intervals * np.add.outer(np.arange(intervals), places).ravel()
    return basis_values(phases, n_harmonics)
