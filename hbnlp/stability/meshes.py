"""Multipliers on one mesh of the period, by the three ways to make its step maps."""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np

from hbnlp.core.types import Array, ComplexArray
from hbnlp.stability.collocation import Gauss, StepMaps
from hbnlp.stability.exponential import ExponentialMaps
from hbnlp.stability.grading import graded
from hbnlp.stability.integrals import Polynomials
from hbnlp.stability.modes import ConstantPart
from hbnlp.stability.prediction import Prediction
from hbnlp.stability.spectra import distance, ordered, product, spectrum
from hbnlp.stability.variation import Linearisation, Variation
from hbnlp.systems.plant import Plant

_JOINED = 8  # maps that a product is left in, from which its eigenvalues are taken
_DECADES = 4.0  # by which a mode may decay within maps joined for the determinant
_MISSED = 2.0  # of an error, what the first-order correction may be short of: measured, see the theory


class OnMesh(NamedTuple):
    """What one mesh gives: multipliers, products of consecutive step maps, log-determinant of one repetition.

    ``error`` is its estimate of its own error, where it has one; ``resolved`` says whether the coefficients are
    polynomials within each interval.
    """

    multipliers: ComplexArray
    maps: Array
    log_determinant: float
    n_intervals: int
    error: float = np.inf
    resolved: bool = True


class Uniform:
    """Meshes of equal intervals, by collocation of the whole equations."""

    def __init__(
        self, linearised: Linearisation, plant: Plant, variation: Variation, period: float, nodes: int
    ) -> None:
        self._linearised, self._plant, self._variation = linearised, plant, variation
        self._period, self._gauss = period / variation.repeats, Gauss.of(nodes)

    def __call__(self, intervals: int) -> OnMesh:
        """Return what a mesh of as many intervals in one repetition gives."""
        assert self._variation.at is not None
        step_maps = StepMaps(self._plant, self._gauss, self._period / intervals)
        places = tuple(self._gauss.c.tolist())
        maps, log_determinant = [], 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for first in range(0, intervals, step_maps.batch):
                last = min(first + step_maps.batch, intervals)
                entries = self._variation.at(places, intervals, first, last)
                steps = step_maps(*self._linearised.matrices(entries))
                log_determinant += float(np.linalg.slogdet(steps)[1].sum())
                maps.append(product(steps, _JOINED * (last - first) // intervals + 1))
            joined = np.concatenate(maps)
            multipliers = spectrum(joined) ** self._variation.repeats
        return OnMesh(_finite(multipliers), joined, log_determinant, intervals)


class Exponential:
    """Meshes of equal intervals, exact for a constant part, each with an estimate of its own error.

    Parameters
    ----------
    constant : ConstantPart
    linearised, variation
    period : float
    nodes : int
    """

    def __init__(
        self,
        constant: ConstantPart,
        linearised: Linearisation,
        variation: Variation,
        period: float,
        nodes: int,
    ) -> None:
        modes = constant.modes
        self._modes, self._constant, self._variation = modes, constant.entries, variation
        self._period, self._nodes = period / variation.repeats, nodes
        rows, columns = linearised.places
        assert variation.amplitudes is not None
        self._entries = np.flatnonzero(variation.amplitudes.any(axis=0))
        self._at = (
            np.searchsorted(modes.rows, rows[self._entries]),
            np.searchsorted(modes.columns, columns[self._entries]),
        )
        shape = (len(modes.rows), len(modes.columns))
        amplitudes, shift = np.zeros((len(variation.amplitudes), *shape)), np.zeros(shape)
        amplitudes[:, *self._at] = variation.amplitudes[:, self._entries]
        shift[self._at] = np.abs(variation.mean - constant.entries)[self._entries]
        self.prediction = Prediction(modes, amplitudes, shift, self._period, period, nodes)

    def __call__(self, intervals: int) -> OnMesh:
        """Return what a mesh of as many intervals in one repetition gives."""
        assert self._variation.at is not None
        step_maps = ExponentialMaps(self._modes, self._nodes, self._period / intervals)
        places = tuple(Polynomials.of(self._nodes).places.tolist())
        decay = -self._modes.exponents.real.min() * self._period / np.log(10.0)
        groups = max(_JOINED, ceil(min(decay / _DECADES, intervals)))
        maps, log_determinant = [], 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for first in range(0, intervals, step_maps.batch):
                last = min(first + step_maps.batch, intervals)
                entries = self._variation.at(places, intervals, first, last)
                steps = product(step_maps(self._varying(entries)), groups * (last - first) // intervals + 1)
                log_determinant += float(np.linalg.slogdet(steps[:, 0])[1].sum())
                maps.append(product(steps, _JOINED * (last - first) // intervals + 1))
            joined, better = np.moveaxis(np.concatenate(maps), 1, 0)
            multipliers, corrected = (_finite(spectrum(m) ** self._variation.repeats) for m in (joined, better))
        error = _MISSED * distance(multipliers, corrected) + float(self.prediction.left_out(intervals))
        return OnMesh(multipliers, joined, log_determinant, intervals, error + self._modes.rounding)

    def _varying(self, entries: Array) -> Array:
        """Return what is not in the constant part, (k, n_places, n_rows, n_columns), of entries (k n_places, ...)."""
        n_places, shape = len(Polynomials.of(self._nodes).places), (len(self._modes.rows), len(self._modes.columns))
        varying = np.zeros((len(entries), *shape))
        varying[:, *self._at] = (entries - self._constant)[:, self._entries]
        return varying.reshape(-1, n_places, *shape)


class Graded:
    """Meshes graded towards where coefficients switch, by collocation of the whole equations."""

    def __init__(
        self,
        linearised: Linearisation,
        plant: Plant,
        variation: Variation,
        period: float,
        nodes: int,
        most: int,
    ) -> None:
        self._linearised, self._plant, self._variation = linearised, plant, variation
        self._period, self._gauss, self._most = period, Gauss.of(nodes), most

    def __call__(self, intervals: int, deviation: float) -> OnMesh:
        """Return what a mesh gives that begins with as many intervals and is halved until they deviate so little."""
        entries, weights, nodes = self._variation.entries, self._variation.weights, len(self._gauss.c)
        assert entries is not None
        assert weights is not None
        mesh = graded(entries, intervals, nodes, tol=deviation, limit=self._most, weights=weights)
        n_state = self._plant.lag_output.shape[1] + 2 * len(self._plant.mass)
        maps = np.empty((len(mesh.levels), n_state, n_state))
        for level in np.unique(mesh.levels):
            step_maps = StepMaps(self._plant, self._gauss, self._period / intervals / 2.0**level)
            (places,) = np.nonzero(mesh.levels == level)
            for first in range(0, places.size, step_maps.batch):
                here = places[first : first + step_maps.batch]
                at_nodes = mesh.entries[here].reshape(here.size * nodes, -1)[:, : self._variation.mean.size]
                maps[here] = step_maps(*self._linearised.matrices(at_nodes))
        with np.errstate(over="ignore", invalid="ignore"):
            log_determinant = float(np.linalg.slogdet(maps)[1].sum())
            joined = product(maps, _JOINED)
            multipliers = spectrum(joined)
        return OnMesh(_finite(multipliers), joined, log_determinant, len(maps), resolved=mesh.resolved)


def _finite(multipliers: ComplexArray) -> ComplexArray:
    """Return multipliers in order; where one overflows, all are infinite."""
    return ordered(multipliers) if np.isfinite(multipliers).all() else np.full(len(multipliers), np.inf + 0j)
