"""Frequency responses as tables of text: columns omega, load, motion, real, imag, in any order of rows.

``load`` counts C_L, dCp_1, ... from 0 and ``motion`` alpha, z, W_1, ... from 0; rows with omega 0 are the static value.
"""

from __future__ import annotations

import csv
import io
import os
import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from hbnlp.core.checks import counted
from hbnlp.core.errors import LoadError
from hbnlp.core.files import write_text
from hbnlp.core.storage import refuse_irregular, refused_as_unreadable
from hbnlp.core.types import Array, ComplexArray

_HEADER = ("omega", "load", "motion", "real", "imag")
_WHOLE = {"load": "C_L is 0, dCp_1 is 1, ...", "motion": "alpha is 0, z is 1, W_1 is 2, ..."}

ROUNDING = 1e-9
"""Imaginary parts of the static value up to this part of its largest entry are taken for rounding."""


def write_table(path: str | os.PathLike[str], omega: Array, values: ComplexArray) -> None:
    """Write matrices (m, N+1, N+2) at the frequencies (m,), all digits of them, whole or not at all.

    Raises
    ------
    SaveError
        (An `OSError`.) If the file cannot be written.
    """
    rows = io.StringIO(newline="")
    writer = csv.writer(rows)
    writer.writerow(_HEADER)
    for w, matrix in zip(omega, values, strict=True):
        for (load, motion), value in np.ndenumerate(matrix):
            writer.writerow((repr(float(w)), load, motion, repr(float(value.real)), repr(float(value.imag))))
    write_text(path, rows.getvalue())


def read_table(path: str | os.PathLike[str]) -> tuple[Array, ComplexArray]:
    """Return the frequencies (m,), rising from 0, and the matrices (m, N+1, N+2) of a table.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    LoadError
        (A `ValueError`.) If it is no table, a cell is no finite number, an entry is missing or given twice, or the
        static value is missing or complex; it names line, column and value.
    """
    name = repr(os.fspath(path))
    with refused_as_unreadable(path, "frequency table"):
        refuse_irregular(Path(path))
        with Path(path).open(newline="", encoding="utf-8-sig") as handle:  # spreadsheets begin with a mark of UTF-8
            entries = _entries(name, csv.reader(handle))
    omega = sorted({w for w, _, _ in entries})
    if omega[:1] != [0.0]:
        raise LoadError(f"{name} has no rows with omega 0; add the static value")
    loads, motions = 1 + max(load for _, load, _ in entries), 1 + max(motion for _, _, motion in entries)
    if len(omega) == 1 or motions != loads + 1:
        raise LoadError(
            f"{name} has {counted(len(omega), 'frequency')} with {loads} loads of {motions} motions; rows with omega 0 "
            "and others are needed, and loads C_L, dCp_1..dCp_N, motions alpha, z, W_1..W_N"
        )
    # none of what the numbers of loads and motions say is made before all of it is known to be there
    wanted = ((w, load, motion) for w in omega for load in range(loads) for motion in range(motions))
    for key in wanted:
        if key not in entries:
            raise LoadError(f"{name} has no row for omega {key[0]:g}, load {key[1]}, motion {key[2]}; add it")
    values = np.array([entries[key][0] for key in sorted(entries)]).reshape(len(omega), loads, motions)
    static = np.abs(values[0].imag)
    if static.max() > ROUNDING * np.abs(values[0]).max():
        value, line = entries[0.0, *divmod(int(static.argmax()), motions)]
        raise LoadError(f"{name}, line {line}, column 'imag': {value.imag:g}; the static value is real, 0 is needed")
    return np.array(omega), values


def _entries(name: str, reader: Any) -> dict[tuple[float, int, int], tuple[complex, int]]:
    """Return the values of a table and the lines where they stand, by frequency, load and motion."""
    header = tuple(cell.strip() for cell in next(reader, []))
    if header != _HEADER:
        raise LoadError(f"{name}, line 1: the header is {textwrap.shorten(str(header), 110)}; {_HEADER} is needed")
    entries: dict[tuple[float, int, int], tuple[complex, int]] = {}
    for row in filter(None, reader):
        where = f"{name}, line {reader.line_num}"
        omega, load, motion, real, imag = _numbers(where, row)
        key = omega, int(load), int(motion)
        if key in entries:
            raise LoadError(f"{where}: the entry stands in line {entries[key][1]} already; give it once")
        entries[key] = complex(real, imag), reader.line_num
    return entries


def _numbers(where: str, cells: list[str]) -> list[float]:
    """Return the numbers of one row of a table, or raise the LoadError that names the cell that is wrong."""
    if len(cells) != len(_HEADER):
        raise LoadError(
            f"{where}: {textwrap.shorten(str(cells), 110)} are {counted(len(cells), 'column')}; {_HEADER} are needed"
        )
    numbers = []
    for name, cell in zip(_HEADER, cells, strict=True):
        try:
            number = float(cell)
        except ValueError:
            number = np.nan
        accepted = f"a whole number is needed: {_WHOLE[name]}" if name in _WHOLE else "a finite number is needed"
        if name == "omega":
            accepted += ", not negative"
        wrong = name in (*_WHOLE, "omega") and number < 0.0
        if wrong or not np.isfinite(number) or (name in _WHOLE and not number.is_integer()):
            raise LoadError(f"{where}, column {name!r}: {textwrap.shorten(repr(cell), 80)}; {accepted}")
        numbers.append(number)
    return numbers
