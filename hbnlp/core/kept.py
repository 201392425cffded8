"""What is costly to build and asked for again, built by one thread at a time and kept with its owner within bounds."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import cached_property, wraps  # noqa: TID251
from typing import Any, Generic, ParamSpec, Self, TypeVar, overload

from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.locks import lasting_lock

T = TypeVar("T")
P = ParamSpec("P")

# One lock for all that is built: what is built asks for more of it, and of several locks two threads could each hold
# the one that the other needs. The second lock is held for a look-up only, so that no thread waits for what another
# one builds unless it wants the same.
# The order matters: before a fork the last one is taken first, as in `Kept.get`.
_LOOKING, _BUILDING = lasting_lock(), lasting_lock()


def by_one_thread(build: Callable[P, T]) -> Callable[P, T]:
    """Return a function that one thread at a time is in, together with all else that is built.

    CasADi's functions may be evaluated by many threads; where two make some at once, the process may end. Ctrl-C waits
    until it is built: CasADi swallows what is raised while it looks what kind of thing it was given.
    """

    @wraps(build)
    def alone(*arguments: P.args, **options: P.kwargs) -> T:
        with _BUILDING, interrupts_kept():
            return build(*arguments, **options)

    return alone


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
            with _BUILDING, interrupts_kept():
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

    Unlike `functools.cached_property`, which two threads may each build from Python 3.12 on: harmless for numbers, but
    not for symbols, of which an expression needs one and the same. Up to 3.11 that holds a lock of its own, which two
    threads take in another order than the one here, and which a forked process finds held for ever.
    """

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> T: ...
    def __get__(self, instance: object | None, owner: type[Any] | None = None) -> Self | T:
        """Return the attribute, the same for all threads."""
        if instance is None:
            return self
        with _BUILDING, interrupts_kept():
            return super().__get__(instance, owner)
