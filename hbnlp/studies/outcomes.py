"""What comes of a task at one point: its result, or its error as text."""

from __future__ import annotations

import functools
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, final

from hbnlp.core.errors import in_users_words
from hbnlp.core.interrupts import INTERRUPTS, interrupts_at_once, interrupts_kept
from hbnlp.studies.points import Value

Task = Callable[..., Any]


@final
@dataclass(frozen=True)
class Failure:
    """The error of a task at a point.

    Attributes
    ----------
    kind : str
        The name of its class, "ConvergenceError".
    message : str
    traceback : str
        With its causes and notes, as Python prints it.
    """

    kind: str
    message: str
    traceback: str = field(repr=False)

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """Return what is kept of an error."""
        return cls(type(error).__name__, str(error), "".join(traceback.format_exception(error)))

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


def attempted(task: Task, point: Mapping[str, Value]) -> Any:
    """Return the result of a task at a point, or its Failure.

    Raises
    ------
    KeyboardInterrupt
        If there was a Ctrl-C meanwhile, also where the task made a result of what it had by then: it is not whole.
    """
    with interrupts_kept():
        before = INTERRUPTS.arrived
        try:
            with interrupts_at_once():
                result = call(task, point)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - of one of many points, which tells it
            result = Failure.of(in_users_words(error) if isinstance(error, Exception) else error)
        if INTERRUPTS.arrived > before:
            raise KeyboardInterrupt
    return result


def call(task: Task, point: Mapping[str, Value]) -> Any:
    """Call a task with the values of a point, and those of other names that a `functools.partial` has in its ``at``."""
    fixed = task.keywords.get("at") if isinstance(task, functools.partial) else None
    return task(at={**(fixed or {}), **point})
