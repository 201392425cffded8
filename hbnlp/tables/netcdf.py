"""A Dataset as one file of netCDF, whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.core.checks import file_name, refused
from hbnlp.core.extras import from_extra
from hbnlp.core.files import written_by_name

if TYPE_CHECKING:
    import xarray

FOREIGN = (".npz", ".csv", ".txt", ".json", ".mat", ".xlsx", ".parquet")
"""Endings of other formats, which a file of netCDF is not to have."""


def write_netcdf(values: xarray.Dataset, path: str | os.PathLike[str]) -> None:
    """Write a Dataset, its complex variables as two: see `Tabular.to_netcdf`.

    Raises
    ------
    ImportError
        If h5netcdf or h5py is not installed.
    SaveError
        If the file cannot be written.
    """
    netcdf_name("path", path)
    for package in ("h5netcdf", "h5py"):
        from_extra(package, "tables", "a file of netCDF")
    with written_by_name(path, "table.nc") as made:
        split(values).to_netcdf(made, engine="h5netcdf")


def netcdf_name(name: str, path: Any) -> None:
    """Raise an error that names ``path`` unless it can be the name of a file of netCDF."""
    file_name(name, path)
    if Path(path).suffix in FOREIGN:
        raise refused(ValueError, name, path, "a name that ends in .nc: this writes netCDF")


def split(values: xarray.Dataset) -> xarray.Dataset:
    """Return a Dataset with real and imaginary parts, ``name_re`` and ``name_im``, for complex variables."""
    parts: dict[str, Any] = {}
    for name, variable in values.data_vars.items():
        if not np.iscomplexobj(variable):
            parts[str(name)] = variable
            continue
        about = variable.attrs.get("long_name", name)
        for ending, part, word in (("re", variable.real, "real"), ("im", variable.imag, "imaginary")):
            parts[f"{name}_{ending}"] = part.assign_attrs({**variable.attrs, "long_name": f"{about}, {word} part"})
    return values.drop_vars([*values.data_vars]).assign(parts)
