"""Observers of traces, sweeps and searches: what they are told, a progress bar, saving every so often."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tqdm.auto import tqdm

from hbnlp.core.checks import real_number
from hbnlp.core.renamed import renamed_name
from hbnlp.core.storage import archive_name

logger = logging.getLogger(__name__)

_RENAMED = {
    "branch": "progress.result()",
    "n_folds": "progress.counts['folds']",
    "n_points": "progress.counts['points']",
}


class StopTracing(Exception):
    """Raise this in a callback to end a trace, a sweep or a search where it is, with all that it has."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """What a callback sees after each point.

    Attributes
    ----------
    task : str
        What goes on: "tracing omega".
    name, value : str, float
        The varied parameter, or what else is counted, and its present value.
    fraction : float
        Part of the work behind. Of a trace, the largest part of the span reached so far (of its logarithm where it
        covers more than a decade).
    counts : mapping of str to int
        How much there is so far: "points", and what else the task finds, "folds" or "jumps".
    done : bool
        Whether this is the last call.
    result : callable
        Returns all so far, as the task itself will: a Branch, a Sweep, a SolutionSet.
    """

    task: str
    name: str
    value: float
    fraction: float
    counts: Mapping[str, int]
    done: bool
    result: Callable[[], Any]

    def __getattr__(self, name: str) -> Any:
        raise renamed_name("Progress", name, _RENAMED)


Callbacks = Sequence[Callable[[Progress], None]]


class ProgressBar:
    """A tqdm bar over the work, with what was found so far; options go to tqdm."""

    def __init__(self, **options: Any) -> None:
        # `miniters` 0: counts are shown where the fraction stands still, too
        self._options = {"total": 100, "bar_format": "{l_bar}{bar}| {elapsed}{postfix}", "miniters": 0, **options}
        self._bar: Any = None

    def __getstate__(self) -> dict[str, Any]:
        """Leave the bar on the screen behind: where it arrives, a new one begins."""
        return {**self.__dict__, "_bar": None}

    def __call__(self, progress: Progress) -> None:
        """Show where the task is."""
        if self._bar is None:
            self._bar = tqdm(desc=progress.task, **self._options)
        whole = round(100 * progress.fraction, 1)
        counts = "".join(f", {number} {what}" for what, number in progress.counts.items())
        self._bar.set_postfix_str(f"{progress.name} = {progress.value:.5g}{counts}", refresh=False)
        self._bar.update(max(whole - self._bar.n, 0.0))
        if progress.done:
            self._bar.close()
            self._bar = None


class Saving:
    """Saves of work that goes on whether they succeed or not; that one failed is logged, once until one succeeds."""

    def __init__(self) -> None:
        self._failing = False

    def __call__(self, save: Callable[[], None], what: str, task: str) -> None:
        """Save, whatever comes of it."""
        try:
            save()
        except Exception as error:  # noqa: BLE001 - what was computed is worth more than its file
            if not self._failing:
                logger.warning("%s failed, %s goes on and it is tried again: %s", what, task, error)
            self._failing = True
        else:
            self._failing = False


class Autosave:
    """Save the result to a file every ``seconds`` and at the end; a save that fails, for whatever reason, ends nothing.

    That it failed is logged as a warning, once until a save succeeds; it is tried again when it is time. Whatever takes
    callbacks returns a record that it can save.
    """

    def __init__(self, path: str | os.PathLike[str], *, seconds: float = 30.0) -> None:
        archive_name("path", path)
        real_number("seconds", seconds, above=0.0, advice=", the time between two saves")
        self.path = path
        self.seconds = seconds
        self._last = time.monotonic()
        self._saving = Saving()

    def __call__(self, progress: Progress) -> None:
        """Save if it is time."""
        if progress.done or time.monotonic() - self._last >= self.seconds:
            self._saving(lambda: progress.result().save(self.path), "autosave", progress.task)
            self._last = time.monotonic()
