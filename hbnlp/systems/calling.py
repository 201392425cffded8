"""A user's function is called with symbols, and what goes wrong in it is said in the user's terms."""

from __future__ import annotations

import inspect
import linecache
import re
import sys
import textwrap
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import PurePath
from typing import Any, NamedTuple

import casadi as ca

NO_NUMBER = "a symbol was asked for its number"
_LIBRARIES = {"casadi", "numpy", "scipy", "hbnlp", *sys.stdlib_module_names}
_NAMES = {
    "abs": "fabs",
    "absolute": "fabs",
    "arccos": "acos",
    "arcsin": "asin",
    "arctan": "atan",
    "arctan2": "atan2",
    "max": "fmax",
    "maximum": "fmax",
    "min": "fmin",
    "minimum": "fmin",
    "pow": "power",
    "select": "if_else",
    "where": "if_else",
}
"""CasADi's names of functions that are called otherwise elsewhere."""


def called(what: str, function: Any, **arguments: Any) -> Any:
    """Return what a user's function makes of symbols; functions of numpy are taken as CasADi's, without a warning.

    Parameters
    ----------
    what : str
        For messages: "forcing".
    function : callable
    **arguments
        Symbols or names of symbols, in the order in which the function takes them.

    Raises
    ------
    TypeError
        If it is no function, or one of other arguments.
    ValueError
        If it raises an error: the message says which, in which line, and what to write; the error is its cause.
    """
    signature = f"({', '.join(arguments)})"
    if not callable(function):
        raise TypeError(f"{what} is {function!r}; a function of {signature} is needed")
    if not _takes(function, len(arguments)):
        raise TypeError(
            f"{what} takes {inspect.signature(function)}; it is called with {signature}: write "
            f"lambda {signature[1:-1]}: ... or def f{signature}: ..."
        )
    try:
        with _among_symbols():
            # a copy of each: a function that writes into its q would take our symbols from us
            value = function(*[ca.SX(each) if isinstance(each, ca.SX) else each for each in arguments.values()])
    except Exception as error:
        place = _place(error)
        raise ValueError(f"{what}{place.words}: {_meaning(_Mistake(error, place.line, arguments))}") from error
    if value is None:
        raise ValueError(f"{what} returned None; end it with return and what it computes")
    return value


def _takes(function: Callable[..., Any], count: int) -> bool:
    try:
        inspect.signature(function).bind(*[None] * count)
    except TypeError:
        return False
    except ValueError:  # a function in C may have no signature; the call tells
        return True
    return True


@contextmanager
def _among_symbols() -> Iterator[None]:
    """Make CasADi raise an error where this thread wants the number of a symbol, and take numpy's functions in silence.

    CasADi's own answer is nan, and ``max(0, float(q[0]))`` would be zero, ``float(q[0]) > 0`` false, without a word.
    Both settings are CasADi's alone, and so of the whole process: it is one thread at a time that builds.
    """
    own, thread = ca.SX.__float__, threading.get_ident()
    # CasADi 3.8 can give several kinds of results for numpy's functions, and warns; -1: CasADi's own, as ever
    mode = ca.GlobalOptions.getNumpyMode() if hasattr(ca.GlobalOptions, "getNumpyMode") else None

    def number(symbol: ca.SX) -> float:
        if threading.get_ident() == thread and not symbol.is_constant():
            raise TypeError(NO_NUMBER)
        return float(own(symbol))

    try:
        ca.SX.__float__ = number
        if mode is not None:
            ca.GlobalOptions.setNumpyMode(-1)
        yield
    finally:
        ca.SX.__float__ = own
        if mode is not None:
            ca.GlobalOptions.setNumpyMode(mode)


class _Place(NamedTuple):
    """Where in the user's code an error was raised: in words, and the line if its source is there."""

    words: str
    line: str


def _place(error: Exception) -> _Place:
    """Return the last line that is not in a library: what it called is not the user's."""
    frames = [
        (frame, number)
        for frame, number in traceback.walk_tb(error.__traceback__)
        if str(frame.f_globals.get("__name__")).partition(".")[0] not in _LIBRARIES
    ]
    if not frames:
        return _Place("", "")
    frame, number = frames[-1]
    name, path = frame.f_code.co_name, frame.f_code.co_filename
    line = linecache.getline(path, number, frame.f_globals).strip()
    where = f"line {number} of {PurePath(path).name}" + (f", in {name}" if name != "<lambda>" else "")
    shown = f": `{textwrap.shorten(line, 80, placeholder=' ...')}`" if line else ""
    return _Place(f" ({where}{shown})", line)


class _Mistake(NamedTuple):
    """An error, the line that raised it, and the arguments of the function."""

    error: Exception
    line: str
    arguments: Mapping[str, Any]


class _Rule(NamedTuple):
    """What an error is known by, what it means, and what to write instead."""

    pattern: str
    meaning: str
    remedy: Callable[[_Mistake], str] | str = ""


def _meaning(mistake: _Mistake) -> str:
    """Return what an error means, by the first rule that knows it, and what to write instead."""
    raised = f"{type(mistake.error).__name__}: {mistake.error}".removesuffix(": ")
    for pattern, meaning, remedy in _RULES:
        known = re.search(pattern, raised)
        if known:
            advice = remedy if isinstance(remedy, str) else remedy(mistake)
            return known.expand(meaning) + (f"; {advice}" if advice else "")
    return raised


def _instead_of_decisions(mistake: _Mistake) -> str:
    written = {
        r"\bmax(imum)?\(": "ca.fmax(a, b)",
        r"\bmin(imum)?\(": "ca.fmin(a, b)",
        r"\band\b|<.*<|>.*>": "ca.logic_and(a, b)",
        r"\bor\b": "ca.logic_or(a, b)",
        r"\bnot\b": "ca.logic_not(a)",
        r"\bif\b": "ca.if_else(condition, a, b)",
    }
    found = [instead for pattern, instead in written.items() if re.search(pattern, mistake.line)]
    return f"write {', '.join(found or ['ca.if_else(condition, a, b)', 'ca.fmax(a, b)', 'ca.fmin(a, b)'])}"


def _casadis_functions(mistake: _Mistake) -> str:
    foreign = [*re.findall(r"numpy\.(\w+)", str(mistake.error)), *re.findall(r"\b(?!ca\.)\w+\.(\w+)\(", mistake.line)]
    names = dict.fromkeys(f"ca.{_NAMES.get(name, name)}" for name in foreign)
    known = [name for name in names if hasattr(ca, name[3:]) and name != "ca.array"]
    if known:
        return f"write {', '.join(known)}"
    return "write functions of CasADi, such as ca.sin, ca.sqrt, ca.fmax, without float() and int(), and return a list"


def _sizes(mistake: _Mistake) -> str:
    given = {name: of for name, of in mistake.arguments.items() if isinstance(of, ca.SX)}
    for name, of in mistake.arguments.items():
        if isinstance(of, Mapping) and name != "p":  # a parameter has one entry and no index
            given |= {f"{name}.{key}": symbol for key, symbol in of.items() if isinstance(symbol, ca.SX)}
    columns = {name: of for name, of in given.items() if not name.endswith("tau")} or given
    sizes: dict[int, list[str]] = {}
    for name, symbol in columns.items():
        sizes.setdefault(symbol.numel(), []).append(name)
    return "; ".join(f"{', '.join(names)}: {_entries(size)}" for size, names in sizes.items())


def _entries(size: int) -> str:
    return "no entries" if not size else "1 entry, [0]" if size == 1 else f"{size} entries, [0] to [{size - 1}]"


_COLUMN = "write q[0], q[1:], ca.dot(a, b), ca.sum1(a), ca.norm_2(a), a.numel(), or for each in ca.vertsplit(a)"
_RULES = (
    _Rule(
        "truth value",
        "a symbol is neither true nor false, so that if, and, or, not, min and max cannot decide by it",
        _instead_of_decisions,
    ),
    _Rule(
        f"{NO_NUMBER}|to_int not defined|does not support numpy|Implicit conversion of symbolic|loop of ufunc|"
        "not supported for the input types|setting an array element|no implementation found|Cannot cast ufunc|condlist",
        "a symbol has no number yet, as float, int, math, scipy, and some functions and arrays of numpy want it",
        _casadis_functions,
    ),
    _Rule("(?i)out of bounds|outside the range", "there is no such entry", _sizes),
    _Rule(
        "not iterable by design|has no len|'SX' object has no attribute", "a CasADi column is no numpy array", _COLUMN
    ),
    _Rule(
        "'method'|builtin_function_or_method",
        "a method stands where a value is meant",
        "call it, with (), or, of a parameter named get, items, keys or values, write p['values']",
    ),
    _Rule("'MX'", "MX symbols stand beside SX symbols", "write it with the symbols given to it alone"),
    _Rule("eval_sx", "this function of CasADi takes no SX symbols", "write it with ca.if_else, ca.pw_lin or sums"),
    _Rule(r"overloaded function '(?:SX_)?(\w+)'", r"CasADi's \1 does not take these arguments"),
    _Rule(r"^(?:AttributeError|KeyError): [\"']*(unknown .*\))", r"\1"),
    _Rule(r"^([^\n]*)", r"\1"),
)
