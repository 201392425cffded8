"""Pictures of the flow: vorticity, animation, loads over time."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

from hbnlp.core.checks import flag, instance_of, interval, real_number, whole_number
from hbnlp.core.types import Array
from hbnlp.plot.arguments import axes, result
from hbnlp.plot.film import film_name, write_film

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hbnlp.dns.history import History
    from hbnlp.dns.observers import Snapshot

# an even number of edges leaves the band about zero white
_STEPS = 26


def plot_vorticity(
    snapshot: Snapshot,
    ax: Axes | None = None,
    *,
    limit: float = 5.0,
    levels: int = 2,
    x: tuple[float, float] | None = None,
    y: tuple[float, float] | None = None,
    bar: bool = True,
) -> Axes:
    """Draw vorticity and body in axes fixed in space.

    Parameters
    ----------
    snapshot : Snapshot
        The flow.
    ax : Axes, optional
        Where to draw; a new figure by default.
    limit : float
        Vorticity, in U/c, at which the colours saturate.
    levels : int
        Number of grid levels to show.
    x, y : tuple of float, optional
        Part of the plane to show; default the outermost level shown.
    bar : bool
        Whether a bar beside the axes tells the colours.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    result("snapshot", snapshot, "Snapshot")
    real_number("limit", limit, above=0.0)
    whole_number("levels", levels, least=1)
    flag("bar", bar)
    x, y = (None if given is None else interval(name, given) for name, given in (("x", x), ("y", y)))
    ax = axes(ax, figsize=(8.0, 4.5))
    bands = np.linspace(-limit, limit, _STEPS)
    if bar:
        _tell_colours(ax, limit)
    shown = min(levels, len(snapshot.vorticity))
    for level in reversed(range(shown)):
        px, py = _in_space(snapshot, snapshot.x[level], snapshot.y[level])
        ax.contourf(px, py, np.clip(snapshot.vorticity[level], -limit, limit), bands, cmap="RdBu_r")
    bx, by = _in_space(snapshot, snapshot.outline[:, 0], snapshot.outline[:, 1])
    ax.plot(bx, by, color="black", linewidth=2.0, solid_capstyle="round")
    px, py = snapshot.x[shown - 1], snapshot.y[shown - 1]
    ax.set(
        xlim=x or (px.min(), px.max()), ylim=y or (py.min(), py.max()), aspect="equal", xlabel="$x/c$", ylabel="$y/c$"
    )
    ax.set_title(f"$tU/c = {snapshot.time:.2f}$")
    return ax


def animate(
    snapshots: list[Snapshot],
    path: str | os.PathLike[str],
    *,
    frames_per_second: int = 15,
    limit: float = 5.0,
    x: tuple[float, float] | None = None,
    y: tuple[float, float] | None = None,
) -> None:
    """Write a film of vorticity: .gif, .html, or .mp4 where ffmpeg is installed.

    Raises
    ------
    ValueError
        If there are no snapshots, or the name of the file ends in something else.
    SaveError
        (An `OSError`.) If the file cannot be written.
    """
    film_name("path", path)
    whole_number("frames_per_second", frames_per_second, least=1, most=1000)
    instance_of("snapshots", snapshots, list, "a list of snapshots, dns.Snapshots(every=...).taken")
    for snapshot in snapshots:
        result("an entry of snapshots", snapshot, "Snapshot")
    real_number("limit", limit, above=0.0)
    for name, given in (("x", x), ("y", y)):
        if given is not None:
            interval(name, given)
    if not snapshots:
        raise ValueError("there are no snapshots; collect some with dns.Snapshots(every=...) as the callback of run")
    figure = Figure(figsize=(7.0, 4.0), dpi=80, layout="constrained")
    ax = figure.subplots()
    _tell_colours(ax, limit)

    def draw(k: int) -> None:
        ax.clear()
        plot_vorticity(snapshots[k], ax, limit=limit, x=x, y=y, bar=False)

    write_film(path, figure, draw, len(snapshots), frames_per_second=frames_per_second)


def plot_loads(history: History, ax: Axes | None = None) -> Axes:
    """Draw C_L and C_D over time."""
    result("history", history, "History")
    ax = axes(ax)
    ax.plot(history.load_time, history.lift, label="$C_L$")
    ax.plot(history.load_time, history.drag, label="$C_D$")
    ax.set(xlabel="$tU/c$", ylabel="load coefficients")
    ax.legend()
    return ax


def _tell_colours(ax: Axes, limit: float) -> None:
    """Draw the bar that tells the colours of vorticity, which saturate at its ends."""
    scale = ScalarMappable(BoundaryNorm(np.linspace(-limit, limit, _STEPS), 256), "RdBu_r")
    ticks = np.linspace(-limit, limit, 5)
    ax.figure.colorbar(scale, ax=ax, label="vorticity $c/U$", extend="both", ticks=ticks, format="%g", shrink=0.8)


def _in_space(snapshot: Snapshot, x: Array, y: Array) -> tuple[Array, Array]:
    c, s = math.cos(snapshot.pitch), math.sin(snapshot.pitch)
    return x * c + y * s, y * c - x * s + snapshot.heave
