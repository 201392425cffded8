"""The points of a study: a grid of values by their names, or a list."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbnlp.core.checks import instance_of, refused

Value = float | int | bool | str
Over = Mapping[str, Sequence[Value]] | Sequence[Mapping[str, Value]]

_ACCEPTED = "finite numbers, texts, True or False"


@dataclass(frozen=True)
class Points:
    """Where a study does its task.

    Attributes
    ----------
    grid : dict of names to tuples of values, or None
        The values along each direction; None of a list of points.
    all : tuple of dict
        Value by name at each point; in a grid the last name varies fastest.
    """

    grid: dict[str, tuple[Value, ...]] | None
    all: tuple[dict[str, Value], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The names that vary."""
        return tuple(self.all[0])

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each direction."""
        return (len(self.all),) if self.grid is None else tuple(map(len, self.grid.values()))

    @classmethod
    def of(cls, over: Any) -> Points:
        """Return the points of what a user gave, or raise an error that says what to give."""
        accepted = (
            'values by name for a grid, {"damping_ratio": [0.01, 0.02], "force": [0.1, 0.2]}, or a list of points, '
            '[{"damping_ratio": 0.01, "force": 0.1}, ...]'
        )
        instance_of("over", over, Mapping | Sequence, accepted)
        if isinstance(over, str) or not len(over):
            raise refused(ValueError, "over", over, accepted)
        if isinstance(over, Mapping):
            grid = {_name(name): _values(name, values) for name, values in over.items()}
            return cls(grid, tuple(dict(zip(grid, point, strict=True)) for point in itertools.product(*grid.values())))
        points = []
        for i, point in enumerate(over):
            instance_of(f"over[{i}]", point, Mapping, accepted)
            if not point or point.keys() != over[0].keys():
                raise refused(ValueError, f"over[{i}]", point, f"a value for each of {', '.join(over[0]) or 'a name'}")
            points.append({_name(name): _value(f"over[{i}][{name!r}]", point[name]) for name in over[0]})
        return cls(None, tuple(points))


def _name(name: Any) -> str:
    instance_of("a name in over", name, str, "a text")
    return str(name)


def _values(name: str, values: Any) -> tuple[Value, ...]:
    """Return the values along a direction of the grid, no two of them equal."""
    what = f"over[{name!r}]"
    if isinstance(values, np.ndarray) and values.ndim == 1:
        values = values.tolist()
    if not isinstance(values, Sequence) or isinstance(values, str) or not values:
        raise refused(ValueError, what, values, f"a list of {_ACCEPTED}, at least one")
    found = tuple(_value(f"{what}[{i}]", value) for i, value in enumerate(values))
    if len({*found}) < len(found):
        raise refused(ValueError, what, values, "each value once")
    return found


def _value(what: str, value: Any) -> Value:
    if isinstance(value, np.generic):
        value = value.item()
    if not isinstance(value, float | int | str) or (isinstance(value, float) and not math.isfinite(value)):
        raise refused(ValueError, what, value, _ACCEPTED)
    return value
