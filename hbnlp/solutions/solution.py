"""One periodic solution: its coefficients, what was asked of it, and how it was found."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import finite_array, instance_of, position, refused
from hbnlp.core.kept import by_one_thread
from hbnlp.core.kinds import Status
from hbnlp.core.layout import Column, Layout, counted_from_one, facts, name_in, numbers_by_name, table, texts
from hbnlp.core.records import check_parameters, loaded, save_record
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import basis_derivatives, basis_values, stretch, to_real
from hbnlp.solutions.attaching import attached, check_problem, with_problem
from hbnlp.solutions.identity import meets, moved
from hbnlp.systems.symmetry import Symmetry, inherent
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(ReadOnlyArrays, Tabular):
    """A periodic solution ``q(tau) = a_0 + sum_h a_{2h-1} cos(h tau / periods) + a_{2h} sin(h tau / periods)``.

    Many methods: what a motion is asked for, most in one line.

    Attributes
    ----------
    coefficients : array (n_dof, 2H+1)
    parameters : dict
        Value of every parameter.
    amplitudes : array (n_outputs, H+1), complex
        Harmonics of all outputs, ``a_0`` and ``a_{2h-1} - i a_{2h}``.
    output_names : tuple of str
    periods : int
        Length in forcing periods.
    status : Status
    statistics : dict
        How it was found: iterations, the residual relative to its terms, the samples of the force, the start that led
        here.
    problem : HarmonicBalance or None
        None for a solution loaded from a file without one.
    origin : Solution or None
        Where its branch leads away from, if it was switched to: the special point's solution.
    """

    coefficients: Array
    parameters: Mapping[str, float]
    amplitudes: ComplexArray
    output_names: tuple[str, ...]
    periods: int = 1
    status: Status = Status.CONVERGED
    statistics: Mapping[str, float | str] = field(default_factory=dict)
    problem: HarmonicBalance | None = field(default=None, repr=False)
    origin: Solution | None = field(default=None, repr=False)

    @property
    def converged(self) -> bool:
        """Whether the balance holds."""
        return self.status is Status.CONVERGED

    @property
    def message(self) -> str:
        """What became of it: why it did not converge, where that is known, and what to do."""
        reason = self.statistics.get("reason", "")
        return self.status.value if self.converged or not reason else f"{reason}; {self.status.value}"

    @property
    def n_harmonics(self) -> int:
        """Number of harmonics H."""
        return int(self.coefficients.shape[1] - 1) // 2

    @property
    def omega(self) -> float:
        """Forcing frequency."""
        return self.parameters["omega"]

    def harmonics(self, output: str) -> ComplexArray:
        """Return the complex amplitudes (H+1,) of a named output."""
        return np.asarray(self.amplitudes[position("output", output, self.output_names)])

    def signal(self, output: str, t: ArrayLike) -> Array:
        """Return a named output at times t, from its harmonics (exact for outputs that are linear)."""
        return np.asarray(self._at(_times(t)) @ to_real(self.harmonics(output)))

    def displacement(self, t: ArrayLike) -> Array:
        """Return q at times t: array (n_dof, len(t))."""
        return self.coefficients @ self._at(_times(t)).T

    def velocity(self, t: ArrayLike) -> Array:
        """Return q' at times t: array (n_dof, len(t))."""
        rate = self.omega / self.periods
        return rate * self.coefficients @ basis_derivatives(rate * _times(t), self.n_harmonics).T

    @property
    def symmetries(self) -> tuple[Symmetry, ...]:
        """Those of the system, at these parameters, that take the motion to itself; all but the identity.

        Raises
        ------
        ValueError
            If the solution came from a file, without its problem.
        """
        known = attached(self).system.symmetries_at(self.parameters)
        return tuple(symmetry for symmetry in known if meets(self, self, symmetry))

    @property
    def is_odd(self) -> bool | None:
        """Whether half a forcing period changes the sign, as the equations allow: the motion has odd harmonics only.

        None for a solution from a file: without the equations it may be so by chance.
        """
        return None if self.problem is None else inherent(self.coefficients.shape[0])[0] in self.symmetries

    def image(self, symmetry: Symmetry) -> Solution:
        """Return the motion to which a symmetry of the system takes this one: another solution, or the same.

        Parameters
        ----------
        symmetry : Symmetry
            One of ``problem.system.symmetries_at(parameters)``, or any other that the equations have there.

        Raises
        ------
        ValueError
            If the equations do not have it at these parameters, or the solution came from a file.
        """
        attached(self).system.invariance.check(symmetry, self.parameters)
        image = self.with_coefficients(moved(self.coefficients, symmetry, self.periods))
        origin = self.origin.image(symmetry) if self.origin is not None else None
        return replace(image, statistics={**self.statistics, "start": f"image by {symmetry.name}"}, origin=origin)

    def with_coefficients(self, coefficients: Array) -> Solution:
        """Return the same record with other coefficients of this motion, and the outputs that go with them."""
        problem = attached(self)
        amplitudes = problem.output_harmonics(coefficients.ravel(), problem.values(self.parameters))[0]
        return replace(self, coefficients=coefficients, amplitudes=amplitudes)

    def plot(self, output: str, *, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw an output over the period; see `hbnlp.plot.plot_signal`."""
        from hbnlp.plot import plot_signal

        return plot_signal(self, output, ax=ax, **options)

    def plot_phase(self, output: str, *, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the rate of an output against its value; see `hbnlp.plot.plot_phase`."""
        from hbnlp.plot import plot_phase

        return plot_phase(self, output, ax=ax, **options)

    def plot_harmonics(self, output: str, *, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the harmonics of an output as bars; see `hbnlp.plot.plot_harmonics`."""
        from hbnlp.plot import plot_harmonics

        return plot_harmonics(self, output, ax=ax, **options)

    def plot_shape(self, *, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the shape of a wing, or of another system, over a period; see `hbnlp.plot.plot_shape`."""
        from hbnlp.plot import plot_shape

        return plot_shape(self, ax=ax, **options)

    def animate(self, path: str | os.PathLike[str], **options: Any) -> None:
        """Write a film of the moving shape and an output, GIF, HTML or MP4; see `hbnlp.plot.animate_solution`."""
        from hbnlp.plot import animate_solution

        animate_solution(self, path, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the solution to one ``.npz`` file without pickle, whole or not at all.

        Its origin is written with it, without an origin that this may have.

        Raises
        ------
        SaveError
            If it cannot be written; an older file is as it was.
        """
        save_record(self, path, _LAYOUT, **self._parts())

    def _parts(self) -> dict[str, Any]:
        origin = self.origin
        return {
            "status": self.status.name,
            "origin": [] if origin is None else [_row(origin)],
            "origin_coefficients": None if origin is None else origin.coefficients[None],
            "origin_amplitudes": None if origin is None else origin.amplitudes[None],
        }

    def _table(self) -> Table:
        return table_of(self, _LAYOUT, **self._parts())

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, problem: HarmonicBalance | None = None) -> Solution:
        """Return a solution from a file that `save` wrote, with its problem if that is given.

        Parameters
        ----------
        path : path-like
        problem : HarmonicBalance, optional
            The problem that it is of, whose balance it solves (the harmonics of an integration may do so to 1e-4
            only, which is refused). Without one the solution can be read, and be a start.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        LoadError
            (A `ValueError`.) If the file is damaged or holds something else.
        ValueError
            If the problem is not the solution's: the message says in what they differ.
        TypeError
            If ``problem`` is something else.
        """
        check_problem(problem)
        with loaded(path, _LAYOUT) as content:
            check_parameters(content)
            if len(content["coefficients"]) == 0:
                raise ValueError("it has no displacements")
            rows, coefficients, amplitudes = (
                content.pop(name) for name in ("origin", "origin_coefficients", "origin_amplitudes")
            )
            if len(rows) > 1:
                raise ValueError(f"it has {len(rows)} origins; one or none is needed")
            names, origin = content["output_names"], None
            if rows:
                origin = cls(coefficients=coefficients[0], amplitudes=amplitudes[0], output_names=names, **rows[0])
            solution = cls(**content, origin=origin)
        return solution if problem is None else with_problem(solution, problem)

    def __call__(self, expression: ca.MX) -> Array:
        """Return the value of a CasADi expression of ``problem.x`` and ``problem.p``, those of the solution's problem.

        Raises
        ------
        ValueError
            If the solution came from a file, without its problem, or for an expression of another problem's symbols.
        """
        problem = attached(self)
        instance_of("expression", expression, ca.MX, "an expression of solution.problem.x and solution.problem.p")
        function = _function(problem, expression)
        return np.asarray(function(self.coefficients.ravel(), problem.values(self.parameters)).full().squeeze())

    def _at(self, t: ArrayLike) -> Array:
        return basis_values(self.omega / self.periods * np.asarray(t, dtype=float), self.n_harmonics)

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value:.10g}" for name, value in self.parameters.items())
        first = ", ".join(
            f"|{name}| = {abs(row[1]):.6g}" for name, row in zip(self.output_names[:4], self.amplitudes, strict=False)
        )
        statistics = ", ".join(
            f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in self.statistics.items()
        )
        return (
            f"Solution ({self.status.name.lower()}), {self.n_harmonics} harmonics of omega"
            f"{f' / {self.periods}' if self.periods > 1 else ''}\n  at {values}\n  first harmonics: {first}\n  "
            f"{statistics}{self._beyond_tolerance()}"
        )

    def _beyond_tolerance(self) -> str:
        """Return what is to be said where the most harmonics do not meet the problem's tolerance."""
        policy, error = self.problem.truncation if self.problem else None, self.statistics.get("truncation_error")
        if policy is None or not isinstance(error, float) or error <= policy.tolerance:
            return ""
        return f": not within the tolerance {policy.tolerance:g} with most_harmonics = {policy.most_harmonics}"


def _row(solution: Solution) -> dict[str, Any]:
    """Return the plain values of a solution, but for the names of its outputs."""
    return {
        "parameters": dict(solution.parameters),
        "periods": solution.periods,
        "status": solution.status.name,
        "statistics": dict(solution.statistics),
    }


_ENTRIES = {
    "parameters": numbers_by_name,
    "periods": counted_from_one,
    "status": name_in(Status),
    "statistics": facts,
}
_LAYOUT = Layout(
    kind="solution",
    columns={
        "coefficients": Column("dof 2H+1", about="displacements"),
        "amplitudes": Column("outputs H+1", complex, about="outputs"),
        "origin_coefficients": Column("origins dof 2K+1"),
        "origin_amplitudes": Column("origins outputs K+1", complex),
    },
    entries={**_ENTRIES, "output_names": texts, "origin": table(**_ENTRIES)},
    lengths={"outputs": "output_names", "origins": "origin"},
    rows="harmonic",
    working=frozenset({"origin", "origin_coefficients", "origin_amplitudes"}),
)


@by_one_thread
def _function(problem: HarmonicBalance, expression: ca.MX) -> ca.Function:
    own = {hash(symbol) for symbol in (problem.x, problem.p)}
    for symbol in ca.symvar(expression):
        if hash(symbol) not in own:
            raise ValueError(
                f"the expression has the symbol {symbol} of another problem, with other harmonics or samples: write it "
                "with solution.problem.x and solution.problem.p"
            )
    return ca.Function("expression", [problem.x, problem.p], [ca.densify(expression)])


def _times(t: ArrayLike) -> Array:
    times: Array = finite_array("t", t)
    if times.ndim > 1:
        raise refused(ValueError, "t", t, "a time, or an array of times (k,)")
    return times


def make_solution(
    problem: HarmonicBalance,
    x: Array,
    values: Array,
    *,
    status: Status = Status.CONVERGED,
    statistics: Mapping[str, float | str] | None = None,
) -> Solution:
    """Return the record of unknowns ``x`` at parameter values, with the harmonics of all outputs."""
    return Solution(
        coefficients=x.reshape(problem.shape).copy(),
        parameters=problem.system.parameters.as_dict(values),
        amplitudes=problem.output_harmonics(x, values)[0],
        output_names=problem.system.output_names,
        periods=problem.periods,
        status=status,
        statistics={"samples": problem.n_samples, **(statistics or {})},
        problem=problem,
    )


def guess_for(problem: HarmonicBalance, near: Solution | ArrayLike) -> Array:
    """Return a solution of the same or of fewer periods, or coefficients (n_dof, any odd number), as unknowns.

    Raises
    ------
    ValueError
        If the solution is of another system or the problem's periods are no multiple of its, or the coefficients have
        another shape.
    """
    if not isinstance(near, Solution):
        accepted = (problem.shape[0], None)
        return problem.vector(finite_array("start", near, accepted, advice=" (2H+1 coefficients), or a Solution"))
    own, its = problem.shape[0], len(near.coefficients)
    if its != own:
        raise ValueError(
            f"start is a solution with {its} displacement(s), the system {problem.system.name!r} has {own}: it is of "
            f"another system; give one of this, or coefficients of shape ({own}, 2H+1)"
        )
    factor, rest = divmod(problem.periods, near.periods)
    if rest or not factor:
        raise ValueError(
            f"the solution has {near.periods} period(s) and the problem {problem.periods}; a divisor is needed"
        )
    return problem.vector(stretch(near.coefficients, factor))
