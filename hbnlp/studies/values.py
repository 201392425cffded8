"""Results that are no records, as arrays and JSON: numbers, texts, arrays, and lists, tuples and mappings of them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from hbnlp.core.checks import refused
from hbnlp.core.storage import load_arrays, refused_as_unreadable, save_arrays

ACCEPTED = (
    "a record of hbnlp that can be saved, a number, a text, an array, or lists, tuples and mappings by text of these: "
    "with a folder, a task returns what a file without pickle can hold"
)
_KIND = "result of a study"


def save_values(value: Any, path: str | os.PathLike[str]) -> None:
    """Write a result to one ``.npz`` file, from which `load_values` returns an equal one of the same types.

    Raises
    ------
    TypeError
        If it is nothing that can be written.
    SaveError
        If the file cannot be written.
    """
    arrays: dict[str, Any] = {}
    content = _written(value, arrays)
    save_arrays(path, _KIND, arrays, {"content": content})


def load_values(path: str | os.PathLike[str]) -> Any:
    """Return the result that a file holds, or raise the LoadError that says what is wrong with it."""
    arrays, metadata = load_arrays(path, _KIND)
    with refused_as_unreadable(path, _KIND):
        return _read(metadata["content"], arrays)


def _written(value: Any, arrays: dict[str, Any]) -> Any:
    """Return a value as JSON, in which arrays stand by their names; an object of JSON has one entry, its kind."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if type(value) is complex:
        return {"complex": [value.real, value.imag]}
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biufcU":
        name = f"array_{len(arrays)}"
        arrays[name] = np.asarray(value)
        return {"array" if isinstance(value, np.ndarray) else "scalar": name}
    if type(value) in (list, tuple):
        return {type(value).__name__: [_written(each, arrays) for each in value]}
    if isinstance(value, Mapping) and all(isinstance(name, str) for name in value):
        return {"mapping": {name: _written(each, arrays) for name, each in value.items()}}
    raise refused(TypeError, "a result of the task", value, ACCEPTED)


def _read(content: Any, arrays: Mapping[str, Any]) -> Any:
    if not isinstance(content, dict):
        return content
    ((kind, value),) = content.items()
    match kind:
        case "complex":
            return complex(*value)
        case "array":
            return arrays[value]
        case "scalar":
            return arrays[value][()]
        case "list" | "tuple":
            several = [_read(each, arrays) for each in value]
            return several if kind == "list" else tuple(several)
        case "mapping":
            return {name: _read(each, arrays) for name, each in value.items()}
    raise ValueError(f"it holds a {kind!r}, which no result is")
