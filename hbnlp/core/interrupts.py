"""Ctrl-C within calls to compiled code, which may swallow it or turn it into an error or a result of its own."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

T = TypeVar("T")


@contextmanager
def interrupts_kept() -> Iterator[None]:
    """Leave the block by a KeyboardInterrupt if one arrived in it, whatever the code within made of it.

    CVODES reports an interrupt as a failure of the right side, other solvers as a result, CasADi's functions may return
    None. Outside the main thread, which alone sees signals, this does nothing.
    """
    handler = signal.getsignal(signal.SIGINT)
    if not callable(handler) or threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal arrived
        try:
            handler(number, frame)
        except KeyboardInterrupt:
            arrived = True
            raise

    signal.signal(signal.SIGINT, note)
    try:
        yield
    except Exception:
        if arrived:
            raise KeyboardInterrupt from None
        raise
    finally:
        signal.signal(signal.SIGINT, handler)
    if arrived:
        raise KeyboardInterrupt


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
