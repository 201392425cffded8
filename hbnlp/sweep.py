"""Marching through values of a parameter, as experiments do: each solution starts from the last, and jumps happen."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance import HarmonicBalance
from hbnlp.errors import ConvergenceError
from hbnlp.firstorder import Method
from hbnlp.fourier import Array, ComplexArray
from hbnlp.marching import march
from hbnlp.newton import Newton
from hbnlp.parameters import unknown_name
from hbnlp.solution import Solution
from hbnlp.solve import attempt, solve
from hbnlp.storage import load_arrays, save_arrays
from hbnlp.system import System
from hbnlp.timesweep import TimeSweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

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
    converged: NDArray[np.bool_]
    jumps: NDArray[np.int_]
    jump_brackets: Array
    parameters: Mapping[str, float]
    periods: int

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
        metadata = {"name": self.name, "output_names": self.output_names, "periods": self.periods}
        save_arrays(path, _KIND, arrays, {**metadata, "parameters": dict(self.parameters)})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Sweep:
        """Return a sweep from a file that `save` wrote."""
        arrays, metadata = load_arrays(path, _KIND)
        content: dict[str, Any] = {**{key: arrays[key] for key in _ARRAYS}, **metadata}
        return cls(**{**content, "output_names": tuple(metadata["output_names"])})

    def __repr__(self) -> str:
        jumps = ", ".join(f"{low:.6g}..{high:.6g}" for low, high in self.jump_brackets) or "none"
        return (
            f"Sweep in {self.name!r}: {len(self)} values from {self.parameter[0]:g} to {self.parameter[-1]:g}, "
            f"{np.count_nonzero(self.converged)} converged\n  jumps: {jumps}"
        )


_ARRAYS = ("parameter", "coefficients", "amplitudes", "converged", "jumps", "jump_brackets")


@overload
def sweep(
    subject: HarmonicBalance,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Newton | None = None,
    **options: Any,
) -> Sweep: ...
@overload
def sweep(
    subject: System,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Method | None = None,
    **options: Any,
) -> TimeSweep: ...
def sweep(
    subject: HarmonicBalance | System,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Any = None,
    **options: Any,
) -> Sweep | TimeSweep:
    """March through values of a parameter, each solution starting from the last; jumps are recorded.

    Parameters
    ----------
    subject : HarmonicBalance or System
        A balance is marched by Newton's method, a system by direct integration.
    name : str
    values : array (k,)
        In the order of marching: rising for a sweep up, falling for a sweep down.
    at : mapping, optional
        Values of the other parameters.
    method : Newton, or RungeKutta4 or Adaptive
        For a balance or a system, respectively.
    **options
        For a balance: ``start``, a Solution to begin from. For a system: those of `hbnlp.marching.march`.

    Returns
    -------
    Sweep or TimeSweep
    """
    if isinstance(subject, System):
        if method is not None and not callable(getattr(method, "propagator", None)):
            raise TypeError(f"method is {method!r}; a System is marched by RungeKutta4(...) or Adaptive(...)")
        return march(subject, name, values, at=at, **({"method": method} if method is not None else {}), **options)
    if not isinstance(subject, HarmonicBalance):
        raise TypeError(f"subject is {subject!r}; a HarmonicBalance or a System is needed")
    return _by_newton(subject, name, values, at=at, method=method or Newton(), **options)


def _by_newton(
    problem: HarmonicBalance,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None,
    method: Newton,
    start: Solution | None = None,
) -> Sweep:
    marched = np.atleast_1d(np.array(values, dtype=float))
    if marched.ndim != 1 or marched.size == 0 or not np.all(np.isfinite(marched)):
        raise ValueError(f"values = {values!r}; a sequence of finite numbers, at least one, is needed")
    if not isinstance(method, Newton):
        raise TypeError(f"method is {method!r}; a HarmonicBalance is marched by Newton(...), a System by integration")
    point = problem.values(at, but=(name,))
    index = problem.system.parameters.index(name)

    def parameters(value: float) -> Array:
        there = point.copy()
        there[index] = value
        return there

    def named(value: float) -> dict[str, float]:
        return problem.system.parameters.as_dict(parameters(value))

    def step(solution: Solution, begin: float, value: float) -> Solution | None:
        """Go from one value to another, in smaller steps where Newton's method needs them."""
        for halvings in range(_HALVINGS):
            here: Solution | None = solution
            for part in np.linspace(begin, value, 2**halvings + 1)[1:]:
                assert here is not None
                trial = attempt(problem, parameters(part), problem.vector(here.coefficients), method, start="marching")
                here = trial if trial.converged else None
                if here is None:
                    break
            if here is not None:
                return here
        return None

    last: Solution | None = start
    last_value = start.parameters[name] if start is not None else marched[0]
    rows: list[Solution | None] = []
    jumps: list[int] = []
    brackets: list[tuple[float, float]] = []
    for i, value in enumerate(marched):
        new = step(last, last_value, value) if last is not None else None
        fresh = new is None
        if fresh:
            try:
                new = solve(problem, at=named(value), method=method)
            except ConvergenceError:
                new = None
        if last is not None and new is not None and (fresh or _moved(last, new) > SUSPICIOUS):
            back = step(new, value, last_value)
            if back is None or _moved(last, back) > 1e-6:
                jumps.append(i)
                brackets.append((float(last_value), float(value)))
        rows.append(new)
        if new is not None:
            last, last_value = new, value
    shape, n_outputs = problem.shape, len(problem.system.output_names)
    lost, silent = np.full(shape, np.nan), np.full((n_outputs, problem.n_harmonics + 1), np.nan + 0j)
    others = problem.system.parameters.as_dict(point)
    del others[name]
    return Sweep(
        name=name,
        parameter=marched,
        coefficients=np.array([lost if s is None else s.coefficients for s in rows]),
        amplitudes=np.array([silent if s is None else s.amplitudes for s in rows]),
        output_names=problem.system.output_names,
        converged=np.array([s is not None for s in rows]),
        jumps=np.array(jumps, dtype=int),
        jump_brackets=np.array(brackets, dtype=float).reshape(-1, 2),
        parameters=others,
        periods=problem.periods,
    )


def _moved(before: Solution, after: Solution) -> float:
    """Return the change of the solution relative to the larger of the two."""
    a, b = before.coefficients, after.coefficients
    size = max(float(np.linalg.norm(a)), float(np.linalg.norm(b)), float(np.finfo(float).tiny))
    return float(np.linalg.norm(a - b)) / size
