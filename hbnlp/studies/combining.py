"""Results of many points as one Dataset: what each has by names and dimensions, side by side along the grid."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.core.checks import refused
from hbnlp.core.extras import from_extra
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    import xarray

    from hbnlp.studies.record import Study

CASE = "case"
"""The dimension of a list of points."""
RESULT = "result"
_ACCEPTED = (
    "numbers, texts, arrays, mappings of these by name, records of hbnlp that have to_xarray, or xarray's own; "
    "extract= makes one of these of any result"
)


def combined(study: Study, extract: Callable[[Any], Any] | None) -> xarray.Dataset:
    """Return the results of a study as one Dataset: see `Study.to_xarray`."""
    package = from_extra("xarray", "tables", "a Dataset")
    there = [i for i, done in enumerate(study.done) if done and i not in study.errors]
    tables = {i: _as_dataset(package, extract(study[i]) if extract else study[i]) for i in there}
    along = (CASE,) if study.over is None else study.names
    taken = {*along, *study.names, "error"}
    tables = {i: table.rename(_apart(table, taken)) for i, table in tables.items()}
    labels = _labels(tables.values())
    parts: dict[str, dict[int, xarray.DataArray]] = {}
    for i, table in tables.items():
        for name, variable in table.reset_coords().data_vars.items():
            parts.setdefault(str(name), {})[i] = variable
    sizes = {name: len(values) for name, values in labels.items()}
    for table in tables.values():
        sizes |= {str(name): max(size, sizes.get(str(name), 0)) for name, size in table.sizes.items()}
    found = {name: _side_by_side(name, each, labels, sizes, len(study)) for name, each in parts.items()}
    coordinates: dict[str, Any] = {name: (name, values) for name, values in labels.items()}
    if study.over is None:
        coordinates |= {name: (CASE, [point[name] for point in study.points]) for name in study.names}
    else:
        coordinates |= {name: (name, list(values)) for name, values in study.over.items()}
    data = {
        name: ((*along, *dims), values.reshape(*study.shape, *values.shape[1:]), about)
        for name, (dims, values, about) in found.items()
    }
    if study.errors:
        told = np.array([str(study.errors.get(i, "")) for i in range(len(study))])
        data["error"] = (along, told.reshape(study.shape), {"long_name": "why there is no result"})
    known = {str(name) for table in tables.values() for name in table.coords if name not in labels}
    return package.Dataset(data, coordinates, _in_common(study, tables)).set_coords(sorted(known & data.keys()))


def _as_dataset(package: Any, result: Any) -> xarray.Dataset:
    """Return one result as a Dataset."""
    if isinstance(result, Tabular):
        return result.to_xarray()
    if isinstance(result, package.Dataset):
        return result
    if isinstance(result, package.DataArray):
        return result.to_dataset(name=result.name or RESULT)
    named = result if isinstance(result, Mapping) else {RESULT: result}
    variables = {_name(name): _variable(_name(name), value) for name, value in named.items()}
    _refuse_twice({dimension for dimensions, _ in variables.values() for dimension in dimensions} & variables.keys())
    return package.Dataset(variables)


def _name(name: Any) -> str:
    if not isinstance(name, str):
        raise refused(TypeError, "a name in a result", name, "a text")
    return name


def _variable(name: str, value: Any) -> tuple[tuple[str, ...], Any]:
    try:
        array = np.asarray(value)
    except ValueError as error:  # ragged lists
        raise refused(TypeError, f"a result's {name}", value, _ACCEPTED) from error
    if array.dtype.kind not in "biufcU":
        raise refused(TypeError, f"a result's {name}", value, _ACCEPTED)
    return tuple(f"{name}_{i}" for i in range(array.ndim)), array


def _apart(table: xarray.Dataset, taken: set[str]) -> dict[str, str]:
    """Return new names for what is called as a direction of the grid is."""
    names = {*map(str, table.variables), *map(str, table.dims)}
    renamed = {name: f"{RESULT}_{name}" for name in names & taken}
    _refuse_twice(names & {*renamed.values()})
    return renamed


def _refuse_twice(names: Collection[str]) -> None:
    """Raise a ValueError for names that two things in a result would have."""
    if names:
        raise ValueError(f"a result has two things called {min(names)!r} in the table: name one of them otherwise")


def _labels(tables: Iterable[xarray.Dataset]) -> dict[str, list[Any]]:
    """Return the labels of the dimensions that have any, each once, in the order in which they come."""
    labels: dict[str, dict[Any, None]] = {}
    for table in tables:
        for name in table.dims:
            if name in table.indexes:
                labels.setdefault(str(name), {}).update(dict.fromkeys(table.indexes[name].tolist()))
    return {name: sorted(each) if _is_sorted(each) else [*each] for name, each in labels.items()}


def _is_sorted(labels: Iterable[Any]) -> bool:
    """Whether labels are put in order: numbers are, names stay as they come."""
    return all(isinstance(label, int | float) for label in labels)


def _side_by_side(
    name: str,
    parts: Mapping[int, xarray.DataArray],
    labels: Mapping[str, Sequence[Any]],
    sizes: Mapping[str, int],
    n_points: int,
) -> tuple[tuple[str, ...], Any, dict[str, Any]]:
    """Return the dimensions, values (n_points, ...) and attributes of a variable; nan where a point has none."""
    first = next(iter(parts.values()))
    dims = tuple(map(str, first.dims))
    arrays = {i: part.values for i, part in parts.items()}
    kinds = {"text" if array.dtype.kind == "U" else "number" for array in arrays.values()}
    if len(kinds) > 1 or any(part.dims != first.dims for part in parts.values()):
        raise ValueError(
            f"the results have no common form: {name!r} is of other dimensions, or kind, at some points; "
            "give extract=, a function that makes of each result what they have in common"
        )
    shape = tuple(sizes[d] for d in dims)
    whole = len(parts) == n_points and all(array.shape == shape for array in arrays.values())
    kind = np.result_type(*(array.dtype for array in arrays.values()))
    if not whole and kind.kind in "biuf":
        kind = np.result_type(kind, np.float64)
    gap: Any = "" if kind.kind == "U" else (0 if kind.kind in "biu" else np.nan)
    values = np.full((n_points, *shape), complex(np.nan, np.nan) if kind.kind == "c" else gap, dtype=kind)
    for i, part in parts.items():
        places = [_places(part, d, labels) for d in dims]
        values[(i, *np.ix_(*places))] = arrays[i]
    return dims, values, dict(first.attrs)


def _places(part: xarray.DataArray, dimension: str, labels: Mapping[str, Sequence[Any]]) -> Any:
    """Return where the entries along a dimension stand among those of all points."""
    if dimension not in part.indexes:
        return np.arange(part.sizes[dimension])
    order = {label: place for place, label in enumerate(labels[dimension])}
    return np.array([order[label] for label in part.indexes[dimension].tolist()], dtype=int)


def _in_common(study: Study, tables: Mapping[int, xarray.Dataset]) -> dict[str, Any]:
    """Return the attributes that all results share, and those of the study."""
    first, *others = [table.attrs for table in tables.values()] or [{}]
    shared = {
        name: value
        for name, value in first.items()
        if all(name in each and np.array_equal(each[name], value) for each in others)
    }
    own = {"kind": "study", "task": study.task["function"], "hbnlp_version": version("hbnlp")}
    return {**shared, **own, "study_message": study.message}
