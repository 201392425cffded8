"""A special point of a branch: a fold, a branch point, a bifurcation of its motions, a peak, an event of the user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.kinds import Kind
from hbnlp.core.layout import (
    Column,
    complex_number,
    flag,
    mapping,
    maybe,
    name_in,
    number,
    numbers_by_name,
    pair,
    table,
    text,
    whole,
)
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array
from hbnlp.fourier import n_coefficients, padded, resize
from hbnlp.solutions.events import Event
from hbnlp.solutions.solution import Solution
from hbnlp.systems.symmetry import Symmetry


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecialPoint(ReadOnlyArrays):
    """A point where something happens, bracketed by two points of the branch and then solved for.

    Attributes
    ----------
    kind : Kind
    name : str
        The continuation parameter.
    value : float
        Its value there.
    bracket : (float, float)
        Its values at the two points of the branch between which the special point lies.
    index : int
        Number of the branch's point before it.
    refined : bool
        Whether it was solved for; if not, value and solution are those of the branch's point after it.
    solution : Solution
    null : array (n_dof, 2H+1) or None
        Null vector of the Jacobian at a fold; second tangent direction at a branch point; None at the others.
    multiplier : complex or None
        The critical Floquet multiplier, where stability was computed. At a fold or branch point it belongs to the null
        vector of the balance, and is +1 but for the harmonics that are left out: far from it, the point is one of the
        truncated equations alone.
    sensitivity : dict
        At a fold or an event: derivative of its value by every other parameter.
    truncation_error : float or None
        By how much it moved when it was solved for with more harmonics, relative to its size; of a peak the estimated
        error of its motion, normal to the branch. None where their number was given.
    converged : bool or None
        Whether that is within the tolerance; False where the most harmonics do not do, None where their number was
        given.
    breaks : Symmetry or None
        At a branch point: the symmetry of the motion that the other branch loses, a pitchfork. None where it loses
        none, a plain crossing, and at all other points. Over several forcing periods it may be the shift by one.
    event : Event or None
        At an event: its name, and the function that vanishes there; in a branch from a file the name alone.
    """

    kind: Kind
    name: str
    value: float
    bracket: tuple[float, float]
    index: int
    refined: bool
    solution: Solution = field(repr=False)
    null: Array | None = field(default=None, repr=False)
    multiplier: complex | None = None
    sensitivity: Mapping[str, float] = field(default_factory=dict)
    truncation_error: float | None = None
    converged: bool | None = None
    breaks: Symmetry | None = None
    event: Event | None = None

    @property
    def n_harmonics(self) -> int:
        """Number of harmonics of its solution."""
        return self.solution.n_harmonics

    @property
    def problem(self) -> HarmonicBalance | None:
        """The problem that it is of; None in a branch loaded from a file without one."""
        return self.solution.problem

    def __repr__(self) -> str:
        state = "" if self.refined else " (not refined)"
        state += " (not converged in harmonics)" if self.converged is False else ""
        state += f", breaks {self.breaks.name!r}" if self.breaks is not None else ""
        name = f" {self.event.name!r}" if self.event is not None else ""
        low, high = self.bracket
        return f"{self.kind.value}{name} at {self.value:.12g}{state}, between {low:.8g} and {high:.8g}"


COLUMNS = {
    "special_coefficients": Column(
        "specials dof 2S+1", numbers="special_n_harmonics", about="displacements at a special point"
    ),
    "special_amplitudes": Column(
        "specials outputs S+1", complex, numbers="special_n_harmonics", about="outputs at a special point"
    ),
    "special_null": Column(
        "specials dof 2S+1",
        finite=False,  # nan where there is none
        numbers="special_n_harmonics",
        about="null vector of the balance's Jacobian",
    ),
    "special_n_harmonics": Column("specials", int, optional=True, about="number of harmonics", units="1"),
    "special_breaks": Column("specials dof dof", finite=False, optional=True),
}
ROWS = table(
    {
        "breaks": None,
        "truncation_error": None,
        "converged": None,
        "event": None,
    },  # files from before there were such things
    kind=name_in(Kind),
    value=number,
    bracket=pair(number),
    index=whole,
    refined=flag,
    parameters=numbers_by_name,
    statistics=mapping,
    multiplier=maybe(complex_number),
    sensitivity=numbers_by_name,
    truncation_error=maybe(number),
    converged=maybe(flag),
    breaks=maybe(mapping),
    event=maybe(text),
)


def packed(points: Sequence[SpecialPoint], n_dof: int) -> dict[str, Any]:
    """Return `COLUMNS` and rows of special points of a system; harmonics that one does not have are zero."""
    content: dict[str, Any] = {"special_points": [_row(p) for p in points], **dict.fromkeys(COLUMNS)}
    if points:
        numbers = [p.n_harmonics for p in points]
        most = max(numbers)
        content["special_n_harmonics"] = np.array(numbers)
        content["special_coefficients"] = np.array([resize(p.solution.coefficients, most) for p in points])
        content["special_amplitudes"] = np.array([padded(p.solution.amplitudes, most) for p in points])
        absent = np.full((n_dof, n_coefficients(most)), np.nan)
        content["special_null"] = np.array([absent if p.null is None else resize(p.null, most) for p in points])
    if any(p.breaks is not None for p in points):
        none = np.full((n_dof, n_dof), np.nan)
        content["special_breaks"] = np.array([none if p.breaks is None else p.breaks.matrix for p in points])
    return content


def unpacked(content: dict[str, Any], problem: HarmonicBalance | None) -> tuple[SpecialPoint, ...]:
    """Take what `packed` made out of the content of a branch's file, and return the special points."""
    coefficients, amplitudes, nulls, numbers, breaks = (content.pop(name) for name in COLUMNS)
    points = []
    for i, row in enumerate(content["special_points"]):
        if row["index"] >= len(content["parameter"]):
            raise ValueError(f"special point {i} lies after point {row['index']} of {len(content['parameter'])}")
        if (row["kind"] is Kind.EVENT) is (row["event"] is None):
            raise ValueError(f"special point {i} is a {row['kind'].value}, and its event {row['event']!r}")
        n_harmonics = coefficients.shape[2] // 2 if numbers is None else int(numbers[i])
        own = slice(n_coefficients(n_harmonics))
        solution = Solution(
            coefficients=coefficients[i, :, own],
            amplitudes=amplitudes[i, :, : n_harmonics + 1],
            parameters=row["parameters"],
            statistics=row["statistics"],
            output_names=content["output_names"],
            periods=content["periods"],
            problem=None if problem is None else problem.carrying(n_harmonics),
        )
        broken = row["breaks"]
        points.append(
            SpecialPoint(
                kind=row["kind"],
                name=content["name"],
                value=row["value"],
                bracket=row["bracket"],
                index=row["index"],
                refined=row["refined"],
                solution=solution,
                null=None if np.all(np.isnan(nulls[i])) else nulls[i, :, own],
                multiplier=row["multiplier"],
                sensitivity=row["sensitivity"],
                truncation_error=row["truncation_error"],
                converged=row["converged"],
                breaks=None if broken is None else Symmetry(breaks[i], shift=broken["shift"], name=broken["name"]),
                event=None if row["event"] is None else Event(row["event"]),
            )
        )
    return tuple(points)


def _row(point: SpecialPoint) -> dict[str, Any]:
    return {
        "kind": point.kind.name,
        "value": point.value,
        "bracket": list(point.bracket),
        "index": point.index,
        "refined": point.refined,
        "parameters": dict(point.solution.parameters),
        "statistics": dict(point.solution.statistics),
        "multiplier": None if point.multiplier is None else [point.multiplier.real, point.multiplier.imag],
        "sensitivity": dict(point.sensitivity),
        "truncation_error": point.truncation_error,
        "converged": point.converged,
        "breaks": None if point.breaks is None else {"name": point.breaks.name, "shift": point.breaks.shift},
        "event": None if point.event is None else point.event.name,
    }
