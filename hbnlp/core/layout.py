"""What a kind of record looks like in its file: its columns and plain values, and the one check that they are that."""

from __future__ import annotations

import enum
import re
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Entry = Callable[[Any], Any]
"""Returns a plain value as a record has it, or raises a ValueError that says what is needed."""

_LENGTH = re.compile(r"(?P<times>\d*)(?P<name>[A-Za-z_]+)(?:\+(?P<plus>\d+))?")
_KINDS = {float: "fiu", complex: "cfiu", int: "iu", bool: "b", object: "cfiub"}


@dataclass(frozen=True)
class Column:
    """An array of a record.

    Attributes
    ----------
    shape : str
        Its lengths, "points dof 2H+1": numbers, or multiples of a name with something added. A name is the same length
        in all columns of a record. "..." is any shape.
    kind : type
        float, complex, int or bool; object for any of these.
    finite : bool
        Whether all values are finite as a rule. Those that were not when the record was saved are loaded as they were.
    optional : bool
        Whether it may be None, or lack in files of earlier versions.
    numbers : str
        Where its last axis are harmonics: the column that tells how many of them each row has, the rest being padded.
    about : str
        What it is, for the tables that are made of it.
    units : str
        "1" for a pure number; empty where it has those of the system's equations.
    """

    shape: str
    kind: type = float
    finite: bool = True
    optional: bool = False
    numbers: str = ""
    about: str = ""
    units: str = ""


@dataclass(frozen=True)
class Layout:
    """How a kind of record lies in its file.

    Attributes
    ----------
    kind : str
        What it is called.
    columns : mapping of names to Column
    entries : mapping of names to Entry
        The plain values.
    lengths : mapping of names of lengths to names of entries
        Entries that have one of the lengths: the names of outputs have "outputs".
    defaults : mapping
        Plain values of files of earlier versions, which lack them.
    more : mapping of str to Column
        What further columns must be, by what their names begin with.
    dimensions : mapping of parts of shapes to str
        What a table calls an axis, where that is not the length's name in the singular.
    rows : str
        The dimension of the rows of a table in two dimensions; by default the first of the first column.
    working : frozenset of str
        Columns and plain values that only work which goes on with the record needs: no table has them.
    """

    kind: str
    columns: dict[str, Column]
    entries: Mapping[str, Entry] = field(default_factory=dict)
    lengths: Mapping[str, str] = field(default_factory=dict)
    defaults: Mapping[str, Any] = field(default_factory=dict)
    more: Mapping[str, Column] = field(default_factory=dict)
    dimensions: Mapping[str, str] = field(default_factory=dict)
    rows: str = ""
    working: frozenset[str] = frozenset()

    def check(
        self, arrays: Mapping[str, Any], metadata: Mapping[str, Any], *, loose: frozenset[str]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the columns and plain values of a record; columns that may lack and do are None.

        Parameters
        ----------
        arrays, metadata : mapping
            What a file holds, or is to hold.
        loose : frozenset of str
            Names of columns that may have values that are not finite.

        Raises
        ------
        ValueError
            If one is missing, or not what it should be.
        """
        values = {name: self._entry(name, entry, metadata) for name, entry in self.entries.items()}
        lengths = {length: len(values[name]) for length, name in self.lengths.items()}
        columns: dict[str, Any] = {}
        for name, column in (self.columns | self._further(arrays)).items():
            array = arrays.get(name)
            if array is None and (column.optional or lengths.get(column.shape.split(" ")[0]) == 0):
                columns[name] = None
            elif array is None:
                raise ValueError(f"it has no {name!r}; it is damaged, or from another version")
            else:
                _check_column(name, array, column, lengths, finite=column.finite and name not in loose)
                columns[name] = array
        return columns, values

    def not_finite(self, arrays: Mapping[str, Any]) -> list[str]:
        """Return the names of columns that should be finite and are not."""
        finite = {name for name, column in self.columns.items() if column.finite}
        return [name for name, array in arrays.items() if name in finite and not np.isfinite(array).all()]

    def _further(self, arrays: Mapping[str, Any]) -> dict[str, Column]:
        """Return what columns must be that are not named one by one."""
        further = {}
        for name in sorted(arrays.keys() - self.columns.keys()):
            described = [column for start, column in self.more.items() if name.startswith(start)]
            if not described:
                raise ValueError(f"it has an array {name!r}, which no {self.kind} has")
            further[name] = described[0]
        return further

    def _entry(self, name: str, entry: Entry, metadata: Mapping[str, Any]) -> Any:
        if name not in metadata:
            if name in self.defaults:
                return self.defaults[name]
            raise ValueError(f"it has no {name!r}; it is damaged, or from another version")
        try:
            return entry(metadata[name])
        except ValueError as error:
            raise ValueError(f"its {name} is {error}") from error


def _check_column(name: str, array: Any, column: Column, lengths: dict[str, int], *, finite: bool) -> None:
    """Raise a ValueError unless an array is as its column says, and note the lengths that it is the first to tell."""
    array = np.asarray(array)
    if array.dtype.kind not in _KINDS[column.kind]:
        raise ValueError(f"its {name} is of {array.dtype}, {column.kind.__name__} is needed")
    parts = column.shape.split()
    if parts != ["..."] and (
        len(parts) != array.ndim
        or not all(_fits(size, part, lengths) for size, part in zip(array.shape, parts, strict=True))
    ):
        known = ", ".join(f"{length} = {lengths[length]}" for length in lengths if length in column.shape)
        where = f", {known}" if known else ""
        raise ValueError(f"its {name} has the shape {array.shape}; ({', '.join(parts)}) is needed{where}")
    if finite and not np.isfinite(array).all():
        raise ValueError(f"its {name} has values that are not finite")
    if column.kind is int and array.size and array.min() < 0:  # they count, all of them
        raise ValueError(f"its {name} has the value {array.min()}; whole numbers that are not negative are needed")


def _fits(size: int, part: str, lengths: dict[str, int]) -> bool:
    """Whether a length is as its part of the shape says; the first of a name decides."""
    if part.isdecimal():
        return size == int(part)
    match = _LENGTH.fullmatch(part)
    assert match is not None, part
    rest = size - int(match["plus"] or 0)
    length, remainder = divmod(rest, int(match["times"] or 1))
    return remainder == 0 and length >= 0 and lengths.setdefault(match["name"], length) == length


# -- entries -----------------------------------------------------------------------------------------------------------


def text(value: Any) -> str:
    """Text."""
    if not isinstance(value, str):
        raise _other(value, "text")
    return value


def flag(value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool):
        raise _other(value, "true or false")
    return value


def whole(value: Any) -> int:
    """A whole number, not negative."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise _other(value, "a whole number, not negative,")
    return value


def counted_from_one(value: Any) -> int:
    """A whole number of at least one."""
    if whole(value) == 0:
        raise _other(value, "a whole number above zero")
    return whole(value)


def number(value: Any) -> float:
    """A number, finite or not."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise _other(value, "a number")
    return value


def texts(value: Any) -> tuple[str, ...]:
    """Texts, in a tuple."""
    return tuple(text(each) for each in _several(value))


def complex_number(value: Any) -> complex:
    """A complex number, which is written as its real and imaginary part."""
    return complex(*pair(number)(value))


def pair(of: Entry) -> Entry:
    """Two of something, in a tuple."""

    def read(value: Any) -> tuple[Any, Any]:
        if len(_several(value)) != 2:
            raise _other(value, "a pair")
        return of(value[0]), of(value[1])

    return read


def mapping(value: Any) -> dict[str, Any]:
    """Anything by name."""
    if not isinstance(value, dict):
        raise _other(value, "a mapping")
    return value


def numbers_by_name(value: Any) -> dict[str, float]:
    """Numbers by name."""
    return {name: number(each) for name, each in mapping(value).items()}


def facts(value: Any) -> dict[str, float | str]:
    """Numbers and texts by name."""
    return {name: each if isinstance(each, str) else number(each) for name, each in mapping(value).items()}


def name_in(kinds: type[enum.Enum]) -> Entry:
    """The name of a member of an enumeration, which is returned."""

    def read(value: Any) -> enum.Enum:
        if text(value) not in kinds.__members__:
            raise _other(value, f"one of {', '.join(kinds.__members__)}")
        return kinds[value]

    return read


def maybe(of: Entry) -> Entry:
    """Something, or None."""
    return lambda value: None if value is None else of(value)


def table(defaults: Mapping[str, Any] | None = None, /, **entries: Entry) -> Entry:
    """Rows, each with the same entries, those of earlier versions with defaults for some of them."""
    rows = Layout(kind="row", columns={}, entries=entries, defaults=defaults or {})
    return lambda value: tuple(rows.check({}, mapping(row), loose=frozenset())[1] for row in _several(value))


def _several(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise _other(value, "a list")
    return value


def _other(value: Any, needed: str) -> ValueError:
    return ValueError(f"{textwrap.shorten(repr(value), 80, placeholder=' ...')}; {needed} is needed")
