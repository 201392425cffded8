"""The arrays of a table with the names of their axes, and its plain values as arrays and attributes."""

from __future__ import annotations

import enum
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hbnlp.core.layout import Column, Layout
from hbnlp.core.types import BoolArray
from hbnlp.fourier import to_complex
from hbnlp.tables.table import Table

HARMONIC, SIDE = "harmonic", "side"
SIDES = ("before", "after")
_HARMONICS = re.compile(r"2?[A-Z]\+1")
_COEFFICIENTS = re.compile(r"2[A-Z]\+1")


@dataclass(frozen=True)
class Variable:
    """An array, the names of its axes, and what is known of it."""

    dimensions: tuple[str, ...]
    values: Any
    about: Mapping[str, str] = field(default_factory=dict)


def dimension(part: str, layout: Layout) -> str:
    """Return what the axis of this part of a shape is called: a length's name in the singular, as a rule."""
    if part in layout.dimensions:
        return layout.dimensions[part]
    if part == "2":
        return SIDE
    return HARMONIC if _HARMONICS.fullmatch(part) else part.removesuffix("s")


def variables(table: Table) -> dict[str, Variable]:
    """Return the arrays of a table: its columns, and what its plain values tell of each row.

    Displacements are complex harmonics, as outputs are. All harmonics lie along one dimension, with nan where a row has
    fewer of them.
    """
    found: dict[str, Variable] = {}
    for name, array in table.columns.items():
        column = table.layout.columns[name]
        found[name.replace("coefficients", "displacements")] = _variable(array, column, table)
    most = max((v.values.shape[-1] for v in found.values() if HARMONIC in v.dimensions), default=0)
    found = {name: _with_harmonics(variable, most) for name, variable in found.items()}
    for length, name in table.layout.lengths.items():
        rows = table.values.get(name, ())
        if rows and isinstance(rows[0], Mapping):
            along = dimension(length, table.layout)
            found |= {f"{along}_{key}": variable for key, variable in _of_rows(rows, along)}
    return found


def labels(table: Table, found: Iterable[Variable]) -> dict[str, Any]:
    """Return the labels of those dimensions that have any."""
    lengths = {name: size for v in found for name, size in zip(v.dimensions, v.values.shape, strict=True)}
    known: dict[str, Any] = {**table.labels, SIDE: SIDES, HARMONIC: range(lengths.get(HARMONIC, 0))}
    for length, name in table.layout.lengths.items():
        if all(isinstance(label, str) for label in table.values.get(name, (None,))):
            known[dimension(length, table.layout)] = table.values[name]
    return {name: known[name] for name in lengths if len(known.get(name, ()))}


def attributes(table: Table) -> dict[str, Any]:
    """Return the plain values of a table that are none of its rows, in what netCDF can write."""
    lengths = set(table.layout.lengths.values())
    values = {name: value for name, value in table.values.items() if name not in lengths}
    return {name: _attribute(value) for name, value in _flat(values) if value is not None}


def _variable(array: Any, column: Column, table: Table) -> Variable:
    parts = column.shape.split()
    dimensions = tuple(dimension(part, table.layout) for part in parts)
    values = np.array(array)
    if parts and dimensions[-1] == HARMONIC:
        values = to_complex(values) if _COEFFICIENTS.fullmatch(parts[-1]) else values.astype(complex)
        numbers = table.columns.get(column.numbers)
        if numbers is not None:
            values[_beyond(values, numbers)] = complex(np.nan, np.nan)
    about = {"long_name": column.about, "units": column.units}
    return Variable(dimensions, values, {name: text for name, text in about.items() if text})


def _beyond(values: Any, numbers: Any) -> BoolArray:
    """Return which harmonics (rows, ..., harmonics) the rows do not have."""
    beyond = np.arange(values.shape[-1]) > np.asarray(numbers)[:, None]
    missing: BoolArray = np.broadcast_to(np.expand_dims(beyond, tuple(range(1, values.ndim - 1))), values.shape)
    return missing


def _with_harmonics(variable: Variable, most: int) -> Variable:
    if HARMONIC not in variable.dimensions:
        return variable
    values = np.full((*variable.values.shape[:-1], most), complex(np.nan, np.nan))
    values[..., : variable.values.shape[-1]] = variable.values
    return Variable(variable.dimensions, values, variable.about)


def _of_rows(rows: tuple[dict[str, Any], ...], along: str) -> Iterator[tuple[str, Variable]]:
    """Yield an array for each of the plain values of rows, nan or no text where a row has none."""
    flat = [dict(_flat(row)) for row in rows]
    for name in dict.fromkeys(name for row in flat for name in row):
        values = [row.get(name) for row in flat]
        there = [value for value in values if value is not None]
        if there and isinstance(there[0], tuple):
            yield name, Variable((along, SIDE), np.array(values, dtype=float))
        elif there and isinstance(there[0], str | enum.Enum):
            yield name, Variable((along,), np.array(["" if v is None else _attribute(v) for v in values]))
        elif there:
            gap = () if len(there) == len(values) else (np.nan,)
            kind = np.array([*there, *gap]).dtype if not gap else np.result_type(np.array(there), float)
            yield name, Variable((along,), np.array([np.nan if v is None else v for v in values], dtype=kind))


def _flat(values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield names and values, those of a mapping by its name and theirs."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from ((f"{name}_{key}", inner) for key, inner in value.items())
        else:
            yield name, value


def _attribute(value: Any) -> Any:
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, float | int | str):
        return value
    if isinstance(value, tuple):
        numbers = all(isinstance(each, float | int) for each in value)
        return [float(each) for each in value] if numbers and value else ", ".join(map(str, value))
    return json.dumps(value) if isinstance(value, Mapping | list) else repr(value)
