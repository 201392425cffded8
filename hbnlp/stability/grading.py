"""Meshes graded towards where the coefficients of the linearised equations switch.

An interval within which they are no polynomial is halved until it is one to a tolerance, or too short to matter: a jump
costs some thirty intervals, and its place is known to 1e-12 of the period. Two uniform meshes instead may agree by luck
while both are wrong, as each misplaces the jump by a share of an interval.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hbnlp.core.types import Array
from hbnlp.stability.collocation import Gauss

SHORT = 1e-12
"""A defect that lasts for less than this part of the period does not matter."""
Entries = Callable[[Array], Array]


class Mesh(NamedTuple):
    """Intervals of a period in order: an interval of level k is a uniform one halved k times.

    ``entries`` is (count, nodes, n_entries), ``levels`` (count,); ``resolved`` says whether each of them will do.
    """

    entries: Array
    levels: Array
    resolved: bool


def graded(
    entries: Entries, intervals: int, nodes: int, *, tol: float, limit: int, weights: Array | float = 1.0
) -> Mesh:
    """Return the mesh whose intervals halve a uniform mesh's until coefficients are polynomials within each.

    Parameters
    ----------
    entries : callable
        Their values (count, n_entries) at phases (count,) between 0 and 2 pi.
    intervals : int
        Number of intervals to begin with.
    nodes : int
        Gauss nodes an interval.
    tol : float
        Largest deviation from a polynomial through the nodes' values, relative to the largest value.
    limit : int
        Number of intervals at which halving ends.
    weights : array (n_entries,)
        Factors with which the entries are compared.
    """
    phases, predict = _in_interval(nodes)
    left, levels = np.arange(intervals) / intervals, np.zeros(intervals, dtype=int)
    kept: list[tuple[Array, Array, Array]] = []
    scale, resolved = 0.0, True
    count = intervals
    while left.size:
        length = 0.5**levels / intervals
        at = left[:, None] + length[:, None] * phases
        values = entries(2.0 * np.pi * at.ravel()).reshape(*at.shape, -1)
        scale = max(scale, float(np.abs(values * weights).max()))
        found, between = values[:, :nodes], values[:, nodes:]
        defect = np.abs((predict @ found - between) * weights).max(axis=(1, 2))
        split = (defect > tol * scale) & (defect * length > SHORT * scale)
        if count + int(split.sum()) > limit:
            resolved, split = False, np.zeros_like(split)
        kept.append((left[~split], levels[~split], found[~split]))
        count += int(split.sum())
        halves = left[split][:, None] + np.array([0.0, 0.5]) * length[split][:, None]
        left, levels = halves.ravel(), np.repeat(levels[split] + 1, 2)
    places, depths, found = (np.concatenate(parts) for parts in zip(*kept, strict=True))
    order = np.argsort(places)
    return Mesh(found[order], depths[order], resolved)


@lru_cache(maxsize=16)
def _in_interval(nodes: int) -> tuple[Array, Array]:
    """Return the nodes of [0, 1], then its ends and points between the nodes; the polynomial's values at the latter."""
    c = Gauss.of(nodes).c
    between = np.concatenate([[1e-9], 0.5 * (c[1:] + c[:-1]), [1.0 - 1e-9]])
    powers = np.polynomial.legendre.legvander(2.0 * np.concatenate([c, between]) - 1.0, nodes - 1)
    return np.concatenate([c, between]), powers[nodes:] @ np.linalg.inv(powers[:nodes])
