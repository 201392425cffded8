"""Curves of folds in two parameters with their cusps, isola births and merges: data, summary, one portable file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.core.kinds import FoldEvent
from hbnlp.core.storage import load_arrays, save_arrays
from hbnlp.core.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_KIND = "fold curve"


@dataclass(frozen=True, kw_only=True, eq=False)
class FoldCurvePoint:
    """A located event: ``first`` and ``second`` are the two parameters there."""

    kind: FoldEvent
    first: float
    second: float
    coefficients: Array = field(repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class FoldBranch:
    """Folds in the plane of two parameters, in order along the curve.

    Attributes
    ----------
    names : (str, str)
        Continuation parameter of the folds, second parameter.
    first, second : array (n_points,)
    coefficients : array (n_points, n_dof, 2H+1)
    events : tuple of FoldCurvePoint
        Cusps (two folds meet), isola births (a detached branch appears as a point) and merges (it joins another
        branch).
    ends : (str, str)
        Why the curve ends, on either side.
    parameters : dict
        Values of the other parameters.
    """

    names: tuple[str, str]
    first: Array
    second: Array
    coefficients: Array
    events: tuple[FoldCurvePoint, ...]
    ends: tuple[str, str]
    parameters: Mapping[str, float]

    def __len__(self) -> int:
        return int(self.first.size)

    def of_kind(self, kind: FoldEvent) -> tuple[FoldCurvePoint, ...]:
        """Return the events of one kind."""
        return tuple(event for event in self.events if event.kind is kind)

    @property
    def cusps(self) -> tuple[FoldCurvePoint, ...]:
        """The cusps."""
        return self.of_kind(FoldEvent.CUSP)

    @property
    def isola_births(self) -> tuple[FoldCurvePoint, ...]:
        """Where a detached branch appears."""
        return self.of_kind(FoldEvent.ISOLA_BIRTH)

    @property
    def isola_merges(self) -> tuple[FoldCurvePoint, ...]:
        """Where a detached branch joins another one."""
        return self.of_kind(FoldEvent.ISOLA_MERGE)

    def plot(self, *, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the curve and its events in the plane of the two parameters; see `hbnlp.plot.plot_fold_curve`."""
        from hbnlp.plot import plot_fold_curve

        return plot_fold_curve(self, ax=ax, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the curve to one ``.npz`` file without pickle, whole or not at all."""
        arrays = {"first": self.first, "second": self.second, "coefficients": self.coefficients}
        if self.events:
            arrays["event_coefficients"] = np.array([event.coefficients for event in self.events])
        events = [{"kind": e.kind.name, "first": e.first, "second": e.second} for e in self.events]
        metadata = {"names": self.names, "ends": self.ends, "parameters": dict(self.parameters), "events": events}
        save_arrays(path, _KIND, arrays, metadata)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> FoldBranch:
        """Return the curve from a file that `save` wrote."""
        arrays, metadata = load_arrays(path, _KIND)
        events = tuple(
            FoldCurvePoint(
                kind=FoldEvent[e["kind"]],
                first=e["first"],
                second=e["second"],
                coefficients=arrays["event_coefficients"][i],
            )
            for i, e in enumerate(metadata["events"])
        )
        return cls(
            names=tuple(metadata["names"]),
            first=arrays["first"],
            second=arrays["second"],
            coefficients=arrays["coefficients"],
            events=events,
            ends=tuple(metadata["ends"]),
            parameters=metadata["parameters"],
        )

    def __repr__(self) -> str:
        def extent(values: Array) -> str:
            return f"[{values.min():.6g}, {values.max():.6g}]"

        events = ", ".join(f"{e.kind.value} at ({e.first:.8g}, {e.second:.8g})" for e in self.events) or "none"
        return (
            f"FoldBranch: {len(self)} folds, {self.names[0]} in {extent(self.first)}, {self.names[1]} in "
            f"{extent(self.second)}\n  events: {events}\n  ends: {self.ends[0]}; {self.ends[1]}"
        )
