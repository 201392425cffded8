"""What is drawn along a branch: its points, the special points located between them, and the line through."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.core.checks import whole_number
from hbnlp.core.kinds import Kind
from hbnlp.core.quantities import quantities_of
from hbnlp.core.types import Array, ComplexArray, IntArray
from hbnlp.fourier import decibels, resize
from hbnlp.plot.arguments import modulus
from hbnlp.plot.smooth import PARTS, Line

if TYPE_CHECKING:
    from hbnlp.branches.branch import Branch
    from hbnlp.branches.special_points import SpecialPoint
    from hbnlp.solutions.solution import Solution


@dataclass(frozen=True, kw_only=True)
class Ordinate:
    """What of a solution or record is drawn: the amplitude of one harmonic of an output.

    Attributes
    ----------
    output : str
    harmonic : int
        Of the motion: on one over two periods of the forcing, the second is that of the forcing.
    per : str or None
        An output by whose amplitude at the frequency of the forcing it is divided.
    decibels : bool
    """

    output: str
    harmonic: int
    per: str | None
    decibels: bool

    def check(self, source: Any) -> None:
        """Raise a ValueError or KeyError that names what a record does not have."""
        most = source.harmonics(self.output).shape[-1] - 1
        whole_number("harmonic", self.harmonic, least=0, most=most, advice=", which are retained")
        if self.per is not None:
            source.harmonics(self.per)

    def amplitudes(self, source: Any, periods: int) -> ComplexArray:
        """Return the complex amplitudes (..., 1 or 2) that it is made of, for all points of a record or a solution.

        The harmonic is that of motions over so many periods; harmonics that the source does not have are zero.
        """

        def harmonic(output: str, order: Fraction) -> ComplexArray:
            amplitudes = source.harmonics(output)
            there = order.denominator == 1 and order < amplitudes.shape[-1]
            return np.asarray(amplitudes[..., int(order)] if there else np.zeros(amplitudes.shape[:-1], dtype=complex))

        made_of = [harmonic(self.output, Fraction(self.harmonic * source.periods, periods))]
        if self.per is not None:
            made_of.append(harmonic(self.per, Fraction(source.periods)))
        return np.stack(made_of, axis=-1)

    def level(self, amplitudes: ComplexArray) -> Array:
        """Return what is drawn, of complex amplitudes; a mean has its sign, but in decibels."""
        signed = self.harmonic == 0 and not self.decibels
        size = amplitudes[..., 0].real if signed else np.abs(amplitudes[..., 0])
        with np.errstate(divide="ignore", invalid="ignore"):  # at rest
            if self.per is not None:
                size = size / np.abs(amplitudes[..., 1])
            return decibels(size) if self.decibels else np.asarray(size)

    def of(self, source: Any) -> Array:
        """Return what is drawn for all points of a record."""
        return self.level(self.amplitudes(source, source.periods))

    def at(self, solution: Solution, periods: int) -> float:
        """Return what is drawn for one solution beside motions over so many periods."""
        return float(self.level(self.amplitudes(solution, periods)))

    def label(self, record: Any, periods: int) -> str:
        """Return what stands beside the axis, for motions of a record over so many periods of the forcing."""
        known = quantities_of(record)
        name, of_mean = known.label(self.output), "" if self.harmonic else "mean of "
        what = of_mean + name if not (self.harmonic or self.decibels) else modulus(of_mean + name)
        what += f" / {modulus(known.label(self.per))}" if self.per is not None else ""
        unit = "" if self.per is not None or self.decibels else known.unit(self.output)
        order = f"harmonic {Fraction(self.harmonic, periods)}" if self.harmonic else ""
        notes = [note for note in (unit, order, "dB" if self.decibels else "") if note]
        return f"{what} ({', '.join(notes)})" if notes else what


@dataclass(frozen=True, kw_only=True)
class Along:
    """A branch as it is drawn, from point to point in `PARTS` parts.

    Attributes
    ----------
    parameter, level : array (n,)
    marks : int array (n_points, k)
        What of each point tells how the line after it is drawn; the last column is of the whole step from it.
    """

    parameter: Array
    level: Array
    marks: IntArray

    @classmethod
    def of(cls, branch: Branch, ordinate: Ordinate, marks: IntArray, begin: SpecialPoint | None = None) -> Along:
        """Return what is drawn of a branch.

        The line goes through the located special points, which lie beyond their neighbours at a fold, and begins at the
        special point that the branch was switched to at, if that is given.
        """
        located = [point for point in branch.special_points if point.refined]
        after = [point.index + 1 for point in located]
        most = branch.coefficients.shape[2] // 2

        def through(of_points: Any, of_located: list[Any]) -> Any:
            return np.insert(of_points, after, np.array(of_located), axis=0) if located else of_points

        parameter = through(branch.parameter, [point.value for point in located])
        motions = through(branch.coefficients, [resize(point.solution.coefficients, most) for point in located])
        amplitudes = through(
            ordinate.amplitudes(branch, branch.periods),
            [ordinate.amplitudes(point.solution, branch.periods) for point in located],
        )
        # after a special point the next point tells what changes there, and the one before what is of the step
        marks = through(marks, [[*marks[i, :-1], marks[i - 1, -1]] for i in after])
        folds = [after[k] + k for k, point in enumerate(located) if point.kind is Kind.FOLD]
        if begin is not None and len(branch):
            # known there up to the symmetries of the system: the size counts, in the phase that the branch has
            size = np.abs(ordinate.amplitudes(begin.solution, branch.periods))
            parameter, motions, marks = (
                np.concatenate([first, each])
                for first, each in (([begin.value], parameter), (motions[:1], motions), (marks[:1], marks))
            )
            amplitudes = np.concatenate([[size * np.exp(1j * np.angle(amplitudes[0]))], amplitudes])
            folds = [1 + fold for fold in folds]
        line = Line(parameter[:, None], motions)
        return cls(parameter=line(parameter, still=folds), level=ordinate.level(line(amplitudes)), marks=marks)

    def pieces(self, *columns: int) -> Iterator[tuple[Array, Array, tuple[int, ...]]]:
        """Yield parameter and level of each part along which these marks stay, and all marks of its first point.

        Each takes the first point of the next, so that the line has no gap.
        """
        changes = np.any(np.diff(self.marks[:, columns], axis=0), axis=1)
        edges = [0, *(1 + np.flatnonzero(changes)), len(self.marks)]
        for begin, end in itertools.pairwise(edges):
            part = slice(PARTS * int(begin), PARTS * int(end) + 1)
            yield self.parameter[part], self.level[part], tuple(map(int, self.marks[begin]))
