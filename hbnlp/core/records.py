"""Records of columns and plain values, each in one file."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

from hbnlp.core.storage import load_arrays, save_arrays


class Layout(NamedTuple):
    """How a kind of record lies in its file: which of its attributes are arrays, and which go into the metadata."""

    kind: str
    arrays: tuple[str, ...]
    metadata: tuple[str, ...]


def save_record(record: Any, path: str | os.PathLike[str], layout: Layout) -> None:
    """Write a record to one ``.npz`` file without pickle, whole or not at all; an array that is None is left out.

    Raises
    ------
    SaveError
        If the file cannot be written.
    """
    columns = {name: getattr(record, name) for name in layout.arrays}
    arrays = {name: column for name, column in columns.items() if column is not None}
    save_arrays(path, layout.kind, arrays, {name: _plain(getattr(record, name)) for name in layout.metadata})


def load_record(path: str | os.PathLike[str], layout: Layout) -> dict[str, Any]:
    """Return the attributes of a record that `save_record` wrote; lists come back as tuples.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is damaged, holds something else, or lacks a part.
    """
    arrays, metadata = load_arrays(path, layout.kind)
    for name in (*layout.arrays, *layout.metadata):
        if name not in arrays and name not in metadata:
            raise ValueError(f"{os.fspath(path)!r} has no {name!r}; it is damaged, or from another version")
    content = {name: arrays[name] for name in layout.arrays}
    return content | {name: tuple(v) if isinstance(v := metadata[name], list) else v for name in layout.metadata}


def _plain(value: Any) -> Any:
    """Return a mapping as a dictionary, for JSON."""
    return dict(value) if hasattr(value, "keys") else value
