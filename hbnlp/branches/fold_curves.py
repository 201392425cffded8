"""Curves of folds, or events, in two parameters with their cusps, isola births and merges: data, one portable file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.arclength import Stop
from hbnlp.core.checks import place
from hbnlp.core.kinds import FoldEvent
from hbnlp.core.layout import (
    Column,
    Layout,
    counted_from_one,
    maybe,
    name_in,
    number,
    numbers_by_name,
    pair,
    table,
    text,
    texts,
)
from hbnlp.core.records import loaded, save_record, values_of
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array, IntArray
from hbnlp.fourier import n_coefficients, resize
from hbnlp.solutions.attaching import attached, check_belongs, check_problem
from hbnlp.solutions.columns import HARMONICS, check_numbers, numbers_of_harmonics
from hbnlp.solutions.solution import Solution, make_solution
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LAYOUT = Layout(
    kind="fold curve",
    columns={
        "first": Column("points", about="continuation parameter of the folds"),
        "second": Column("points", about="second parameter"),
        **{name: column for name, column in HARMONICS.items() if name != "amplitudes"},
        "event_coefficients": Column("events dof 2H+1", numbers="event_n_harmonics", about="displacements at an event"),
        "event_n_harmonics": Column("events", int, optional=True, about="number of harmonics", units="1"),
    },
    entries={
        "names": pair(text),
        "ends": pair(text),
        "parameters": numbers_by_name,
        "output_names": texts,
        "periods": counted_from_one,
        "event": maybe(text),
        "events": table(kind=name_in(FoldEvent), first=number, second=number),
    },
    lengths={"events": "events"},
    defaults={
        "output_names": (),
        "periods": 1,
        "event": None,
    },  # earlier files do not say which, those of version 0.1 how many
)
FIRST_SPAN, SECOND_SPAN = "end of the first span", "end of the second span"
_COMPLETE = (FIRST_SPAN, SECOND_SPAN, Stop.CLOSED.value)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FoldCurvePoint:
    """A located event: ``first`` and ``second`` are the two parameters there."""

    kind: FoldEvent
    first: float
    second: float
    coefficients: Array = field(repr=False)

    @property
    def n_harmonics(self) -> int:
        """Number of harmonics of its motion."""
        return int(self.coefficients.shape[1]) // 2

    def __repr__(self) -> str:
        return f"{self.kind.value} at ({self.first:.8g}, {self.second:.8g})"


@dataclass(frozen=True, kw_only=True, eq=False)
class FoldBranch(ReadOnlyArrays, Tabular):
    """Folds, or one event of the user, in the plane of two parameters, in order along the curve.

    Attributes
    ----------
    names : (str, str)
        Continuation parameter of the folds, second parameter.
    first, second : array (n_points,)
    coefficients : array (n_points, n_dof, 2H+1)
        H is the largest number of harmonics, and zeros stand where a fold has fewer.
    n_harmonics : array (n_points,), int
        Number of harmonics of each fold: one and the same, unless the problem has a tolerance.
    truncation_error : array (n_points,) or None
        Estimated error for want of harmonics, of the place in the plane of the parameters and of the motions, these but
        for what is along the branch; None without a tolerance.
    events : tuple of FoldCurvePoint
        Cusps (two folds meet), isola births (a detached branch appears as a point) and merges (it joins another
        branch).
    ends : (str, str)
        Why the curve ends, on either side, and at how many folds there the most harmonics do not do.
    parameters : dict
        Values of the other parameters.
    output_names : tuple of str
        Those of the system; empty in a curve from a file that an earlier version wrote.
    periods : int
        Length of the motions in forcing periods.
    event : str or None
        The name of the event whose curve it is; None for folds.
    problem : HarmonicBalance or None
        None for a curve loaded from a file without one.
    """

    names: tuple[str, str]
    first: Array
    second: Array
    coefficients: Array
    n_harmonics: IntArray
    truncation_error: Array | None
    events: tuple[FoldCurvePoint, ...]
    ends: tuple[str, str]
    parameters: Mapping[str, float]
    output_names: tuple[str, ...] = ()
    periods: int = 1
    event: str | None = None
    problem: HarmonicBalance | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return int(self.first.size)

    @property
    def complete(self) -> bool:
        """Whether the curve was followed to the ends of the spans, or closed; if not, ``message`` says why."""
        return all(end.partition(";")[0] in _COMPLETE for end in self.ends)

    @property
    def message(self) -> str:
        """Why it ended, on either side."""
        return "; ".join(dict.fromkeys(self.ends))

    def values(self, name: str) -> Array:
        """Return the values (n_points,) of a parameter, one of the two or another."""
        return values_of(name, dict(zip(self.names, (self.first, self.second), strict=True)), self.parameters)

    def solution(self, index: int) -> Solution:
        """Return the motion at one fold.

        Raises
        ------
        ValueError
            If the curve came from a file without its problem, whose outputs are needed.
        """
        index = place("index", index, len(self.first))
        problem, motion = attached(self, "load the curve with problem=..."), self._motion(index)
        own = problem.carrying(motion.n_harmonics)
        return make_solution(own, motion.coefficients.ravel(), problem.values(motion.parameters))

    def _motion(self, index: int) -> Solution:
        """Return the motion at one fold with the names of its outputs alone."""
        own, other = self.names
        n_harmonics = int(self.n_harmonics[index])
        return Solution(
            coefficients=self.coefficients[index, :, : n_coefficients(n_harmonics)],
            parameters={**self.parameters, own: float(self.first[index]), other: float(self.second[index])},
            amplitudes=np.full((len(self.output_names), n_harmonics + 1), np.nan + 0j),
            output_names=self.output_names,
            periods=self.periods,
        )

    def of_kind(self, kind: FoldEvent | str) -> tuple[FoldCurvePoint, ...]:
        """Return the events of one kind, or of its word: "cusp", "isola birth", "isola merge".

        Raises
        ------
        ValueError
            If there is no such kind.
        """
        wanted = FoldEvent.of(kind)
        return tuple(event for event in self.events if event.kind is wanted)

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
        save_record(self, path, _LAYOUT, **_parts(self))

    def _table(self) -> Table:
        names = dict(zip(("first", "second"), self.names, strict=True))
        return table_of(self, _LAYOUT, coordinates=names, **_parts(self))

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, problem: HarmonicBalance | None = None) -> FoldBranch:
        """Return the curve from a file that `save` wrote, with its problem if that is given; see `Branch.load`."""
        check_problem(problem)
        with loaded(path, _LAYOUT) as content:
            content["n_harmonics"] = numbers_of_harmonics(content["n_harmonics"], content["coefficients"])
            coefficients, numbers = content.pop("event_coefficients"), content.pop("event_n_harmonics")
            if content["events"]:
                numbers = numbers_of_harmonics(numbers, coefficients)
            content["events"] = tuple(
                FoldCurvePoint(**event, coefficients=coefficients[i, :, : n_coefficients(numbers[i])])
                for i, event in enumerate(content["events"])
            )
            curve = cls(**content, problem=problem)
        if problem is not None:
            check_numbers(problem, curve.n_harmonics, what="curve")
            for motion in (curve._motion(index) for index in ({0, len(curve) - 1} if len(curve) else ())):
                check_belongs(problem.carrying(motion.n_harmonics), motion, what="curve")
        return curve

    def __repr__(self) -> str:
        def extent(values: Array) -> str:
            return f"[{values.min():.6g}, {values.max():.6g}]"

        events = ", ".join(map(repr, self.events)) or "none"
        points = "folds" if self.event is None else f"events {self.event!r}"
        return (
            f"FoldBranch: {len(self)} {points}, {self.names[0]} in {extent(self.first)}, {self.names[1]} in "
            f"{extent(self.second)}\n  events: {events}\n  ends: {self.ends[0]}; {self.ends[1]}"
        )


def _parts(curve: FoldBranch) -> dict[str, Any]:
    """Return what the file of a curve has that are not its attributes as they are."""
    events, most = curve.events, curve.coefficients.shape[2] // 2
    return {
        "event_coefficients": np.array([resize(e.coefficients, most) for e in events]) if events else None,
        "event_n_harmonics": np.array([e.n_harmonics for e in events], dtype=int),
        "events": [{"kind": e.kind.name, "first": e.first, "second": e.second} for e in events],
    }
