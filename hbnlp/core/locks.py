"""Locks that a forked process finds open, whichever thread held them in the process that it came from."""

from __future__ import annotations

import os
import threading
from typing import Any, Protocol


class Lock(Protocol):
    """What a lock is used for here: the with statement."""

    def __enter__(self) -> bool: ...
    def __exit__(self, *error: Any) -> None: ...


def lasting_lock() -> Lock:
    """Return a reentrant lock, for the life of the process, that a fork waits for.

    A child that was forked while another thread held a lock would wait for it for ever: that thread is not there.
    """
    lock = threading.RLock()
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release)
    return lock
