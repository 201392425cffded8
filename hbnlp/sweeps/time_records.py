"""What marching by direct integration returns: responses along a parameter with their jumps, in one file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from hbnlp.core.checks import unknown_name
from hbnlp.core.storage import load_arrays, save_arrays
from hbnlp.core.types import Array, BoolArray, ComplexArray, IntArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_KIND = "time sweep"
_ARRAYS = ("parameter", "amplitudes", "states", "periodic", "defects", "n_periods", "jumps", "jump_brackets")
_METADATA = ("name", "output_names", "parameters", "periods", "method", "complete", "message")


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
        """Return the complex amplitudes of a named output, (k, H+1)."""
        if output not in self.output_names:
            raise KeyError(unknown_name("output", output, self.output_names))
        return self.amplitudes[:, self.output_names.index(output)]

    def plot(self, output: str, *, ax: Axes | None = None, harmonic: int = 1, **options: Any) -> Axes:
        """Draw the amplitude of one harmonic of an output, jumps as arrows; see `hbnlp.plot.plot_sweep`."""
        from hbnlp.plot import plot_sweep

        return plot_sweep(self, output, ax=ax, harmonic=harmonic, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the sweep to one ``.npz`` file (no pickle; all of it or nothing).

        Raises
        ------
        SaveError
            If the file cannot be written.
        """
        arrays = {key: getattr(self, key) for key in _ARRAYS}
        save_arrays(Path(path), _KIND, arrays, {key: getattr(self, key) for key in _METADATA})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> TimeSweep:
        """Read a sweep that `save` wrote."""
        arrays, metadata = load_arrays(Path(path), _KIND)
        try:
            content: dict[str, Any] = {**{k: arrays[k] for k in _ARRAYS}, **{k: metadata[k] for k in _METADATA}}
        except KeyError as error:
            raise ValueError(f"{str(path)!r} has no {error}; it is damaged, or from another version") from error
        content["output_names"] = tuple(content["output_names"])
        return cls(**content)

    def __repr__(self) -> str:
        span = f"{self.parameter[0]:g} to {self.parameter[-1]:g}" if len(self) else "none"
        jumps = ", ".join(f"{low:g}..{high:g}" for low, high in self.jump_brackets) or "none"
        return (
            f"TimeSweep in {self.name!r}: {len(self)} responses ({span}), {int(self.periodic.sum())} of them periodic\n"
            f"  outputs: {', '.join(self.output_names)}; {self.amplitudes.shape[2] - 1} harmonics\n"
            f"  jumps: {jumps}\n"
            f"  {self.message}"
        )
