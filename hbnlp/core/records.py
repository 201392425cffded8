"""Records of columns and plain values, each in one file."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from hbnlp.core.checks import position, unknown_name
from hbnlp.core.errors import SaveError
from hbnlp.core.layout import Layout
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.storage import as_text, load_arrays, refused_as_unreadable, save_arrays
from hbnlp.core.types import Array, ComplexArray


def save_record(record: Any, path: str | os.PathLike[str], layout: Layout, **parts: Any) -> None:
    """Write a record to one ``.npz`` file without pickle, whole or not at all.

    Parameters
    ----------
    record : object
    path : path-like
    layout : Layout
    **parts
        Columns and plain values that are not the record's attributes as they are. A column that is None is left out.

    Raises
    ------
    SaveError
        If the file cannot be written, or the record is not as its layout says.
    """
    save_columns(path, layout, *taken_apart(record, layout, **parts))


def taken_apart(record: Any, layout: Layout, **parts: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the columns and plain values of a record, ``parts`` in the place of its attributes."""
    content = {n: parts[n] if n in parts else getattr(record, n) for n in (*layout.columns, *layout.entries)}
    arrays = {name: content[name] for name in layout.columns if content[name] is not None}
    return arrays, {name: _plain(content[name]) for name in layout.entries}


def save_columns(
    path: str | os.PathLike[str], layout: Layout, arrays: Mapping[str, Any], metadata: Mapping[str, Any] | None = None
) -> None:
    """Write arrays and plain values that are as a layout says; see `save_record`."""
    loose = layout.not_finite(arrays)
    written = {**(metadata or {}), "not_finite": loose}
    try:
        layout.check(arrays, json.loads(as_text(written)), loose=frozenset(loose))
    except ValueError as error:
        msg = f"could not write {os.fspath(path)!r}: as a {layout.kind} it could not be read again, {error}"
        raise SaveError(errno.EINVAL, msg) from error
    save_arrays(path, layout.kind, arrays, written)


@contextmanager
def loaded(path: str | os.PathLike[str], layout: Layout, *, plain: bool = False) -> Iterator[dict[str, Any]]:
    """Give the columns and plain values of a file to a block that makes a record of them.

    Parameters
    ----------
    path : path-like
    layout : Layout
    plain : bool
        Whether an archive of arrays alone will do; see `load_arrays`.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    LoadError
        (A `ValueError`.) If the file is damaged, holds something else, or not what the layout says; or if the block
        finds that no record can be made of it.
    """
    arrays, metadata = load_arrays(path, layout.kind, plain=plain)
    with refused_as_unreadable(path, layout.kind):
        loose = frozenset(metadata.pop("not_finite", ()))
        columns, values = layout.check(arrays, metadata, loose=loose)
        yield columns | values


class AlongParameter(ReadOnlyArrays):
    """What records of solutions along one parameter have in common."""

    name: str
    parameter: Array
    amplitudes: ComplexArray
    output_names: tuple[str, ...]
    parameters: Mapping[str, float]

    def __len__(self) -> int:
        return int(self.parameter.size)

    def harmonics(self, output: str) -> ComplexArray:
        """Return the complex amplitudes (n_points, H+1) of a named output: ``a_0`` and ``a_{2h-1} - i a_{2h}``."""
        return self.amplitudes[:, position("output", output, self.output_names)]

    @renamed_arguments(index="solution(index).parameters; values(name) is an array along the record")
    def values(self, name: str) -> Array:
        """Return the values (n_points,) of a parameter, the one that varies or another."""
        return values_of(name, {self.name: self.parameter}, self.parameters)


def values_of(name: str, columns: Mapping[str, Array], others: Mapping[str, float]) -> Array:
    """Return the values of a parameter at all points of a record, (n_points,).

    Parameters
    ----------
    name : str
    columns : mapping of names to arrays (n_points,)
        The parameters that vary.
    others : mapping of names to values
    """
    if not isinstance(name, str):
        raise TypeError(
            f"values({name}): give the name of a parameter; those of one point are solution({name}).parameters"
        )
    if name in columns:
        return columns[name]
    if name not in others:
        raise KeyError(unknown_name("parameter", name, [*dict.fromkeys([*columns, *others])]))
    n_points = next(iter(columns.values())).size
    return np.full(n_points, others[name])


def _plain(value: Any) -> Any:
    """Return a mapping as a dictionary, for JSON."""
    return dict(value) if hasattr(value, "keys") else value
