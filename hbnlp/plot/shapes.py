"""The shape of a wing, or of another system, as it moves."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from hbnlp.core.checks import finite_array, flag, instance_of, whole_number
from hbnlp.core.types import Array
from hbnlp.plot.arguments import axes, result
from hbnlp.plot.film import film_name, write_film
from hbnlp.plot.motions import draw_signal, over_period

if TYPE_CHECKING:
    from hbnlp.solutions.solution import Solution

Modes = Callable[[Array], Any]
WING = {"alpha", "z", "midchord", "W1"}
"""Outputs by which a membrane wing is known, whose displacements are amplitudes of sin(k pi x)."""
PLACES = 201
"""Points along the chord."""
CYCLIC = ListedColormap(0.8 * plt.get_cmap("twilight_shifted")(np.linspace(0.0, 1.0, 256))[:, :3], "phase")
"""Colours of a phase, the same at its end as at its beginning, none of them lost on white."""


@dataclass(frozen=True)
class Shapes:
    """How the displacements of a solution look along a line.

    Attributes
    ----------
    x : array (n_x,)
        Places.
    modes : array (n_x, n_dof)
        Displacement there per displacement of the system.
    labels : (str, str)
    style : dict
        How they are drawn, for matplotlib.
    """

    x: Array
    modes: Array
    labels: tuple[str, str]
    style: dict[str, Any]


def plot_shape(
    solution: Solution,
    *,
    modes: Modes | None = None,
    in_space: bool = False,
    n_shapes: int = 12,
    ax: Axes | None = None,
    **options: Any,
) -> Axes:
    """Draw the shape at equal steps of a period, in the colour of its phase, and the mean shape dotted.

    Parameters
    ----------
    solution : Solution
        A membrane wing's is drawn as displacement w(x) along the chord, both in chords; that of another system as its
        displacements beside each other, a point each, unless there are ``modes``.
    modes : callable (x) -> array (len(x), n_dof), optional
        Shapes of the displacements at places x from 0 to 1: those of a beam, for instance. Their sum is drawn.
    in_space : bool
        Whether a wing is drawn where it is, at the height z - alpha x + w above the stream (its pitch and heave with
        the membrane's displacement; small angles), instead of in its own frame.
    n_shapes : int
        Number of shapes, 1 to 200.
    ax : Axes, optional
        Where to draw; a new figure by default.
    **options
        For matplotlib's lines.

    Returns
    -------
    Axes

    Raises
    ------
    ValueError
        If ``in_space`` is asked of what is no membrane wing, or modes are not of the shape above.
    """
    result("solution", solution, "Solution")
    whole_number("n_shapes", n_shapes, least=1, most=200)
    shapes = _shapes_of(solution, modes)
    phases = np.linspace(0.0, solution.periods, n_shapes, endpoint=False)
    drawn = _heights(solution, shapes, phases, in_space=in_space)
    mean = _heights(solution, shapes, over_period(solution)[:-1], in_space=in_space).mean(axis=1)
    ax = axes(ax)
    scale = ScalarMappable(Normalize(0.0, solution.periods), CYCLIC)
    for shape, phase in zip(drawn.T, phases, strict=True):
        ax.plot(shapes.x, shape, **{"color": scale.to_rgba(phase), "linewidth": 1.3, **shapes.style, **options})
    ax.plot(shapes.x, mean, "k:", linewidth=1.3, label="mean")
    plt.colorbar(scale, ax=ax, label="forcing periods")
    _label(ax, shapes, in_space=in_space)
    ax.legend(frameon=False)
    return ax


def animate_solution(
    solution: Solution,
    path: str | os.PathLike[str],
    *,
    output: str | None = None,
    modes: Modes | None = None,
    in_space: bool = False,
    n_frames: int = 60,
    frames_per_second: int = 20,
) -> None:
    """Write a film of one period: the moving shape within all that it passes, and an output against time below.

    Needs no display. A page of HTML holds its pictures, and plays without a network.

    Parameters
    ----------
    solution : Solution
    path : path-like
        The file: .gif, .html, or .mp4 where ffmpeg is installed.
    output : str, optional
        By default the first, the lift of a membrane wing.
    modes, in_space
        As in `plot_shape`.
    n_frames : int
        Pictures a period, 2 to 1000.
    frames_per_second : int
        1 to 100.

    Raises
    ------
    ValueError
        If the name ends in something else, or .mp4 and there is no ffmpeg; and where `plot_shape` raises one.
    SaveError
        (An `OSError`.) If the file cannot be written; an older one is as it was.
    """
    result("solution", solution, "Solution")
    film_name("path", path)
    whole_number("n_frames", n_frames, least=2, most=1000)
    whole_number("frames_per_second", frames_per_second, least=1, most=100)
    shown = next(iter(solution.output_names), "") if output is None else output
    shapes = _shapes_of(solution, modes)
    phases = np.linspace(0.0, solution.periods, n_frames, endpoint=False)
    moving = _heights(solution, shapes, phases, in_space=in_space)
    passed = _heights(solution, shapes, over_period(solution), in_space=in_space)
    figure = Figure(figsize=(6.4, 5.6), dpi=100, layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(3, 2))
    draw_signal(below, solution, shown, color="tab:blue", linewidth=1.4)
    values = solution.signal(shown, 2.0 * np.pi / solution.omega * phases)
    above.fill_between(shapes.x, passed.min(axis=1), passed.max(axis=1), color="0.9", linewidth=0.0)
    (line,) = above.plot(shapes.x, moving[:, 0], **{"color": "tab:red", "linewidth": 2.2, **shapes.style})
    (dot,) = below.plot(phases[:1], values[:1], "o", color="tab:red")
    _label(above, shapes, in_space=in_space)
    above.set_title(f"$\\omega = {solution.omega:.4g}$")
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # nothing else moves

    def draw(k: int) -> None:
        line.set_ydata(moving[:, k])
        dot.set_data(phases[k : k + 1], values[k : k + 1])

    write_film(path, figure, draw, n_frames, frames_per_second=frames_per_second)


def _shapes_of(solution: Solution, modes: Modes | None) -> Shapes:
    instance_of("modes", modes, Callable | None, "a function of places x (n_x,) that returns (n_x, n_dof), or None")
    n_dof = len(solution.coefficients)
    x = np.linspace(0.0, 1.0, PLACES)
    if modes is not None:
        values: Array = finite_array("modes(x)", modes(x.copy()), (PLACES, n_dof), advice=" for these places")
        return Shapes(x, values, ("$x$", "displacement"), {})
    if {*solution.output_names} >= WING:
        sines = np.sin(np.multiply.outer(x, np.pi * np.arange(1.0, n_dof + 1)))
        return Shapes(x, sines, ("$x/c$", "$w/c$"), {})
    return Shapes(np.arange(1.0, n_dof + 1), np.eye(n_dof), ("displacement number", "displacement"), {"marker": "o"})


def _heights(solution: Solution, shapes: Shapes, phases: Array, *, in_space: bool) -> Array:
    """Return where the places are at phases, in forcing periods, (n_x, n_phases)."""
    flag("in_space", in_space)
    t = 2.0 * np.pi / solution.omega * phases
    heights: Array = shapes.modes @ solution.displacement(t)
    if in_space:
        if not {*solution.output_names} >= WING:
            raise ValueError("in_space is True, but only a membrane wing has pitch and heave; leave it out")
        heights = heights + solution.signal("z", t) - np.multiply.outer(shapes.x, solution.signal("alpha", t))
    return heights


def _label(ax: Axes, shapes: Shapes, *, in_space: bool) -> None:
    along, height = shapes.labels
    ax.set(xlabel=along, ylabel="height above the stream $/c$" if in_space else height)
    if shapes.style:
        ax.set_xticks(shapes.x[:: 1 + len(shapes.x) // 12])
