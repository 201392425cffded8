"""Marching through values of a parameter, by Newton's method or by direct integration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, overload

from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Newton
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import instance_of, list_of_callables
from hbnlp.integration.first_order import Method
from hbnlp.sweeps.by_integration import march
from hbnlp.sweeps.by_newton import NewtonMarch
from hbnlp.sweeps.records import Sweep, TimeSweep
from hbnlp.systems.system import System


@overload
def sweep(
    subject: HarmonicBalance,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Newton | None = None,
    callbacks: Callbacks = (),
    **options: Any,
) -> Sweep: ...
@overload
def sweep(
    subject: System,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Method | None = None,
    callbacks: Callbacks = (),
    **options: Any,
) -> TimeSweep: ...
def sweep(
    subject: HarmonicBalance | System,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Any = None,
    callbacks: Callbacks = (),
    **options: Any,
) -> Sweep | TimeSweep:
    """March through values of a parameter, each solution starting from the last; jumps are recorded.

    Parameters
    ----------
    subject : HarmonicBalance or System
        A balance is marched by Newton's method, a system by direct integration.
    name : str
    values : array (k,)
        In the order of marching: rising for a sweep up, falling for a sweep down.
    at : mapping, optional
        Values of the other parameters.
    method : Newton, or RungeKutta4 or Adaptive
        For a balance or a system, respectively.
    callbacks : sequence of callables
        Called after each value with a `Progress`; one that raises `StopTracing` ends the sweep, as Ctrl-C does.
    **options
        For a balance: ``start``, a Solution or coefficients (n_dof, 2H+1) to begin from. For a system: those of
        `hbnlp.sweeps.by_integration.march`.

    Returns
    -------
    Sweep or TimeSweep

    Raises
    ------
    ValueError, KeyError
        For an unknown parameter, or values that are not finite.
    TypeError
        For a subject, a method, callbacks or an option of another kind.
    """
    if isinstance(subject, System):
        given = {"method": method} if method is not None else {}
        return march(subject, name, values, at=at, callbacks=callbacks, **given, **options)
    instance_of("subject", subject, HarmonicBalance, "a HarmonicBalance or a System")
    list_of_callables("callbacks", callbacks)
    return NewtonMarch(subject, name, values, at=at, method=method or Newton(), **options).run(callbacks)
