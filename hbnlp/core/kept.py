"""What is costly to build and asked for again, built by one thread at a time and kept with its owner within bounds."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import cached_property
from typing import Any, Generic, Self, TypeVar, overload

T = TypeVar("T")

# One lock for all that is built: what is built asks for more of it, and of several locks two threads could each hold
# the one that the other needs. The second lock is held for a look-up only, so that no thread waits for what another
# one builds unless it wants the same.
_BUILDING, _LOOKING = threading.RLock(), threading.RLock()

if hasattr(os, "register_at_fork"):
    # a child that was forked while another thread held a lock would wait for ever
    for _lock in (_BUILDING, _LOOKING):
        os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)


class Kept(Generic[T]):
    """Objects by key, built when first asked for; of those the ``most`` last used are kept.

    An interrupt while one is built leaves nothing of it; threads that ask for the same one get the same.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._objects: OrderedDict[Hashable, T] = OrderedDict()

    def get(self, key: Hashable, build: Callable[[], T]) -> T:
        """Return the object of this key, from ``build`` if there is none."""
        found = self._found(key)
        if not found:
            with _BUILDING:
                found = self._found(key) or self._added(key, build())
        return found[0]

    def _found(self, key: Hashable) -> tuple[T] | tuple[()]:
        with _LOOKING:
            if key not in self._objects:
                return ()
            self._objects.move_to_end(key)
            return (self._objects[key],)

    def _added(self, key: Hashable, built: T) -> tuple[T]:
        with _LOOKING:
            self._objects[key] = built
            while len(self._objects) > self._most:
                self._objects.popitem(last=False)
        return (built,)

    def __len__(self) -> int:
        return len(self._objects)


class built_once(cached_property[T]):  # noqa: N801
    """A property that is built when first asked for, by one thread, and then kept.

    Unlike `functools.cached_property`, which two threads may each build: harmless for numbers, but not for symbols, of
    which an expression needs one and the same.
    """

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> T: ...
    def __get__(self, instance: object | None, owner: type[Any] | None = None) -> Self | T:
        """Return the attribute, the same for all threads."""
        if instance is None:
            return self
        with _BUILDING:
            return super().__get__(instance, owner)
