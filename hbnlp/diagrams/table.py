"""The branches of a diagram as one table: their points one after another, each with the number of its branch."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from hbnlp.branches.branch import LAYOUT as BRANCH
from hbnlp.core.layout import Column
from hbnlp.core.types import Array
from hbnlp.fourier import of_equal_length
from hbnlp.tables.table import Table

_LAYOUT = dataclasses.replace(
    BRANCH,
    kind="diagram",
    columns={
        **BRANCH.columns,
        "branch": Column("points", int, about="number of the branch", units="1"),
        "periods": Column("points", int, about="periods of the forcing in one of the motion", units="1"),
    },
)
_ALIKE = ("name", "span", "parameters", "system_name", "output_names")
"""Plain values that all branches have in common."""


def joined(tables: Sequence[Table], message: str) -> Table:
    """Return the table of all branches, of which each has its own."""
    lengths = [len(table.columns["parameter"]) for table in tables]
    columns = {
        name: _one_after_another([table.columns[name] for table in tables if name in table.columns])
        for name in BRANCH.columns
        if any(name in table.columns for table in tables)
    }
    columns["branch"] = np.repeat(np.arange(len(tables)), lengths)
    columns["periods"] = np.repeat([table.values["periods"] for table in tables], lengths)
    special_points = tuple(
        {"branch": number, **row} for number, table in enumerate(tables) for row in table.values["special_points"]
    )
    values: dict[str, Any] = {name: tables[0].values[name] for name in _ALIKE}
    return Table(
        layout=_LAYOUT,
        columns=columns,
        values={**values, "message": message, "special_points": special_points},
        coordinates=tables[0].coordinates,
        axes=(),
        labels=tables[0].labels,
        quantities=tables[0].quantities,
    )


def _one_after_another(columns: Sequence[Array]) -> Array:
    return np.concatenate(of_equal_length(*columns) if columns[0].ndim > 1 else columns)
