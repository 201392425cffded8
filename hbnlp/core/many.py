"""One function of many arguments, here or by the workers of an executor, whichever call ends first."""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any

from hbnlp.core.interrupts import interrupts_at_once
from hbnlp.core.sent_once import Answer, Call, UnreadableTaskError, answered, packed

CARRYING = 16
"""So many first calls carry the function, as nobody has it yet; later ones do where a worker asks."""

_GONE = (
    "a worker ended: there was no memory left, or it was killed, or could not start, as if a script starts processes "
    "outside of `if __name__ == '__main__':`"
)

Take = Callable[[int, Any], None]
"""Is given the number of a call, and its value or, if it did not come about, the error."""


def each_of(
    function: Callable[[Any], Any], arguments: Sequence[Any], take: Take, *, executor: Executor | None
) -> Generator[int, None, None]:
    """Call a function with all arguments, and yield the number of each call once ``take`` has what came of it.

    What has ended by the time that the work is left, by Ctrl-C, an error or ``close()``, is taken as well; what has not
    begun is cancelled.

    Parameters
    ----------
    function : callable
        Of one argument. Other processes are sent it once.
    arguments : sequence
    take : callable
    executor : Executor or None

    Raises
    ------
    BrokenExecutor, CancelledError
        If the workers are gone.
    KeyboardInterrupt
        Of this process, or of a worker.
    UnreadableTaskError
        If a worker cannot unpickle the function.
    """
    if executor is None:
        for i, argument in enumerate(arguments):
            take(i, function(argument))
            yield i
        return
    calls = _Calls(function, arguments, executor)
    try:
        calls.begin()
        while calls.pending:
            with interrupts_at_once():
                future = calls.ended.get()
            number = calls.end(future, take)
            if number is not None:
                yield number
    finally:
        calls.leave(take)


class _Calls:
    """Calls under way; threads share the function with this one."""

    def __init__(self, function: Callable[[Any], Any], arguments: Sequence[Any], executor: Executor) -> None:
        self._function, self._arguments, self._executor = function, arguments, executor
        self._shared = isinstance(executor, ThreadPoolExecutor)
        self._token, self._content = (b"", b"") if self._shared else packed(function)
        self._asked, self._refusals = set[tuple[str, int]](), Counter[int]()
        self.pending: dict[Future[Answer], int] = {}
        self.ended: SimpleQueue[Future[Answer]] = SimpleQueue()

    def begin(self) -> None:
        """Give all calls to the executor, which knows best how many there can be at once."""
        for number in range(len(self._arguments)):
            self._send(number, carrying=number < CARRYING)

    def end(self, future: Future[Answer], take: Take) -> int | None:
        """Have taken what came of a call, and return its number; None if it is sent again."""
        number = self.pending.pop(future)
        error = future.exception()
        if isinstance(error, BrokenExecutor):
            error.add_note(_GONE)
        if isinstance(error, BrokenExecutor | CancelledError | KeyboardInterrupt | UnreadableTaskError):
            raise error
        if error is None and future.result().unknown:
            self._send_again(number, future.result().worker)
            return None
        take(number, future.result().value if error is None else error)
        return number

    def leave(self, take: Take) -> None:
        """Have taken what has ended by now, and cancel the rest."""
        for future, number in self.pending.items():
            gone = future.cancel() or not future.done() or future.cancelled() or future.exception() is not None
            if not gone and not future.result().unknown:
                take(number, future.result().value)

    def _send(self, number: int, *, carrying: bool) -> None:
        argument = self._arguments[number]
        if self._shared:
            future = self._executor.submit(_here, self._function, argument)
        else:
            content = self._content if carrying else None
            future = self._executor.submit(answered, Call(self._token, content, argument, uuid.uuid4().hex))
        self.pending[future] = number
        future.add_done_callback(self.ended.put)

    def _send_again(self, number: int, worker: tuple[str, int]) -> None:
        """Send a call with the function, once for each worker that asks; a call that is refused twice has it, too."""
        self._refusals[number] += 1
        self._send(number, carrying=worker not in self._asked or self._refusals[number] > 1)
        self._asked.add(worker)


def _here(function: Callable[[Any], Any], argument: Any) -> Answer:
    return Answer(("", 0), function(argument))
