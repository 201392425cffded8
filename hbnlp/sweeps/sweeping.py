"""Marching through values of a parameter, by Newton's method or by direct integration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, overload

from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Newton
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import flag, instance_of, list_of_callables, refused
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.renamed import renamed_arguments
from hbnlp.integration.first_order import Method
from hbnlp.solutions.solution import Solution
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
    start: Solution | ArrayLike | None = None,
    callbacks: Callbacks = (),
) -> Sweep: ...
@overload
def sweep(
    subject: System,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Method | None = None,
    start: Any = None,
    callbacks: Callbacks = (),
    n_harmonics: int | None = None,
    periods: int | None = None,
    max_periods: int | None = None,
    periodic_tol: float | None = None,
    find_jumps: bool | None = None,
) -> TimeSweep: ...
@renamed_arguments(initial="start", progress="callbacks=[...]: each is called with a hbnlp.Progress")
@interrupts_kept(returns=True)
def sweep(
    subject: HarmonicBalance | System,
    name: str,
    values: ArrayLike,
    *,
    at: Mapping[str, float] | None = None,
    method: Any = None,
    start: Any = None,
    callbacks: Callbacks = (),
    n_harmonics: int | None = None,
    periods: int | None = None,
    max_periods: int | None = None,
    periodic_tol: float | None = None,
    find_jumps: bool | None = None,
) -> Sweep | TimeSweep:
    """March through values of a parameter, each solution starting from the last; jumps are recorded.

    Parameters
    ----------
    subject : HarmonicBalance or System
        A balance is marched by Newton's method, a system by direct integration.
    name : str
        The parameter that is varied.
    values : array (k,)
        In the order of marching: rising for a sweep up, falling for a sweep down.
    at : mapping, optional
        Values of the other parameters.
    method : Newton, or RungeKutta4, ExponentialRungeKutta4 or Adaptive
        For a balance or a system, respectively.
    start : Solution or array, optional
        Where to begin. For a balance, a solution at a value before the first, or coefficients (n_dof, 2H+1) near that
        at the first; for a system, what `hbnlp.integrate` takes: a solution, a state, coefficients, a response.
    callbacks : sequence of callables
        Called after each value with a `Progress`; one that raises `StopTracing` ends the sweep, as Ctrl-C does.
    n_harmonics : int, optional
        Of a system only, as all that follow: harmonics that are kept, 5 by default.
    periods, max_periods, periodic_tol : optional
        As in `hbnlp.integrate`, for each value; 1, 2000 and 1e-8 by default. A response that does not become periodic
        is kept and marked; marching goes on.
    find_jumps : bool, optional
        Whether jumps are looked for, which they are by default; the proof of each costs one more integration.

    Returns
    -------
    Sweep or TimeSweep
        Of fewer values where it broke off; ``message`` says why.

    Raises
    ------
    ValueError, KeyError
        For an unknown parameter, values that are not finite, a step that is unstable at the first value.
    TypeError
        For a subject, a method, callbacks or an option of another kind, or one that the subject does not take.
    """
    given = {
        "n_harmonics": n_harmonics,
        "periods": periods,
        "max_periods": max_periods,
        "periodic_tol": periodic_tol,
        "find_jumps": find_jumps,
    }
    options: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    if isinstance(values, tuple) and len(values) == 2:
        raise refused(
            ValueError,
            "values",
            values,
            "all values to march through, numpy.linspace(begin, end, 50), or two as a list",
        )
    if find_jumps is not None:
        flag("find_jumps", find_jumps)
    if isinstance(subject, System):
        return march(subject, name, values, at=at, method=method, start=start, callbacks=callbacks, **options)
    instance_of("subject", subject, HarmonicBalance, "a HarmonicBalance or a System")
    if options:
        raise TypeError(
            f"{next(iter(options))} is an option of a sweep by integration; give a System to have one, problem.system, "
            "or leave it out: a HarmonicBalance has its own harmonics and periods"
        )
    list_of_callables("callbacks", callbacks)
    return NewtonMarch(subject, name, values, at=at, method=method or Newton(), start=start).run(callbacks)
