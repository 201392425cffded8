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
from hbnlp.solutions.attempt import attempt
from hbnlp.solutions.solution import Solution, guess_for
from hbnlp.solutions.solving import solve
from hbnlp.sweeps.jumps import UNKNOWN, is_suspicious, relative_change
from hbnlp.sweeps.records import Sweep

SAME = 1e-6
"""The way back leads to the old solution if it comes this near to it, relative to its size."""
_HALVINGS = 6


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
        if start is not None:
            begin = start.parameters[name] if isinstance(start, Solution) else marched[0]
            near = attempt(problem, self._parameters(begin), guess_for(problem, start), method, start="given")
            self._last = near if near.converged else None
        self._last_value = self._last.parameters[name] if self._last is not None else marched[0]

    def run(self, callbacks: Callbacks = ()) -> Sweep:
        """March through all values, or until Ctrl-C or a callback ends it."""
        return drive(f"marching {self._name}", self._steps(), self._sweep, name=self._name, callbacks=callbacks)

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
                new = solve(self._problem, at=at, method=self._method)
            except ConvergenceError:
                new = None
            except NonFiniteError:  # at rest: nothing to start from but the last solution, which leads nowhere
                if last is None and not self._rows:
                    raise
                new = None
        if last is not None and new is not None:
            change = relative_change(last.coefficients, new.coefficients)
            if fresh or is_suspicious(change, self._last_change):
                back = self._step(new, value, self._last_value)
                if back is None or relative_change(last.coefficients, back.coefficients) > SAME:
                    self._jumps.append((len(self._rows), float(self._last_value), float(value)))
            self._last_change = change
        self._rows.append(new)
        if new is not None:
            self._last, self._last_value = new, value

    def _step(self, solution: Solution, begin: float, value: float) -> Solution | None:
        """Go from one value to another, in smaller steps where Newton's method needs them."""
        for halvings in range(_HALVINGS):
            here: Solution | None = solution
            for part in np.linspace(begin, value, 2**halvings + 1)[1:]:
                assert here is not None
                guess = self._problem.vector(here.coefficients)
                trial = attempt(self._problem, self._parameters(part), guess, self._method, start="marching")
                here = trial if trial.converged else None
                if here is None:
                    break
            if here is not None:
                return here
        return None

    def _parameters(self, value: float) -> Array:
        there = self._values.copy()
        there[self._index] = value
        return there

    def _sweep(self, ending: Ending) -> Sweep:
        problem, rows = self._problem, self._rows
        lost = np.full(problem.shape, np.nan)
        silent = np.full((len(problem.system.output_names), problem.n_harmonics + 1), np.nan + 0j)
        others = problem.system.parameters.as_dict(self._values)
        del others[self._name]
        jumps = [jump for jump in self._jumps if jump[0] < len(rows)]
        return Sweep(
            name=self._name,
            parameter=self._marched[: len(rows)],
            coefficients=np.array([lost if s is None else s.coefficients for s in rows]).reshape(-1, *lost.shape),
            amplitudes=np.array([silent if s is None else s.amplitudes for s in rows]).reshape(-1, *silent.shape),
            output_names=problem.system.output_names,
            converged=np.array([s is not None for s in rows], dtype=bool),
            jumps=np.array([jump[0] for jump in jumps], dtype=int),
            jump_brackets=np.array([jump[1:] for jump in jumps], dtype=float).reshape(-1, 2),
            parameters=others,
            periods=problem.periods,
            complete=len(rows) == self._marched.size,
            message=self._message(ending),
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
