"""A diagram: branches, the points where they meet, and what a user asks of them all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.core.checks import counted, instance_of, real_number
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kinds import Kind
from hbnlp.core.records import loaded, save_columns
from hbnlp.diagrams.marching import March, march
from hbnlp.diagrams.meeting import image_of, is_crossed, least_size, place_of
from hbnlp.diagrams.storing import LAYOUT, branches_of, columns_of
from hbnlp.diagrams.stretches import Interval, Stretch, intervals_of, stretches_of
from hbnlp.diagrams.table import joined
from hbnlp.diagrams.tracing import before_first
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.identity import meets
from hbnlp.solutions.solution import Solution
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.systems.symmetry import Symmetry
from hbnlp.tables.table import Table
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SAME = 1e-6
"""Motions at one value that differ by less, relative to their size, are one; a tolerance of the harmonics is added."""


@dataclass(frozen=True)
class Origin:
    """Where a branch of a diagram comes from; all None: from the start.

    Attributes
    ----------
    junction : int or None
        The number of the junction that it was switched at.
    side : int
        Which of the starts there, or of the motions that were known and then found by a search.
    value : float or None
        The parameter at which a search found it, or at which it was known.
    backward : bool
        Whether it is the part on the other side of the start.
    """

    junction: int | None = None
    side: int = 0
    value: float | None = None
    backward: bool = False


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Junction:
    """A special point where branches meet.

    Attributes
    ----------
    point : SpecialPoint
        As the first of them tells it.
    branches : tuple of int
        Their numbers.
    has_images : bool
        Whether the branch that crosses has a mirror image, which is not traced.
    """

    point: SpecialPoint
    branches: tuple[int, ...]
    has_images: bool = False

    def __repr__(self) -> str:
        where = f"of branch{'es' if len(self.branches) > 1 else ''} {', '.join(map(str, self.branches))}"
        return f"{self.point!r}, {where}" + (", the last with a mirror image" if self.has_images else "")


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """One of the motions at a value of the parameter.

    Attributes
    ----------
    solution : Solution
    branch : int
        The number of its branch.
    stable : bool or None
        None where stability was off.
    n_images : int
        How many further motions the symmetries of the system make of it.
    """

    solution: Solution = field(repr=False)
    branch: int
    stable: bool | None
    n_images: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagram(Tabular):
    """Branches that are connected, and others beside them.

    Attributes
    ----------
    name : str
        The continuation parameter.
    span : (float, float)
    branches : tuple of Branch
    origins : tuple of Origin
        Where each of them comes from.
    junctions : tuple of Junction
        The branch points and period doublings, with the branches that meet there.
    left : tuple of str
        What was not followed, and why.
    message : str
        How it ended.
    problem : HarmonicBalance or None
        None for a diagram loaded from a file without one.
    """

    name: str
    span: tuple[float, float]
    branches: tuple[Branch, ...]
    origins: tuple[Origin, ...]
    junctions: tuple[Junction, ...]
    left: tuple[str, ...]
    message: str
    problem: HarmonicBalance | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.branches)

    @property
    def n_points(self) -> int:
        """Points of all branches together."""
        return sum(map(len, self.branches))

    @property
    def special_points(self) -> tuple[Junction, ...]:
        """All special points by their value, with the branches that meet there, or with the one that they are of."""
        crossed = [(i, point) for i, branch in enumerate(self.branches) for point in branch.special_points]
        alone = [Junction(point=point, branches=(i,)) for i, point in crossed if not is_crossed(point)]
        return tuple(sorted([*self.junctions, *alone], key=lambda each: each.point.value))

    @interrupts_kept()
    def at(self, value: float) -> tuple[Motion, ...]:
        """Return all motions at a value of the parameter, in the order of their branches; images are counted.

        Raises
        ------
        ValueError, TypeError
            If the diagram came from a file, without its problem, or the value is no finite number.
        ConvergenceError
            If a branch cannot be followed between two of its points.
        """
        problem, value = attached(self), real_number("value", value)
        tol = max(SAME, 3.0 * problem.truncation.tolerance) if problem.truncation is not None else SAME
        motions: list[Motion] = []
        for i, branch in enumerate(self.branches):
            for solution in (*branch.at(value), *self._before_first(i, value)):
                if all(image_of(solution, known.solution, tol) is None for known in motions):
                    motions.append(
                        Motion(
                            solution=solution,
                            branch=i,
                            stable=None if branch.stable is None else _is_stable(solution),
                            n_images=_n_images(solution, tol),
                        )
                    )
        return tuple(motions)

    def _before_first(self, number: int, value: float) -> tuple[Solution, ...]:
        """Return the motions of a branch that was switched to, between the junction and its first point."""
        junction = self.origins[number].junction
        if junction is None:
            return ()
        return before_first(self.branches[number], self.junctions[junction].point, value)

    def stretches(self) -> tuple[Stretch, ...]:
        """Return the parts of all branches along which stability stays.

        Raises
        ------
        ValueError
            If it was made without stability.
        """
        scale, size = max(map(abs, self.span)), least_size(self.branches)
        joined = [junction.point for junction in self.junctions]

        def known(point: SpecialPoint) -> SpecialPoint:
            place = place_of(point, joined, scale=scale, size=size) if is_crossed(point) else None
            return point if place is None else joined[place]

        stretches: list[Stretch] = []
        for i, (branch, origin) in enumerate(zip(self.branches, self.origins, strict=True)):
            begin = None if origin.junction is None else self.junctions[origin.junction].point
            stretches += stretches_of(i, branch, begin, known)
        return tuple(stretches)

    def intervals(self) -> tuple[Interval, ...]:
        """Return where two or more stable motions exist that are no images of each other, from low to high values.

        Raises
        ------
        ValueError
            If it was made without stability.
        """
        return tuple(intervals_of(self.stretches()))

    @interrupts_kept()
    def march(
        self,
        way: str,
        *,
        begin: float | None = None,
        branch: int | None = None,
        integrated: bool = True,
        max_periods: int = 2000,
    ) -> March:
        """Return where a slow march in the parameter goes.

        Parameters
        ----------
        way : "up" or "down"
        begin : float, optional
            Where it begins; by default on the stable motion that reaches farthest back.
        branch : int, optional
            The number of the branch that it begins on, where several have a stable motion there; by default the first.
        integrated : bool
            Whether integration in time from the end of a stretch tells where the march falls to, and whether it does so
            from modulated motions, along which it integrates for a hundred periods at each per cent of the parameter.
            Without, it falls where there is one stable motion alone, and lists them where there are several; modulated
            motions are taken to last until the motion is stable again.
        max_periods : int
            Periods of the forcing that such an integration may take.

        Raises
        ------
        ValueError
            If the diagram was made without stability, came from a file without its problem, or has no stable motion
            or no such branch there.
        """
        return march(self, way, begin=begin, branch=branch, integrated=integrated, max_periods=max_periods)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the diagram to one ``.npz`` file without pickle, whole or not at all.

        Raises
        ------
        SaveError
            If it cannot be written; an older file is as it was.
        """
        arrays, rows = columns_of(self.branches)
        metadata = {
            "name": self.name,
            "span": list(self.span),
            "branches": rows,
            "origins": [vars(origin) for origin in self.origins],
            "junctions": [self._row(junction) for junction in self.junctions],
            "left": list(self.left),
            "message": self.message,
        }
        save_columns(path, LAYOUT, arrays, metadata)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, problem: HarmonicBalance | None = None) -> Diagram:
        """Return a diagram from a file that `save` wrote, with its problem if that is given; see `Branch.load`."""
        expected = "the HarmonicBalance(system, ...) of the diagram"
        instance_of("problem", problem, HarmonicBalance | None, expected)
        with loaded(path, LAYOUT) as content:
            rows = content.pop("branches")
            arrays = {name: content.pop(name) for name in [*content] if name.startswith("branch_")}
            branches = branches_of(arrays, rows, problem)
            junctions = tuple(_junction(row, branches) for row in content.pop("junctions"))
            origins = tuple(Origin(**row) for row in content.pop("origins"))
            if len(origins) != len(branches):
                raise ValueError(f"it has {len(branches)} branches and {len(origins)} origins")
            diagram = cls(**content, branches=branches, origins=origins, junctions=junctions, problem=problem)
        for branch in branches:
            branch.check_its_problem()
        return diagram

    def _table(self) -> Table:
        return joined([branch._table() for branch in self.branches], self.message)

    def _row(self, junction: Junction) -> dict[str, Any]:
        first = junction.branches[0]
        points = self.branches[first].special_points
        return {
            "point": next(i for i, point in enumerate(points) if point is junction.point),
            "branches": list(junction.branches),
            "has_images": junction.has_images,
        }

    def plot(self, output: str, *, ax: Axes | None = None, harmonic: int = 1, **options: Any) -> Axes:
        """Draw the amplitude of one harmonic of an output along all branches; see `hbnlp.plot.plot_diagram`."""
        from hbnlp.plot import plot_diagram

        return plot_diagram(self, output, ax=ax, harmonic=harmonic, **options)

    def __repr__(self) -> str:
        met = ", ".join(
            counted(sum(junction.point.kind is kind for junction in self.special_points), kind.value)
            for kind in Kind
            if any(junction.point.kind is kind for junction in self.special_points)
        )
        left = f"\n  left: {counted(len(self.left), 'special point')}" if self.left else ""
        return (
            f"Diagram of {self.branches[0].system_name if self.branches else 'nothing'!r}: "
            f"{counted(len(self.branches), 'branch')}, {counted(self.n_points, 'point')}\n"
            f"  {self.name} within {self.span}\n  special points: {met or 'none'}\n  {self.message}{left}"
        )


def _junction(row: Mapping[str, Any], branches: tuple[Branch, ...]) -> Junction:
    """Return the junction of a row in a file, or raise a ValueError if there is no such point."""
    numbers = row["branches"]
    if not numbers or max(numbers) >= len(branches) or row["point"] >= len(branches[numbers[0]].special_points):
        raise ValueError(f"a junction is special point {row['point']} of the branches {numbers}, which there is none")
    point = branches[numbers[0]].special_points[row["point"]]
    return Junction(point=point, branches=numbers, has_images=row["has_images"])


def _is_stable(solution: Solution) -> bool:
    problem = attached(solution)
    return FloquetEvaluator.of(problem)(solution.coefficients, problem.values(solution.parameters)).stable


def _n_images(solution: Solution, tol: float) -> int:
    """Return how many motions that differ from it and from one another the symmetries make of a motion."""
    identity = Symmetry.identity(solution.coefficients.shape[0])
    distinct = [solution]
    for symmetry in attached(solution).system.symmetries_at(solution.parameters):
        image = solution.image(symmetry)
        if all(not meets(image, known, identity, tol) for known in distinct):
            distinct.append(image)
    return len(distinct) - 1
