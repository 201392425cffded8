"""What is costly to build and asked for again, kept with its owner within bounds."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

T = TypeVar("T")


class Kept(Generic[T]):
    """Objects by key, built when first asked for; of those the ``most`` last used are kept.

    An interrupt while one is built leaves nothing of it; threads that ask for the same one get the same.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._objects: OrderedDict[Hashable, T] = OrderedDict()
        self._lock = threading.RLock()

    def get(self, key: Hashable, build: Callable[[], T]) -> T:
        """Return the object of this key, from ``build`` if there is none."""
        with self._lock:
            if key not in self._objects:
                self._objects[key] = build()
                while len(self._objects) > self._most:
                    self._objects.popitem(last=False)
            self._objects.move_to_end(key)
            return self._objects[key]

    def __len__(self) -> int:
        return len(self._objects)
