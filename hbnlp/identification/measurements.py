"""Measured amplitudes against frequency, from arrays or from a table of text."""

from __future__ import annotations

import csv
import os
import re
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import (
    counted,
    file_name,
    finite_numbers,
    instance_of,
    list_of,
    place,
    real_number,
    refused,
    text,
)
from hbnlp.core.errors import LoadError
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.storage import refuse_irregular, refused_as_unreadable
from hbnlp.core.types import Array

WAYS = ("up", "down")
_UNIT = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$")
_PURE = {"", "-", "1", "rad"}


@final
@dataclass(frozen=True, init=False, repr=False, eq=False)
class Measurements(ReadOnlyArrays):
    """Amplitudes that were measured at frequencies, in the units of the equations.

    Parameters
    ----------
    omega : array_like (n,)
        Frequencies of the forcing, above zero, in any order.
    amplitude : array_like (n,)
        Amplitudes of one harmonic of an output, not negative: half of what is between the peaks of a sine.
    way : sequence of str, optional
        "up" or "down" for each, the way in which the frequency went; where it is not known, "". It is drawn, no more:
        on which branch a point lies is found from its amplitude.
    lines : sequence of int, optional
        Where each stands in its file.

    Raises
    ------
    ValueError, TypeError
        If these are no such numbers, or not as many of each.
    """

    omega: Array
    amplitude: Array
    way: tuple[str, ...]
    lines: tuple[int, ...]

    # written by hand because it takes lists, where the fields are arrays
    def __init__(self, omega: ArrayLike, amplitude: ArrayLike, *, way: Any = None, lines: Any = None) -> None:
        frequencies, sizes = finite_numbers("omega", omega), finite_numbers("amplitude", amplitude)
        if frequencies.size != sizes.size:
            raise ValueError(f"omega has {frequencies.size} values and amplitude {sizes.size}; give one for each")
        if frequencies.min() <= 0.0:
            raise refused(ValueError, "omega", frequencies.min(), "frequencies above zero")
        if sizes.min() < 0.0 or not sizes.any():
            raise refused(ValueError, "amplitude", sizes.min(), "amplitudes, which are not negative nor all zero")
        ways = [""] * sizes.size if way is None else way
        list_of("way", ways, str, "a list of 'up' or 'down', one for each")
        if len(ways) != sizes.size or not {*ways} <= {*WAYS, ""}:
            raise refused(ValueError, "way", way, f"'up', 'down' or '' for each of the {sizes.size} amplitudes")
        numbers = () if lines is None else lines
        list_of("lines", numbers, int, "a list of whole numbers, one for each")
        if len(numbers) not in (0, sizes.size):
            raise refused(ValueError, "lines", lines, f"a number for each of the {sizes.size} amplitudes")
        for name, value in (
            ("omega", frequencies), ("amplitude", sizes), ("way", tuple(ways)), ("lines", tuple(numbers)),
        ):  # fmt: skip
            object.__setattr__(self, name, value)
        self.__post_init__()

    @classmethod
    def from_csv(
        cls,
        path: str | os.PathLike[str],
        *,
        omega: str = "omega",
        amplitude: str = "amplitude",
        way: str | None = None,
        omega_unit: float | None = None,
        amplitude_unit: float | None = None,
    ) -> Measurements:
        """Read a table of text: a header, then a row a measurement, in any order of rows and columns.

        Parameters
        ----------
        path : path-like
            Cells are separated by commas, semicolons or tabulators; lines that begin with # are comments.
        omega, amplitude : str
            Names of the columns of the frequency and the amplitude.
        way : str, optional
            Name of the column of "up" or "down"; by default "way" if there is one.
        omega_unit, amplitude_unit : float, optional
            What a number of the column is multiplied by to be in the units of the equations: ``2 * pi`` for Hz where
            time is in seconds, 0.5 for an amplitude from peak to peak, 1e-3 for mm where lengths are in m. By default
            1; a column whose name ends with its unit in brackets, ``f [Hz]``, must have it.

        Returns
        -------
        Measurements

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        LoadError
            (A `ValueError`.) If a column is missing, a cell no finite number, a frequency not above zero or an
            amplitude negative: it names line, column and value, and says what to do.
        """
        file_name("path", path)
        text("omega", omega)
        text("amplitude", amplitude)
        instance_of("way", way, str | None, "the name of a column, or None")
        factors = {}
        for argument, unit in (("omega_unit", omega_unit), ("amplitude_unit", amplitude_unit)):
            if unit is not None:
                real_number(argument, unit, above=0.0)
            factors[argument] = unit
        name = repr(os.fspath(path))
        with refused_as_unreadable(path, "table of measurements"):
            refuse_irregular(Path(path))
            rows = _rows(name, _text_of(path))
        header = rows[0][1]
        places = [_place(name, header, omega, "omega"), _place(name, header, amplitude, "amplitude")]
        units = [
            _factor(name, header[place], factors[argument], argument)
            for place, argument in zip(places, factors, strict=True)
        ]
        ways = (
            [_place(name, header, way, "way")] if way is not None else [k for k, h in enumerate(header) if h == "way"]
        )
        numbers, found, lines = [], [], []
        for line, cells in rows[1:]:
            where = f"{name}, line {line}"
            if len(cells) != len(header):
                raise LoadError(f"{where}: {counted(len(cells), 'cell')}, the header has {len(header)}; give as many")
            numbers.append([_number(where, header[place], cells[place], place == places[0]) for place in places])
            found.append(_way(where, header[ways[0]], cells[ways[0]]) if ways else "")
            lines.append(line)
        frequencies, amplitudes = np.array(numbers).T
        if not amplitudes.any():
            raise LoadError(f"{name}: all amplitudes are zero; give those of a motion")
        return cls(units[0] * frequencies, units[1] * amplitudes, way=found, lines=lines)

    def __len__(self) -> int:
        return self.omega.size

    def named(self, index: int) -> str:
        """Return what a measurement is called: its line in the file, or its number from 0, with its values."""
        index = place("index", index, len(self))
        where = f"line {self.lines[index]}" if self.lines else f"number {index}"
        way = f", {self.way[index]}" if self.way[index] else ""
        return f"{where} (omega {self.omega[index]:.6g}, amplitude {self.amplitude[index]:.4g}{way})"

    def __repr__(self) -> str:
        up, down = (self.way.count(way) for way in WAYS)
        return (
            f"Measurements: {counted(len(self), 'amplitude')}, {up} on the way up, {down} on the way down\n"
            f"  omega {self.omega.min():g} to {self.omega.max():g}, amplitude {self.amplitude.min():g} to "
            f"{self.amplitude.max():g}"
        )


def _text_of(path: str | os.PathLike[str]) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        wrong = error.object[error.start : error.start + 1]
        raise LoadError(
            f"{os.fspath(path)!r} is no text in UTF-8: byte {error.start} is {wrong!r}; save the table as CSV in UTF-8"
        ) from error


def _rows(name: str, content: str) -> list[tuple[int, list[str]]]:
    """Return the cells of the lines that have any, with the numbers of these lines; the header is the first."""
    lines = [(k, line) for k, line in enumerate(content.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    if len(lines) < 2:
        raise LoadError(f"{name} has no measurements; give a header, such as omega,amplitude,way, and a row for each")
    separator = max(",;\t", key=lines[0][1].count)
    reader = csv.reader([line for _, line in lines], delimiter=separator)
    return [(lines[reader.line_num - 1][0], [cell.strip() for cell in row]) for row in reader]  # a cell may have lines


def _place(name: str, header: list[str], wanted: str, argument: str) -> int:
    if header.count(wanted) != 1:
        found = textwrap.shorten(", ".join(map(repr, header)), 200)
        often = "several columns" if wanted in header else "no column"
        raise LoadError(
            f"{name} has {often} {wanted!r} among {found}; say which it is, {argument}='...', and name each column once"
        )
    return header.index(wanted)


def _factor(name: str, column: str, unit: float | None, argument: str) -> float:
    """Return what numbers of a column are multiplied by."""
    said = _UNIT.search(column)
    if unit is None and said is not None and said[1].lower() not in _PURE:
        example = "2*pi for Hz and a time in seconds" if argument == "omega_unit" else "1e-3 for mm and a length in m"
        raise LoadError(
            f"{name}: the column {column!r} is in {said[1]}; say how much one of these is in the units of the "
            f"equations, {argument}=..., for instance {example}, or 1 if they are the same"
        )
    return 1.0 if unit is None else float(unit)


def _number(where: str, column: str, cell: str, positive: bool) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = np.nan
    shown = f"{where}, column {column!r}: {textwrap.shorten(repr(cell), 80)}"
    if not np.isfinite(number):
        raise LoadError(f"{shown}; a finite number with a decimal point is needed: take the row out if there is none")
    if positive and number <= 0.0:
        raise LoadError(f"{shown}; a frequency is above zero: take the row out")
    if not positive and number < 0.0:
        raise LoadError(
            f"{shown}; an amplitude is not negative: give its size where this is one part of it, and what it was "
            "before the logarithm where it is in decibels"
        )
    return number


def _way(where: str, column: str, cell: str) -> str:
    if cell.lower() not in (*WAYS, ""):
        raise LoadError(f"{where}, column {column!r}: {textwrap.shorten(repr(cell), 80)}; give up, down, or nothing")
    return cell.lower()
