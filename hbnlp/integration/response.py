"""What a time integration returns: the last period, its outputs and their harmonics, and how it ended."""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from hbnlp.core.checks import position, whole_number
from hbnlp.core.layout import (
    Column,
    Layout,
    counted_from_one,
    flag,
    mapping,
    maybe,
    number,
    numbers_by_name,
    text,
    texts,
    whole,
)
from hbnlp.core.records import check_parameters, loaded, save_record
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array, ComplexArray
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.exponential import ExponentialRungeKutta4
from hbnlp.integration.first_order import FirstOrderForm, Method, Window
from hbnlp.integration.runge_kutta import RungeKutta4
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_METHODS = {each.__name__: each for each in (RungeKutta4, ExponentialRungeKutta4, Adaptive)}


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TimeResponse(ReadOnlyArrays, Tabular):
    """The last window (one or more periods of the forcing) of an integration in time.

    Attributes
    ----------
    t : array (n_t,)
        Times since the window's beginning, where the phase ``tau = omega t`` is zero; equidistant, end left out.
    q, v, x : array (n_t, n), (n_t, n), (n_t, m)
        Displacements, velocities and lag states.
    state : array (n_state,)
        (q, q', x) at the window's end: the place to go on from.
    signals : array (n_t, n_outputs)
        All outputs, in the order of ``output_names``.
    parameters : dict
        Parameter values.
    periods : int
        Periods of the forcing in a window.
    periodic : bool
        Whether the state repeated itself within the tolerance.
    defects : array (n_windows,)
        Relative change of the state over each window so far. What is left of the transient is larger by
        ``1 / (1 - |multiplier|)`` of the slowest Floquet multiplier.
    n_periods : int
        Periods of the forcing that were integrated in all.
    stopped_at : float or None
        The time since the very beginning at which the integration broke off, if it did.
    method : Method
        What integrated.
    message : str
        How it ended, and what to do about it.
    """

    t: Array
    q: Array
    v: Array
    x: Array
    state: Array
    signals: Array
    output_names: tuple[str, ...]
    parameters: dict[str, float]
    periods: int
    periodic: bool
    defects: Array
    n_periods: int
    stopped_at: float | None
    method: Method
    message: str

    @property
    def converged(self) -> bool:
        """Whether the response became periodic."""
        return self.periodic

    @property
    def omega(self) -> float:
        """Frequency of the forcing."""
        return self.parameters["omega"]

    def signal(self, output: str) -> Array:
        """Return a named output at the times ``t``, (n_t,)."""
        return self.signals[:, position("output", output, self.output_names)]

    def harmonics(self, output: str, n_harmonics: int = 5) -> ComplexArray:
        """Return the complex amplitudes of a named output, (n_harmonics + 1,): a_0 and a_{2h-1} - i a_{2h}.

        They are projections over the whole window with the phase of the forcing, harmonics of ``omega / periods``.
        """
        amplitudes: ComplexArray = project(self._whole(self.signal(output)[:, None]), n_harmonics)[0]
        return amplitudes

    def displacement_harmonics(self, n_harmonics: int = 5) -> ComplexArray:
        """Return the complex amplitudes of all displacements, (n, n_harmonics + 1)."""
        return project(self._whole(self.q), n_harmonics)

    def all_harmonics(self, n_harmonics: int = 5) -> ComplexArray:
        """Return the complex amplitudes of all outputs, (n_outputs, n_harmonics + 1)."""
        return project(self._whole(self.signals), n_harmonics)

    def plot(self, output: str, *, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw an output over the last window, in forcing periods; see `hbnlp.plot.plot_response`."""
        from hbnlp.plot import plot_response

        return plot_response(self, output, ax=ax, **options)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the response to one ``.npz`` file without pickle, whole or not at all.

        Raises
        ------
        SaveError
            If the file cannot be written, or it was integrated by a method that is not the package's.
        """
        save_record(self, path, _LAYOUT, method=_said(self.method))

    def _table(self) -> Table:
        return table_of(self, _LAYOUT, axes=("t",), method=_said(self.method))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> TimeResponse:
        """Return a response from a file that `save` wrote; `hbnlp.integrate` goes on with ``start=response``.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        LoadError
            (A `ValueError`.) If the file is damaged or holds something else.
        """
        with loaded(path, _LAYOUT) as content:
            check_parameters(content)
            n_state = 2 * content["q"].shape[1] + content["x"].shape[1]
            if content["state"].size != n_state:
                raise ValueError(f"its state has {content['state'].size} entries, its displacements need {n_state}")
            if content["defects"].size * content["periods"] != content["n_periods"]:
                raise ValueError(
                    f"it has {content['defects'].size} defects, each over {content['periods']} of "
                    f"{content['n_periods']} periods"
                )
            return cls(**content)

    def _whole(self, signals: Array) -> Array:
        if self.stopped_at is not None:
            raise ValueError("the integration broke off within its last period: there are no harmonics of it")
        return signals

    def __repr__(self) -> str:
        kind = "periodic" if self.periodic else "not periodic"
        defect = f"{self.defects[-1]:.1e}" if self.defects.size else "none"
        return (
            f"TimeResponse: {kind} after {self.n_periods} periods at omega = {self.omega:g}, last defect {defect}\n"
            f"  {self.method!r}, {self.t.size} times in {self.periods} period{'s' if self.periods > 1 else ''}\n"
            f"  {self.message}"
        )


def _said(method: Method) -> dict[str, Any]:
    """Return a method by its name and options, or by its name alone if it is not the package's."""
    options = dataclasses.asdict(method) if isinstance(method, RungeKutta4 | ExponentialRungeKutta4 | Adaptive) else {}
    return {"name": type(method).__name__, **options}


def _method(value: Any) -> Method:
    """Return the method of such a name and options."""
    options = mapping(value)
    name = options.get("name")
    if name not in [*_METHODS]:
        raise ValueError(f"{name!r}; one of {', '.join(_METHODS)} is needed")
    method: Method = _METHODS[name](**{key: each for key, each in options.items() if key != "name"})
    return method


_LAYOUT = Layout(
    kind="time response",
    columns={
        "t": Column("times", about="time since the beginning of the last window"),
        "q": Column("times dof", about="displacements"),
        "v": Column("times dof", about="velocities"),
        "x": Column("times lags", about="lag states"),
        "state": Column("states", about="(q, q', lag states) at the end, where tau = 0"),
        "signals": Column("times outputs", about="outputs"),
        "defects": Column("windows", finite=False, about="relative change of the state over each window", units="1"),
    },
    entries={
        "output_names": texts,
        "parameters": numbers_by_name,
        "periods": counted_from_one,
        "periodic": flag,
        "n_periods": whole,
        "stopped_at": maybe(number),
        "method": _method,
        "message": text,
    },
    lengths={"outputs": "output_names"},
    dimensions={"states": "component"},  # a variable is called state
)


def project(signals: Array, n_harmonics: int) -> ComplexArray:
    """Return complex amplitudes (k, n_harmonics + 1) of signals (n_t, k) sampled over whole periods."""
    size = signals.shape[0]
    n_harmonics = whole_number("n_harmonics", n_harmonics, least=0, most=(size - 1) // 2, advice=f" of {size} times")
    amplitudes: ComplexArray = np.fft.rfft(signals, axis=0)[: n_harmonics + 1].T * (2.0 / size)
    amplitudes[:, 0] *= 0.5
    return np.ascontiguousarray(amplitudes)


def respond(
    form: FirstOrderForm,
    values: Array,
    *,
    method: Method,
    periods: int,
    periodic_tol: float,
    window: Window,
    defects: list[float],
) -> TimeResponse:
    """Return the record of an integration: its last window with the outputs there, and the message."""
    system = form.system
    omega = float(values[system.parameters.index("omega")])
    n_periods = len(defects) * periods
    states, stopped_at = window.states, None
    if window.failed_at is None:
        states = states[:-1]
        message = _ending(defects[-1], periodic_tol, n_periods, periods)
        message += f"; {window.remark}" if window.remark else ""
    else:
        stopped_at = (2.0 * np.pi * n_periods + window.failed_at) / omega
        period = n_periods + int(window.failed_at / (2.0 * np.pi)) + 1
        message = f"stopped at t = {stopped_at:g}, in period {period}: {window.reason}"
    tau: Array = window.step * np.arange(states.shape[0], dtype=float)
    q, v, x = np.split(states, [system.n_dof, 2 * system.n_dof], axis=1)
    a = form.acceleration(states.T, tau[None, :], form.pack(values))
    signals = system.outputs(q.T, v.T, a, x.T, tau[None, :], values).full().T
    return TimeResponse(
        t=tau / omega,
        q=q,
        v=v,
        x=x,
        state=window.states[-1].copy(),
        signals=signals,
        output_names=system.output_names,
        parameters=system.parameters.as_dict(values),
        periods=periods,
        periodic=stopped_at is None and defects[-1] <= periodic_tol,
        defects=np.array(defects),
        n_periods=n_periods,
        stopped_at=stopped_at,
        method=method,
        message=message,
    )


def _ending(defect: float, periodic_tol: float, n_periods: int, periods: int) -> str:
    if defect <= periodic_tol:
        return f"the state repeats itself to {defect:.1e} (tolerance {periodic_tol:.1e})"
    return (
        f"not periodic after {n_periods} periods: the state still changes by {defect:.1e} over {periods} of them "
        f"(tolerance {periodic_tol:.1e}); raise max_periods, start nearer (start=), or, if the change does not fall, "
        f"try periods={2 * periods}: the response may be subharmonic, or not periodic at all"
    )
