"""Random starts of a search, run by workers before it is their turn."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import NamedTuple

import numpy as np

from hbnlp.core.interrupts import interrupts_at_once
from hbnlp.core.types import Array

AHEAD = 8
"""Starts that are given to an executor before it is their turn."""

Draw = Callable[[np.random.Generator], Array]
Run = Callable[[Array], Array | None]


class _Waiting(NamedTuple):
    start: Array
    found: Future[Array | None]


class Ahead:
    """Runs from the starts that follow, as a search would make them that finds nothing from here on.

    Most starts find nothing, and then those ahead were what a search by itself would have run. Where one finds a
    motion, the runs ahead were without a pole that they should have had: they are dropped and made again.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._waiting: deque[_Waiting] = deque()
        self._n_known = -1
        self._rng: np.random.Generator | None = None

    def run(
        self, start: Array, run: Run, draw: Draw, rng: np.random.Generator, *, n_known: int, left: int
    ) -> Array | None:
        """Return what a run from a start finds.

        Parameters
        ----------
        start : array
            Drawn by ``draw`` from ``rng``, which stands behind it.
        run : callable
            That can be sent; what it finds from a start.
        draw : callable
            Draws the start that follows.
        rng : numpy Generator
            It is not drawn from.
        n_known : int
            Solutions from which runs lead away: with one more they lead elsewhere.
        left : int
            Starts that are still to come.
        """
        first = self._waiting[0] if self._waiting and self._n_known == n_known else None
        if first is None or not np.array_equal(first.start, start):
            self.drop()
            self._n_known, self._rng = n_known, copy.deepcopy(rng)
            self._waiting.append(_Waiting(start, self._executor.submit(run, start)))
        assert self._rng is not None
        while len(self._waiting) < min(AHEAD, 1 + left):
            following = draw(self._rng)
            self._waiting.append(_Waiting(following, self._executor.submit(run, following)))
        with interrupts_at_once():
            found = self._waiting[0].found.result()
        self._waiting.popleft()
        return found

    def drop(self) -> None:
        """Cancel the runs that have not begun, and forget the others."""
        for each in self._waiting:
            each.found.cancel()
        self._waiting.clear()
