"""What marching returns: responses along a parameter with their jumps, each kind in one file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import instance_of, place
from hbnlp.core.kinds import Status
from hbnlp.core.layout import Column, Entry, Layout, counted_from_one, flag, numbers_by_name, text, texts
from hbnlp.core.records import AlongParameter, check_parameters, loaded, save_record
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.types import Array, BoolArray, ComplexArray, IntArray
from hbnlp.fourier import n_coefficients
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.settling import integrate
from hbnlp.solutions.attaching import check_belongs, check_problem
from hbnlp.solutions.columns import HARMONICS, check_numbers, numbers_of_harmonics
from hbnlp.solutions.solution import Solution
from hbnlp.systems.system import System
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

REPEATS = 1e-2
"""A periodic response whose state changes more over a window is none of the system; less may be the steps' error."""

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep(AlongParameter, Tabular):
    """Solutions along values of one parameter, in the order of marching.

    Attributes
    ----------
    name : str
    parameter : array (k,)
    coefficients : array (k, n_dof, 2H+1)
        H is the largest number of harmonics, and zeros stand where a solution has fewer.
    amplitudes : array (k, n_outputs, H+1), complex
    n_harmonics : array (k,), int
        Number of harmonics of each solution: one and the same, unless the problem has a tolerance.
    truncation_error : array (k,) or None
        Estimated error for want of harmonics, as the problem's tolerance bounds it; None without a tolerance.
    output_names : tuple of str
    converged : array (k,), bool
        Where it is False the row holds nan.
    jumps : array (n_jumps,), int
        Index of the first solution after each jump.
    jump_brackets : array (n_jumps, 2)
        The parameter before and after it.
    parameters : dict
        Values of the other parameters.
    periods : int
    complete : bool
        Whether all values were reached; a sweep that was interrupted or stopped keeps the ones before.
    message : str
    problem : HarmonicBalance or None
        None for a sweep loaded from a file without one.

    Notes
    -----
    A jump is a change that the way back does not undo: where the solution changes by more than 2 %, or by more than
    0.1 % and five times the change before, or Newton's method needs a new start, the parameter is taken back, in one
    step or in growing ones, and the old solution must come out again, with as many harmonics as it had. Just before a
    fold a long step may come to the unstable solution, which is so near that no jump is told: shorter ones do not.
    """

    name: str
    parameter: Array
    coefficients: Array
    amplitudes: ComplexArray
    n_harmonics: IntArray
    truncation_error: Array | None
    output_names: tuple[str, ...]
    converged: BoolArray
    jumps: IntArray
    jump_brackets: Array
    parameters: Mapping[str, float]
    periods: int
    complete: bool
    message: str
    problem: HarmonicBalance | None = field(default=None, repr=False)

    def solution(self, index: int) -> Solution:
        """Return one value as a Solution."""
        index = place("index", index, len(self))
        n_harmonics = int(self.n_harmonics[index])
        statistics: dict[str, float | str] = {"method": "Newton"}
        if self.truncation_error is not None and self.converged[index]:
            statistics["truncation_error"] = float(self.truncation_error[index])
        return Solution(
            coefficients=self.coefficients[index, :, : n_coefficients(n_harmonics)],
            parameters={**self.parameters, self.name: float(self.parameter[index])},
            amplitudes=self.amplitudes[index, :, : n_harmonics + 1],
            output_names=self.output_names,
            periods=self.periods,
            status=Status.CONVERGED if self.converged[index] else Status.NOT_CONVERGED,
            statistics=statistics,
            problem=None if self.problem is None else self.problem.carrying(n_harmonics),
        )

    def plot(self, output: str, *, ax: Axes | None = None, harmonic: int = 1, **options: Any) -> Axes:
        """Draw the amplitude of one harmonic of an output, jumps as arrows; see `hbnlp.plot.plot_sweep`."""
        from hbnlp.plot import plot_sweep

        return plot_sweep(self, output, ax=ax, harmonic=harmonic, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the sweep to one ``.npz`` file without pickle, whole or not at all.

        Raises
        ------
        SaveError
            If the file cannot be written.
        """
        save_record(self, path, _SWEEP)

    def _table(self) -> Table:
        return table_of(self, _SWEEP, coordinates={"parameter": self.name})

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, problem: HarmonicBalance | None = None) -> Sweep:
        """Return a sweep from a file that `save` wrote, with its problem if that is given.

        Raises
        ------
        FileNotFoundError, ValueError
            If there is no such file, it is damaged or holds something else, or the problem is not the sweep's.
        """
        check_problem(problem)
        with loaded(path, _SWEEP) as content:
            _check(content)
            content["n_harmonics"] = numbers_of_harmonics(content["n_harmonics"], content["coefficients"])
            sweep = cls(**content, problem=problem)
        solved = np.flatnonzero(sweep.converged)
        if problem is not None and solved.size:
            check_numbers(problem, sweep.n_harmonics[solved], what="sweep")
            first = sweep.solution(int(solved[0]))
            check_belongs(problem.carrying(first.n_harmonics), first, what="sweep")
        return sweep

    def __repr__(self) -> str:
        jumps = ", ".join(f"{low:.6g}..{high:.6g}" for low, high in self.jump_brackets) or "none"
        extent = f" from {self.parameter[0]:g} to {self.parameter[-1]:g}" if len(self) else ""
        return (
            f"Sweep in {self.name!r}: {len(self)} values{extent}, {np.count_nonzero(self.converged)} converged\n"
            f"  jumps: {jumps}\n  {self.message}"
        )


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TimeSweep(AlongParameter, Tabular):
    """Responses along a range of one parameter, in the order in which they were integrated.

    Attributes
    ----------
    name : str
        The parameter.
    parameter : array (k,)
        Its values.
    amplitudes : array (k, n_outputs, H+1), complex
        Harmonics of all outputs, ``a_0`` and ``a_{2h-1} - i a_{2h}``.
    output_names : tuple of str
    coefficients : array (k, n_dof, 2H+1)
        Of the displacements; nan in a sweep from a file that an earlier version wrote.
    states : array (k, n_state)
        (q, q', x) at the end of each response, at tau = 0.
    periodic : array (k,), bool
        Whether the response became periodic before the next value was taken.
    defects : array (k,)
        Relative change of the state over the last window.
    n_periods : array (k,), int
        Periods of the forcing integrated.
    jumps : array (n_jumps,), int
        Index of the first response after each jump.
    jump_brackets : array (n_jumps, 2)
        The parameter at the last periodic response before, and at the first after it.
    parameters : dict
        The values of the other parameters.
    periods : int
        Periods of the forcing in a window; the harmonics are those of ``omega / periods``.
    method : str
        What integrated.
    complete : bool
        Whether all values were reached.
    message : str
        How it ended.
    system : System or None
        None for a sweep loaded from a file without one.

    Notes
    -----
    A jump is a change that the way back does not undo. Where the displacements' harmonics change by more than 2 % from
    one periodic response to the next (or by more than 0.1 % and five times the change before), the parameter is taken
    back from the new state; if the response then stays nearer to the new one than to the old, the old branch was left.
    A steep but continuous response returns. A jump smaller than these bounds is not seen; responses that are not
    periodic are passed over, and the bracket of a jump across them is as much wider.
    """

    name: str
    parameter: Array
    amplitudes: ComplexArray
    output_names: tuple[str, ...]
    coefficients: Array
    states: Array
    periodic: BoolArray
    defects: Array
    n_periods: IntArray
    jumps: IntArray
    jump_brackets: Array
    parameters: Mapping[str, float]
    periods: int
    method: str
    complete: bool
    message: str
    system: System | None = None

    def solution(self, index: int) -> Solution:
        """Return one response as a Solution: a start for a balance, or to compare with it."""
        index, n_harmonics = place("index", index, len(self)), self.amplitudes.shape[2] - 1
        problem = None
        if self.system is not None:
            problem = HarmonicBalance(self.system, n_harmonics, periods=self.periods)
        return Solution(
            coefficients=self.coefficients[index],
            parameters={**self.parameters, self.name: float(self.parameter[index])},
            amplitudes=self.amplitudes[index],
            output_names=self.output_names,
            periods=self.periods,
            status=Status.CONVERGED if self.periodic[index] else Status.NOT_CONVERGED,
            statistics={"method": self.method, "defect": float(self.defects[index])},
            problem=problem,
        )

    def plot(self, output: str, *, ax: Axes | None = None, harmonic: int = 1, **options: Any) -> Axes:
        """Draw the amplitude of one harmonic of an output, jumps as arrows; see `hbnlp.plot.plot_sweep`."""
        from hbnlp.plot import plot_sweep

        return plot_sweep(self, output, ax=ax, harmonic=harmonic, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the sweep to one ``.npz`` file without pickle, whole or not at all.

        Raises
        ------
        SaveError
            If the file cannot be written.
        """
        save_record(self, path, _TIME_SWEEP)

    def _table(self) -> Table:
        return table_of(self, _TIME_SWEEP, coordinates={"parameter": self.name})

    @classmethod
    @renamed_arguments()
    def load(cls, path: str | os.PathLike[str], *, system: System | None = None) -> TimeSweep:
        """Return a sweep from a file that `save` wrote, with its system if that is given.

        Raises
        ------
        FileNotFoundError, ValueError
            If there is no such file, it is damaged or holds something else, or the system is not the sweep's.
        TypeError
            If ``system`` is something else.
        """
        instance_of("system", system, System | None, "the System of the record, or None")
        with loaded(path, _TIME_SWEEP) as content:
            _check(content)
            if content["coefficients"] is None:
                n_points, _, length = content["amplitudes"].shape
                content["coefficients"] = np.full((n_points, 0, 2 * length - 1), np.nan)
            sweep = cls(**content, system=system)
        if system is not None:
            instance_of("system", system, System, "the System that was integrated")
            names = sorted([sweep.name, *sweep.parameters])
            n_state = sweep.states.shape[1]
            if sorted(system.parameters.names) != names or n_state != system.n_state:
                raise ValueError(
                    f"the sweep has parameters {names} and {n_state} states, the system "
                    f"{sorted(system.parameters.names)} and {system.n_state}: give the system that was integrated"
                )
            _check_repeats(system, sweep)
        return sweep

    def __repr__(self) -> str:
        span = f"{self.parameter[0]:g} to {self.parameter[-1]:g}" if len(self) else "none"
        jumps = ", ".join(f"{low:g}..{high:g}" for low, high in self.jump_brackets) or "none"
        return (
            f"TimeSweep in {self.name!r}: {len(self)} responses ({span}), {int(self.periodic.sum())} of them periodic\n"
            f"  outputs: {', '.join(self.output_names)}; {self.amplitudes.shape[2] - 1} harmonics\n"
            f"  jumps: {jumps}\n"
            f"  {self.message}"
        )


def _check(content: dict[str, Any]) -> None:
    """Raise a ValueError if a sweep read from a file lacks a parameter, or has a jump beyond its end."""
    check_parameters(content, content["name"])
    if np.any(content["jumps"] >= content["parameter"].size):
        raise ValueError(f"it has a jump at value {content['jumps'].max()} of {content['parameter'].size}")


def _check_repeats(system: System, sweep: TimeSweep) -> None:
    """Raise a ValueError unless the last periodic response of a sweep repeats itself in a system, over one window."""
    periodic = np.flatnonzero(sweep.periodic)
    if not periodic.size:
        return
    last, periods = int(periodic[-1]), sweep.periods
    again = integrate(
        system,
        at={**sweep.parameters, sweep.name: float(sweep.parameter[last])},
        start=sweep.states[last],
        method=Adaptive(),
        periods=periods,
        max_periods=periods,
        throw=False,
    )
    change = float(again.defects[-1]) if again.stopped_at is None else np.inf
    if change > REPEATS + 10.0 * sweep.defects[last]:
        raise ValueError(
            f"the sweep's response at {sweep.name} = {sweep.parameter[last]:g} does not repeat itself in "
            f"this system: its state changes by {change:.1e} of its size over a window; give the system that "
            "was integrated"
        )


_ENTRIES: dict[str, Entry] = {
    "name": text,
    "output_names": texts,
    "parameters": numbers_by_name,
    "periods": counted_from_one,
    "complete": flag,
    "message": text,
}
_PARAMETER = Column("points", about="parameter of the sweep, in the order of marching")
_JUMPS = {
    "jumps": Column("jumps", int, about="first point after the jump", units="1"),
    "jump_brackets": Column("jumps 2", finite=False, about="parameter before and after the jump"),
}
_SWEEP = Layout(
    kind="sweep",
    columns={
        "parameter": _PARAMETER,
        **HARMONICS,
        # nan where Newton's method did not converge
        "coefficients": replace(HARMONICS["coefficients"], finite=False),
        "amplitudes": replace(HARMONICS["amplitudes"], finite=False),
        "converged": Column("points", bool, about="whether Newton's method converged"),
        **_JUMPS,
    },
    entries=_ENTRIES,
    lengths={"outputs": "output_names"},
)
_TIME_SWEEP = Layout(
    kind="time sweep",
    columns={
        "parameter": _PARAMETER,
        "amplitudes": replace(HARMONICS["amplitudes"], numbers=""),
        "coefficients": replace(HARMONICS["coefficients"], numbers="", optional=True),
        "states": Column("points states", about="(q, q', lag states) at the end, where tau = 0"),
        "periodic": Column("points", bool, about="whether the response became periodic"),
        "defects": Column("points", finite=False, about="relative change of the state over the last window", units="1"),
        "n_periods": Column("points", int, about="periods of the forcing that were integrated", units="1"),
        **_JUMPS,
    },
    entries={**_ENTRIES, "method": text},
    lengths={"outputs": "output_names"},
    dimensions={"states": "component"},
)
