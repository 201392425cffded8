"""Ctrl-C during long work: noted when it comes, raised where nothing is half done.

An exception that appears just anywhere gets lost: CasADi's functions return None or an error of their own, IPOPT tries
a shorter step, CVODES reports a failed right side, and Python ignores what is raised while an object is deleted. So
SIGINT is noted, and raised by the next check: after a call of a compiled function, between iterations of IPOPT, at the
end of a step of long work. A second one, of somebody who does not want to wait, is raised at once.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

from hbnlp.core.errors import in_users_words

T = TypeVar("T")

_AGAIN = 0.05
"""Seconds after which an interrupt is sent again: the way back to the caller takes some microseconds."""


class Interrupts:
    """What SIGINT is handed to while work is under way, before the handler that was there."""

    def __init__(self) -> None:
        self._here = self._arrived  # as it is found in the table of signals, which alone says whose turn it is
        self._handler: Callable[[int, FrameType | None], object] = signal.default_int_handler
        self._noted: BaseException | None = None
        self._at_once = self._leaving = False
        self._count = 0

    @property
    def noted(self) -> bool:
        """Whether there was one that the calling thread has to end for: only the main thread sees signals."""
        return self._noted is not None and _in_main_thread()

    @property
    def arrived(self) -> int:
        """How many there were for the calling thread while work was under way, whatever became of them."""
        return self._count if _in_main_thread() else 0

    def taken(self) -> bool:
        """Return whether there was one, and forget it: for whoever returns a result that says so."""
        noted = self.noted
        if noted:
            self._noted = None
        return noted

    def check(self) -> None:
        """Raise what was noted, if anything was."""
        if self._noted is not None and _in_main_thread():
            raise self._noted.with_traceback(None)

    @contextmanager
    def kept(self, *, returns: bool = False) -> Iterator[Interrupts]:
        """Note Ctrl-C in this block, or in a function so decorated, and raise it at the end if not before.

        An error in a block that was interrupted is what the interrupt was turned into; one of CasADi about a callback
        of the user's is raised in the user's words. Blocks may stand in each other.
        Outside the main thread, and where SIGINT is ignored, no interrupt is kept.

        Parameters
        ----------
        returns : bool
            Whether the block ends with a result that must not be lost. What comes too late for the result to say so is
            sent again when the caller has it.
        """
        before = signal.getsignal(signal.SIGINT)
        if not callable(before) or not _in_main_thread():
            try:
                yield self
            except RuntimeError as error:  # CasADi's are
                raise in_users_words(error)  # noqa: B904 - its cause is set
            return
        outermost = before is not self._here
        at_once = self._at_once and not outermost
        try:
            if outermost:
                self._handler, self._noted, self._leaving = before, None, False
                signal.signal(signal.SIGINT, self._here)
            self._at_once = False
            yield self
            if not returns:
                self.check()
        except BaseException as error:
            returns = False
            if isinstance(error, Exception):
                self.check()
                raise in_users_words(error)  # noqa: B904 - its cause is set
            raise
        finally:
            self._at_once = at_once
            if outermost:
                self._leave(again=returns)

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Raise Ctrl-C at once in this part of a block, and at the end if the code in it swallows it.

        For what may last and can end anywhere: a user's callback, CVODES, a factorisation.
        """
        if signal.getsignal(signal.SIGINT) is not self._here or not _in_main_thread():
            yield
            return
        before, self._at_once = self._at_once, True
        try:
            self.check()
            yield
            self.check()
        except Exception:
            self.check()
            raise
        finally:
            self._at_once = before

    def _leave(self, *, again: bool) -> None:
        """Put the handler back that was there, and raise what came too late for a check, or have it sent again."""
        self._leaving = True  # one that comes now must not keep the handler from being put back
        signal.signal(signal.SIGINT, self._handler)
        late, self._noted = self._noted, None
        if late is not None and again:
            sender = threading.Timer(_AGAIN, _thread.interrupt_main)
            sender.daemon = True
            sender.start()
        elif late is not None:
            raise late.with_traceback(None)

    def _arrived(self, number: int, frame: FrameType | None) -> None:
        """Ask the handler that was there what it makes of the signal; an exception is what has to wait."""
        self._count += 1
        waits = self._leaving or (self._noted is None and not self._at_once)
        try:
            self._handler(number, frame)
        except BaseException as raised:
            self._noted = raised
            if not waits:
                raise


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


# a process has one SIGINT, hence one of these
INTERRUPTS = Interrupts()
interrupts_kept = INTERRUPTS.kept
interrupts_at_once = INTERRUPTS.at_once
check_interrupts = INTERRUPTS.check


def guarded(items: Iterable[T]) -> Iterator[T]:
    """Yield the items, each of them made with `interrupts_kept`."""
    iterator = iter(items)
    while True:
        with interrupts_kept():
            try:
                item = next(iterator)
            except StopIteration:
                return
        yield item
