"""Stretches of branches along which stability stays, and the intervals in which several stable motions exist."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from hbnlp.branches.branch import Branch
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.core.kinds import End, Kind


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """A part of a branch along which stability stays as it is.

    Attributes
    ----------
    branch : int
        The number of its branch.
    begin, end : int
        Its first and last point there.
    low, high : float
        The values of the parameter that it reaches, up to the special points that bound it.
    at_low, at_high : SpecialPoint or None
        These; None at an end of the branch, and where stability changes at none: with a fixed number of harmonics, too
        few, it may do so away from the folds of the equations.
    stable : bool
    modulated : bool
        Whether it lost its stability at a Neimark-Sacker point: what is seen there is a modulated motion.
    """

    branch: int
    begin: int
    end: int
    low: float
    high: float
    at_low: SpecialPoint | None = field(repr=False)
    at_high: SpecialPoint | None = field(repr=False)
    stable: bool
    modulated: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Interval:
    """Values of the parameter between which several stable motions exist.

    Attributes
    ----------
    low, high : float
    at_low, at_high : SpecialPoint or None
        What bounds it; None where a stretch has none.
    stretches : tuple of Stretch
        The stable stretches that it holds a part of.
    modulated : tuple of Stretch
        Unstable ones beside them, beyond a Neimark-Sacker point: modulated motions may exist there as well.
    """

    low: float
    high: float
    at_low: SpecialPoint | None
    at_high: SpecialPoint | None
    stretches: tuple[Stretch, ...]
    modulated: tuple[Stretch, ...]

    def __repr__(self) -> str:
        bounds = ((self.low, self.at_low), (self.high, self.at_high))
        ends = [f"{value:.8g} ({'no special point' if at is None else at.kind.value})" for value, at in bounds]
        branches = ", ".join(str(number) for number in sorted({stretch.branch for stretch in self.stretches}))
        return f"Interval from {ends[0]} to {ends[1]}: stable motions of the branches {branches}"


def stretches_of(
    number: int, branch: Branch, origin: SpecialPoint | None, known: Callable[[SpecialPoint], SpecialPoint]
) -> list[Stretch]:
    """Return the stretches of a branch that was traced with stability, in branch order; also cut where it turns.

    Parameters
    ----------
    number : int
        That of the branch in its diagram.
    branch : Branch
    origin : SpecialPoint or None
        At which it was switched to.
    known : callable
        A special point as the first of the branches that meet there has it: the others have it up to round-off.

    Raises
    ------
    ValueError
        If it was traced without.
    """
    if branch.stable is None:
        raise ValueError("the diagram was made without stability, which this needs: explore(..., stability=Floquet())")
    stable, parameter = branch.stable, branch.parameter
    turns = {point.index for point in branch.folds}
    cuts = [i for i in range(len(branch) - 1) if stable[i] != stable[i + 1] or i in turns]
    stretches, before = [], origin
    for begin, end in zip([0, *(cut + 1 for cut in cuts)], [*cuts, len(branch) - 1], strict=True):
        if end < len(branch) - 1:
            after = _bound(branch, end, known, first=bool(stable[end]))
        else:  # one that met another branch ends with its step across that
            after = known(_bounds(branch)[-1]) if branch.end is End.MET else None
        ends = [(_value(before, parameter[begin]), before), (_value(after, parameter[end]), after)]
        (low, at_low), (high, at_high) = sorted(ends, key=lambda each: each[0])
        bounds = [point.kind for point in (before, after) if point is not None]
        stretches.append(
            Stretch(
                branch=number,
                begin=begin,
                end=end,
                low=low,
                high=high,
                at_low=at_low,
                at_high=at_high,
                stable=bool(stable[begin]),
                modulated=not stable[begin] and Kind.NEIMARK_SACKER in bounds,
            )
        )
        before = _bound(branch, end, known, first=False) if end < len(branch) - 1 else None
    return stretches


def intervals_of(stretches: Sequence[Stretch]) -> list[Interval]:
    """Return the intervals in which two or more stable stretches lie beside each other."""
    stable = [stretch for stretch in stretches if stretch.stable and stretch.high > stretch.low]
    bounds = sorted({value for stretch in stable for value in (stretch.low, stretch.high)})
    intervals: list[list[float]] = []
    for low, high in pairwise(bounds):
        middle = 0.5 * (low + high)
        if sum(stretch.low < middle < stretch.high for stretch in stable) < 2:
            continue
        if intervals and intervals[-1][1] == low:
            intervals[-1][1] = high
        else:
            intervals.append([low, high])
    return [_interval(low, high, stretches) for low, high in intervals]


def _interval(low: float, high: float, stretches: Sequence[Stretch]) -> Interval:
    inside = [each for each in stretches if each.low < high and each.high > low]
    stable = tuple(each for each in inside if each.stable)
    return Interval(
        low=low,
        high=high,
        at_low=next((s.at_low if s.low == low else s.at_high for s in stable if low in (s.low, s.high)), None),
        at_high=next((s.at_high if s.high == high else s.at_low for s in stable if high in (s.low, s.high)), None),
        stretches=stable,
        modulated=tuple(each for each in inside if each.modulated),
    )


def _bound(
    branch: Branch, index: int, known: Callable[[SpecialPoint], SpecialPoint], *, first: bool
) -> SpecialPoint | None:
    """Return the special point in a step at which stability changes: the first of several, or the last."""
    inside = [point for point in _bounds(branch) if point.index == index]
    return None if not inside else known(inside[0 if first else -1])


def _bounds(branch: Branch) -> list[SpecialPoint]:
    """Return the special points at which stability may change: all but what the user looks for."""
    return [point for point in branch.special_points if point.kind is not Kind.EVENT]


def _value(point: SpecialPoint | None, otherwise: float) -> float:
    return float(otherwise) if point is None else point.value
