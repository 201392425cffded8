"""A diagram as columns and plain values: those of its branches, each by its number, and what joins them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import LAYOUT as BRANCH
from hbnlp.branches.branch import Branch
from hbnlp.core.layout import Column, Layout, flag, mapping, maybe, number, pair, table, text, texts, whole

LAYOUT = Layout(
    kind="diagram",
    columns={},
    entries={
        "name": text,
        "span": pair(number),
        "branches": table(metadata=mapping, not_finite=texts),
        "origins": table(junction=maybe(whole), side=whole, value=maybe(number), backward=flag),
        "junctions": table(point=whole, branches=lambda value: tuple(map(whole, value)), has_images=flag),
        "left": texts,
        "message": text,
    },
    more={"branch_": Column("...", object, finite=False)},
)


def columns_of(branches: tuple[Branch, ...]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the columns of all branches, and the plain values of each."""
    arrays: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    for i, branch in enumerate(branches):
        own, metadata = branch.parts()
        arrays |= {f"branch_{i}_{name}": np.asarray(array) for name, array in own.items()}
        rows.append({"metadata": metadata, "not_finite": BRANCH.not_finite(own)})
    return arrays, rows


def branches_of(
    arrays: Mapping[str, Any], rows: tuple[Mapping[str, Any], ...], problem: HarmonicBalance | None
) -> tuple[Branch, ...]:
    """Return the branches of such columns and plain values, or raise a ValueError if they are none."""
    branches = []
    for i, row in enumerate(rows):
        start = f"branch_{i}_"
        own = {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}
        columns, values = BRANCH.check(own, row["metadata"], loose=frozenset(row["not_finite"]))
        branches.append(Branch.of_parts(columns | values, problem))
    return tuple(branches)
