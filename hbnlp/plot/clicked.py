"""The motion at a clicked point of a branch, beside it: in windows, and in notebooks by ipympl."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import Event, KeyEvent, MouseEvent
from matplotlib.figure import FigureBase

from hbnlp.core.checks import flag, instance_of, whole_number
from hbnlp.core.types import Array
from hbnlp.plot.along import Ordinate
from hbnlp.plot.arguments import result
from hbnlp.plot.branches import plot_branch
from hbnlp.plot.motions import plot_phase
from hbnlp.plot.shapes import WING, plot_shape

if TYPE_CHECKING:
    from hbnlp.branches.branch import Branch
    from hbnlp.solutions.solution import Solution

    Drawing = Callable[[Solution, Axes], Any]

REACH = 30.0
"""A click this many pixels from the nearest point of the branch, or farther, is none."""
STEPS = {"right": 1, "left": -1}
CHOSEN: dict[str, Any] = {
    "marker": "o",
    "markersize": 11.0,
    "markerfacecolor": "none",
    "markeredgecolor": "black",
    "markeredgewidth": 1.6,
    "linestyle": "none",
    "zorder": 5,
}


class Clicked:
    """A drawn branch whose points can be clicked: made by `plot_clicked`.

    Attributes
    ----------
    axes : Axes
        Those of the branch.
    index : int or None
        The point that is shown; None before the first.
    """

    def __init__(self, branch: Branch, axes: Axes, points: Array, panel: FigureBase, draw: Drawing) -> None:
        self.axes = axes
        self.index: int | None = None
        self._branch, self._points, self._panel, self._draw = branch, points, panel, draw
        self._marker = axes.plot([], [], **CHOSEN)[0]
        # a bound method is held weakly: the connection would be gone with a result that nobody keeps
        canvas = axes.figure.canvas
        self._connections = [
            canvas.mpl_connect("button_press_event", partial(Clicked._clicked, self)),
            canvas.mpl_connect("key_press_event", partial(Clicked._pressed, self)),
        ]

    @property
    def solution(self) -> Solution | None:
        """The motion that is shown."""
        return None if self.index is None else self._branch.solution(self.index)

    def show(self, index: int) -> None:
        """Show the motion at a point of the branch, as a click on it does."""
        self.index = whole_number("index", index, least=0, most=len(self._branch) - 1)
        solution = self._branch.solution(self.index)
        self._marker.set_data(self._points[[self.index], 0], self._points[[self.index], 1])
        self._panel.clear()
        ax = self._panel.subplots()
        plt.sca(ax)
        self._draw(solution, ax)
        ax.set_title(f"{self._branch.name} = {self._branch.parameter[self.index]:.6g}{self._said()}")
        for canvas in {self.axes.figure.canvas, ax.figure.canvas}:
            canvas.draw_idle()

    def disconnect(self) -> None:
        """Let clicks and keys be."""
        for connection in self._connections:
            self.axes.figure.canvas.mpl_disconnect(connection)

    def _said(self) -> str:
        stable = self._branch.stable
        return "" if stable is None else ", stable" if stable[self.index] else ", unstable"

    def _clicked(self, event: Event) -> None:
        assert isinstance(event, MouseEvent)
        zooms = bool(getattr(getattr(event.canvas, "toolbar", None), "mode", None))  # or moves the picture
        if event.inaxes is not self.axes or zooms:
            return
        pixels = self.axes.transData.transform(self._points)
        distances = np.hypot(*(pixels - (event.x, event.y)).T)
        distances[~np.isfinite(distances)] = np.inf
        if distances.min() < REACH:
            self.show(int(distances.argmin()))

    def _pressed(self, event: Event) -> None:
        assert isinstance(event, KeyEvent)
        step = STEPS.get(event.key or "", 0)
        if step and self.index is not None:
            self.show(min(max(self.index + step, 0), len(self._branch) - 1))


def plot_clicked(
    branch: Branch,
    output: str,
    *,
    ax: Axes | None = None,
    draw: Callable[[Solution, Axes], Any] | None = None,
    harmonic: int = 1,
    per: str | None = None,
    decibels: bool = False,
) -> Clicked:
    """Draw a branch, and beside it the motion at the point that is clicked; the arrow keys go to its neighbours.

    It needs a backend of matplotlib that answers: a window, or ``%matplotlib widget`` in a notebook (the extra
    ``hbnlp[notebook]``).

    Parameters
    ----------
    branch : Branch
        With a point at least.
    output : str
    ax : Axes, optional
        Where `plot_branch` has drawn this output of this branch already, with the same harmonic, ``per`` and decibels;
        motions are drawn in a figure of their own then. By default a new figure for both.
    draw : callable (solution, ax), optional
        What is drawn of a motion: ``lambda solution, ax: solution.plot(output, ax=ax)``. By default the shape of a
        membrane wing over a period, and the phase portrait of the output for other systems.
    harmonic, per, decibels
        As for `plot_branch`.

    Returns
    -------
    Clicked
        Its ``index`` and ``solution`` are those last clicked; ``show(index)`` shows another, ``disconnect()`` ends it.
    """
    result("branch", branch, "Branch")
    instance_of("draw", draw, Callable | None, "a function of (solution, ax), or None")
    instance_of("ax", ax, Axes | None, "the Axes on which the branch was drawn, or None for a new figure")
    flag("decibels", decibels)
    if not len(branch):
        raise ValueError(f"the branch has no points to click on: {branch.message}")
    ordinate = Ordinate(output=output, harmonic=harmonic, per=per, decibels=decibels)
    ordinate.check(branch)
    levels = ordinate.of(branch)
    panel: FigureBase
    if ax is None:
        whole = plt.figure(figsize=(11.0, 4.4), layout="constrained")
        grid = whole.add_gridspec(1, 2)
        left, panel = whole.add_subfigure(grid[0]), whole.add_subfigure(grid[1])
        ax = plot_branch(branch, output, ax=left.subplots(), harmonic=harmonic, per=per, decibels=decibels)
        ax.set_title("click on a point")
    else:
        panel = plt.figure(layout="constrained")
    return Clicked(branch, ax, np.column_stack([branch.parameter, levels]), panel, draw or _usual(branch, output))


def _usual(branch: Branch, output: str) -> Drawing:
    """Return what is drawn of a motion unless the user says what."""
    if {*branch.output_names} >= WING:
        return lambda solution, ax: plot_shape(solution, ax=ax)
    return lambda solution, ax: plot_phase(solution, output, ax=ax)
