"""On which stable part of a branch a measured amplitude lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbnlp.branches.branch import Branch
from hbnlp.core.kinds import Kind
from hbnlp.core.types import Array, BoolArray, IntArray
from hbnlp.diagrams.stretches import Stretch, stretches_of
from hbnlp.identification.measurements import Measurements
from hbnlp.solutions.solution import Solution

NEAR = 0.1
"""A point this near to the end of a part may lie on it beyond, in parts of the measured range and amplitude."""
TYPICAL = 3.0
"""So many times the median distance from the branch is near, too: then all of the branch is elsewhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A stable stretch of a branch, as a line from its lowest to its highest frequency, special points at its ends."""

    omega: Array
    amplitude: Array
    places: IntArray
    branch: Branch
    folds: tuple[float, ...]
    """Amplitudes at those of its ends that are folds."""

    @classmethod
    def of(cls, branch: Branch, stretch: Stretch, output: str, harmonic: int) -> Part:
        """Return a stretch of a branch as a part."""
        places = np.arange(stretch.begin, stretch.end + 1)
        omega, amplitude = branch.parameter[places], np.abs(branch.harmonics(output)[places, harmonic])
        order = np.argsort(omega, kind="stable")
        places, omega, amplitude = places[order], omega[order], amplitude[order]
        folds = []
        for point, end in ((stretch.at_low, 0), (stretch.at_high, -1)):
            if point is not None:
                where, size = 0 if end == 0 else places.size, float(abs(point.solution.harmonics(output)[harmonic]))
                omega, amplitude = np.insert(omega, where, point.value), np.insert(amplitude, where, size)
                places = np.insert(places, where, places[end])
                folds += [size] if point.kind is Kind.FOLD else []
        return cls(omega=omega, amplitude=amplitude, places=places, branch=branch, folds=tuple(folds))

    def at(self, omega: Array) -> Array:
        """Return the amplitudes at frequencies (n,), nan where the part does not reach."""
        return np.asarray(np.interp(omega, self.omega, self.amplitude, left=np.nan, right=np.nan))

    def distances(self, omega: Array, amplitude: Array, sizes: tuple[float, float]) -> Array:
        """Return the distances of points (n,) from the line, in these sizes of frequency and amplitude."""
        scale = np.array(sizes)
        line, points = (
            np.column_stack([self.omega, self.amplitude]) / scale,
            np.column_stack([omega, amplitude]) / scale,
        )
        if len(line) == 1:
            return np.asarray(np.linalg.norm(points - line, axis=1))
        begin, along = line[:-1], np.diff(line, axis=0)
        length = np.maximum(np.sum(along**2, axis=1), np.finfo(float).tiny)
        ahead = points[:, None] - begin
        share = np.clip(np.sum(ahead * along, axis=2) / length, 0.0, 1.0)
        return np.asarray(np.linalg.norm(ahead - share[..., None] * along, axis=2).min(axis=1))

    def near(self, omega: float) -> Solution:
        """Return the point of the branch on this part that is nearest to a frequency."""
        return self.branch.solution(int(self.places[np.argmin(np.abs(self.omega - omega))]))


def parts_of(branch: Branch, output: str, harmonic: int) -> list[Part]:
    """Return the stable parts of a branch."""
    stretches = stretches_of(0, branch, None, lambda point: point)
    return [Part.of(branch, stretch, output, harmonic) for stretch in stretches if stretch.stable]


@dataclass(frozen=True, kw_only=True, eq=False)
class Assignment:
    """Which part each measurement is taken to lie on.

    Attributes
    ----------
    parts : list of Part
    labels : array (n,), int
        Numbers of parts.
    beyond : array (n,), bool
        Whether the part ends before the frequency of the measurement, and would have to reach further.
    amplitudes : array (n_parts, n)
        Of the parts at the measured frequencies, nan where they do not reach.
    """

    parts: Sequence[Part]
    labels: IntArray
    beyond: BoolArray
    amplitudes: Array

    @property
    def own(self) -> Array:
        """Amplitude of the part of each measurement, (n,), nan where it does not reach."""
        return np.asarray(self.amplitudes[self.labels, np.arange(self.labels.size)])

    def starts(self, measured: Measurements) -> list[Solution]:
        """Return a solution near each measurement on its part."""
        return [self.parts[k].near(omega) for k, omega in zip(self.labels, measured.omega, strict=True)]

    def relabelled(self, index: int, label: int) -> Assignment:
        """Return a copy in which one measurement lies on another part, which reaches its frequency."""
        labels, beyond = self.labels.copy(), self.beyond.copy()
        labels[index], beyond[index] = label, False
        return Assignment(parts=self.parts, labels=labels, beyond=beyond, amplitudes=self.amplitudes)


def assign(parts: Sequence[Part], measured: Measurements, barred: BoolArray) -> Assignment:
    """Return the part that each measurement lies on, by its amplitude.

    That is the part whose amplitude at its frequency is the nearest. Where another part ends near it, which the
    measurement lies nearer to, the part is taken to reach further: folds are among what is to be found.

    Parameters
    ----------
    parts : sequence of Part
        One at least.
    measured : Measurements
    barred : array (n,), bool
        Measurements for which no part is taken to reach further, unless there is no other at their frequency.
    """
    omega, amplitude = measured.omega, measured.amplitude
    there = np.array([part.at(omega) for part in parts])
    sizes = float(np.ptp(omega)) or float(omega[0]), float(amplitude.max())
    misfits = np.abs(there - amplitude) / sizes[1]
    misfits = np.where(np.isnan(there), np.inf, misfits)
    distances = np.array([part.distances(omega, amplitude, sizes) for part in parts])
    nearest, labels = distances.argmin(axis=0), misfits.argmin(axis=0)
    own, everyone = distances.min(axis=0), np.arange(omega.size)
    ends = np.isnan(there[nearest, everyone])
    beyond = ends & ~barred & (own <= max(NEAR, TYPICAL * float(np.median(own)))) & (own < misfits.min(axis=0))
    beyond |= np.isinf(misfits.min(axis=0))
    return Assignment(parts=parts, labels=np.where(beyond, nearest, labels), beyond=beyond, amplitudes=there)
