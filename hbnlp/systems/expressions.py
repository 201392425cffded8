"""What a user writes as a matrix, a force, a signal or numbers, read as CasADi expressions and checked."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbnlp.core.checks import finite_array
from hbnlp.core.types import Array
from hbnlp.systems.calling import called
from hbnlp.systems.parameters import Namespace

_ENTRIES = (ca.SX, ca.DM, float, int, np.generic, np.ndarray)

Matrix = ArrayLike | Callable[[Any], Any]
Force = Callable[[ca.SX, ca.SX, ca.SX, Any], Any]
Signal = Callable[[ca.SX, Any], Any]
Output = Callable[[Any], Any]


def displacements(n: int) -> dict[str, Output]:
    """Return the outputs of a system without any of its own: its displacements."""

    def reader(i: int) -> Output:
        return lambda s: s.q[i]

    return {"x" if n == 1 else f"x{i + 1}": reader(i) for i in range(n)}


def motion_derivatives(motion: ca.SX, tau: ca.SX, omega: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the derivatives u' and u'' of a motion u(tau) by time."""
    first = ca.jacobian(motion, tau)
    return omega * first, omega**2 * ca.jacobian(first, tau)


def compiled_outputs(
    rules: Mapping[str, Output], symbols: tuple[ca.SX, ca.SX, ca.SX, ca.SX], motion: ca.SX, n_lags: int, named: Any
) -> ca.Function:
    """Return a user's outputs as one CasADi function (q, q', q'', x, tau, p) -> their values."""
    q, v, tau, p = symbols
    a, x = ca.SX.sym("a", q.numel()), ca.SX.sym("x", n_lags)
    du, ddu = motion_derivatives(motion, tau, named.omega)
    signals = {"q": q, "v": v, "a": a, "x": x, "u": motion, "du": du, "ddu": ddu, "tau": tau, "p": named}
    arguments, rows = [q, v, a, x, tau, p], []
    for name, rule in rules.items():
        # copies for each: a rule that writes into its q would change what the next one sees
        copies = {key: ca.SX(each) if isinstance(each, ca.SX) else each for key, each in signals.items()}
        seen = Namespace("signal", copies)
        rows.append(column(f"output {name!r}", called(f"output {name!r}", rule, s=seen), 1))
        check_symbols(f"output {name!r}", rows[-1], arguments)
    return ca.Function("outputs", arguments, [ca.densify(ca.vertcat(*rows)) if rows else ca.SX(0, 1)])


def matrix(what: str, given: Matrix | None, p: ca.SX, named: Any, shape: tuple[int, int] | None = None) -> ca.SX:
    """Return a user's matrix, which may be a callable of the parameters by name; ``shape`` None: square of any size."""
    if given is None and shape is not None:
        return ca.SX.zeros(*shape)
    value = called(what, given, p=named) if callable(given) else given
    if isinstance(value, ca.SX | ca.DM):
        read = ca.SX(value)
    else:
        array = _array(what, value)
        if array.ndim == 0:
            array = array.reshape(1, 1)
        if array.ndim != 2:
            raise ValueError(f"{what} has shape {array.shape}; a matrix is needed")
        read = ca.SX(*array.shape)
        for i, j in np.ndindex(array.shape):
            read[i, j] = _expression(what, array[i, j])
    if shape is None:
        shape = (read.shape[0], read.shape[0])
    if read.shape != shape:
        raise ValueError(f"{what} has shape {read.shape}; {shape} is needed")
    read = _with_finite_numbers(what, read)
    check_symbols(what, read, [p])
    return read


def column(what: str, value: Any, size: int | None = None, *, each: str = "") -> ca.SX:
    """Return what a user's function gave as a column of ``size`` expressions; ``each`` says of what."""
    if isinstance(value, ca.SX | ca.DM):
        read = ca.SX(value)
        shape = read.shape
        read = read.T if read.shape[0] == 1 and read.shape[1] > 1 else read
    else:
        entries = _array(what, value)
        shape = entries.shape
        read = ca.SX(0, 1)
        for entry in entries.ravel():
            read = ca.vertcat(read, _expression(what, entry))
    if sum(length > 1 for length in shape) > 1:
        raise ValueError(f"{what} returned a matrix of shape {shape}; a list of expressions is needed")
    if size is not None and read.shape[0] != size:
        returned = f"{read.shape[0]} expression{'s' if read.shape[0] != 1 else ''}"
        raise ValueError(f"{what} returned {returned}; {size} {'is' if size == 1 else 'are'} needed{each}")
    return _with_finite_numbers(what, ca.densify(read))


def _array(what: str, value: Any) -> NDArray[np.object_]:
    """Return what a user gave, numbers and expressions in lists or arrays, as an array of them."""
    try:
        return np.array(value, dtype=object)
    except Exception as error:  # earlier releases of CasADi raise nothing more special
        raise ValueError(
            f"{what} is a list with columns in it; one column, such as ca.vertcat(a, b), or a list of single "
            "expressions, such as [q[0], q[1]], is needed"
        ) from error


def _expression(what: str, entry: Any) -> ca.SX:
    if isinstance(entry, _ENTRIES) and not isinstance(entry, bool | np.bool_):
        with suppress(NotImplementedError):
            return ca.SX(entry)
    shown = textwrap.shorten(repr(entry), 80, placeholder=" ...")
    raise ValueError(f"{what} has the entry {shown}; a number or an expression of the symbols given to it is needed")


def check_symbols(what: str, expression: ca.SX, arguments: list[ca.SX]) -> None:
    """Raise a ValueError if an expression uses other symbols than these."""
    function = ca.Function("check", arguments, [expression], {"allow_free": True})
    strange = function.get_free()
    if strange:
        raise ValueError(f"{what} uses {strange[0]!r}, which is neither its argument nor a parameter")
    constants = (k for k in range(function.n_instructions()) if function.instruction_id(k) == ca.OP_CONST)
    if any(np.isnan(function.instruction_constant(k)) for k in constants):
        raise ValueError(f"{what} has the number nan in it, and so no value; look at the numbers that it takes")


def _with_finite_numbers(what: str, expression: ca.SX) -> ca.SX:
    if not all(np.isfinite(float(entry)) for entry in expression.nonzeros() if entry.is_constant()):
        raise ValueError(f"{what} has entries that are not finite")
    return expression


def numbers(what: str, given: ArrayLike | None, shape: tuple[int, int] | None) -> Array:
    """Return a constant matrix, checked; ``shape`` None: square of any size."""
    if given is None:
        return np.zeros(shape or (0, 0))
    array: Array = finite_array(what, given, (None, None) if shape is None else shape)
    if shape is None and array.shape[0] != array.shape[1]:
        raise ValueError(f"{what} has shape {array.shape}; give a square matrix")
    return array
