"""A traced branch and its special points: data, summary, one portable file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import counted, unknown_name
from hbnlp.core.kinds import End, Kind
from hbnlp.core.storage import load_arrays, save_arrays
from hbnlp.core.types import Array, BoolArray, ComplexArray, IntArray
from hbnlp.solutions.crossing import solution_between
from hbnlp.solutions.equations import ParameterCurve
from hbnlp.solutions.solution import Solution, make_solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_KIND = "branch"


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecialPoint:
    """A point where something happens, bracketed by two points of the branch and then solved for.

    Attributes
    ----------
    kind : Kind
    value : float
        The continuation parameter there.
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
        At a fold: derivative of its value by every other parameter, from the left null vector.
    """

    kind: Kind
    value: float
    bracket: tuple[float, float]
    index: int
    refined: bool
    solution: Solution = field(repr=False)
    null: Array | None = field(default=None, repr=False)
    multiplier: complex | None = None
    sensitivity: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        state = "" if self.refined else " (not refined)"
        return f"{self.kind.value} at {self.value:.12g}{state}, between {self.bracket[0]:.8g} and {self.bracket[1]:.8g}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Branch:
    """Points along a curve of periodic solutions, in order.

    Attributes
    ----------
    name : str
        The continuation parameter.
    span : (float, float)
    parameter : array (n_points,)
        Its values.
    coefficients : array (n_points, n_dof, 2H+1)
        Ordered ``a_0, a_1 (cos), a_2 (sin), ...``.
    amplitudes : array (n_points, n_outputs, H+1), complex
        Harmonics of all outputs.
    multipliers : array (n_points, n_state), complex, or None
        Floquet multipliers by decreasing modulus; None where stability was off.
    stable : array (n_points,), bool, or None
    stability_error : array (n_points,) or None
        Estimated error of the multipliers.
    stability_converged : array (n_points,), bool, or None
        False where the multipliers could not be had to the tolerance.
    arclength, residual : array (n_points,)
        Length in the continuation's metric; residual relative to its terms.
    iterations, n_samples : array (n_points,), int
    special_points : tuple of SpecialPoint
    end : End
    message : str
    parameters : dict
        Values of all other parameters.
    system_name, output_names, periods
        What was traced.
    refused : int
        Steps that were refused and retried.
    problem : HarmonicBalance or None
        None for a branch loaded from a file.
    """

    name: str
    span: tuple[float, float]
    parameter: Array
    coefficients: Array
    amplitudes: ComplexArray
    multipliers: ComplexArray | None
    stable: BoolArray | None
    stability_error: Array | None
    stability_converged: BoolArray | None
    arclength: Array
    residual: Array
    iterations: IntArray
    n_samples: IntArray
    special_points: tuple[SpecialPoint, ...]
    end: End
    message: str
    parameters: Mapping[str, float]
    parameter_names: tuple[str, ...]
    system_name: str
    output_names: tuple[str, ...]
    periods: int
    refused: int
    problem: HarmonicBalance | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return int(self.parameter.size)

    @property
    def n_harmonics(self) -> int:
        """Number of harmonics H."""
        return int(self.coefficients.shape[2] - 1) // 2

    def harmonics(self, output: str) -> ComplexArray:
        """Return the complex amplitudes (n_points, H+1) of a named output: ``a_0`` and ``a_{2h-1} - i a_{2h}``."""
        if output not in self.output_names:
            raise KeyError(unknown_name("output", output, self.output_names))
        return self.amplitudes[:, self.output_names.index(output)]

    def values(self, index: int) -> dict[str, float]:
        """Return the values of all parameters at a point, in the system's order."""
        return {n: float(self.parameter[index]) if n == self.name else self.parameters[n] for n in self.parameter_names}

    def solution(self, index: int) -> Solution:
        """Return one point as a Solution."""
        return Solution(
            coefficients=self.coefficients[index],
            parameters=self.values(index),
            amplitudes=self.amplitudes[index],
            output_names=self.output_names,
            periods=self.periods,
            statistics={"residual": float(self.residual[index]), "samples": int(self.n_samples[index])},
            problem=self.problem,
        )

    def at(self, value: float) -> tuple[Solution, ...]:
        """Return the solutions at which the branch passes a value of its parameter, in branch order.

        They are solved for between the points of the branch, also where two of them are about to meet in a fold.

        Parameters
        ----------
        value : float
            Of the continuation parameter. One that the branch does not reach has no solutions.

        Raises
        ------
        ValueError
            If the branch came from a file, without its problem.
        ConvergenceError
            If the branch cannot be followed between two of its points.
        """
        if self.problem is None:
            raise ValueError("a branch from a file has no problem to be solved with; trace or resume it with its own")
        values = np.array([self.parameters.get(name, np.nan) for name in self.parameter_names])
        curve = ParameterCurve(self.problem, values, self.name, 0.01 * abs(self.span[1] - self.span[0]))
        curve.solution_floor = max(1e-3 * self._largest, curve.solution_floor)
        points = np.column_stack([self.coefficients.reshape(len(self), -1), self.parameter])
        turns = [fold for fold in self.folds if fold.refined]
        turning = [np.append(fold.solution.coefficients.ravel(), fold.value) for fold in turns]
        points = np.insert(points, [fold.index + 1 for fold in turns], turning, axis=0) if turns else points
        if self.closed:
            points[-1] = points[0]  # the same but for round-off, and counted once
        ahead = points[:, -1] - value
        found = []
        for i in range(len(points) - self.closed):
            if ahead[i] == 0.0:
                found.append(make_solution(self.problem, points[i, :-1], curve.values(points[i])))
            elif i + 1 < len(points) and ahead[i] * ahead[i + 1] < 0.0:
                found.append(solution_between(curve, points[i], points[i + 1], float(value)))
        return tuple(found)

    @property
    def _largest(self) -> float:
        """Size of the largest solution: a branch may begin at rest, where nothing can be measured relative to it."""
        return float(np.linalg.norm(self.coefficients, axis=(1, 2)).max(initial=0.0))

    def of_kind(self, kind: Kind) -> tuple[SpecialPoint, ...]:
        """Return the special points of one kind, in branch order."""
        return tuple(point for point in self.special_points if point.kind is kind)

    @property
    def folds(self) -> tuple[SpecialPoint, ...]:
        """The folds, in branch order."""
        return self.of_kind(Kind.FOLD)

    @property
    def branch_points(self) -> tuple[SpecialPoint, ...]:
        """The branch points, in branch order."""
        return self.of_kind(Kind.BRANCH_POINT)

    @property
    def closed(self) -> bool:
        """Whether the branch is a loop (an isola)."""
        return self.end is End.CLOSED

    def plot(self, output: str, *, ax: Axes | None = None, harmonic: int = 1, **options: Any) -> Axes:
        """Draw the amplitude of one harmonic of an output against the parameter; see `hbnlp.plot.plot_branch`."""
        from hbnlp.plot import plot_branch

        return plot_branch(self, output, ax=ax, harmonic=harmonic, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the branch to one ``.npz`` file without pickle, whole or not at all.

        Raises
        ------
        SaveError
            If it cannot be written; the branch in memory and an older file are as they were.
        """
        arrays = {name: getattr(self, name) for name in _COLUMNS if getattr(self, name) is not None}
        points = self.special_points
        if points:
            arrays["special_coefficients"] = np.array([p.solution.coefficients for p in points])
            arrays["special_amplitudes"] = np.array([p.solution.amplitudes for p in points])
            absent = np.full(self.coefficients.shape[1:], np.nan)
            arrays["special_null"] = np.array([absent if p.null is None else p.null for p in points])
        metadata = {name: getattr(self, name) for name in _METADATA}
        metadata["parameters"] = dict(self.parameters)
        metadata["end"] = self.end.name
        metadata["special_points"] = [_special_metadata(p) for p in points]
        save_arrays(path, _KIND, arrays, metadata)

    def __repr__(self) -> str:
        extent = "no points"
        if len(self):
            first, last, low, high = self.parameter[0], self.parameter[-1], self.parameter.min(), self.parameter.max()
            extent = f"{self.name} from {first:.6g} to {last:.6g}, within [{low:.6g}, {high:.6g}]"
        counts = ", ".join(counted(len(self.of_kind(k)), k.value) for k in Kind if self.of_kind(k)) or "none"
        stability = "not computed"
        if self.stable is not None:
            stability = f"{np.count_nonzero(self.stable)} stable, {np.count_nonzero(~self.stable)} unstable points"
        return (
            f"Branch of {self.system_name!r}: {counted(len(self), 'point')}, {counted(self.n_harmonics, 'harmonic')}\n"
            f"  {extent}\n"
            f"  special points: {counts}\n"
            f"  stability: {stability}\n"
            f"  end: {self.message}"
        )


_COLUMNS = (
    "parameter",
    "coefficients",
    "amplitudes",
    "multipliers",
    "stable",
    "stability_error",
    "stability_converged",
    "arclength",
    "residual",
    "iterations",
    "n_samples",
)
_METADATA = ("name", "span", "message", "parameter_names", "system_name", "output_names", "periods", "refused")


def load_branch(path: str | os.PathLike[str]) -> Branch:
    """Return a branch from a file that `Branch.save` wrote; no system is needed.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is damaged or holds something else.
    """
    arrays, metadata = load_arrays(path, _KIND)
    columns: dict[str, Any] = {name: arrays.get(name) for name in _COLUMNS}
    fields: dict[str, Any] = {name: tuple(v) if isinstance(v := metadata[name], list) else v for name in _METADATA}
    shared: dict[str, Any] = {"output_names": fields["output_names"], "periods": fields["periods"]}
    points = []
    for i, entry in enumerate(metadata["special_points"]):
        null = arrays["special_null"][i]
        solution = Solution(
            coefficients=arrays["special_coefficients"][i],
            amplitudes=arrays["special_amplitudes"][i],
            parameters=entry["parameters"],
            statistics=entry["statistics"],
            **shared,
        )
        points.append(
            SpecialPoint(
                kind=Kind[entry["kind"]],
                value=entry["value"],
                bracket=(entry["bracket"][0], entry["bracket"][1]),
                index=entry["index"],
                refined=entry["refined"],
                solution=solution,
                null=None if np.all(np.isnan(null)) else null,
                multiplier=None if entry["multiplier"] is None else complex(*entry["multiplier"]),
                sensitivity=entry["sensitivity"],
            )
        )
    return Branch(
        **columns,
        **fields,
        parameters=metadata["parameters"],
        end=End[metadata["end"]],
        special_points=tuple(points),
    )


def _special_metadata(point: SpecialPoint) -> dict[str, Any]:
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
    }
