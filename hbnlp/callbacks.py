"""Observers of a trace: a progress bar, and saving to a file every so often."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tqdm.auto import tqdm

from hbnlp.branch import Branch
from hbnlp.errors import SaveError

logger = logging.getLogger(__name__)


class StopTracing(Exception):
    """Raise this in a callback to end a trace where it is, with all points kept."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """What a callback sees after each point.

    Attributes
    ----------
    name, value : str, float
        The continuation parameter and its present value.
    fraction : float
        Largest part of the span that was reached so far (of its logarithm where it covers more than a decade).
    n_points, n_folds : int
    done : bool
        Whether this is the last call.
    branch : callable
        Returns all points so far as a Branch.
    """

    name: str
    value: float
    fraction: float
    n_points: int
    n_folds: int
    done: bool
    branch: Callable[[], Branch]


class ProgressBar:
    """A tqdm bar over the span, with the number of points and folds; options go to tqdm."""

    def __init__(self, **options: Any) -> None:
        self._options = {"total": 100, "bar_format": "{l_bar}{bar}| {elapsed}{postfix}", **options}
        self._bar: Any = None

    def __call__(self, progress: Progress) -> None:
        """Show where the trace is."""
        if self._bar is None:
            self._bar = tqdm(desc=f"tracing {progress.name}", **self._options)
        whole = round(100 * progress.fraction, 1)
        self._bar.set_postfix_str(
            f"{progress.name} = {progress.value:.5g}, {progress.n_points} points, {progress.n_folds} folds",
            refresh=False,
        )
        self._bar.update(max(whole - self._bar.n, 0.0))
        if progress.done:
            self._bar.close()
            self._bar = None


class Autosave:
    """Save the branch to a file every ``seconds`` and at the end; a failure to write is logged, no more."""

    def __init__(self, path: str | os.PathLike[str], *, seconds: float = 30.0) -> None:
        if seconds <= 0.0:
            raise ValueError(f"seconds = {seconds!r}; a positive time between two saves is needed")
        self.path = path
        self.seconds = seconds
        self._last = time.monotonic()

    def __call__(self, progress: Progress) -> None:
        """Save if it is time."""
        if progress.done or time.monotonic() - self._last >= self.seconds:
            try:
                progress.branch().save(self.path)
            except SaveError as error:
                logger.warning("autosave failed, the trace goes on: %s", error)
            self._last = time.monotonic()
