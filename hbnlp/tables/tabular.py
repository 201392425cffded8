"""What every record has that is a table."""

from __future__ import annotations

import html
import os
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from hbnlp.tables.dataset import dataset
from hbnlp.tables.frame import data_frame
from hbnlp.tables.netcdf import netcdf_name, write_netcdf
from hbnlp.tables.table import Table

if TYPE_CHECKING:
    import pandas
    import xarray


MOST_WORDS = 3
"""A line of a summary begins with what it is about if there are no more words before its colon."""


class Tabular(ABC):
    """A record whose columns and plain values go into tables of other packages, labelled."""

    @abstractmethod
    def _table(self) -> Table:
        """Return columns and plain values with their layout."""

    def to_xarray(self) -> xarray.Dataset:
        """Return the record as a Dataset of xarray, which shares no memory with it.

        Returns
        -------
        xarray.Dataset
            The record's arrays by their names, with the dimensions point, output, harmonic, dof, multiplier, time and
            others; a parameter that varies is a coordinate along them (of no index: it may turn). ``displacements``
            stands for the coefficients: complex harmonics (..., dof, harmonic), ``a_0`` and ``a_{2h-1} - i a_{2h}``,
            nan where a point has fewer. All else that is known, each other parameter, units and the version of hbnlp
            are attributes; ``units_x`` is the unit of the output or parameter x, if the system has one.

        Raises
        ------
        ImportError
            If xarray is not installed (extra ``hbnlp[tables]``).
        """
        return dataset(self._table())

    def to_netcdf(self, path: str | os.PathLike[str]) -> None:
        """Write the Dataset of `to_xarray` to one file of netCDF, whole or not at all; xarray alone can read it.

        netCDF has no complex numbers: a variable ``amplitudes`` is two in the file, ``amplitudes_re`` and
        ``amplitudes_im``. Nothing loads a record from such a file: `save` is for that.

        Parameters
        ----------
        path : path-like
            The file; its name, ending in .nc as a rule, is taken as given.

        Raises
        ------
        ImportError
            If xarray, h5netcdf or h5py is not installed (extra ``hbnlp[tables]``).
        SaveError
            (An `OSError`.) If the file cannot be written; an older file is as it was.
        """
        netcdf_name("path", path)
        write_netcdf(self.to_xarray(), path)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the record as a DataFrame of pandas, a row for each point (or time, or frequency).

        Returns
        -------
        pandas.DataFrame
            Columns are the parameter that varies and whatever lies along the points: harmonic 1 of the output C_L is
            ``C_L_h1_re`` and ``C_L_h1_im``, a multiplier ``multipliers_0_re``. ``attrs`` has what the Dataset's have.

        Raises
        ------
        ImportError
            If xarray or pandas is not installed (extra ``hbnlp[tables]``).
        """
        return data_frame(self._table())

    def _repr_html_(self) -> str:
        """Return the summary that `repr` is as a small table, for a notebook."""
        title, *lines = repr(self).splitlines()
        rows = "".join(_row(line.strip()) for line in lines)
        return f"<table><caption><b>{html.escape(title)}</b></caption>{rows}</table>"


def _row(line: str) -> str:
    about, colon, rest = line.partition(": ")
    if not colon or len(about.split()) > MOST_WORDS:
        about, rest = "", line
    style = "text-align: left"
    return f'<tr><th style="{style}">{html.escape(about)}</th><td style="{style}">{html.escape(rest)}</td></tr>'
