"""Where an expression is not smooth: the quantities at whose zeros it jumps or has a kink."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np

_OF_ARGUMENT = (ca.OP_SIGN, ca.OP_FABS, ca.OP_SQRT, ca.OP_LOG, ca.OP_LOG1P)
_OF_DIFFERENCE = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_FMIN, ca.OP_FMAX)
_LOGICAL = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR)


def switches(expression: ca.SX, rate: Callable[[ca.SX], ca.SX] | None = None) -> ca.SX:
    """Return the quantities (m,) at whose zeros an expression is not smooth, as far as its operations tell.

    They are the arguments of signs, moduli, roots and comparisons, and what is zero where a function that is periodic
    or has two branches jumps. There may be zeros at which the expression is smooth.

    A root or an arc cosine whose argument touches its limit has a kink where the argument's derivative by the phase is
    zero, which is found more exactly than where it touches: ``rate`` is that derivative, where it can be had.
    """
    found: list[ca.SX] = []
    for node in nodes(expression):
        found += _of_node(node.op(), dependencies(node), rate)
    return ca.cse(ca.vertcat(*[each for each in found if not each.is_constant()]))


def nodes(expression: ca.SX) -> Iterator[ca.SX]:
    """Yield the operations of an expression, each once."""
    seen: set[int] = set()
    pending = [entry for entry in ca.SX(expression).nonzeros() if not entry.is_constant()]
    while pending:
        node = pending.pop()
        key = node.element_hash()
        if key not in seen and not node.is_leaf():
            seen.add(key)
            yield node
            pending += dependencies(node)


def dependencies(node: ca.SX) -> list[ca.SX]:
    """Return what an operation is applied to."""
    return [node.dep(i) for i in range(node.n_dep())]


def _of_node(operation: int, of: list[ca.SX], rate: Callable[[ca.SX], ca.SX] | None) -> list[ca.SX]:
    quantities: list[ca.SX] = []
    if operation in _OF_ARGUMENT or (operation == ca.OP_IF_ELSE_ZERO and of[0].op() not in _LOGICAL):
        quantities = [of[0]]
    elif operation in _OF_DIFFERENCE:
        quantities = [of[0] - of[1]]
    elif operation in (ca.OP_FLOOR, ca.OP_CEIL):
        quantities = [ca.sin(np.pi * of[0])]
    elif operation == ca.OP_FMOD:
        quantities = [ca.sin(np.pi * (of[0] / of[1]))]
    elif operation == ca.OP_REMAINDER:
        quantities = [ca.cos(np.pi * (of[0] / of[1]))]
    elif operation in (ca.OP_ASIN, ca.OP_ACOS):
        quantities = [1.0 - of[0], 1.0 + of[0]] if rate is None else [rate(of[0])]
    elif operation == ca.OP_TAN:
        quantities = [ca.cos(of[0])]
    elif operation == ca.OP_COPYSIGN:
        quantities = [of[1]]
    elif operation == ca.OP_ATAN2:
        # the branch cut, along which the second argument is negative
        quantities = [of[0]]
    elif operation in (ca.OP_CONSTPOW, ca.OP_POW) and not _is_whole(of[1]):
        quantities = [of[0]]
    if rate is not None and operation in (ca.OP_SQRT, ca.OP_CONSTPOW, ca.OP_POW):
        quantities += [rate(each) for each in quantities]
    return quantities


def _is_whole(exponent: ca.SX) -> bool:
    return bool(exponent.is_constant()) and float(exponent) == round(float(exponent))
