"""Marching through values of a parameter by Newton's method: each solution starts from the last, and jumps happen."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Newton
from hbnlp.core.callbacks import Callbacks, Observers, StopTracing, ended_by
from hbnlp.core.checks import finite_numbers, unknown_name
from hbnlp.core.errors import ConvergenceError, TaskError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.storage import load_arrays, save_arrays
from hbnlp.core.types import Array, BoolArray, ComplexArray, IntArray
from hbnlp.solutions.solution import Solution, guess_for
from hbnlp.solutions.solving import attempt, solve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

logger = logging.getLogger(__name__)

_KIND = "sweep"
SUSPICIOUS = 0.02
"""A relative change of the solution that calls for the proof whether it is a jump."""
_HALVINGS = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """Solutions along values of one parameter, in the order of marching.

    Attributes
    ----------
    name : str
    parameter : array (k,)
    coefficients : array (k, n_dof, 2H+1)
    amplitudes : array (k, n_outputs, H+1), complex
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

    Notes
    -----
    A jump is a change that the way back does not undo: where the solution changes by more than 2 %, or Newton's method
    needs a new start, the parameter is taken back, and the old solution must come out again.
    """

    name: str
    parameter: Array
    coefficients: Array
    amplitudes: ComplexArray
    output_names: tuple[str, ...]
    converged: BoolArray
    jumps: IntArray
    jump_brackets: Array
    parameters: Mapping[str, float]
    periods: int
    complete: bool
    message: str

    def __len__(self) -> int:
        return int(self.parameter.size)

    def harmonics(self, output: str) -> ComplexArray:
        """Return the complex amplitudes (k, H+1) of a named output."""
        if output not in self.output_names:
            raise KeyError(unknown_name("output", output, self.output_names))
        return self.amplitudes[:, self.output_names.index(output)]

    def plot(self, output: str, *, ax: Axes | None = None, harmonic: int = 1, **options: Any) -> Axes:
        """Draw the amplitude of one harmonic of an output, jumps as arrows; see `hbnlp.plot.plot_sweep`."""
        from hbnlp.plot import plot_sweep

        return plot_sweep(self, output, ax=ax, harmonic=harmonic, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the sweep to one ``.npz`` file without pickle, whole or not at all."""
        arrays = {key: getattr(self, key) for key in _ARRAYS}
        metadata = {key: getattr(self, key) for key in _METADATA}
        save_arrays(path, _KIND, arrays, {**metadata, "parameters": dict(self.parameters)})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Sweep:
        """Return a sweep from a file that `save` wrote."""
        arrays, metadata = load_arrays(path, _KIND)
        content: dict[str, Any] = {**{key: arrays[key] for key in _ARRAYS}, **metadata}
        return cls(**{**content, "output_names": tuple(metadata["output_names"])})

    def __repr__(self) -> str:
        jumps = ", ".join(f"{low:.6g}..{high:.6g}" for low, high in self.jump_brackets) or "none"
        extent = f" from {self.parameter[0]:g} to {self.parameter[-1]:g}" if len(self) else ""
        return (
            f"Sweep in {self.name!r}: {len(self)} values{extent}, {np.count_nonzero(self.converged)} converged\n"
            f"  jumps: {jumps}\n  {self.message}"
        )


_ARRAYS = ("parameter", "coefficients", "amplitudes", "converged", "jumps", "jump_brackets")
_METADATA = ("name", "output_names", "periods", "complete", "message")


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
        marched = finite_numbers("values", values)
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
        if start is not None:
            begin = start.parameters[name] if isinstance(start, Solution) else marched[0]
            near = attempt(problem, self._parameters(begin), guess_for(problem, start), method, start="given")
            self._last = near if near.converged else None
        self._last_value = self._last.parameters[name] if self._last is not None else marched[0]

    def run(self, callbacks: Callbacks = ()) -> Sweep:
        """March through all values, or until Ctrl-C or a callback ends it."""
        marched, rows = self._marched, self._rows
        observers = Observers(callbacks, f"marching {self._name}", self._name)
        try:
            for value in marched:
                with interrupts_kept():
                    self._advance(value)
                counts = {"values": len(rows), "jumps": len(self._jumps)}
                observers.tell(value, len(rows) / marched.size, counts, self._sweep)
            lost = sum(row is None for row in rows)
            ending = f"all {marched.size} values reached" + (f", no solution at {lost} of them" if lost else "")
        except (KeyboardInterrupt, StopTracing) as stop:
            ending = f"{ended_by(stop)} after {len(rows)} of {marched.size} values"
            solved = [i for i, row in enumerate(rows) if row is not None]
            ending += f"; go on from start=sweep.coefficients[{solved[-1]}]" if solved else ""
            logger.warning("the sweep was %s", ending)
        except Exception as error:
            sweep = self._sweep(f"{type(error).__name__} after {len(rows)} of {marched.size} values: {error}")
            observers.finish(sweep)
            raise TaskError(f"marching {self._name}", sweep, error) from error
        sweep = self._sweep(ending)
        observers.finish(sweep)
        return sweep

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
        if last is not None and new is not None and (fresh or _moved(last, new) > SUSPICIOUS):
            back = self._step(new, value, self._last_value)
            if back is None or _moved(last, back) > 1e-6:
                self._jumps.append((len(self._rows), float(self._last_value), float(value)))
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

    def _sweep(self, message: str = "under way") -> Sweep:
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
            message=message,
        )


def _moved(before: Solution, after: Solution) -> float:
    """Return the change of the solution relative to the larger of the two."""
    a, b = before.coefficients, after.coefficients
    size = max(float(np.linalg.norm(a)), float(np.linalg.norm(b)), float(np.finfo(float).tiny))
    return float(np.linalg.norm(a - b)) / size
