"""The points of a trace as they come, after those of the branch that it resumes, and the Branch that they make."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.point import Point
from hbnlp.core.kinds import End, Kind
from hbnlp.core.types import Array
from hbnlp.fourier import n_coefficients, of_equal_length
from hbnlp.solutions.columns import not_met
from hbnlp.solutions.equations import Equations
from hbnlp.stability.result import FloquetResult


@dataclass(frozen=True, kw_only=True)
class Traced:
    """One point of a trace: the point and its equations, its stability, and what lies between it and the one before."""

    point: Point
    curve: Equations
    floquet: FloquetResult | None
    special_points: tuple[SpecialPoint, ...]
    truncation_error: float | None = None

    @property
    def n_samples(self) -> int:
        """Samples of the force."""
        return self.curve.problem.n_samples


class Collection:
    """The points of a trace so far.

    Parameters
    ----------
    curve : Equations
        That of the first point.
    resumed : Branch or None
        The branch whose points come first.

    Attributes
    ----------
    curve : Equations
        That of the last point: it has what all points share.
    records : list of Traced
    n_folds : int
        Folds so far, those resumed from included.
    """

    def __init__(self, curve: Equations, resumed: Branch | None) -> None:
        self.curve, self.records = curve, list[Traced]()
        self.n_folds = len(resumed.folds) if resumed is not None else 0
        self._resumed = resumed
        self._moved: Traced | None = None  # in the place of the last point of the branch that is resumed

    def __len__(self) -> int:
        return len(self.records) + (len(self._resumed) if self._resumed is not None else 0)

    def add(self, record: Traced) -> None:
        """Take the next point."""
        if self.records:
            self.records[-1] = _slim(self.records[-1])
        self.records.append(record)
        self.curve = record.curve
        self.n_folds += _n_folds(record)

    def drop(self) -> None:
        """Forget the last point: the step to it is made again."""
        self.n_folds -= _n_folds(self.records.pop())

    def correct(self, record: Traced) -> None:
        """Put a point in the place of the last one: it was found anew, with more samples or other harmonics."""
        if self.records:
            self.records[-1] = dataclasses.replace(record, special_points=self.records[-1].special_points)
        else:
            self._moved = record

    def branch(self, span: tuple[float, float], *, end: End, message: str, refused: int) -> Branch:
        """Return the branch of all points."""
        problem, name, resumed = self.curve.problem, self.curve.name, self._resumed
        columns = _columns([self._moved, *self.records] if self._moved is not None else self.records, problem)
        points = tuple(special for record in self.records for special in record.special_points)
        if resumed is not None and not self.records:
            columns, points, refused = (
                {key: getattr(resumed, key) for key in columns},
                resumed.special_points,
                resumed.refused,
            )
        elif resumed is not None:
            shift = float(resumed.arclength[-1])
            columns["arclength"] = columns["arclength"] + shift
            kept = len(resumed) - (self._moved is not None)
            for key, column in columns.items():
                old = getattr(resumed, key)
                columns[key] = None if old is None or column is None else _joined(old[:kept], column)
            points = resumed.special_points + points
            refused += resumed.refused
        return Branch(
            **columns,
            name=name,
            span=span,
            special_points=tuple(_bracketed(point, columns["parameter"]) for point in points),
            end=end,
            message=message + not_met(columns["truncation_error"], problem),
            parameters={key: value for key, value in self.curve.fixed_parameters().items() if key != name},
            parameter_names=problem.system.parameters.names,
            system_name=problem.system.name,
            output_names=problem.system.output_names,
            periods=problem.periods,
            refused=refused,
            problem=problem if problem.truncation is None else problem.with_harmonics(problem.truncation.first),
        )


def _n_folds(record: Traced) -> int:
    return sum(found.kind is Kind.FOLD for found in record.special_points)


def _slim(record: Traced) -> Traced:
    """Return a record without the factors at its point, which take far more memory than all else that is kept."""
    return dataclasses.replace(record, point=dataclasses.replace(record.point, factors=None))


def _joined(old: Array, new: Array) -> Array:
    """Return the rows of one column after those of another."""
    return np.concatenate(of_equal_length(old, new) if old.ndim > 1 else [old, new])


def _bracketed(point: SpecialPoint, parameter: Array) -> SpecialPoint:
    """Return a special point between the points of the branch as they are in the end."""
    bracket = float(parameter[point.index]), float(parameter[point.index + 1])
    return point if point.bracket == bracket else dataclasses.replace(point, bracket=bracket)


def _columns(records: list[Traced], problem: HarmonicBalance) -> dict[str, Any]:
    numbers = np.array([record.curve.problem.n_harmonics for record in records], dtype=int)
    most = int(numbers.max(initial=1))
    n, n_outputs = problem.system.n_dof, len(problem.system.output_names)
    coefficients = np.zeros((len(records), n, n_coefficients(most)))
    amplitudes = np.zeros((len(records), n_outputs, most + 1), dtype=complex)
    values = np.array([record.curve.values(record.point.y) for record in records])
    for number in np.unique(numbers):
        rows = np.flatnonzero(numbers == number)
        own = records[int(rows[-1])].curve.problem
        x = np.array([one.curve.unknowns.coefficients(one.point.y) for one in (records[int(row)] for row in rows)])
        coefficients[rows, :, : n_coefficients(number)] = x.reshape(-1, *own.shape)
        amplitudes[rows, :, : number + 1] = own.output_harmonics(x, values[rows])
    results = [record.floquet for record in records if record.floquet is not None]
    errors = [record.truncation_error for record in records if record.truncation_error is not None]
    complete = bool(results) and len(results) == len(records)
    return {
        "parameter": np.array([record.point.value for record in records]),
        "coefficients": coefficients,
        "amplitudes": amplitudes,
        "n_harmonics": numbers,
        "truncation_error": np.array(errors) if errors and len(errors) == len(records) else None,
        "multipliers": np.array([r.multipliers for r in results]) if complete else None,
        "stable": np.array([r.stable for r in results]) if complete else None,
        "stability_error": np.array([r.error for r in results]) if complete else None,
        "stability_converged": np.array([r.converged for r in results]) if complete else None,
        "arclength": np.array([record.point.arclength for record in records]),
        "residual": np.array([record.point.residual for record in records]),
        "iterations": np.array([record.point.iterations for record in records], dtype=int),
        "n_samples": np.array([record.n_samples for record in records], dtype=int),
    }
