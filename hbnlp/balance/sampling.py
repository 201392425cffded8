"""How many samples a period a force needs, so that products of harmonics do not fold back onto the retained ones."""

from __future__ import annotations

import casadi as ca

from hbnlp.systems.system import System

HIGHEST_DEGREE = 9
MOST_SAMPLES = 8192


def polynomial_degree(system: System) -> int | None:
    """Return the degree of the force as a polynomial in (q, q'), or None if it is no polynomial or depends on tau.

    The degree is carried through the operations of the force one by one, so that it holds whatever the units and the
    parameter values: an upper bound (at least 1), exact unless terms cancel. Degrees above 9 count as no polynomial.
    """
    arguments = [system.q, system.v, system.tau, system.p]
    force = ca.Function("force", arguments, [ca.densify(system.force)])
    degrees: dict[int, int | None] = {}
    constants: dict[int, float] = {}
    highest = 1
    for k in range(force.n_instructions()):
        operation = force.instruction_id(k)
        inputs, outputs = force.instruction_input(k), force.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            degree = degrees[inputs[0]]
            if degree is None:
                return None
            highest = max(highest, degree)
            continue
        target = outputs[0]
        constants.pop(target, None)
        if operation == ca.OP_CONST:
            degrees[target], constants[target] = 0, force.instruction_constant(k)
        elif operation == ca.OP_INPUT:
            # inputs 0 and 1 are q and q', 2 is tau, 3 the parameters
            degrees[target] = (1, 1, None, 0)[inputs[0]]
        else:
            exponent = constants.get(inputs[1]) if len(inputs) > 1 else None
            degrees[target] = _degree(operation, [degrees[i] for i in inputs], exponent)
    return highest if highest <= HIGHEST_DEGREE else None


def _degree(operation: int, degrees: list[int | None], exponent: float | None) -> int | None:
    """Return the degree of the result of one operation, None where that is no polynomial."""
    known = [degree for degree in degrees if degree is not None]
    if len(known) < len(degrees):
        return None
    first, last = (known[0], known[-1]) if known else (0, 0)
    power = int(exponent) if exponent is not None and exponent >= 0.0 and exponent == int(exponent) else None
    if max(known, default=0) == 0:
        degree: int | None = 0
    elif operation in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN):
        degree = max(known)
    elif operation == ca.OP_MUL:
        degree = first + last
    elif operation == ca.OP_SQ:
        degree = 2 * first
    elif operation in (ca.OP_CONSTPOW, ca.OP_POW) and power is not None:
        degree = power * first
    else:
        degree = first if operation == ca.OP_DIV and last == 0 else None
    return degree


def sufficient_samples(n_harmonics: int, degree: int | None) -> int:
    """Return the samples that are exact for a polynomial force, (d + 1) H + 1, or a start for doubling (d = 7)."""
    return ((7 if degree is None else max(degree, 1)) + 1) * n_harmonics + 1
