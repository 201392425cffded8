"""What a study is when it is over, or as far as it came."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import counted, file_name, instance_of, place, refused
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.studies.combining import combined
from hbnlp.studies.outcomes import Failure
from hbnlp.studies.points import Points, Value
from hbnlp.studies.storing import Folder, read_results, read_study
from hbnlp.tables.netcdf import netcdf_name, write_netcdf

if TYPE_CHECKING:
    import xarray

SHOWN, LONGEST = 4, 160
"""Values of a name that the summary of a study shows, and characters of a line of it."""


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Study(ReadOnlyArrays):
    """The results of a task at many points, in their order; a sequence of them.

    Attributes
    ----------
    task : dict
        The name of the task's function, and the arguments that it had at all points, as text.
    over : dict of names to tuples of values, or None
        The grid; None for a list of points.
    points : tuple of dict
        The values at each point; in a grid the last name varies fastest.
    results : tuple
        What the task returned at each point; None where it failed or was not done.
    errors : dict of int to Failure
        By the numbers of the points.
    done : tuple of bool
        Whether the task was done at each point, failed or not.
    message : str
    """

    task: dict[str, Any]
    over: dict[str, tuple[Value, ...]] | None
    points: tuple[dict[str, Value], ...]
    results: tuple[Any, ...]
    errors: dict[int, Failure]
    done: tuple[bool, ...]
    message: str

    @property
    def names(self) -> tuple[str, ...]:
        """The names that vary."""
        return tuple(self.points[0])

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each direction of the grid; of a list, how many there are."""
        return Points(self.over, self.points).shape

    @property
    def complete(self) -> bool:
        """Whether the task was done at all points, failed or not."""
        return all(self.done)

    def __len__(self) -> int:
        return len(self.points)

    def __iter__(self) -> Iterator[Any]:
        return iter(self.results)

    def __getitem__(self, index: int | tuple[int, ...]) -> Any:
        """Return the result at a point by its number, or by its place along each direction of the grid.

        Where the task failed, or was not done, it is None.

        Raises
        ------
        ValueError
            If there is no such point.
        """
        if not isinstance(index, tuple):
            return self.results[place("index", index, len(self))]
        if len(index) != len(self.shape):
            raise refused(ValueError, "index", index, f"a place along each of {', '.join(self.over or ['the list'])}")
        number = 0
        for each, length in zip(index, self.shape, strict=True):
            number = number * length + place("index", each, length)
        return self.results[number]

    def to_xarray(self, extract: Callable[[Any], Any] | None = None) -> xarray.Dataset:
        """Return the results as one Dataset of xarray, labelled by the values of the grid.

        Its first dimensions are the names of the grid, or ``case`` for a list of points. Numbers, texts and arrays are
        ``result`` with dimensions ``result_0``, ``result_1``; those of a mapping have its names; records of hbnlp have
        the variables and dimensions of their own ``to_xarray``, so that 50 branches of one parameter make one Dataset
        with ``point`` as long as the longest. What a point lacks is nan, False counting as 0, and no text. ``error``
        tells of points that failed.

        Parameters
        ----------
        extract : callable, optional
            Makes of each result what goes into the Dataset: ``lambda branch: abs(branch.harmonics("x")[:, 1]).max()``.

        Raises
        ------
        ImportError
            If xarray is not installed (extra ``hbnlp[tables]``).
        ValueError
            If results have no common form: other dimensions, or numbers here and texts there.
        TypeError
            If they are of another kind.
        """
        instance_of("extract", extract, Callable | None, "a function of one result")
        return combined(self, extract)

    def to_netcdf(self, path: str | os.PathLike[str], extract: Callable[[Any], Any] | None = None) -> None:
        """Write the Dataset of `to_xarray` to one file of netCDF, as records do.

        Raises
        ------
        ImportError
            If xarray, h5netcdf or h5py is not installed (extra ``hbnlp[tables]``).
        SaveError
            (An `OSError`.) If it cannot be written; an older file is as it was.
        """
        netcdf_name("path", path)
        write_netcdf(self.to_xarray(extract), path)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all results to a folder, as ``hbnlp.study(..., folder=path)`` does; it is new, or of this study.

        Raises
        ------
        ValueError
            If the folder belongs to another study.
        TypeError
            If a result is nothing that a file without pickle can hold.
        SaveError
            (An `OSError`.) If it cannot be written.
        """
        file_name("path", path)
        kept = Folder(path, self.task, Points(self.over, self.points))
        for number, result in enumerate(self.results):
            if self.done[number]:
                kept.keep(number, self.errors.get(number, result))

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, problem: HarmonicBalance | None = None) -> Study:
        """Return what a folder has of a study.

        Parameters
        ----------
        path : path-like
            The folder.
        problem : HarmonicBalance, optional
            That of the records in it, if they have one in common.

        Raises
        ------
        FileNotFoundError
            If there is no such folder.
        LoadError
            (A `ValueError`.) If it is no folder of a study.
        """
        file_name("path", path)
        instance_of("problem", problem, HarmonicBalance | None, "the HarmonicBalance(system, ...) of the records")
        task, points = read_study(path)
        return study_of(task, points, read_results(path, problem))

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self.shape))
        names = [f"{name}: {_summary([point[name] for point in self.points])}" for name in self.names]
        lines = [f"Study of {self.task['function']} at {shape} points", "; ".join(names), self.message]
        if self.errors:
            number, failure = next(iter(self.errors.items()))
            lines.append(f"first failure at {self.points[number]}: {failure}")
        return "\n  ".join(textwrap.shorten(line, LONGEST, placeholder=" ...") for line in lines)


def study_of(task: Mapping[str, Any], points: Points, found: Mapping[int, Any], ending: str = "") -> Study:
    """Return the study of results and Failures by their numbers."""
    numbers = range(len(points.all))
    errors = {i: found[i] for i in numbers if isinstance(found.get(i), Failure)}
    failed = f", {len(errors)} failed" if errors else ""
    done = f"{sum(i in found for i in numbers)} of {counted(len(numbers), 'point')} done{failed}"
    return Study(
        task=dict(task),
        over=points.grid,
        points=points.all,
        results=tuple(None if i in errors else found.get(i) for i in numbers),
        errors=errors,
        done=tuple(i in found for i in numbers),
        message=f"{ending}{done}",
    )


def _summary(values: list[Value]) -> str:
    distinct = [*dict.fromkeys(values)]
    if len(distinct) > SHOWN and not any(isinstance(value, str) for value in distinct):
        return f"{len(distinct)} values from {min(distinct):g} to {max(distinct):g}"
    shown = ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in distinct[:SHOWN])
    return shown + (", ..." if len(distinct) > SHOWN else "")
