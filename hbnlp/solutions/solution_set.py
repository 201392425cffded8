"""The solutions at one parameter point that a search found, and what it needs to go on: summary, one portable file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, final, overload

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import counted
from hbnlp.core.generators import read_state
from hbnlp.core.layout import (
    Column,
    Layout,
    counted_from_one,
    facts,
    flag,
    maybe,
    number,
    numbers_by_name,
    table,
    text,
    texts,
    whole,
)
from hbnlp.core.records import loaded, save_record
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.fourier import n_coefficients, padded, resize
from hbnlp.solutions.attaching import check_problem, with_problem
from hbnlp.solutions.columns import check_numbers, numbers_of_harmonics
from hbnlp.solutions.solution import Solution
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = 6
"""Solutions of which `repr` tells an amplitude."""


@dataclass(frozen=True, kw_only=True)
class SearchState:
    """Where a search is after the last start that was over: it goes on from there as if it had not ended.

    Attributes
    ----------
    order : tuple of int
        The places of the solutions in the set, in the order in which they were found.
    images : tuple of bool
        Whether each solution of the set was made by a symmetry instead of found.
    searched : int
        How many of the solutions, in the order in which they were found, were searched around.
    scale : float or None
        Size that the amplitudes of random starts are relative to; None before the first start was over.
    generator : mapping
        Where the generator of random numbers is.
    spurious : tuple of tuple of float
        With a tolerance: unknowns of the balance that is searched with at which it is balanced, but which are none of
        the solutions: it keeps away from them as well.
    """

    order: tuple[int, ...]
    images: tuple[bool, ...]
    searched: int
    scale: float | None
    generator: Mapping[str, Any]
    spurious: tuple[tuple[float, ...], ...] = ()


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SolutionSet(ReadOnlyArrays, Sequence[Solution], Tabular):
    """The solutions at one parameter point that `hbnlp.find_all` found, a sequence of them, smallest first.

    Attributes
    ----------
    solutions : tuple of Solution
    parameters : dict
        Value of every parameter.
    system_name, output_names, periods
        What was searched.
    n_starts : int
        Random starts that were asked for.
    n_tried : int
        Random starts that were made, after the neighbourhoods of what was known and of a cold start.
    complete : bool
        Whether all starts were made. That is no proof that all solutions were found.
    message : str
        How it ended.
    state : SearchState
        What ``find_all(problem, known=found)`` needs to go on, without a start that was made before.
    problem : HarmonicBalance or None
        None for a set loaded from a file without one.
    """

    solutions: tuple[Solution, ...]
    parameters: Mapping[str, float]
    system_name: str
    output_names: tuple[str, ...]
    periods: int
    n_starts: int
    n_tried: int
    complete: bool
    message: str
    state: SearchState
    problem: HarmonicBalance | None = None

    def __len__(self) -> int:
        return len(self.solutions)

    @overload
    def __getitem__(self, index: int) -> Solution: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Solution, ...]: ...
    def __getitem__(self, index: int | slice) -> Solution | tuple[Solution, ...]:
        return self.solutions[index]

    def plot(self, output: str, *, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw an output of all solutions over their period; see `hbnlp.plot.plot_solutions`."""
        from hbnlp.plot import plot_solutions

        return plot_solutions(self, output, ax=ax, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the set to one ``.npz`` file without pickle, whole or not at all.

        Raises
        ------
        SaveError
            If it cannot be written; an older file is as it was.
        """
        save_record(self, path, _LAYOUT, **self._parts())

    def _parts(self) -> dict[str, Any]:
        found, state = self.solutions, self.state
        most = max((s.n_harmonics for s in found), default=0)
        return {
            "coefficients": np.array([resize(s.coefficients, most) for s in found]) if found else None,
            "amplitudes": np.array([padded(s.amplitudes, most) for s in found]) if found else None,
            "n_harmonics": np.array([s.n_harmonics for s in found], dtype=int),
            "spurious": np.array(state.spurious) if state.spurious else None,
            "solutions": [
                {"statistics": dict(s.statistics), "place": place, "image": image}
                for s, place, image in zip(found, np.argsort(state.order), state.images, strict=True)
            ],
            "searched": state.searched,
            "scale": state.scale,
            "generator": state.generator,
        }

    def _table(self) -> Table:
        return table_of(self, _LAYOUT, **self._parts())

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, problem: HarmonicBalance | None = None) -> SolutionSet:
        """Return a set from a file that `save` wrote, with its problem if that is given.

        Parameters
        ----------
        path : path-like
        problem : HarmonicBalance, optional
            The problem that was searched. Without one the solutions can be read.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        LoadError
            (A `ValueError`.) If the file is damaged or holds something else.
        ValueError
            If the problem is not that of the solutions: the message says in what they differ.
        TypeError
            If ``problem`` is something else.
        """
        check_problem(problem)
        with loaded(path, _LAYOUT) as content:
            found = cls(**_unpacked(content))
        return found if problem is None else set_with_problem(found, problem)

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value:.10g}" for name, value in self.parameters.items())
        first = ", ".join(f"{abs(s.amplitudes[0, 1]):.6g}" for s in self.solutions[:SHOWN] if len(s.amplitudes))
        more = ", ..." if len(self) > SHOWN else ""
        amplitudes = f"  first harmonics of {self.output_names[0]}: {first}{more}\n" if first else ""
        return (
            f"SolutionSet of {self.system_name!r}: {counted(len(self), 'solution')}\n  at {values}\n{amplitudes}"
            f"  {self.message}"
        )


def set_with_problem(found: SolutionSet, problem: HarmonicBalance) -> SolutionSet:
    """Return a set with its problem, if that is of all its solutions: see `check_belongs`."""
    check_numbers(problem, np.array([s.n_harmonics for s in found.solutions]), what="solution set")
    solutions = tuple(with_problem(solution, problem, what="solution set") for solution in found.solutions)
    return replace(found, solutions=solutions, problem=problem)


_LAYOUT = Layout(
    kind="solution set",
    columns={
        "coefficients": Column("solutions dof 2H+1", numbers="n_harmonics", about="displacements"),
        "amplitudes": Column("solutions outputs H+1", complex, numbers="n_harmonics", about="outputs"),
        "n_harmonics": Column("solutions", int, optional=True, about="number of harmonics", units="1"),
        "spurious": Column("roots size", optional=True),
    },
    entries={
        "parameters": numbers_by_name,
        "system_name": text,
        "output_names": texts,
        "periods": counted_from_one,
        "n_starts": whole,
        "n_tried": whole,
        "complete": flag,
        "message": text,
        "solutions": table(statistics=facts, place=whole, image=flag),
        "searched": whole,
        "scale": maybe(number),
        "generator": read_state,
    },
    lengths={"outputs": "output_names", "solutions": "solutions"},
    working=frozenset({"spurious", "searched", "scale", "generator"}),
)


def _unpacked(content: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a set from the content of its file, or raise a ValueError if they are at odds."""
    rows, coefficients, amplitudes = (content.pop(name) for name in ("solutions", "coefficients", "amplitudes"))
    searched, scale, generator = (content.pop(name) for name in ("searched", "scale", "generator"))
    numbers, spurious = content.pop("n_harmonics"), content.pop("spurious")
    numbers = numbers_of_harmonics(numbers, coefficients) if rows else ()
    places = [row["place"] for row in rows]
    if sorted(places) != [*range(len(rows))] or searched > len(rows):
        raise ValueError(f"its {len(rows)} solutions have the places {places}, and {searched} of them were searched")
    solutions = tuple(
        Solution(
            coefficients=coefficients[i, :, : n_coefficients(own)],
            amplitudes=amplitudes[i, :, : own + 1],
            statistics=row["statistics"],
            **{name: content[name] for name in ("parameters", "output_names", "periods")},
        )
        for i, (row, own) in enumerate(zip(rows, numbers, strict=True))
    )
    state = SearchState(
        order=tuple(np.argsort(places).tolist()),
        images=tuple(row["image"] for row in rows),
        searched=searched,
        scale=scale,
        generator=generator,
        spurious=() if spurious is None else tuple(tuple(root.tolist()) for root in spurious),
    )
    return {**content, "solutions": solutions, "state": state}
