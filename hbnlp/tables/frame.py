"""A Dataset as a DataFrame of pandas: a row a point."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.core.extras import from_extra
from hbnlp.tables.dataset import dataset
from hbnlp.tables.table import Table
from hbnlp.tables.variables import HARMONIC, dimension

if TYPE_CHECKING:
    import pandas
    import xarray

OUTPUT = "output"


def data_frame(table: Table) -> pandas.DataFrame:
    """Return what lies along the rows of a table, its other dimensions side by side: see `Tabular.to_dataframe`.

    Raises
    ------
    ImportError
        If pandas or xarray is not installed.
    """
    pandas = from_extra("pandas", "tables", "a DataFrame")
    layout, values = table.layout, dataset(table)
    first = next(iter(layout.columns.values())).shape.split()[0]
    rows = layout.rows or dimension(first, layout)
    columns: dict[str, Any] = {}
    for name, variable in {**values.coords, **values.data_vars}.items():
        if rows in variable.dims and str(name) != rows:
            for short, full, column in _columns(str(name), variable.transpose(rows, ...)):
                columns[full if short in columns else short] = column
    index = values[rows].to_index() if rows in values.coords else pandas.RangeIndex(values.sizes[rows], name=rows)
    frame = pandas.DataFrame(columns, index=index)
    frame.attrs = dict(values.attrs)
    return frame


def _columns(name: str, variable: xarray.DataArray) -> Iterator[tuple[str, str, Any]]:
    """Yield the columns of a variable whose rows come first, each with a short name and one that none other has.

    An output's is its own, harmonics are h0, h1, ...: ``C_L_h1_re``.
    """
    others = [str(other) for other in variable.dims[1:]]
    labels = [[_label(other, value) for value in variable[other].values] for other in others]
    for places in itertools.product(*(range(len(each)) for each in labels)):
        words = [each[place] for each, place in zip(labels, places, strict=True)]
        column = variable.values[(slice(None), *places)]
        parts = {"re": column.real, "im": column.imag} if np.iscomplexobj(column) else {"": column}
        for part, values in parts.items():
            own = [*words, part] if part else words
            full = "_".join([name, *own])
            yield "_".join(own) if OUTPUT in others else full, full, values


def _label(dimension: str, value: Any) -> str:
    return f"h{value}" if dimension == HARMONIC else str(value)
