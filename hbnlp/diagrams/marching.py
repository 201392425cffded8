"""Where a slow march through a diagram goes: along stable stretches, on through soft bifurcations, and where it falls.

A march stays on a stable motion until that ends. Where stable motions begin at the special point that ends it, and go
on in the same way, the march goes on with these; otherwise it falls, and where it lands depends on basins of
attraction, which integration in time from the end of the stretch tells.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import lcm
from typing import TYPE_CHECKING

import numpy as np

from hbnlp.branches.special_points import SpecialPoint
from hbnlp.core.checks import counted, flag, place, real_number, refused, whole_number
from hbnlp.core.kinds import Kind
from hbnlp.diagrams.meeting import image_of, least_size
from hbnlp.diagrams.stretches import Stretch
from hbnlp.fourier import to_real
from hbnlp.integration.response import TimeResponse
from hbnlp.integration.settling import integrate
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.solution import Solution

if TYPE_CHECKING:
    from hbnlp.diagrams.diagram import Diagram

BEYOND = 1e-3
"""How far beyond the end of a stretch, relative to its value there, it is looked where the march lands."""
PUSH = 1.01
"""By what the motion at the end is multiplied before it is integrated."""
LANDED = 0.02
"""A response is, or tends to, a stable motion of the diagram that differs by less, relative to its size."""
STEP = 0.01
"""Step of a march along modulated motions, relative to the parameter where they begin."""
HELD = 100
"""Periods of the forcing that such a motion is integrated for at each step."""
REPEATS = 0.01
"""Relative change of the state over a window below which a response may be a periodic one."""
MOST_LEGS = 1000


class Next(enum.Enum):
    """What comes after a leg of a march."""

    END = "the branch ends"
    SOFT = "it goes on with the motion that begins there"
    FALL = "it falls to another motion"
    MODULATED = "it becomes modulated, until the motion is stable again"
    LOST = "it becomes modulated, and falls from there to another motion"
    OPEN = "it falls, and where to is not known"


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """What a march does on one stable stretch.

    Attributes
    ----------
    stretch : Stretch
    enters, leaves : float
        Values of the parameter at which it comes and goes.
    next : Next
        What comes after.
    candidates : tuple of Stretch
        Where it falls: the stable stretches beside that end.
    falls_at : float or None
        Where it falls: there, or farther on from a modulated motion; None if it does not.
    response : TimeResponse or None
        The integration that tells where it lands, if one was made.
    """

    stretch: Stretch
    enters: float
    leaves: float
    next: Next
    candidates: tuple[Stretch, ...] = ()
    falls_at: float | None = None
    response: TimeResponse | None = field(default=None, repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class March:
    """Where a slow march goes.

    Attributes
    ----------
    name : str
    way : str
        "up" or "down".
    legs : tuple of Leg
    """

    name: str
    way: str
    legs: tuple[Leg, ...]

    @property
    def falls(self) -> tuple[Leg, ...]:
        """The legs after which it falls, or where that is open."""
        return tuple(leg for leg in self.legs if leg.falls_at is not None)

    def __repr__(self) -> str:
        counts = f"{counted(len(self.legs), 'leg')}, {counted(len(self.falls), 'fall')}"
        legs = [
            f"\n  branch {leg.stretch.branch}, {leg.enters:.6g} to {leg.leaves:.6g}: {leg.next.value}"
            + (f", at {leg.falls_at:.6g}" if leg.next is Next.LOST else "")
            for leg in self.legs
        ]
        return f"March {self.way} in {self.name}: {counts}{''.join(legs)}"


def march(
    diagram: Diagram, way: str, *, begin: float | None, branch: int | None, integrated: bool, max_periods: int
) -> March:
    """Return where a slow march through a diagram goes; see `Diagram.march`."""
    if not isinstance(way, str) or way not in ("up", "down"):
        raise refused(ValueError, "way", way, "'up' or 'down'")
    flag("integrated", integrated)
    whole_number("max_periods", max_periods, least=1)
    if begin is not None:
        begin = real_number("begin", begin)
    if branch is not None:
        branch = place("branch", branch, len(diagram))
    return _Marcher(diagram, 1.0 if way == "up" else -1.0, integrated, max_periods).march(way, begin, branch)


class _Marcher:
    """One march; ``sign`` says which way."""

    def __init__(self, diagram: Diagram, sign: float, integrated: bool, max_periods: int) -> None:
        self._diagram, self._sign = diagram, sign
        self._integrated, self._max_periods = integrated, max_periods
        self._all = diagram.stretches()
        self._stable = [stretch for stretch in self._all if stretch.stable and stretch.high > stretch.low]
        self._periods = lcm(*(branch.periods for branch in diagram.branches))

    def march(self, way: str, begin: float | None, branch: int | None) -> March:
        name = self._diagram.name
        if not self._stable:
            raise ValueError(f"the diagram has no stable motion to march along in {name}")
        stretch = self._first(begin, branch)
        enters = self._ends(stretch)[0] if begin is None else begin
        legs: list[Leg] = []
        while len(legs) < MOST_LEGS:
            leg, following = self._leg(stretch, enters)
            legs.append(leg)
            if following is None:
                break
            # a march that falls lands beside where it fell, not at the beginning of the other stretch
            enters = leg.leaves if leg.falls_at is None else leg.falls_at
            enters = self._ends(following)[0] if leg.next is Next.MODULATED else enters
            stretch = following
        return March(name=name, way=way, legs=tuple(legs))

    def _first(self, begin: float | None, branch: int | None) -> Stretch:
        stable = [each for each in self._stable if branch is None or each.branch == branch]
        if not stable:
            raise refused(ValueError, "branch", branch, "the number of one with stable motions")
        if begin is None:
            return min(stable, key=lambda each: self._sign * self._ends(each)[0])
        there = [each for each in stable if each.low <= begin <= each.high]
        if not there:
            raise refused(ValueError, "begin", begin, f"a value of {self._diagram.name} with a stable motion")
        return there[0]

    def _ends(self, stretch: Stretch) -> tuple[float, float]:
        """Return where a march enters a stretch at the earliest, and where it leaves."""
        return (stretch.low, stretch.high) if self._sign > 0.0 else (stretch.high, stretch.low)

    def _leg(self, stretch: Stretch, enters: float) -> tuple[Leg, Stretch | None]:
        leaves = self._ends(stretch)[1]
        point = stretch.at_high if self._sign > 0.0 else stretch.at_low
        leg = Leg(stretch=stretch, enters=enters, leaves=leaves, next=Next.END)
        if point is None:
            return leg, None
        soft = [each for each in self._stable if each is not stretch and self._begin_of(each) is point]
        if soft:
            return dataclasses.replace(leg, next=Next.SOFT), soft[0]
        again = self._stable_again(stretch) if point.kind is Kind.NEIMARK_SACKER else None
        if again is not None:
            leg = dataclasses.replace(leg, next=Next.MODULATED)
            return self._modulated(leg, point.solution, again) if self._integrated else (leg, again)
        beyond = leaves + self._sign * BEYOND * abs(leaves)
        candidates = self._stable_at(beyond, but=stretch)
        leg = dataclasses.replace(leg, next=Next.OPEN, candidates=candidates, falls_at=leaves)
        if self._integrated:
            response, landed = self._landing(point.solution, beyond, candidates)
            leg = dataclasses.replace(leg, response=response)
        else:
            landed = candidates[0] if len(candidates) == 1 else None
        return (leg, None) if landed is None else (dataclasses.replace(leg, next=Next.FALL), landed)

    def _begin_of(self, stretch: Stretch) -> SpecialPoint | None:
        """Return the special point at which a march enters a stretch."""
        return stretch.at_low if self._sign > 0.0 else stretch.at_high

    def _stable_again(self, stretch: Stretch) -> Stretch | None:
        """Return the next stable stretch of the same branch the same way, beyond one that is modulated."""
        same = [each for each in self._all if each.branch == stretch.branch]
        here = same.index(stretch)
        for step in (1, -1):
            if 0 <= here + 2 * step < len(same):
                between, after = same[here + step], same[here + 2 * step]
                ahead = self._sign * (self._ends(after)[0] - self._ends(stretch)[1]) > 0.0
                if between.modulated and after.stable and ahead:
                    return after
        return None

    def _stable_at(self, value: float, *, but: Stretch) -> tuple[Stretch, ...]:
        return tuple(each for each in self._stable if each is not but and each.low <= value <= each.high)

    def _modulated(self, leg: Leg, motion: Solution, again: Stretch) -> tuple[Leg, Stretch]:
        """Return a leg that ends in modulated motions, and the stretch that a march along these comes to.

        They are integrated in time, the state carried over from step to step, until the motion is stable again or the
        response is another stable one.
        """
        begin, end = leg.leaves, self._ends(again)[0]
        step = STEP * abs(begin) or STEP * abs(end)
        start: Solution | TimeResponse = self._pushed(motion)
        held = min(HELD, self._max_periods)
        for value in begin + self._sign * np.arange(step, abs(end - begin), step):
            start = self._integrate(motion, start, float(value), held)
            if start.defects[-1] < REPEATS:
                there = self._stable_at(float(value), but=leg.stretch)
                landed = self._tended_to(start, float(value), there)
                if landed is not None:
                    lost = dataclasses.replace(leg, next=Next.LOST, falls_at=float(value), candidates=there)
                    return dataclasses.replace(lost, response=start), landed
        return leg, again

    def _landing(
        self, motion: Solution, beyond: float, candidates: Sequence[Stretch]
    ) -> tuple[TimeResponse, Stretch | None]:
        """Return what integration from a motion leads to beyond its end, and the stretch that this is on."""
        response = self._integrate(motion, self._pushed(motion), beyond, self._max_periods)
        return response, self._tended_to(response, beyond, candidates)

    def _pushed(self, motion: Solution) -> Solution:
        """Return a motion that is a little larger; rest stays where it is however it is multiplied."""
        pushed, size = PUSH * motion.coefficients, least_size(self._diagram.branches)
        if float(np.linalg.norm(pushed)) < size:
            pushed[:, :2] += (PUSH - 1.0) * size
        return dataclasses.replace(motion, coefficients=pushed)

    def _integrate(self, motion: Solution, start: Solution | TimeResponse, value: float, most: int) -> TimeResponse:
        """Return what integration at a value leads to, over the periods that a motion of any branch takes."""
        return integrate(
            attached(motion).system,
            at={**motion.parameters, self._diagram.name: value},
            start=start,
            periods=self._periods,
            max_periods=max(most, self._periods),
            throw=False,
        )

    def _tended_to(self, response: TimeResponse, value: float, candidates: Sequence[Stretch]) -> Stretch | None:
        """Return the stretch of the stable motion that a response is, or is so near to that it is on its way there."""
        size = least_size(self._diagram.branches)
        for each in (motion for motion in self._diagram.at(value) if motion.stable):
            coefficients = to_real(response.displacement_harmonics(each.solution.n_harmonics * self._periods))
            seen = dataclasses.replace(each.solution, coefficients=coefficients, periods=self._periods)
            if image_of(seen, each.solution, LANDED, floor=size) is not None:
                on = [s for s in candidates if s.branch == each.branch and s.low <= value <= s.high]
                return on[0] if on else None
        return None
