"""Checks of what users give, with one grammar of messages: what it is called, the value given, what to give.

They stand at the public boundary alone, first in a function and in ``__post_init__`` of options; what is evaluated at
every point or step has none.
"""

from __future__ import annotations

import difflib
import math
import operator
import os
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from hbnlp.core.types import Array

LONGEST = 110
"""Characters of a value that a message shows."""
MOST = 10**9
"""The largest number of anything, where no smaller one is given: libraries count with 32 bits."""


def refused(error: type[Exception], name: str, value: Any, accepted: str) -> Exception:
    """Return the error for an argument: "tol is -1; give a finite number greater than 0"."""
    return error(f"{name} is {_shown(value)}; give {accepted}")


def whole_number(name: str, value: Any, *, least: int, most: int = MOST, advice: str = "") -> int:
    """Return ``value`` as an int within ``least`` and ``most``, or raise a ValueError that names it."""
    try:
        number = operator.index(value)
    except (TypeError, RuntimeError):  # the latter of symbols
        number = least - 1
    if not least <= number <= most or isinstance(value, bool):
        unlimited = most == MOST and number < least
        accepted = f"an integer of at least {least}" if unlimited else f"an integer from {least} to {most}"
        raise refused(ValueError, name, value, accepted + advice)
    return number


def place(name: str, value: Any, length: int) -> int:
    """Return where an entry of so many stands, counted from the end where it is negative, as sequences are."""
    number = whole_number(name, value, least=-length, most=length - 1)
    return number if number >= 0 else number + length


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
    name: str,
    value: Any,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    below: float = math.inf,
    most: float = math.inf,
    advice: str = "",
) -> float:
    """Return ``value`` as a finite float within its bounds, or raise an error that names it.

    Raises
    ------
    TypeError
        If it is no number.
    ValueError
        If it is not finite, or outside of ``above < value < below`` or ``least <= value <= most``.
    """
    bounds = [f" greater than {above:g}"] if above > -math.inf else []
    bounds += [f" of at least {least:g}"] if least > -math.inf else []
    bounds += [f" less than {below:g}"] if below < math.inf else []
    bounds += [f" of at most {most:g}"] if most < math.inf else []
    accepted = f"a finite number{' and'.join(bounds)}{advice}"
    number = as_float(value)
    if number is None:
        raise refused(TypeError, name, value, accepted)
    if not math.isfinite(number) or not above < number < below or not least <= number <= most:
        raise refused(ValueError, name, value, accepted)
    return number


def finite_numbers(name: str, values: Any) -> Array:
    """Return a sequence of finite numbers as an array (k,), k >= 1, or raise a ValueError that names it."""
    if isinstance(values, np.ndarray):
        values = np.atleast_1d(values)
    single = as_float(values)
    several = single is None and isinstance(values, Iterable) and not isinstance(values, str | bytes)
    try:
        numbers = [as_float(entry) for entry in values] if several else [single]
    except TypeError:  # of symbols, which have an iterator that raises
        numbers = []
    if not numbers or any(number is None or not math.isfinite(number) for number in numbers):
        raise refused(ValueError, name, values, "a sequence of finite numbers, at least one")
    return np.array(numbers, dtype=float)


def interval(
    name: str, value: Any, *, above: float = -math.inf, least: float = -math.inf, advice: str = ""
) -> tuple[float, float]:
    """Return two finite numbers in rising order, or raise a ValueError that names what was given."""
    bound = f" greater than {above:g}" if above > -math.inf else ""
    bound += f" of at least {least:g}" if least > -math.inf else ""
    ends = _entries(value)
    numbers = [end for end in ends if end is not None and math.isfinite(end) and end > above and end >= least]
    if len(ends) != 2 or len(numbers) != 2 or numbers[0] >= numbers[1]:
        raise refused(ValueError, name, value, f"two finite numbers{bound}, the lower one first{advice}")
    return numbers[0], numbers[1]


def two_values(name: str, value: Any, what: str) -> tuple[float, float]:
    """Return two different finite numbers as they come, or raise a ValueError that names what was given."""
    ends = _entries(value)
    numbers = [end for end in ends if end is not None and math.isfinite(end)]
    if len(ends) != 2 or len(numbers) != 2 or numbers[0] == numbers[1]:
        raise refused(ValueError, name, value, f"two different finite {what}, where to begin and where to end")
    return numbers[0], numbers[1]


def finite_array(
    name: str, value: Any, shape: Sequence[int | None] | None = None, *, kind: type = float, advice: str = ""
) -> Any:
    """Return ``value`` as an array of finite numbers, real ones unless ``kind`` is complex, or raise a ValueError.

    Parameters
    ----------
    name : str
    value : array_like
    shape : sequence of int or None, optional
        What is accepted; None stands for any length, and no shape at all for any shape.
    kind : float or complex
    """
    accepted = f"an array of finite {'numbers' if kind is complex else 'real numbers'}"
    if shape is not None:
        accepted += f" of shape ({', '.join('any' if n is None else str(n) for n in shape)}{',' * (len(shape) == 1)})"
    accepted += advice
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError):  # ragged lists, and symbols
        array = np.array(None)
    numeric = array.dtype.kind in ("iufc" if kind is complex else "iuf")
    if not numeric:
        raise refused(ValueError, name, value, accepted)
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        where = tuple(bad[0].tolist())
        raise refused(ValueError, f"{name}{list(where)}" if where else name, array[where].item(), accepted)
    if shape is not None and (
        array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"{name} has shape {array.shape}; give {accepted}")
    return array.astype(kind)


def counted(number: int, what: str) -> str:
    """Return "1 fold", "2 folds", "2 branches"."""
    return f"{number} {what}" + ("" if number == 1 else "es" if what.endswith("ch") else "s")


def instance_of(name: str, value: Any, kinds: Any, advice: str) -> None:
    """Raise a TypeError that names ``value`` and says what to give unless it is of one of the ``kinds``."""
    if not isinstance(value, kinds) or isinstance(value, type):  # a class has all methods of a protocol
        raise refused(TypeError, name, value, advice)


def flag(name: str, value: Any) -> None:
    """Raise a TypeError that names ``value`` unless it is True or False."""
    instance_of(name, value, bool | np.bool_, "True or False")


def text(name: str, value: Any) -> None:
    """Raise a TypeError that names ``value`` unless it is text."""
    instance_of(name, value, str, "a text")


def file_name(name: str, value: Any) -> None:
    """Raise a TypeError that names ``value`` unless it can be the path of a file."""
    instance_of(name, value, str | os.PathLike, "the path of a file, as text or a pathlib.Path")
    if "\0" in os.fsdecode(value):
        raise refused(ValueError, name, value, "a path without the character 0, which no system has in names")


def list_of(name: str, value: Any, kinds: Any, advice: str) -> None:
    """Raise a TypeError that names ``value`` unless it is a sequence of what is of one of the ``kinds``."""
    if not isinstance(value, Sequence) or isinstance(value, str) or not all(isinstance(each, kinds) for each in value):
        raise refused(TypeError, name, value, advice)


def function_of_time(name: str, law: Any, accepted: str, shapes: Sequence[tuple[int | None, ...]]) -> None:
    """Raise an error that names ``law`` unless it gives finite numbers in these shapes at time 0.

    One shape is that of what it returns; several are those of what it returns together.
    """
    instance_of(name, law, Callable, accepted)
    try:
        result = law(0.0)
    except Exception as error:
        raise refused(ValueError, name, law, f"{accepted}; at time 0 it raised {error!r}") from error
    parts = (result,) if len(shapes) == 1 else result
    if not isinstance(parts, Sequence | np.ndarray) or len(parts) != len(shapes):
        raise refused(ValueError, f"{name}(0.0)", result, accepted)
    for part, shape in zip(parts, shapes, strict=True):
        finite_array(f"{name}(0.0)", part, shape)


def list_of_callables(name: str, value: Any) -> None:
    """Raise a TypeError that names ``value`` unless it is a sequence of callables."""
    if not isinstance(value, Sequence) or not all(callable(each) for each in value):
        raise refused(TypeError, name, value, "a list of callables, [...], also for a single one")


def unknown_name(kind: str, name: Any, known: Iterable[str]) -> str:
    """Return the message for a name that is not known, with the nearest known one."""
    known = list(known)
    near = difflib.get_close_matches(str(name), known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"unknown {kind} {_shown(name)}{hint} (known: {', '.join(known) or 'none'})"


def position(kind: str, name: Any, known: Sequence[str]) -> int:
    """Return where a name stands among the known ones, or raise a KeyError with the nearest of them."""
    if not isinstance(name, str) or name not in known:
        raise KeyError(unknown_name(kind, name, known))
    return known.index(name)


def _entries(value: Any) -> list[float | None]:
    """Return the entries of a sequence as numbers; None for each that is none."""
    one = isinstance(value, str) or (isinstance(value, np.ndarray) and value.ndim == 0)
    return [as_float(entry) for entry in value] if isinstance(value, Sequence | np.ndarray) and not one else []


def _shown(value: Any) -> str:
    try:
        words = " ".join(repr(value.item() if isinstance(value, np.generic) else value).split())
    except ValueError:  # of an integer with thousands of digits
        words = f"a {type(value).__name__}"
    return words if len(words) <= LONGEST else f"{words[:LONGEST]} ..."
