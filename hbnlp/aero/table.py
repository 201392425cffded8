"""Frequency responses as tables of text: columns omega, load, motion, real, imag, in any order of rows.

``load`` counts C_L, dCp_1, ... from 0 and ``motion`` alpha, z, W_1, ... from 0; rows with omega 0 are the static value.
"""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

import numpy as np

from hbnlp.core.files import write_text
from hbnlp.core.types import Array, ComplexArray

_HEADER = ("omega", "load", "motion", "real", "imag")
_WHOLE = {"load": "C_L is 0, dCp_1 is 1, ...", "motion": "alpha is 0, z is 1, W_1 is 2, ..."}


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
    ValueError
        If the header differs, a cell is no finite number, an entry is missing or given twice, or the static value is
        missing; it names line, column and value.
    """
    name = repr(os.fspath(path))
    with Path(path).open(newline="") as handle:
        reader = csv.reader(handle)
        header = tuple(cell.strip() for cell in next(reader, []))
        if header != _HEADER:
            raise ValueError(f"the header of {name} is {header}; {_HEADER} is needed")
        rows = np.array([_numbers(f"{name}, line {reader.line_num}", row) for row in reader if row])
    if rows.size == 0 or rows[:, 0].min() != 0.0:
        raise ValueError(f"{name} has no rows with omega 0; add the static value")
    omega, at = np.unique(rows[:, 0], return_inverse=True)
    loads, motions = rows[:, 1].astype(int), rows[:, 2].astype(int)
    values = np.full((omega.size, loads.max() + 1, motions.max() + 1), np.nan, dtype=complex)
    values[at, loads, motions] = rows[:, 3] + 1j * rows[:, 4]
    if len(np.unique(rows[:, :3], axis=0)) != len(rows) or len(rows) != values.size:
        raise ValueError(
            f"{name} has {len(rows)} rows for {omega.size} frequencies and {values.shape[1:]} matrices; "
            f"every entry is needed exactly once, {values.size} rows"
        )
    return omega, values


def _numbers(where: str, cells: list[str]) -> list[float]:
    """Return the numbers of one row of a table, or raise the ValueError that names the cell that is wrong."""
    if len(cells) != len(_HEADER):
        raise ValueError(f"{where}: {cells} are {len(cells)} columns; {_HEADER} are needed")
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
            raise ValueError(f"{where}, column {name!r}: {cell!r}; {accepted}")
        numbers.append(number)
    return numbers
