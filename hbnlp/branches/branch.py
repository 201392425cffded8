"""A traced branch and its special points: data, summary, one portable file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.balance.sampling import MOST_HARMONICS
from hbnlp.branches.special_points import COLUMNS, ROWS, SpecialPoint, packed, unpacked
from hbnlp.core.checks import counted, place, real_number
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kinds import End, Kind
from hbnlp.core.layout import (
    Column,
    Layout,
    counted_from_one,
    name_in,
    number,
    numbers_by_name,
    pair,
    text,
    texts,
    whole,
)
from hbnlp.core.records import AlongParameter, check_parameters, content_of, loaded, save_columns
from hbnlp.core.types import Array, BoolArray, ComplexArray, IntArray
from hbnlp.fourier import n_coefficients
from hbnlp.solutions.attaching import attached, check_belongs, check_problem
from hbnlp.solutions.columns import HARMONICS, check_numbers, numbers_of_harmonics
from hbnlp.solutions.crossing import solution_between
from hbnlp.solutions.equations import along_parameter
from hbnlp.solutions.solution import Solution
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True, eq=False)
class Branch(AlongParameter, Tabular):
    """Points along a curve of periodic solutions, in order.

    Many methods: what a branch is asked for, most in one line.

    Attributes
    ----------
    name : str
        The continuation parameter.
    span : (float, float)
    parameter : array (n_points,)
        Its values.
    coefficients : array (n_points, n_dof, 2H+1)
        Ordered ``a_0, a_1 (cos), a_2 (sin), ...``; H is the largest number of harmonics, and zeros stand where a point
        has fewer.
    amplitudes : array (n_points, n_outputs, H+1), complex
        Harmonics of all outputs, likewise.
    n_harmonics : array (n_points,), int
        Number of harmonics of each point: one and the same, unless the problem has a tolerance.
    truncation_error : array (n_points,) or None
        Estimated error for want of harmonics, as the problem's tolerance bounds it; None without a tolerance.
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
        None for a branch loaded from a file without one.
    """

    name: str
    span: tuple[float, float]
    parameter: Array
    coefficients: Array
    amplitudes: ComplexArray
    n_harmonics: IntArray
    truncation_error: Array | None
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

    def solution(self, index: int) -> Solution:
        """Return one point as a Solution."""
        index = place("index", index, len(self))
        n_harmonics = int(self.n_harmonics[index])
        statistics = {"residual": float(self.residual[index]), "samples": int(self.n_samples[index])}
        if self.truncation_error is not None:
            statistics["truncation_error"] = float(self.truncation_error[index])
        return Solution(
            coefficients=self.coefficients[index, :, : n_coefficients(n_harmonics)],
            parameters={
                name: float(self.parameter[index]) if name == self.name else self.parameters[name]
                for name in self.parameter_names
            },
            amplitudes=self.amplitudes[index, :, : n_harmonics + 1],
            output_names=self.output_names,
            periods=self.periods,
            statistics=statistics,
            problem=None if self.problem is None else self.problem.carrying(n_harmonics),
        )

    def _turns_at(self, point: SpecialPoint) -> bool:
        """Return whether the parameter turns at a special point: a fold, or the pitchfork that a branch comes from."""
        if point.kind not in (Kind.FOLD, Kind.BRANCH_POINT) or not point.refined:
            return False
        before, after = self.parameter[point.index : point.index + 2] - point.value
        return bool(point.kind is Kind.FOLD or before * after > 0.0)

    @interrupts_kept()
    def at(self, value: float) -> tuple[Solution, ...]:
        """Return the solutions at which the branch passes a value of its parameter, in branch order.

        They are solved for between the points of the branch, also where two of them are about to meet in a fold.

        Parameters
        ----------
        value : float
            Of the continuation parameter. One that the branch does not reach has no solutions.

        Raises
        ------
        ValueError, TypeError
            If the branch came from a file, without its problem, or the value is no finite number.
        ConvergenceError
            If the branch cannot be followed between two of its points.
        """
        problem, value = attached(self), real_number("value", value)
        values = problem.values(self.parameters, but=(self.name,))
        # a branch may begin at rest, where nothing can be measured relative to the solution
        largest = float(np.linalg.norm(self.coefficients, axis=(1, 2)).max(initial=0.0))
        curve = along_parameter(problem, values, self.name, span=self.span, floor=1e-3 * largest or 1.0)
        points = [self.solution(i) for i in range(len(self))]
        if self.closed:
            points[-1] = points[0]  # the same but for round-off, and counted once
        for fold in reversed([point for point in self.special_points if self._turns_at(point)]):
            points.insert(fold.index + 1, fold.solution)
        ahead = [point.parameters[self.name] - value for point in points]
        found = []
        for i in range(len(points) - self.closed):
            if ahead[i] == 0.0:
                own = curve.on(problem.carrying(points[i].n_harmonics))
                found.append(own.solution(own.point(points[i].coefficients, value)))
            elif i + 1 < len(points) and ahead[i] * ahead[i + 1] < 0.0:
                found.append(solution_between(curve, points[i], points[i + 1], value))
        return tuple(found)

    def of_kind(self, kind: Kind | str) -> tuple[SpecialPoint, ...]:
        """Return the special points of one kind, in branch order.

        Parameters
        ----------
        kind : Kind or str
            Or its word ("fold") or code ("LP", "BP", "PD", "NS" or "TR", "HB" or "H", "UZ").

        Raises
        ------
        ValueError
            If there is no such kind.
        """
        wanted = Kind.of(kind)
        return tuple(point for point in self.special_points if point.kind is wanted)

    @property
    def folds(self) -> tuple[SpecialPoint, ...]:
        """The folds, in branch order."""
        return self.of_kind(Kind.FOLD)

    @property
    def branch_points(self) -> tuple[SpecialPoint, ...]:
        """The branch points, in branch order."""
        return self.of_kind(Kind.BRANCH_POINT)

    @property
    def complete(self) -> bool:
        """Whether the branch was traced to an end of the span, or closed; if not, ``message`` says why."""
        return self.end.complete

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
        save_columns(path, LAYOUT, *self.parts())

    def parts(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the columns and plain values by which it stands in a file, as `LAYOUT` says."""
        return content_of(self, LAYOUT, **self._parts())

    def _parts(self) -> dict[str, Any]:
        return {"end": self.end.name, **packed(self.special_points, self.coefficients.shape[1])}

    def _table(self) -> Table:
        return table_of(self, LAYOUT, coordinates={"parameter": self.name}, **self._parts())

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, problem: HarmonicBalance | None = None) -> Branch:
        """Return a branch from a file that `save` wrote, with its problem if that is given.

        Parameters
        ----------
        path : path-like
        problem : HarmonicBalance, optional
            The problem that the branch was traced with. Without one the branch can be read and drawn.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        LoadError
            (A `ValueError`.) If the file is damaged or holds something else.
        ValueError
            If the problem is not the branch's: the message says in what they differ.
        TypeError
            If ``problem`` is something else.
        """
        check_problem(problem)
        with loaded(path, LAYOUT) as content:
            branch = cls.of_parts(content, problem)
        branch.check_its_problem()
        return branch

    @classmethod
    def of_parts(cls, content: dict[str, Any], problem: HarmonicBalance | None) -> Branch:
        """Return the branch of columns and plain values that are as `LAYOUT` says.

        Raises
        ------
        ValueError
            If they are at odds.
        """
        check_parameters(content, content["name"], names=["omega", *content["parameter_names"]])
        if content["name"] not in content["parameter_names"]:
            raise ValueError(f"its name {content['name']!r} is none of its parameters")
        content["n_harmonics"] = numbers_of_harmonics(content["n_harmonics"], content["coefficients"])
        content["special_points"] = unpacked(content, problem)
        return cls(**content, problem=problem)

    def check_its_problem(self) -> None:
        """Raise a ValueError that says in what they differ unless its problem is that of its points."""
        problem = self.problem
        if problem is not None:
            check_numbers(problem, self.n_harmonics, what="branch")
            for index in {0, len(self) - 1} if len(self) else ():
                solution = self.solution(index)
                check_belongs(problem.carrying(solution.n_harmonics), solution, what="branch")

    def __repr__(self) -> str:
        extent = "no points"
        if len(self):
            first, last, low, high = self.parameter[0], self.parameter[-1], self.parameter.min(), self.parameter.max()
            extent = f"{self.name} from {first:.6g} to {last:.6g}, within [{low:.6g}, {high:.6g}]"
        counts = ", ".join(counted(len(self.of_kind(k)), k.value) for k in Kind if self.of_kind(k)) or "none"
        stability = "not computed"
        if self.stable is not None:
            stability = f"{np.count_nonzero(self.stable)} stable, {np.count_nonzero(~self.stable)} unstable points"
        most, fewest = int(self.n_harmonics.max(initial=0)), int(self.n_harmonics.min(initial=MOST_HARMONICS))
        harmonics = counted(most, "harmonic") if fewest >= most else f"{fewest} to {most} harmonics"
        return (
            f"Branch of {self.system_name!r}: {counted(len(self), 'point')}, {harmonics}\n"
            f"  {extent}\n"
            f"  special points: {counts}\n"
            f"  stability: {stability}\n"
            f"  end: {self.message}"
        )


LAYOUT = Layout(
    kind="branch",
    columns={
        "parameter": Column("points", about="continuation parameter"),
        **HARMONICS,
        "multipliers": Column(
            "points multipliers",
            complex,
            finite=False,
            optional=True,
            about="Floquet multipliers by decreasing modulus",
            units="1",
        ),
        "stable": Column("points", bool, optional=True, about="whether no multiplier is outside the unit circle"),
        "stability_error": Column(
            "points", finite=False, optional=True, about="estimated error of the multipliers", units="1"
        ),
        "stability_converged": Column(
            "points", bool, optional=True, about="whether the multipliers could be had to the tolerance"
        ),
        "arclength": Column("points", about="length in the continuation's metric", units="1"),
        "residual": Column("points", about="residual of the balance relative to its terms", units="1"),
        "iterations": Column("points", int, about="iterations of Newton's method", units="1"),
        "n_samples": Column("points", int, about="samples of the force a period", units="1"),
        **COLUMNS,
    },
    entries={
        "name": text,
        "span": pair(number),
        "end": name_in(End),
        "message": text,
        "parameters": numbers_by_name,
        "parameter_names": texts,
        "system_name": text,
        "output_names": texts,
        "periods": counted_from_one,
        "refused": whole,
        "special_points": ROWS,
    },
    lengths={"outputs": "output_names", "specials": "special_points"},
    working=frozenset({"special_breaks"}),
)
