"""Marching through values of a parameter by Newton's method: each solution starts from the last, and jumps happen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Newton
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.errors import ConvergenceError, NonFiniteError
from hbnlp.core.tasks import COMPLETE, INTERRUPTED, STOPPED, Ending, Report, drive
from hbnlp.core.types import Array
from hbnlp.fourier import n_coefficients, padded, resize
from hbnlp.solutions.accuracy import Accuracy, problem_and_guess
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.attempt import attempt
from hbnlp.solutions.columns import not_met
from hbnlp.solutions.equations import Equations, along_load
from hbnlp.solutions.solution import Solution
from hbnlp.solutions.solving import solved
from hbnlp.sweeps.jumps import UNKNOWN, is_suspicious, relative_change
from hbnlp.sweeps.records import Sweep

SAME = 1e-6
"""The way back leads to the old solution if it comes this near to it, relative to its size."""
_HALVINGS = 6
_GROWING = (1 / 64, 1 / 16, 1 / 4, 1.0)
"""Parts of the way back at which the steps end that grow."""


@final
class NewtonMarch:
    """One march, value by value.

    Parameters
    ----------
    problem : HarmonicBalance
    name : str
        The parameter that is varied.
    values : array (k,)
        In the order of marching.
    at : mapping, optional
        Values of the other parameters.
    method : Newton
    start : Solution or array (n_dof, 2H+1), optional
        Where to begin: a solution at a value before the first, or coefficients near that at the first. By default the
        first value is a cold start.

    Raises
    ------
    ValueError, TypeError
        For values that are not finite numbers, or another method.
    """

    def __init__(
        self,
        problem: HarmonicBalance,
        name: str,
        values: ArrayLike,
        *,
        at: Mapping[str, float] | None,
        method: Newton,
        start: Solution | ArrayLike | None = None,
    ) -> None:
        marched = problem.system.parameters.series(name, values)
        if not isinstance(method, Newton):
            raise TypeError(
                f"method is {method!r}; a HarmonicBalance is marched by Newton(...), a System by integration"
            )
        self._problem, self._name, self._marched, self._method = problem, name, marched, method
        self._values = problem.values(at, but=(name,))
        self._index = problem.system.parameters.index(name)
        self._rows: list[Solution | None] = []
        self._jumps: list[tuple[int, float, float]] = []
        self._last: Solution | None = None
        self._last_change = UNKNOWN
        self._accuracy = Accuracy(problem) if problem.truncation is not None else None
        if start is not None:
            begin = start.parameters[name] if isinstance(start, Solution) else marched[0]
            own, guess = problem_and_guess(problem, start)
            near = attempt(own, self._parameters(begin), guess, method, start="given", accuracy=self._accuracy)
            self._last = near if near.converged else None
        self._last_value = self._last.parameters[name] if self._last is not None else marched[0]

    def run(self, callbacks: Callbacks = ()) -> Sweep:
        """March through all values, or until Ctrl-C or a callback ends it."""
        task, name, warn_of = f"marching {self._name}", self._name, self._problem.system.warn_of
        return drive(task, self._steps(), self._sweep, name=name, callbacks=callbacks, warn_of=warn_of)

    def _steps(self) -> Iterator[Report]:
        for value in self._marched:
            self._advance(value)
            counts = {"values": len(self._rows), "jumps": len(self._jumps)}
            yield Report(value, len(self._rows) / self._marched.size, counts)

    def _advance(self, value: float) -> None:
        """Solve at the next value, from the last solution or anew, and see whether that was a jump."""
        last = self._last
        new = self._step(last, self._last_value, value) if last is not None else None
        fresh = new is None
        if fresh:
            try:
                at = self._problem.system.parameters.as_dict(self._parameters(value))
                new = solved(self._problem, at=at, method=self._method)
            except ConvergenceError:
                new = None
            except NonFiniteError:  # at rest: nothing to start from but the last solution, which leads nowhere
                if last is None and not self._rows:
                    raise
                new = None
        if last is not None and new is not None:
            change = relative_change(last.coefficients, new.coefficients)
            if fresh or is_suspicious(change, self._last_change):
                back = self._back(new, value, last)
                if back is None or relative_change(last.coefficients, back.coefficients) > SAME:
                    self._jumps.append((len(self._rows), float(self._last_value), float(value)))
            self._last_change = change
        self._rows.append(new)
        if new is not None:
            self._last, self._last_value = new, value
            if self._accuracy is not None:
                self._accuracy.see(*self._on_curve(new))

    def _back(self, new: Solution, value: float, last: Solution) -> Solution | None:
        """Go back to the last value, and in growing steps if that comes to another solution.

        Just before a fold a solution moves as the root of the distance to it: a long step from there leaves the branch.
        The last step has as many harmonics as the old solution: truncated alike, the same motion is the same solution.
        """
        begin = value
        back = self._step(new, value, self._last_value, n_harmonics=last.n_harmonics)
        if back is not None and relative_change(last.coefficients, back.coefficients) <= SAME:
            return back
        here: Solution | None = new
        for part in _GROWING:
            if here is None:
                return None
            end = self._last_value if part == 1.0 else value + part * (self._last_value - value)
            here = self._step(here, begin, end, n_harmonics=last.n_harmonics if part == 1.0 else None)
            begin = end
        return here

    def _step(
        self, solution: Solution, begin: float, value: float, *, n_harmonics: int | None = None
    ) -> Solution | None:
        """Go from one value to another, in smaller steps where Newton's method needs them.

        The last one begins with a number of harmonics that is given, the others with those that matter.
        """
        for halvings in range(_HALVINGS):
            here: Solution | None = solution
            for part in np.linspace(begin, value, 2**halvings + 1)[1:]:
                assert here is not None
                given = n_harmonics if part == value else None
                problem = self._problem.carrying(given or self._enough(here))
                guess, there = problem.vector(here.coefficients), self._parameters(part)
                trial = attempt(problem, there, guess, self._method, start="marching", accuracy=self._accuracy)
                here = trial if trial.converged else None
                if here is None:
                    break
            if here is not None:
                return here
        return None

    def _enough(self, solution: Solution) -> int:
        """Return with how many harmonics the solution after this one is begun."""
        if self._accuracy is None:
            return solution.n_harmonics
        return self._accuracy.enough(*self._on_curve(solution))

    @staticmethod
    def _on_curve(solution: Solution) -> tuple[Equations, Array]:
        problem = attached(solution)
        curve = along_load(problem, problem.values(solution.parameters))
        return curve, curve.point(solution.coefficients, 1.0)

    def _parameters(self, value: float) -> Array:
        there = self._values.copy()
        there[self._index] = value
        return there

    def _sweep(self, ending: Ending) -> Sweep:
        problem, rows = self._problem, self._rows
        numbers = np.array([problem.n_harmonics if s is None else s.n_harmonics for s in rows], dtype=int)
        errors = np.array([np.nan if s is None else s.statistics.get("truncation_error", np.nan) for s in rows])
        most, n_outputs = int(max(numbers, default=problem.n_harmonics)), len(problem.system.output_names)
        coefficients = np.full((len(rows), problem.system.n_dof, n_coefficients(most)), np.nan)
        amplitudes = np.full((len(rows), n_outputs, most + 1), np.nan + 0j)
        for i, row in enumerate(rows):
            if row is not None:
                coefficients[i], amplitudes[i] = resize(row.coefficients, most), padded(row.amplitudes, most)
        others = problem.system.parameters.as_dict(self._values)
        del others[self._name]
        jumps = [jump for jump in self._jumps if jump[0] < len(rows)]
        return Sweep(
            name=self._name,
            parameter=self._marched[: len(rows)],
            coefficients=coefficients,
            amplitudes=amplitudes,
            n_harmonics=numbers,
            truncation_error=errors if problem.truncation is not None else None,
            output_names=problem.system.output_names,
            converged=np.array([s is not None for s in rows], dtype=bool),
            jumps=np.array([jump[0] for jump in jumps], dtype=int),
            jump_brackets=np.array([jump[1:] for jump in jumps], dtype=float).reshape(-1, 2),
            parameters=others,
            periods=problem.periods,
            complete=len(rows) == self._marched.size,
            message=self._message(ending) + not_met(errors, problem),
            problem=problem,
        )

    def _message(self, ending: Ending) -> str:
        rows, whole = self._rows, self._marched.size
        if ending is COMPLETE:
            lost = sum(row is None for row in rows)
            return f"all {whole} values reached" + (f", no solution at {lost} of them" if lost else "")
        solved = [i for i, row in enumerate(rows) if row is not None]
        resumable = bool(solved) and ending in (INTERRUPTED, STOPPED)
        advice = f"; go on from start=sweep.coefficients[{solved[-1]}]" if resumable else ""
        return ending.after(f"{len(rows)} of {whole} values") + advice
