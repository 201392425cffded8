"""Records of columns and plain values, each in one file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hbnlp.core.checks import position, unknown_name
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.storage import load_arrays, save_arrays
from hbnlp.core.types import Array, ComplexArray


class Layout(NamedTuple):
    """How a kind of record lies in its file: which of its attributes are arrays, and which go into the metadata.

    Those of the arrays that are ``optional`` may be None, and lack in files of earlier versions.
    """

    kind: str
    arrays: tuple[str, ...]
    metadata: tuple[str, ...]
    optional: tuple[str, ...] = ()


def save_record(record: Any, path: str | os.PathLike[str], layout: Layout) -> None:
    """Write a record to one ``.npz`` file without pickle, whole or not at all; an array that is None is left out.

    Raises
    ------
    SaveError
        If the file cannot be written.
    """
    save_arrays(path, layout.kind, *parts_of(record, layout))


def load_record(path: str | os.PathLike[str], layout: Layout) -> dict[str, Any]:
    """Return the attributes of a record that `save_record` wrote; lists come back as tuples.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is damaged, holds something else, or lacks a part.
    """
    return attributes_of(path, *load_arrays(path, layout.kind), layout)


def parts_of(record: Any, layout: Layout) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what a layout names of a record: arrays, those that are None left out, and metadata."""
    columns = {name: getattr(record, name) for name in layout.arrays}
    arrays = {name: column for name, column in columns.items() if column is not None}
    return arrays, {name: _plain(getattr(record, name)) for name in layout.metadata}


def attributes_of(
    path: str | os.PathLike[str], arrays: Mapping[str, Any], metadata: Mapping[str, Any], layout: Layout
) -> dict[str, Any]:
    """Return the attributes that a layout names from what a file holds; a ValueError says which one it lacks."""
    for name in (*layout.arrays, *layout.metadata):
        if name not in arrays and name not in metadata and name not in layout.optional:
            raise ValueError(f"{os.fspath(path)!r} has no {name!r}; it is damaged, or from another version")
    content: dict[str, Any] = {name: arrays.get(name) for name in layout.arrays}
    return content | {name: tuple(v) if isinstance(v := metadata[name], list) else v for name in layout.metadata}


class AlongParameter:
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
