"""Branches with their stability and special points, sweeps with their jumps, fold curves.

Stable is solid and thick, unstable dashed and thin; where stability was not computed, solid and thin. Each kind of
special point has one marker and one legend entry. A branch that was traced to a tolerance can show by its colour how
many harmonics that takes.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from hbnlp.core.checks import flag, list_of, refused, whole_number
from hbnlp.core.kinds import FoldEvent, Kind
from hbnlp.core.types import Array
from hbnlp.fourier import decibels
from hbnlp.plot.arguments import axes, check_color, check_label, result

if TYPE_CHECKING:
    from hbnlp.branches.branch import Branch
    from hbnlp.branches.fold_curves import FoldBranch
    from hbnlp.diagrams.diagram import Diagram
    from hbnlp.sweeps.records import Sweep, TimeSweep
    from hbnlp.wing.validity import Validity

STABLE: dict[str, Any] = {"linestyle": "-", "linewidth": 2.2}
UNKNOWN: dict[str, Any] = {"linestyle": "-", "linewidth": 1.2}
UNSTABLE: dict[str, Any] = {"linestyle": (0, (4, 2)), "linewidth": 1.0}
BEYOND: dict[str, Any] = {"color": "0.85", "linewidth": 9.0, "solid_capstyle": "round", "zorder": 0}
BY_NUMBER = "n_harmonics"
"""In the place of a colour: that of the number of harmonics."""
MARKERS = {
    Kind.FOLD: ("o", "tab:red"),
    Kind.BRANCH_POINT: ("s", "tab:purple"),
    Kind.PERIOD_DOUBLING: ("^", "tab:green"),
    Kind.NEIMARK_SACKER: ("D", "tab:orange"),
    Kind.PEAK: ("*", "black"),
    Kind.EVENT: ("X", "tab:blue"),
}
EVENT_MARKERS = {
    FoldEvent.CUSP: ("v", "tab:purple"),
    FoldEvent.ISOLA_BIRTH: ("o", "tab:green"),
    FoldEvent.ISOLA_MERGE: ("s", "tab:orange"),
}


def plot_branch(
    branch: Branch,
    output: str,
    *,
    ax: Axes | None = None,
    harmonic: int = 1,
    per: str | None = None,
    decibels: bool = False,
    special: bool | Collection[Kind] = True,
    label: str | None = None,
    color: Any = None,
    validity: Validity | None = None,
) -> Axes:
    """Draw the amplitude of one harmonic of an output along a branch.

    Parameters
    ----------
    branch : Branch
    output : str
    ax : Axes, optional
        Where to draw; a new figure by default.
    harmonic : int
        0 is the mean value, drawn with its sign (not in decibels).
    per : str, optional
        Another output by whose first harmonic the amplitude is divided: ``"alpha_acceleration"`` for a wing's C_L.
    decibels : bool
        Draw 20 log10 of the amplitude.
    special : bool or collection of Kind
        Whether to mark special points, or which kinds of them.
    label : str, optional
    color
        A colour of matplotlib, or "n_harmonics": by the number of harmonics of each step, with a bar that tells them.
    validity : Validity, optional
        ``wing.validity(branch)``: where a limit is exceeded the branch is shaded.

    Returns
    -------
    Axes
    """
    result("branch", branch, "Branch")
    flag("decibels", decibels)
    check_label(label)
    by_number = isinstance(color, str) and color == BY_NUMBER
    if not by_number:
        check_color(color, f", or {BY_NUMBER!r}")
    if not isinstance(special, bool):
        list_of(
            "special",
            special if isinstance(special, str) else [*special] if isinstance(special, Collection) else special,
            Kind,
            "True, False or kinds, such as [Kind.FOLD]",
        )
    level = _level(branch, output, harmonic, per, decibels)
    if validity is not None:
        result("validity", validity, "Validity")
        if len(validity) != len(branch):
            raise refused(ValueError, "validity", validity, f"that of this branch, of {len(branch)} points")
    ax = axes(ax)
    if validity is not None and not validity.within.all():
        shaded = np.where(validity.within, np.nan, level)
        ax.plot(branch.parameter, shaded, **BEYOND)
        _explain(ax, "beyond the model", **BEYOND)
    color = ax.plot([], [], color="0.5" if by_number else color, label=label or "_branch")[0].get_color()
    numbers = branch.n_harmonics if by_number else np.zeros(len(branch), dtype=int)
    stable = branch.stable if branch.stable is not None else np.ones(len(branch), dtype=bool)
    solid = STABLE if branch.stable is not None else UNKNOWN
    # the line goes through the located special points, which lie beyond their neighbours at a fold
    located = [p for p in branch.special_points if p.refined]
    after = [p.index + 1 for p in located]
    along = np.insert(branch.parameter, after, [p.value for p in located])
    level = np.insert(level, after, [_level(p.solution, output, harmonic, per, decibels) for p in located])
    colors = _bar(ax, np.unique(numbers)) if by_number and len(branch) else {0: color}
    for part, (steady, number) in _segments(*(np.insert(each, after, each[after]) for each in (stable, numbers))):
        ax.plot(along[part], level[part], color=colors[number], **(solid if steady else UNSTABLE))
    if not stable.all():
        _explain(ax, "stable", color="0.3", **STABLE)
        _explain(ax, "unstable", color="0.3", **UNSTABLE)
    wanted = (Kind if special else ()) if isinstance(special, bool) else special
    for kind, (marker, paint) in MARKERS.items():
        points = branch.of_kind(kind)
        if points and kind in wanted:
            x = [p.value for p in points]
            y = [float(_level(p.solution, output, harmonic, per, decibels)) for p in points]
            style: dict[str, Any] = {"marker": marker, "color": paint, "markersize": 5.5, "linestyle": "none"}
            ax.plot(x, y, **style, markeredgecolor="white", markeredgewidth=0.6, zorder=3)
            _explain(ax, kind.value, **style)
    _finish(ax, branch.name, output, harmonic, per, decibels)
    return ax


def plot_diagram(
    diagram: Diagram,
    output: str,
    *,
    ax: Axes | None = None,
    harmonic: int = 1,
    per: str | None = None,
    decibels: bool = False,
    special: bool | Collection[Kind] = True,
) -> Axes:
    """Draw the amplitude of one harmonic of an output along all branches of a diagram, each in its colour.

    Parameters
    ----------
    diagram : Diagram
    output, ax, harmonic, per, decibels, special
        As for `plot_branch`.

    Returns
    -------
    Axes
    """
    result("diagram", diagram, "Diagram")
    ax = axes(ax)
    for branch in diagram.branches:
        plot_branch(branch, output, ax=ax, harmonic=harmonic, per=per, decibels=decibels, special=special)
    return ax


def plot_sweep(
    sweep: Sweep | TimeSweep,
    output: str,
    *,
    ax: Axes | None = None,
    harmonic: int = 1,
    per: str | None = None,
    decibels: bool = False,
    label: str | None = None,
    **options: Any,
) -> Axes:
    """Draw one harmonic of an output along a sweep as `plot_branch` does; a jump is an arrow, no part of the curve."""
    result("sweep", sweep, "Sweep", "TimeSweep")
    flag("decibels", decibels)
    check_label(label)
    level = _level(sweep, output, harmonic, per, decibels)
    ax = axes(ax)
    jumps = sorted(int(jump) for jump in sweep.jumps)
    edges = [0, *jumps, len(sweep)]
    style = {"marker": ".", "markersize": 3.0, "linewidth": 1.0, **options}
    for k, (begin, end) in enumerate(itertools.pairwise(edges)):
        line = ax.plot(sweep.parameter[begin:end], level[begin:end], label=label if k == 0 else None, **style)[0]
        style["color"] = line.get_color()
    for jump in jumps:
        ax.annotate(
            "",
            xy=(sweep.parameter[jump], level[jump]),
            xytext=(sweep.parameter[jump - 1], level[jump - 1]),
            arrowprops={"arrowstyle": "->", "color": style["color"], "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0},
        )
    _finish(ax, sweep.name, output, harmonic, per, decibels)
    return ax


def plot_fold_curve(curve: FoldBranch, *, ax: Axes | None = None, label: str | None = None, **options: Any) -> Axes:
    """Draw a curve of folds or events in the plane of its two parameters, with cusps, isola births and merges."""
    result("curve", curve, "FoldBranch")
    check_label(label)
    ax = axes(ax)
    ax.plot(
        curve.first,
        curve.second,
        **{"color": "tab:red", "linewidth": 1.6, **options},
        label=label or curve.event or "folds",
    )
    for kind, (marker, paint) in EVENT_MARKERS.items():
        events = curve.of_kind(kind)
        if events:
            x, y = [e.first for e in events], [e.second for e in events]
            ax.plot(x, y, marker=marker, color=paint, linestyle="none", markersize=6, label=kind.value, zorder=3)
    ax.set_xlabel(_axis(curve.names[0]))
    ax.set_ylabel(_axis(curve.names[1]))
    ax.legend(frameon=False)
    return ax


def _level(source: Any, output: str, harmonic: int, per: str | None, in_decibels: bool) -> Array:
    """Return what is drawn for every point of a branch or sweep, or for one solution."""
    amplitudes = source.harmonics(output)
    whole_number("harmonic", harmonic, least=0, most=amplitudes.shape[-1] - 1, advice=", which are retained")
    signed = harmonic == 0 and not in_decibels  # a mean has a sign
    size = amplitudes[..., 0].real if signed else np.abs(amplitudes[..., harmonic])
    if per is not None:
        with np.errstate(divide="ignore", invalid="ignore"):  # at rest
            size = size / np.abs(source.harmonics(per)[..., 1])
    with np.errstate(divide="ignore"):
        return decibels(size) if in_decibels else np.asarray(size)


def _segments(*columns: Array) -> Iterator[tuple[slice, tuple[int, ...]]]:
    """Yield runs of equal rows; each run takes the first point of the next, so that the curve has no gap."""
    rows = np.column_stack([column.astype(int) for column in columns])
    edges = [0, *(1 + np.flatnonzero(np.any(np.diff(rows, axis=0), axis=1))), len(rows)]
    for begin, end in itertools.pairwise(edges):
        yield slice(int(begin), min(int(end) + 1, len(rows))), tuple(map(int, rows[begin]))


def _bar(ax: Axes, numbers: Array) -> dict[int, Any]:
    """Return a colour for each of the numbers of harmonics, in order, and draw the bar that tells them."""
    places = np.arange(len(numbers))
    scale = ScalarMappable(BoundaryNorm([*(places - 0.5), len(numbers) - 0.5], 256), "viridis_r")
    bar = plt.colorbar(scale, ax=ax, label="number of harmonics", ticks=places[:: 1 + len(numbers) // 12])
    bar.minorticks_off()
    bar.ax.set_yticklabels([f"{number}" for number in numbers[:: 1 + len(numbers) // 12]])
    return dict(zip(numbers.tolist(), map(tuple, scale.to_rgba(places)), strict=True))


def _axis(parameter: str) -> str:
    return r"$\omega$" if parameter == "omega" else parameter


def _explain(ax: Axes, label: str, **style: Any) -> None:
    """Add a legend entry without data, once."""
    if label not in ax.get_legend_handles_labels()[1]:
        ax.plot([], [], label=label, **style)


def _finish(ax: Axes, parameter: str, output: str, harmonic: int, per: str | None, decibels: bool) -> None:
    ax.set_xlabel(_axis(parameter))
    name = output if harmonic else f"mean of {output}"
    what = f"|{name}|" if harmonic or decibels else name
    what += f" / |{per}|" if per else ""
    notes = [*([f"harmonic {harmonic}"] if harmonic else []), *(["dB"] if decibels else [])]
    ax.set_ylabel(f"{what} ({', '.join(notes)})" if notes else what)
    if ax.get_xscale() == "log":
        ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
    if ax.get_legend_handles_labels()[1]:
        ax.legend(frameon=False)
