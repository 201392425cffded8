"""Physical parameters: names with values, and the namespace through which a user's functions see them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from hbnlp.core.checks import unknown_name
from hbnlp.core.types import Array


class Namespace(Mapping[str, Any]):
    """Read-only names, as attributes or items: ``p.omega`` is ``p["omega"]``."""

    _kind: str
    _entries: dict[str, Any]

    def __init__(self, kind: str, entries: Mapping[str, Any]) -> None:
        object.__setattr__(self, "_kind", kind)
        object.__setattr__(self, "_entries", dict(entries))

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{self._kind} {name!r} cannot be set to {value!r} here; values are given with at={{...}}")

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self._entries[name]
        except KeyError:
            raise AttributeError(unknown_name(self._kind, name, self._entries)) from None

    def __getitem__(self, name: str) -> Any:
        try:
            return self._entries[name]
        except KeyError:
            raise KeyError(unknown_name(self._kind, name, self._entries)) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __repr__(self) -> str:
        return f"<{self._kind}s: {', '.join(self._entries)}>"


class ParameterSet:
    """Ordered parameter names with default values; a value of ``nan`` is "to be given"."""

    def __init__(self, defaults: Mapping[str, float]) -> None:
        entries = dict(defaults)
        entries.setdefault("omega", np.nan)
        for name, value in entries.items():
            if not name.isidentifier():
                raise ValueError(f"parameter name {name!r} is not a Python identifier; rename it")
            if not _is_number(value) or np.isinf(float(value)):
                raise ValueError(f"parameter {name!r} has the value {value!r}; a finite number is needed")
        self.names: tuple[str, ...] = tuple(entries)
        self.defaults = {name: float(value) for name, value in entries.items()}

    def index(self, name: str) -> int:
        """Return the position of ``name``, or raise a KeyError with the nearest known name."""
        try:
            return self.names.index(name)
        except ValueError:
            raise KeyError(unknown_name("parameter", name, self.names)) from None

    def values(self, at: Mapping[str, float] | None = None, *, but: Iterable[str] = ()) -> Array:
        """Return all values in order, the defaults overridden by ``at``.

        Parameters named in ``but`` may be without a value (they are about to be varied) and are then ``nan``.
        """
        merged = dict(self.defaults)
        for name, value in (at or {}).items():
            self.index(name)
            if not _is_number(value) or not np.isfinite(float(value)):
                raise ValueError(f"parameter {name!r} was given as {value!r}; a finite number is needed")
            merged[name] = float(value)
        free = set(but)
        for name in free:
            self.index(name)
        missing = [name for name, value in merged.items() if np.isnan(value) and name not in free]
        if missing:
            raise ValueError(
                f"parameter {missing[0]!r} has no value; give one, for instance at={{{missing[0]!r}: 1.0}}"
            )
        return np.array([merged[name] for name in self.names])

    def ordered(self, mapping: Mapping[str, float]) -> Array:
        """Return the values of a mapping that has every parameter, in order, whatever the order of the mapping.

        Raises
        ------
        KeyError
            For a name that is not known, or a parameter that is missing; it tells the nearest name.
        """
        for name in mapping:
            self.index(name)
        for name in self.names:
            if name not in mapping:
                raise KeyError(f"parameter {name!r} is missing (given: {', '.join(mapping) or 'none'})")
        return np.array([mapping[name] for name in self.names], dtype=float)

    def as_dict(self, values: Iterable[float]) -> dict[str, float]:
        """Return the values as a dictionary by name."""
        return {name: float(value) for name, value in zip(self.names, values, strict=True)}


def _is_number(value: Any) -> bool:
    try:
        float(value)
    except (TypeError, ValueError):
        return False
    return np.ndim(value) == 0
