"""The one driver of long work: callbacks, Ctrl-C, errors; nothing that was computed is lost by any of them."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Iterable, Mapping, Sized
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

from hbnlp.core.callbacks import Callbacks, Progress, StopTracing
from hbnlp.core.errors import TaskError, in_users_words
from hbnlp.core.interrupts import interrupts_at_once, interrupts_kept

logger = logging.getLogger(__name__)

Result = TypeVar("Result")


class Report(NamedTuple):
    """What a task says after each of its steps: `value`, `fraction` and `counts` of a `Progress`."""

    value: float
    fraction: float
    counts: Mapping[str, int]


@dataclass(frozen=True)
class Ending:
    """How a task ended, in words that a record can carry; ``error`` is what ended it, if that was an error."""

    words: str
    error: Exception | None = None

    def __str__(self) -> str:
        return self.words

    def after(self, done: str) -> str:
        """Return the sentence for a task that ended after a part of its work, such as "3 of 9 values"."""
        if self.error is not None:
            return f"{type(self.error).__name__} after {done}: {self.error}"
        return self.words if self is UNDER_WAY else f"{self.words} after {done}"


UNDER_WAY = Ending("under way")
COMPLETE = Ending("complete")
INTERRUPTED = Ending("interrupted")
STOPPED = Ending("stopped by a callback")


class Observers:
    """The callbacks of one task.

    Parameters
    ----------
    callbacks : sequence of callables
    task, name : str
        As in `Progress`.
    """

    def __init__(self, callbacks: Callbacks, task: str, name: str) -> None:
        self._callbacks = callbacks
        self._last = Progress(
            task=task, name=name, value=float("nan"), fraction=0.0, counts={}, done=False, result=lambda: None
        )

    def tell(self, report: Report, result: Callable[[], Any]) -> None:
        """Call all callbacks; what one of them raises, StopTracing above all, ends the task."""
        if self._callbacks:
            value, fraction, counts = report
            self._last = dataclasses.replace(
                self._last, value=float(value), fraction=fraction, counts=counts, result=result
            )
            with interrupts_at_once():
                for callback in self._callbacks:
                    callback(self._last)

    def finish(self, result: Any) -> None:
        """Call all callbacks for the last time; the task has ended, and what they raise is logged."""
        last = dataclasses.replace(self._last, done=True, result=lambda: result)
        for callback in self._callbacks:
            try:
                callback(last)
            except StopTracing:
                continue
            except Exception:
                logger.exception("a callback failed after the end of %s", last.task)


def drive(
    task: str,
    work: Iterable[Report],
    result: Callable[[Ending], Result],
    *,
    name: str,
    callbacks: Callbacks,
    warn_of: Callable[[Any], None] | None = None,
) -> Result:
    """Do the work step by step, tell the callbacks of each, and return the result, however it ends.

    Parameters
    ----------
    task, name : str
        As in `Progress`.
    work : iterable of Report
        Its steps are done with `interrupts_kept`, so that each is whole or fails.
    result : callable
        Makes the record of what there is, from the word for how it ended (`UNDER_WAY` for a callback that asks).
    callbacks : sequence of callables
    warn_of : callable, optional
        Told of the record once, to warn of what speaks against it.

    Raises
    ------
    TaskError
        If an error ends it, or a warning is one; ``result`` is the record, the cause is the error. An error before the
        first step is over is raised as it is: there is nothing to keep.
    """
    observers = Observers(callbacks, task, name)
    ending, report = COMPLETE, None
    with interrupts_kept(returns=True) as interrupts:
        try:
            for report in work:
                observers.tell(report, lambda: result(UNDER_WAY))
        except KeyboardInterrupt:
            ending = INTERRUPTED
        except StopTracing:
            ending = STOPPED
        except Exception as error:
            if report is None and not interrupts.noted:
                raise
            said = in_users_words(error)
            ending = Ending(f"{type(said).__name__}: {said}", said)
        if interrupts.taken():  # the other endings may be what it was turned into
            ending = INTERRUPTED
        try:
            record = result(ending)
            observers.finish(record)
            interrupts.check()
        except KeyboardInterrupt:  # it came late, and is no reason to lose all
            interrupts.taken()
            ending = INTERRUPTED
            record = result(ending)
    if ending.error is not None:
        raise TaskError(task, record, ending.error) from ending.error
    if warn_of is not None:
        try:
            warn_of(record)
        except Warning as error:
            raise TaskError(task, record, error) from error
    if ending is not COMPLETE:
        logger.warning("%s: %s", task, _last_words(ending, record, report))
    return record


def _last_words(ending: Ending, record: object, report: Report | None) -> str:
    message = str(getattr(record, "message", ""))
    if message.startswith((f"{ending} after", f"{ending}:")) or not isinstance(record, Sized):
        return message
    what = next(iter(report.counts)) if report is not None else "steps"
    return f"{ending} after {len(record)} {what}"
