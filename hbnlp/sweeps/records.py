"""What marching returns: responses along a parameter with their jumps, each kind in one file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from hbnlp.core.checks import position
from hbnlp.core.records import Layout, load_record, save_record
from hbnlp.core.types import Array, BoolArray, ComplexArray, IntArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@final
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
        return self.amplitudes[:, position("output", output, self.output_names)]

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

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Sweep:
        """Return a sweep from a file that `save` wrote.

        Raises
        ------
        FileNotFoundError, ValueError
            If there is no such file, or it is damaged or holds something else.
        """
        return cls(**load_record(path, _SWEEP))

    def __repr__(self) -> str:
        jumps = ", ".join(f"{low:.6g}..{high:.6g}" for low, high in self.jump_brackets) or "none"
        extent = f" from {self.parameter[0]:g} to {self.parameter[-1]:g}" if len(self) else ""
        return (
            f"Sweep in {self.name!r}: {len(self)} values{extent}, {np.count_nonzero(self.converged)} converged\n"
            f"  jumps: {jumps}\n  {self.message}"
        )


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TimeSweep:
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

    Notes
    -----
    A jump is a change that the way back does not undo. Where the displacements' harmonics change by more than 5 % from
    one periodic response to the next (or by more than 0.1 % and five times the change before), the parameter is taken
    back from the new state; if the response then stays nearer to the new one than to the old, the old branch was left.
    A steep but continuous response returns. A jump smaller than these bounds is not seen; responses that are not
    periodic are passed over, and the bracket of a jump across them is as much wider.
    """

    name: str
    parameter: Array
    amplitudes: ComplexArray
    output_names: tuple[str, ...]
    states: Array
    periodic: BoolArray
    defects: Array
    n_periods: IntArray
    jumps: IntArray
    jump_brackets: Array
    parameters: dict[str, float]
    periods: int
    method: str
    complete: bool
    message: str

    def __len__(self) -> int:
        return int(self.parameter.size)

    def harmonics(self, output: str) -> ComplexArray:
        """Return the complex amplitudes (k, H+1) of a named output."""
        return self.amplitudes[:, position("output", output, self.output_names)]

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

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> TimeSweep:
        """Return a sweep from a file that `save` wrote.

        Raises
        ------
        FileNotFoundError, ValueError
            If there is no such file, or it is damaged or holds something else.
        """
        return cls(**load_record(path, _TIME_SWEEP))

    def __repr__(self) -> str:
        span = f"{self.parameter[0]:g} to {self.parameter[-1]:g}" if len(self) else "none"
        jumps = ", ".join(f"{low:g}..{high:g}" for low, high in self.jump_brackets) or "none"
        return (
            f"TimeSweep in {self.name!r}: {len(self)} responses ({span}), {int(self.periodic.sum())} of them periodic\n"
            f"  outputs: {', '.join(self.output_names)}; {self.amplitudes.shape[2] - 1} harmonics\n"
            f"  jumps: {jumps}\n"
            f"  {self.message}"
        )


_SHARED = ("name", "output_names", "parameters", "periods", "complete", "message")
_SWEEP = Layout(
    kind="sweep",
    arrays=("parameter", "coefficients", "amplitudes", "converged", "jumps", "jump_brackets"),
    metadata=_SHARED,
)
_TIME_SWEEP = Layout(
    kind="time sweep",
    arrays=("parameter", "amplitudes", "states", "periodic", "defects", "n_periods", "jumps", "jump_brackets"),
    metadata=(*_SHARED, "method"),
)
