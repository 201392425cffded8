"""Which integration method a system gets where none is asked for."""

from __future__ import annotations

from hbnlp.core.types import Array
from hbnlp.integration.exponential import ExponentialRungeKutta4, first_steps
from hbnlp.integration.first_order import FirstOrderForm, Method
from hbnlp.integration.runge_kutta import RungeKutta4, chosen_steps

METHODS = "RungeKutta4(...), ExponentialRungeKutta4(...) or Adaptive(...)"
QUICKER = 10
"""A step of the classical scheme takes at least this part of the time of the other's, measured on small systems."""


def automatic(form: FirstOrderForm, values: Array, state: Array) -> Method:
    """Return the classical scheme for a small system, the exponential one for others, and where lag states are fast.

    Measured: from some sixteen states on a step of either takes as long, and fast lag states ask the classical one for
    many more of them. Parameter values and a state stand for those at which the system will be integrated.
    """
    if not form.is_small:
        return ExponentialRungeKutta4()
    packed = form.pack(values)
    few = chosen_steps(form.eigenvalues(packed, state)) <= QUICKER * first_steps(form, packed, state)
    return RungeKutta4() if few else ExponentialRungeKutta4()
