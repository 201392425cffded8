"""How many harmonics an expression has: read off its operations, so that it holds at all parameter values.

Sums, differences and products of harmonics and of the motion have a highest harmonic; any other expression (a fraction,
a switch, a phase with a parameter before it) has none that could be told.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca


class Spectrum(NamedTuple):
    """A polynomial of degree ``degree`` in the motion whose coefficients have harmonics of tau up to ``highest``.

    Upper bounds, exact unless terms cancel.
    """

    degree: int
    highest: int


class _Phase(NamedTuple):
    """A whole multiple of tau, and something constant."""

    multiple: int


_CONSTANT = Spectrum(0, 0)
_MOTION = Spectrum(1, 0)
_Read = Spectrum | _Phase | None


def spectra(function: ca.Function, tau: int, motion: Sequence[int] = ()) -> list[list[Spectrum | None]]:
    """Return the spectrum of each entry of each output of an SX function; None where an entry has no highest harmonic.

    Parameters
    ----------
    function : casadi.Function
    tau : int
        The input that is the phase.
    motion : sequence of int
        The inputs that hold the motion; those that are neither are constant over a period.
    """
    read: dict[int, _Read] = {}
    numbers: dict[int, float] = {}
    result: list[list[Spectrum | None]] = [[_CONSTANT] * function.numel_out(i) for i in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            value = read[inputs[0]]
            result[outputs[0]][outputs[1]] = value if isinstance(value, Spectrum) else None
            continue
        target = outputs[0]
        if operation == ca.OP_CONST:
            read[target], numbers[target] = _CONSTANT, function.instruction_constant(k)
            continue
        if operation == ca.OP_INPUT:
            read[target] = _Phase(1) if inputs[0] == tau else _MOTION if inputs[0] in motion else _CONSTANT
        else:
            read[target] = _result(operation, [read[i] for i in inputs], [numbers.get(i) for i in inputs])
        numbers.pop(target, None)
    return result


def _result(operation: int, of: list[_Read], numbers: list[float | None]) -> _Read:
    """Return what one operation makes of its arguments, of which some are numbers."""
    if any(each is None for each in of):
        return None
    if any(isinstance(each, _Phase) for each in of):
        return _of_phases(operation, of, numbers)
    known = [each for each in of if isinstance(each, Spectrum)]
    first, last = known[0], known[-1]
    exponent = numbers[-1]
    power = int(exponent) if exponent is not None and exponent >= 0.0 and exponent.is_integer() else None
    result: Spectrum | None = None
    if all(each == _CONSTANT for each in known):
        result = _CONSTANT
    elif operation in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN):
        result = Spectrum(max(each.degree for each in known), max(each.highest for each in known))
    elif operation == ca.OP_MUL:
        result = Spectrum(first.degree + last.degree, first.highest + last.highest)
    elif operation == ca.OP_SQ:
        result = Spectrum(2 * first.degree, 2 * first.highest)
    elif operation in (ca.OP_CONSTPOW, ca.OP_POW) and power is not None:
        result = Spectrum(power * first.degree, power * first.highest)
    elif operation == ca.OP_DIV and last == _CONSTANT:
        result = first
    return result


def _of_phases(operation: int, of: list[_Read], numbers: list[float | None]) -> _Read:
    """Return what one operation makes of arguments among which are multiples of tau."""
    multiples = [each.multiple if isinstance(each, _Phase) else 0 for each in of]
    if not all(isinstance(each, _Phase) or each == _CONSTANT for each in of):
        return None
    first, last = multiples[0], multiples[-1]
    if operation in (ca.OP_SIN, ca.OP_COS):
        return Spectrum(0, abs(first))
    factor: float | None = None
    if operation in (ca.OP_ADD, ca.OP_SUB):
        factor = first + last if operation == ca.OP_ADD else first - last
    elif operation in (ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN):
        factor = {ca.OP_NEG: -1, ca.OP_TWICE: 2, ca.OP_ASSIGN: 1}[operation] * first
    elif operation == ca.OP_MUL:
        number = numbers[1] if isinstance(of[0], _Phase) else numbers[0]
        factor = None if number is None else number * (first or last)
    elif operation == ca.OP_DIV and numbers[-1]:
        factor = first / numbers[-1]
    if factor is None or not float(factor).is_integer():
        return None
    return _Phase(int(factor)) if factor else _CONSTANT
