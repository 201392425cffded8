"""The result files of the campaign: one a case, JSON with a key a line and the numbers of a key on one line."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(__file__).parents[1] / "results"
Result = dict[str, Any]
Row = list[str]


def compact(value: Any, indent: str = "") -> str:
    """JSON in which a dictionary has a key a line, as has a list of dictionaries, and any other list is on one line."""
    inner = indent + " "
    if isinstance(value, dict):
        brackets, items = "{}", [f"{json.dumps(key)}: {compact(item, inner)}" for key, item in value.items()]
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        brackets, items = "[]", [compact(item, inner) for item in value]
    else:
        return json.dumps(value)
    lines = ",\n".join(inner + item for item in items)
    return f"{brackets[0]}\n{lines}\n{indent}{brackets[1]}"


def exists(name: str) -> bool:
    """Whether a case is finished."""
    return (RESULTS / f"{name}.json").exists()


def read(name: str) -> Result:
    """Result of a case."""
    return dict(json.loads((RESULTS / f"{name}.json").read_text()))


def read_all(prefix: str) -> list[Result]:
    """Results of all cases whose names begin with ``prefix_``, in the order of the names."""
    return [read(path.stem) for path in sorted(RESULTS.glob(f"{prefix}_*.json"))]


def write(name: str, result: Result) -> None:
    """Keep the result of a case; an interruption leaves no half of a file."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    path = RESULTS / f"{name}.json"
    part = path.with_suffix(f".{os.getpid()}.part")
    part.write_text(compact(result) + "\n")
    part.replace(path)


def write_table(name: str, rows: list[Row]) -> None:
    """Write a table of docs/dns.md."""
    with (RESULTS / f"{name}.csv").open("w", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows(rows)


def pairs(values: Any) -> Any:
    """Complex numbers as nested lists whose innermost are [real part, imaginary part]."""
    return np.stack([np.real(values), np.imag(values)], axis=-1).tolist()


def complexes(nested: Any) -> np.ndarray:
    """Complex numbers that `pairs` wrote."""
    array = np.asarray(nested, dtype=float)
    return array[..., 0] + 1j * array[..., 1]
