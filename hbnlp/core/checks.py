"""Checks of what users give: what it is called, the value given, what is accepted."""

from __future__ import annotations

import difflib
import math
import operator
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from hbnlp.core.types import Array


def whole_number(name: str, value: Any, *, least: int, most: int | None = None, advice: str = "") -> int:
    """Return ``value`` as an int within ``least`` and ``most``, or raise a ValueError that names it."""
    accepted = f"an integer of at least {least}" if most is None else f"an integer from {least} to {most}"
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if number < least or isinstance(value, bool) or (most is not None and number > most):
        raise ValueError(f"{name} is {value!r}; give {accepted}{advice}")
    return number


def as_float(value: Any) -> float | None:
    """Return a real number of any kind as a float; None for text, truth values, complex values and longer arrays.

    ``float`` alone would read ``"1.2"`` and ``True`` as numbers.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    foreign = isinstance(value, np.ndarray) or (
        isinstance(value, np.generic) and not isinstance(value, np.integer | np.floating)
    )
    if foreign or isinstance(value, bool) or not hasattr(value, "__float__"):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # of symbols, and of numbers beyond the largest
        return None
    symbolic = math.isnan(number) and not isinstance(value, float | np.floating)  # CasADi reads its symbols as nan
    return None if symbolic else number


def real_number(
    name: str, value: Any, *, above: float = -math.inf, least: float = -math.inf, advice: str = ""
) -> float:
    """Return ``value`` as a finite float greater than ``above`` and at least ``least``, or raise an error naming it.

    Raises
    ------
    TypeError
        If it is no number.
    ValueError
        If it is not finite or too small.
    """
    bounds = [f" greater than {above:g}"] if above > -math.inf else []
    bounds += [f" of at least {least:g}"] if least > -math.inf else []
    accepted = f"a finite number{' and'.join(bounds)}{advice}"
    number = as_float(value)
    if number is None:
        raise TypeError(f"{name} is {value!r}; give {accepted}")
    if not math.isfinite(number) or number <= above or number < least:
        raise ValueError(f"{name} is {value!r}; give {accepted}")
    return number


def finite_numbers(name: str, values: Any) -> Array:
    """Return a sequence of finite numbers as an array (k,), k >= 1, or raise a ValueError that names it."""
    if isinstance(values, np.ndarray):
        values = np.atleast_1d(values)
    single = as_float(values)
    several = single is None and isinstance(values, Iterable) and not isinstance(values, str | bytes)
    numbers = [as_float(entry) for entry in values] if several else [single]
    if not numbers or any(number is None or not math.isfinite(number) for number in numbers):
        given = textwrap.shorten(repr(values), 120, placeholder=" ...")
        raise ValueError(f"{name} = {given}; a sequence of finite numbers, at least one, is needed")
    return np.array(numbers, dtype=float)


def counted(number: int, what: str) -> str:
    """Return "1 fold", "2 folds"."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def instance_of(name: str, value: Any, kinds: Any, advice: str) -> None:
    """Raise a TypeError that names ``value`` and says what to give unless it is of one of the ``kinds``."""
    if not isinstance(value, kinds) or isinstance(value, type):  # a class has all methods of a protocol
        raise TypeError(f"{name} is {textwrap.shorten(repr(value), 120, placeholder=' ...')}; give {advice}")


def list_of_callables(name: str, value: Any) -> None:
    """Raise a TypeError that names ``value`` unless it is a sequence of callables."""
    if not isinstance(value, Sequence) or not all(callable(each) for each in value):
        raise TypeError(f"{name} is {value!r}; give a list of callables, [...], also for a single one")


def unknown_name(kind: str, name: str, known: Iterable[str]) -> str:
    """Return the message for a name that is not known, with the nearest known one."""
    known = list(known)
    near = difflib.get_close_matches(str(name), known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"unknown {kind} {name!r}{hint} (known: {', '.join(known) or 'none'})"


def position(kind: str, name: str, known: Sequence[str]) -> int:
    """Return where a name stands among the known ones, or raise a KeyError with the nearest of them."""
    if name not in known:
        raise KeyError(unknown_name(kind, name, known))
    return known.index(name)
