"""Branches with their stability and special points, sweeps with their jumps, fold curves.

Stable is solid and thick, unstable dashed and thin; where stability was not computed, solid and thin. Each kind of
special point has one marker and one legend entry. A branch that was traced to a tolerance can show by its colour how
many harmonics that takes.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from hbnlp.core.checks import flag, list_of, refused, whole_number
from hbnlp.core.kinds import FoldEvent, Kind
from hbnlp.core.types import Array, BoolArray
from hbnlp.fourier import resize
from hbnlp.plot.along import Along, Ordinate
from hbnlp.plot.arguments import axes, axis, check_color, check_label, result
from hbnlp.plot.smooth import Line, place_between

if TYPE_CHECKING:
    from hbnlp.branches.branch import Branch
    from hbnlp.branches.fold_curves import FoldBranch
    from hbnlp.branches.special_points import SpecialPoint
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
    codes: bool = False,
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
    codes : bool
        Whether the letters of its kind, LP for a fold, stand beside each mark; see `Kind`.
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
    ordinate = _checked(output, harmonic, per, decibels)
    check_label(label)
    by_number = isinstance(color, str) and color == BY_NUMBER
    if not by_number:
        check_color(color, f", or {BY_NUMBER!r}")
    wanted = _kinds(special)
    flag("codes", codes)
    ordinate.check(branch)
    within = _within(branch, validity)
    ax = axes(ax)
    _draw(ax, branch, ordinate, within, color=color, label=label, by_number=by_number)
    _mark(
        ax,
        [(point, ordinate.at(point.solution, branch.periods)) for point in branch.special_points],
        wanted,
        codes=codes,
    )
    _finish(ax, axis(branch, branch.name), ordinate.label(branch, branch.periods))
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
    codes: bool = False,
    validity: Sequence[Validity] | None = None,
) -> Axes:
    """Draw the amplitude of one harmonic of an output along all branches of a diagram, each in its colour.

    A branch that was switched to is drawn from the special point at which it begins.

    Parameters
    ----------
    diagram : Diagram
    output, ax, per, decibels, special, codes
        As for `plot_branch`.
    harmonic : int
        Of the motions that the diagram begins with, and of the same frequency on branches of twice their period.
    validity : sequence of Validity, optional
        ``[wing.validity(branch) for branch in diagram.branches]``: where a limit is exceeded a branch is shaded.

    Returns
    -------
    Axes
    """
    result("diagram", diagram, "Diagram")
    whole_number("harmonic", harmonic, least=0)
    wanted = _kinds(special)
    flag("codes", codes)
    if validity is not None and (not isinstance(validity, Sequence) or len(validity) != len(diagram)):
        raise refused(ValueError, "validity", validity, f"one of each of the {len(diagram)} branches, in their order")
    judged: Sequence[Validity | None] = validity or [None] * len(diagram)
    within = [_within(branch, each) for branch, each in zip(diagram.branches, judged, strict=True)]
    base = min((branch.periods for branch in diagram.branches), default=1)
    ordinates = [_checked(output, harmonic * branch.periods // base, per, decibels) for branch in diagram.branches]
    for branch, ordinate in zip(diagram.branches, ordinates, strict=True):
        ordinate.check(branch)
    ax = axes(ax)
    for branch, origin, ordinate, holds in zip(diagram.branches, diagram.origins, ordinates, within, strict=True):
        begin = None if origin.junction is None else diagram.junctions[origin.junction].point
        _draw(ax, branch, ordinate, holds, begin=begin)
    met = [(junction.point, junction.branches[0]) for junction in diagram.special_points]
    levels = [ordinates[on].at(point.solution, diagram.branches[on].periods) for point, on in met]
    _mark(ax, [(point, level) for (point, _), level in zip(met, levels, strict=True)], wanted, codes=codes)
    _finish(ax, axis(diagram, diagram.name), _checked(output, harmonic, per, decibels).label(diagram, base))
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
    jumps: bool = True,
    **options: Any,
) -> Axes:
    """Draw one harmonic of an output along a sweep as `plot_branch` does; a jump is an arrow, no part of the curve.

    Without ``jumps`` there are no arrows, and the curve has gaps.
    """
    result("sweep", sweep, "Sweep", "TimeSweep")
    flag("jumps", jumps)
    ordinate = _checked(output, harmonic, per, decibels)
    check_label(label)
    ordinate.check(sweep)
    level = ordinate.of(sweep)
    ax = axes(ax)
    places = sorted(int(jump) for jump in sweep.jumps)
    edges = [0, *places, len(sweep)]
    style = {"marker": ".", "markersize": 3.0, "linewidth": 1.0, **options}
    for k, (begin, end) in enumerate(itertools.pairwise(edges)):
        line = ax.plot(sweep.parameter[begin:end], level[begin:end], label=label if k == 0 else None, **style)[0]
        style["color"] = line.get_color()
    for jump in places if jumps else ():
        ax.annotate(
            "",
            xy=(sweep.parameter[jump], level[jump]),
            xytext=(sweep.parameter[jump - 1], level[jump - 1]),
            arrowprops={"arrowstyle": "->", "color": style["color"], "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0},
        )
    _finish(ax, axis(sweep, sweep.name), ordinate.label(sweep, sweep.periods))
    return ax


def plot_fold_curve(
    curve: FoldBranch, *, ax: Axes | None = None, label: str | None = None, special: bool = True, **options: Any
) -> Axes:
    """Draw a curve of folds or events in the plane of its two parameters, with its cusps, isola births and merges.

    Without ``special`` the line alone is drawn; options go to matplotlib's line.
    """
    result("curve", curve, "FoldBranch")
    check_label(label)
    flag("special", special)
    ax = axes(ax)
    first, second = _through(curve)
    ax.plot(
        first,
        second,
        **{"color": "tab:red", "linewidth": 1.6, **options},
        label=label or curve.event or "folds",
    )
    for kind, (marker, paint) in EVENT_MARKERS.items():
        events = curve.of_kind(kind)
        if events and special:
            x, y = [e.first for e in events], [e.second for e in events]
            style: dict[str, Any] = {"marker": marker, "color": paint, "linestyle": "none", "markersize": 6}
            ax.plot(x, y, **style, zorder=3)
            _explain(ax, kind.value, **style)
    ax.set_xlabel(axis(curve, curve.names[0]))
    ax.set_ylabel(axis(curve, curve.names[1]))
    ax.legend(frameon=False)
    return ax


def _checked(output: str, harmonic: int, per: str | None, decibels: bool) -> Ordinate:
    flag("decibels", decibels)
    return Ordinate(output=output, harmonic=harmonic, per=per, decibels=decibels)


def _kinds(special: bool | Collection[Kind]) -> Collection[Kind]:
    """Return the kinds of special points that are marked."""
    if isinstance(special, bool):
        return tuple(Kind) if special else ()
    given = special if isinstance(special, str) else [*special] if isinstance(special, Collection) else special
    list_of("special", given, Kind, "True, False or kinds, such as [Kind.FOLD]")
    return special


def _within(branch: Branch, validity: Validity | None) -> BoolArray:
    """Return whether the model holds at each point of a branch and its next one."""
    if validity is None:
        return np.ones(len(branch), dtype=bool)
    result("validity", validity, "Validity")
    if len(validity) != len(branch):
        raise refused(ValueError, "validity", validity, f"that of this branch, of {len(branch)} points")
    holds: BoolArray = validity.within & np.append(validity.within[1:], True)
    return holds


def _draw(
    ax: Axes,
    branch: Branch,
    ordinate: Ordinate,
    within: BoolArray,
    *,
    begin: SpecialPoint | None = None,
    color: Any = None,
    label: str | None = None,
    by_number: bool = False,
) -> None:
    """Draw the line of one branch, and add what explains it to the legend."""
    color = ax.plot([], [], color="0.5" if by_number else color, label=label or "_branch")[0].get_color()
    if not len(branch):
        return
    stable = branch.stable if branch.stable is not None else np.ones(len(branch), dtype=bool)
    solid = STABLE if branch.stable is not None else UNKNOWN
    numbers = branch.n_harmonics if by_number else np.zeros(len(branch), dtype=int)
    colors = _bar(ax, np.unique(numbers)) if by_number else {0: color}
    along = Along.of(branch, ordinate, np.column_stack([stable, numbers, within]), begin)
    for parameter, level, (_, _, holds) in along.pieces(2):
        if not holds:
            ax.plot(parameter, level, **BEYOND)
            _explain(ax, "beyond the model", **BEYOND)
    for parameter, level, (steady, number, _) in along.pieces(0, 1):
        ax.plot(parameter, level, color=colors[number], **(solid if steady else UNSTABLE))
    if not stable.all():
        _explain(ax, "stable", color="0.3", **STABLE)
        _explain(ax, "unstable", color="0.3", **UNSTABLE)


def _mark(ax: Axes, points: Sequence[tuple[SpecialPoint, float]], wanted: Collection[Kind], *, codes: bool) -> None:
    """Mark special points at their levels, with one legend entry a kind."""
    for kind, (marker, paint) in MARKERS.items():
        here = [(point.value, level) for point, level in points if point.kind is kind]
        if here and kind in wanted:
            style: dict[str, Any] = {"marker": marker, "color": paint, "markersize": 5.5, "linestyle": "none"}
            ax.plot(*np.array(here).T, **style, markeredgecolor="white", markeredgewidth=0.6, zorder=3)
            _explain(ax, kind.value, **style)
            for place in here if codes else ():
                ax.annotate(kind.code, place, (4.0, 4.0), textcoords="offset points", fontsize="small", color=paint)


def _through(curve: FoldBranch) -> tuple[Array, Array]:
    """Return a smooth line through the points and events of a curve, in the plane of its parameters."""
    plane, motions = np.column_stack([curve.first, curve.second]), curve.coefficients
    cusps: list[int] = []
    turns: list[int] = []
    for event in curve.events:
        motion = resize(event.coefficients, motions.shape[2] // 2)
        at = place_between(plane, motions, np.array([event.first, event.second]), motion)
        plane, motions = (
            np.insert(plane, at, [event.first, event.second], axis=0),
            np.insert(motions, at, motion, axis=0),
        )
        cusps, turns = ([i + (i >= at) for i in places] for places in (cusps, turns))
        (cusps if event.kind is FoldEvent.CUSP else turns).append(at)
    line = Line(plane, motions)
    return line(plane[:, 0], still=cusps), line(plane[:, 1], still=[*cusps, *turns])


def _bar(ax: Axes, numbers: Array) -> dict[int, Any]:
    """Return a colour for each of the numbers of harmonics, in order, and draw the bar that tells them."""
    places = np.arange(len(numbers))
    scale = ScalarMappable(BoundaryNorm([*(places - 0.5), len(numbers) - 0.5], 256), "viridis_r")
    bar = plt.colorbar(scale, ax=ax, label="number of harmonics", ticks=places[:: 1 + len(numbers) // 12])
    bar.minorticks_off()
    bar.ax.set_yticklabels([f"{number}" for number in numbers[:: 1 + len(numbers) // 12]])
    return dict(zip(numbers.tolist(), map(tuple, scale.to_rgba(places)), strict=True))


def _explain(ax: Axes, label: str, **style: Any) -> None:
    """Add a legend entry without data, once."""
    if label not in ax.get_legend_handles_labels()[1]:
        ax.plot([], [], label=label, **style)


def _finish(ax: Axes, parameter: str, level: str) -> None:
    ax.set_xlabel(parameter)
    ax.set_ylabel(level)
    if ax.get_xscale() == "log":
        ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
    if ax.get_legend_handles_labels()[1]:
        ax.legend(frameon=False)
