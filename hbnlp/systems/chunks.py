"""CasADi functions at many phases: compiled for a fixed number of columns, called as often as it takes."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.core.types import Array

CHUNK = 512
"""Phases at which a function is evaluated in one call."""


def of_columns(function: ca.Function, shared: list[int]) -> ca.Function:
    """Return a function of CHUNK columns at once; the inputs ``shared`` are the same for all of them."""
    return function.map(f"{function.name()}_in_chunk", "serial", CHUNK, shared, [])


def in_chunks(function: ca.Function, *arguments: Array) -> Array:
    """Return what `of_columns` made at any number n of columns (size, n); vectors are what all columns share."""
    count = arguments[0].shape[1]
    missing = -count % CHUNK
    columns = [np.pad(each, ((0, 0), (0, missing)), mode="edge") if each.ndim == 2 else each for each in arguments]
    parts = [
        function(*[each[:, k : k + CHUNK] if each.ndim == 2 else each for each in columns]).full()
        for k in range(0, count + missing, CHUNK)
    ]
    return np.concatenate(parts, axis=1)[:, :count]
