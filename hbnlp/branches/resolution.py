"""As many harmonics along a branch as each of its points needs."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.balance.sampling import MOST_HARMONICS
from hbnlp.branches.branch import Branch
from hbnlp.continuation.newton import Newton, correct
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import instance_of, list_of_callables, place, real_number, whole_number
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kinds import Status
from hbnlp.core.layout import Column, Layout, counted_from_one, number, numbers_by_name, text, texts
from hbnlp.core.records import AlongParameter, loaded, save_record
from hbnlp.core.renamed import renamed_name
from hbnlp.core.tasks import COMPLETE, Ending, Report, drive
from hbnlp.core.types import Array, BoolArray, ComplexArray, IntArray
from hbnlp.solutions.attaching import check_belongs, check_problem
from hbnlp.solutions.equations import Equations, along_parameter
from hbnlp.solutions.solution import Solution, attached
from hbnlp.solutions.truncation import Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True, eq=False)
class ResolvedBranch(AlongParameter):
    """A branch with as many harmonics at each point as a tolerance asks for.

    Attributes
    ----------
    name : str
        The continuation parameter.
    parameter : array (n_points,)
    n_harmonics : array (n_points,), int
    truncation_error : array (n_points,)
        Estimate relative to the size of the solution; nan where no solution was found near the branch.
    coefficients : array (n_points, n_dof, 2 H + 1)
        H is the largest number of harmonics; zero beyond a point's own, nan where no solution was found.
    amplitudes : array (n_points, n_outputs, H + 1), complex
        Harmonics of all outputs.
    output_names : tuple of str
    periods : int
    parameters : dict
        Values of all parameters; that of the continuation parameter is its last.
    tolerance : float
    message : str
        Whether all points of the branch were resolved.
    problem : HarmonicBalance or None
        That of the branch; None from a file.
    """

    name: str
    parameter: Array
    n_harmonics: IntArray
    truncation_error: Array
    coefficients: Array
    amplitudes: ComplexArray
    output_names: tuple[str, ...]
    periods: int
    parameters: Mapping[str, float]
    tolerance: float
    message: str
    problem: HarmonicBalance | None = field(default=None, repr=False)

    @property
    def complete(self) -> bool:
        """Whether all points of the branch were treated."""
        return self.message.startswith("all ")

    @property
    def reached(self) -> BoolArray:
        """Whether the tolerance is met, (n_points,)."""
        return np.asarray(self.truncation_error <= self.tolerance)

    def __getattr__(self, name: str) -> Any:
        raise renamed_name("ResolvedBranch", name, {"solutions": "resolved.solution(i)"})

    def solution(self, index: int) -> Solution:
        """Return one point as a Solution with its own number of harmonics."""
        index = place("index", index, len(self))
        n_harmonics = int(self.n_harmonics[index])
        found = bool(np.isfinite(self.truncation_error[index]))
        return Solution(
            coefficients=self.coefficients[index, :, : 2 * n_harmonics + 1],
            parameters={**self.parameters, self.name: float(self.parameter[index])},
            amplitudes=self.amplitudes[index, :, : n_harmonics + 1],
            output_names=self.output_names,
            periods=self.periods,
            status=Status.CONVERGED if found else Status.NOT_CONVERGED,
            problem=None if self.problem is None else self.problem.with_harmonics(n_harmonics),
        )

    def plot(self, output: str, *, ax: Axes | None = None, harmonic: int = 1, **options: Any) -> Axes:
        """Draw the amplitude of an output, coloured by the number of harmonics; see `hbnlp.plot.plot_resolved`."""
        from hbnlp.plot import plot_resolved

        return plot_resolved(self, output, ax=ax, harmonic=harmonic, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to one ``.npz`` file without pickle, whole or not at all."""
        save_record(self, path, _LAYOUT)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, problem: HarmonicBalance | None = None) -> ResolvedBranch:
        """Return what `save` wrote, with its problem (of any harmonics) if that is given: see `Branch.load`."""
        check_problem(problem)
        with loaded(path, _LAYOUT) as content:
            resolved = cls(**content)
        found = np.flatnonzero(np.isfinite(resolved.truncation_error))
        if problem is not None and found.size:
            solution = resolved.solution(int(found[0]))
            check_belongs(problem.with_harmonics(solution.n_harmonics), solution, what="resolved branch")
        return dataclasses.replace(resolved, problem=problem)

    def __repr__(self) -> str:
        extent = f" with {self.n_harmonics.min()} to {self.n_harmonics.max()} harmonics" if len(self) else ""
        return (
            f"ResolvedBranch: {len(self)} points{extent}\n"
            f"  truncation error at most {self.tolerance:g} at {np.count_nonzero(self.reached)} points, not reached at "
            f"{np.count_nonzero(self.truncation_error > self.tolerance)}, no solution near the branch at "
            f"{np.count_nonzero(np.isnan(self.truncation_error))}\n  {self.message}"
        )


_LAYOUT = Layout(
    kind="resolved branch",
    columns={
        "parameter": Column("points"),
        "n_harmonics": Column("points", int),
        "truncation_error": Column("points", finite=False),
        "coefficients": Column("points dof 2H+1", finite=False),
        "amplitudes": Column("points outputs H+1", complex, finite=False),
    },
    entries={
        "name": text,
        "output_names": texts,
        "periods": counted_from_one,
        "tolerance": number,
        "message": text,
        "parameters": numbers_by_name,
    },
    lengths={"outputs": "output_names"},
)


@interrupts_kept(returns=True)
def resolve_harmonics(
    branch: Branch,
    tolerance: float,
    *,
    least: int = 1,
    at_most: int = 31,
    method: Newton | None = None,
    callbacks: Callbacks = (),
) -> ResolvedBranch:
    """Solve the points of a branch again, each with as few harmonics as meet a tolerance.

    Each point is sought in the plane normal to the branch, so that folds are no obstacle. The number of harmonics is
    raised until the estimated error falls below the tolerance; the next point begins with one less.

    Parameters
    ----------
    branch : Branch
        From `hbnlp.trace`, of two points or more; its own number of harmonics need only be enough to lead.
    tolerance : float
        Bound on the truncation error, relative to the size of the solution, or to a thousandth of the largest on the
        branch where the solution is smaller than that.
    least, at_most : int
        Numbers of harmonics between which the choice is made. Where ``at_most`` does not do, ``reached`` is False.
    method : Newton, optional
    callbacks : sequence of callables
        Called after each point with a `Progress`; one that raises `StopTracing` ends it, as Ctrl-C does, with all
        points so far.

    Raises
    ------
    ValueError
        For a tolerance that is not between 0 and 1, numbers out of order, or a branch from a file.
    """
    instance_of("branch", branch, Branch, "a Branch, as hbnlp.trace returns it")
    instance_of("method", method, Newton | None, "Newton(...)")
    list_of_callables("callbacks", callbacks)
    real_number("tolerance", tolerance, above=0.0, below=1.0)
    whole_number("least", least, least=1, most=MOST_HARMONICS)
    whole_number("at_most", at_most, least=least, most=MOST_HARMONICS)
    problem = attached(branch)
    if len(branch) < 2:
        raise ValueError("the branch has a single point, and so no direction; trace two points or more")
    resolver = _Resolver(branch, problem, float(tolerance), at_most, method or Newton())
    rows: list[_Row] = []

    def work() -> Iterator[Report]:
        for i in range(len(branch)):
            rows.append(resolver.point(i, max(least, rows[-1].n_harmonics - 1) if rows else least))
            counts = {"points": len(rows), "harmonics": rows[-1].n_harmonics}
            yield Report(rows[-1].parameter, len(rows) / len(branch), counts)

    def result(ending: Ending) -> ResolvedBranch:
        whole = f"all {len(branch)} points of the branch"
        message = whole if ending is COMPLETE else ending.after(f"{len(rows)} of {len(branch)} points")
        return _resolved(rows, branch, problem, float(tolerance), message)

    return drive(f"resolving along {branch.name}", work(), result, name=branch.name, callbacks=callbacks)


class _Row(NamedTuple):
    """One resolved point; no solution where none was found."""

    parameter: float
    n_harmonics: int
    error: float
    solution: Solution | None


class _Resolver:
    """The points of a branch, each solved again with the number of harmonics that it needs."""

    def __init__(
        self, branch: Branch, problem: HarmonicBalance, tolerance: float, at_most: int, method: Newton
    ) -> None:
        self._branch, self._tolerance, self._at_most, self._method = branch, tolerance, at_most, method
        # a branch may begin at rest, where nothing can be measured relative to the solution
        floor = 1e-3 * float(np.linalg.norm(branch.coefficients, axis=(1, 2)).max()) or 1.0
        values = problem.values(branch.solution(0).parameters)
        self._curve = along_parameter(problem, values, branch.name, span=branch.span, floor=floor)
        self._curves = {problem.n_harmonics: self._curve}
        self._points = [self._curve.point(branch.coefficients[i], branch.parameter[i]) for i in range(len(branch))]

    def point(self, i: int, n_harmonics: int) -> _Row:
        """Return a point with no less than the given number of harmonics."""
        points = self._points
        tangent = points[min(i + 1, len(points) - 1)] - points[max(i - 1, 0)]
        while True:
            curve = self._with_harmonics(n_harmonics)
            guess, along = (curve.carried_from(self._curve, v) for v in (points[i], tangent))
            row = along / curve.scale(guess) ** 2
            found = correct(curve, guess, row / np.linalg.norm(row), self._method)
            finer = curve.resampled(found.y) if found.converged else None
            if finer is not None:
                self._curves[n_harmonics] = finer
            elif found.converged:
                estimate = Estimate(curve, found.y, row)
                if estimate.error <= self._tolerance or n_harmonics >= self._at_most:
                    return _Row(float(found.y[-1]), n_harmonics, estimate.error, curve.solution(found.y))
                n_harmonics = min(self._at_most, estimate.harmonics_for(self._tolerance))
            elif n_harmonics >= self._at_most:
                return _Row(float(points[i][-1]), n_harmonics, float("nan"), None)
            else:
                n_harmonics += 1

    def _with_harmonics(self, n_harmonics: int) -> Equations:
        if n_harmonics not in self._curves:
            self._curves[n_harmonics] = self._curve.on(self._curve.problem.with_harmonics(n_harmonics))
        return self._curves[n_harmonics]


def _resolved(
    rows: list[_Row], branch: Branch, problem: HarmonicBalance, tolerance: float, message: str
) -> ResolvedBranch:
    largest = max((row.n_harmonics for row in rows), default=1)
    coefficients = np.zeros((len(rows), problem.shape[0], 2 * largest + 1))
    amplitudes = np.zeros((len(rows), len(branch.output_names), largest + 1), dtype=complex)
    for i, row in enumerate(rows):
        if row.solution is None:
            coefficients[i], amplitudes[i] = np.nan, np.nan
        else:
            coefficients[i, :, : 2 * row.n_harmonics + 1] = row.solution.coefficients
            amplitudes[i, :, : row.n_harmonics + 1] = row.solution.amplitudes
    return ResolvedBranch(
        name=branch.name,
        parameter=np.array([row.parameter for row in rows]),
        n_harmonics=np.array([row.n_harmonics for row in rows], dtype=int),
        truncation_error=np.array([row.error for row in rows]),
        coefficients=coefficients,
        amplitudes=amplitudes,
        output_names=branch.output_names,
        periods=branch.periods,
        parameters=branch.solution(len(branch) - 1).parameters,
        tolerance=tolerance,
        message=message,
        problem=problem,
    )
