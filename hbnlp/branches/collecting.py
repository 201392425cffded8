"""From the points of a trace to a Branch, after those of the branch it resumed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbnlp.branches.branch import Branch
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.continuation.point import Point
from hbnlp.core.kinds import End
from hbnlp.core.types import Array
from hbnlp.solutions.equations import Equations
from hbnlp.stability.result import FloquetResult


@dataclass(frozen=True, kw_only=True)
class Traced:
    """One point of a trace: the point and its equations, its stability, and what lies between it and the one before."""

    point: Point
    curve: Equations
    floquet: FloquetResult | None
    special_points: tuple[SpecialPoint, ...]

    @property
    def n_samples(self) -> int:
        """Samples of the force."""
        return self.curve.problem.n_samples


def make_branch(
    records: Sequence[Traced],
    curve: Equations,
    span: tuple[float, float],
    *,
    end: End,
    message: str,
    refused: int,
    resumed: Branch | None,
    moved: Traced | None = None,
) -> Branch:
    """Return the branch of all records, those of ``resumed`` first; ``curve`` has what all of them share.

    ``moved`` takes the place of the last point of ``resumed``, where that was found anew with more samples.
    """
    problem, name = curve.problem, curve.name
    columns = _columns([moved, *records] if moved is not None else records, curve)
    points = tuple(special for record in records for special in record.special_points)
    if resumed is not None and not records:
        columns, points, refused = (
            {key: getattr(resumed, key) for key in columns},
            resumed.special_points,
            resumed.refused,
        )
    elif resumed is not None:
        shift = float(resumed.arclength[-1])
        columns["arclength"] = columns["arclength"] + shift
        kept = len(resumed) - (moved is not None)
        for key, column in columns.items():
            old = getattr(resumed, key)
            columns[key] = None if old is None or column is None else np.concatenate([old[:kept], column])
        points = resumed.special_points + points
        refused += resumed.refused
    return Branch(
        **columns,
        name=name,
        span=span,
        special_points=tuple(_bracketed(point, columns["parameter"]) for point in points),
        end=end,
        message=message,
        parameters={key: value for key, value in curve.fixed_parameters().items() if key != name},
        parameter_names=problem.system.parameters.names,
        system_name=problem.system.name,
        output_names=problem.system.output_names,
        periods=problem.periods,
        refused=refused,
        problem=problem,
    )


def _bracketed(point: SpecialPoint, parameter: Array) -> SpecialPoint:
    """Return a special point between the points of the branch as they are in the end."""
    bracket = float(parameter[point.index]), float(parameter[point.index + 1])
    return point if point.bracket == bracket else dataclasses.replace(point, bracket=bracket)


def _columns(records: Sequence[Traced], curve: Equations) -> dict[str, Any]:
    problem = curve.problem
    coefficients = np.array([record.curve.coefficients(record.point.y) for record in records])
    coefficients = coefficients.reshape(-1, *problem.shape)
    values = np.array([record.curve.values(record.point.y) for record in records])
    n_outputs = len(problem.system.output_names)
    empty = np.zeros((0, n_outputs, problem.n_harmonics + 1), dtype=complex)
    unknowns = coefficients.reshape(-1, problem.size)
    results = [record.floquet for record in records if record.floquet is not None]
    complete = bool(results) and len(results) == len(records)
    return {
        "parameter": np.array([record.point.value for record in records]),
        "coefficients": coefficients,
        "amplitudes": problem.output_harmonics(unknowns, values) if len(records) else empty,
        "multipliers": np.array([r.multipliers for r in results]) if complete else None,
        "stable": np.array([r.stable for r in results]) if complete else None,
        "stability_error": np.array([r.error for r in results]) if complete else None,
        "stability_converged": np.array([r.converged for r in results]) if complete else None,
        "arclength": np.array([record.point.arclength for record in records]),
        "residual": np.array([record.point.residual for record in records]),
        "iterations": np.array([record.point.iterations for record in records], dtype=int),
        "n_samples": np.array([record.n_samples for record in records], dtype=int),
    }
