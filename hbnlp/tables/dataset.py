"""A table as a Dataset of xarray."""

from __future__ import annotations

import dataclasses
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np

from hbnlp.core.extras import from_extra
from hbnlp.tables.table import Table
from hbnlp.tables.variables import HARMONIC, Variable, attributes, labels, variables

if TYPE_CHECKING:
    import xarray

UNITS = (
    "those of the system's equations where a variable has none; a membrane wing is nondimensional with chord, stream "
    "velocity and density: C_L and dCp per dynamic pressure, times in chord / velocity, angles in rad"
)


def dataset(table: Table) -> xarray.Dataset:
    """Return a table as a Dataset: see `Tabular.to_xarray`.

    Raises
    ------
    ImportError
        If xarray is not installed.
    """
    xarray = from_extra("xarray", "tables", "a Dataset")
    found = variables(table)
    coordinates = {
        name: Variable((name,), np.array(list(values))) for name, values in labels(table, found.values()).items()
    }
    if HARMONIC in coordinates:
        told = {"long_name": "multiple of omega / periods: a_0, then a_cos - i a_sin", "units": "1"}
        coordinates[HARMONIC] = Variable((HARMONIC,), coordinates[HARMONIC].values, told)
    taken = {*found, *(name for variable in found.values() for name in variable.dimensions)}
    for column in table.axes:
        variable = found.pop(column)
        coordinates[variable.dimensions[0]] = variable
    for column, name in table.coordinates.items():
        along = found.pop(column)
        about = {**along.about, **table.quantities.attributes(name)}
        coordinates[f"parameter_{name}" if name in taken else name] = dataclasses.replace(along, about=about)
    units = {f"units_{name}": unit for name, unit in table.quantities.units.items()}
    told = {"kind": table.layout.kind, "hbnlp_version": version("hbnlp"), "units": UNITS, **units}
    return xarray.Dataset(
        {name: (v.dimensions, v.values, v.about) for name, v in found.items()},
        {name: (v.dimensions, v.values, v.about) for name, v in coordinates.items()},
        told | attributes(table),
    )
