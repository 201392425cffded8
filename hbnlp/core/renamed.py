"""Old names: they are errors that say the new one."""

from __future__ import annotations

import difflib
import functools
import inspect
import numbers
from collections.abc import Callable, Mapping, Sequence
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def renamed_arguments(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator for a function whose arguments have other names now: ``renamed_arguments(guess="start")``.

    What stands for the new name is put into the message as it is, so that it may be a sentence. Of a name that is not
    known the nearest is told; values of parameters, ``solve(problem, omega=1)``, are given with ``at``.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        known = list(inspect.signature(function).parameters)
        called = getattr(function, "__qualname__", "function").removesuffix(".__init__").rpartition(".")[2]

        @functools.wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            for old in names.keys() & kwargs.keys():
                raise TypeError(f"{called}() has no argument {old!r} any more: {_now(names[old])}")
            for unknown in kwargs.keys() - known:
                raise TypeError(f"{called}() has no argument {unknown!r}; {_instead(unknown, kwargs[unknown], known)}")
            return function(*args, **kwargs)

        return checked

    return decorate


def fewer_arguments(most: int, write: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator for a function that takes at most so many positional arguments now, and took more."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            if len(args) > most:
                name = getattr(function, "__name__", "function")
                many = "one argument" if most == 1 else f"{most} arguments"
                raise TypeError(f"{name}() takes no more than {many} by position now: {_now(write)}")
            return function(*args, **kwargs)

        return checked

    return decorate


def renamed_name(owner: str, name: str, names: Mapping[str, str]) -> AttributeError:
    """Return the error for an attribute that is not there, which names the new one if it is an old one."""
    if name in names:
        return AttributeError(f"{owner} has no {name!r} any more: {_now(names[name])}", name=name)
    return AttributeError(f"{owner} has no attribute {name!r}", name=name)


def _now(new: str) -> str:
    return f"it is {new!r} now" if new.isidentifier() else f"write {new}"


def _instead(unknown: str, value: object, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(unknown, known, n=1)
    if near:
        return f"did you mean {near[0]!r}?"
    place = next((name for name in ("at", "parameters") if name in known), None)
    is_value = place is not None and isinstance(value, numbers.Real)
    at = f"; values of parameters are given with {place}={{{unknown!r}: {value!r}}}" if is_value else ""
    return f"it takes {', '.join(name for name in known if name not in ('self', 'cls'))}{at}"
