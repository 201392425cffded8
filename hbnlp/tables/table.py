"""What a record hands over for its tables, by the layout by which it is saved."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hbnlp.core.layout import Layout
from hbnlp.core.quantities import Quantities, quantities_of
from hbnlp.core.records import content_of
from hbnlp.core.storage import as_text


@dataclass(frozen=True, kw_only=True)
class Table:
    """Columns and plain values of a record, as a file that was loaded has them.

    Attributes
    ----------
    layout : Layout
    columns : mapping of names to arrays
        Those that are not None.
    values : mapping of names to plain values
    coordinates : mapping of names of columns to names
        The columns that are coordinates along a dimension, and what they are called as such.
    axes : tuple of names of columns
        The columns that are coordinates of their own dimension, and called as it is.
    labels : mapping of dimensions to their labels
    quantities : Quantities
        Labels and units of parameters and outputs, as far as the system has them.
    """

    layout: Layout
    columns: Mapping[str, Any]
    values: Mapping[str, Any]
    coordinates: Mapping[str, str]
    axes: tuple[str, ...]
    labels: Mapping[str, Sequence[str]]
    quantities: Quantities


def table_of(
    record: Any,
    layout: Layout,
    *,
    coordinates: Mapping[str, str] | None = None,
    axes: tuple[str, ...] = (),
    labels: Mapping[str, Sequence[str]] | None = None,
    **parts: Any,
) -> Table:
    """Return the table of a record.

    Parameters
    ----------
    record : object
    layout : Layout
    coordinates, axes, labels : optional
        See `Table`. What has a length in the layout and consists of texts labels its dimension in any case.
    **parts
        What `save_record` gets for this record: columns and plain values that are not its attributes as they are.
    """
    arrays, metadata = content_of(record, layout, **parts)
    columns, values = layout.check(arrays, json.loads(as_text(metadata)), loose=frozenset(layout.columns))
    return Table(
        layout=layout,
        columns={name: array for name, array in columns.items() if array is not None and name not in layout.working},
        values={name: value for name, value in values.items() if name not in layout.working},
        coordinates=coordinates or {},
        axes=axes,
        labels=labels or {},
        quantities=quantities_of(record),
    )
