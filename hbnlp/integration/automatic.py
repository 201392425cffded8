"""Which integration method a system gets where none is asked for."""

from __future__ import annotations

from hbnlp.integration.exponential import ExponentialRungeKutta4
from hbnlp.integration.first_order import FirstOrderForm, Method
from hbnlp.integration.runge_kutta import RungeKutta4

METHODS = "RungeKutta4(...), ExponentialRungeKutta4(...) or Adaptive(...)"


def automatic(form: FirstOrderForm) -> Method:
    """Return the classical scheme for small systems, compiled as they are, the exponential one for others.

    Measured: from some sixteen states on a step takes as long, and is more accurate; fast lag states make it ten to
    forty times as long.
    """
    return RungeKutta4() if form.is_small else ExponentialRungeKutta4()
