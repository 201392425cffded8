"""Loads and deflections over time, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hbnlp.core.layout import Column, Layout
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LAYOUT = Layout(
    kind="history",
    columns={
        "time": Column("steps", about="ends of the steps", units="1"),
        "load_time": Column("steps", about="middles of the steps, the times of the loads", units="1"),
        "lift": Column("steps", about="C_L", units="1"),
        "drag": Column("steps", about="C_D", units="1"),
        "jump": Column("steps places", about="dCp along the plate", units="1"),
        "jump_modes": Column("steps modes", about="sine coefficients dCp_k", units="1"),
        "deflection": Column("steps shapes", about="sine coefficients W_k", units="1"),
        "rate": Column("steps shapes", about="W_k'", units="1"),
    },
    dimensions={"steps": "time"},
)


@dataclass(frozen=True)
class Record:
    """What a step leaves: loads are means over the step and belong to its middle, the deflection to its end.

    Parameters
    ----------
    time : float
        End of the step.
    lift, drag : float
        C_L and C_D, the whole force, friction included, normal to and along the stream.
    jump : ndarray of shape (n,)
        Pressure jump dCp along the sharp plate; empty for other bodies.
    coefficients : ndarray of shape (n_modes,)
        Its sine coefficients dCp_k; empty for other bodies.
    deflection, rate : ndarray of shape (n_modes,)
        W and W' of a plate that deforms; empty otherwise.
    """

    time: float
    lift: float
    drag: float
    jump: Array
    coefficients: Array
    deflection: Array
    rate: Array


@dataclass(frozen=True)
class History(ReadOnlyArrays, Tabular):
    """Records of a run, one row a step.

    Parameters
    ----------
    load_time : ndarray of shape (steps,)
        Middles of the steps, the times of the loads.
    time : ndarray of shape (steps,)
        Ends of the steps, the times of the deflections.
    lift, drag : ndarray of shape (steps,)
        C_L and C_D.
    jump : ndarray of shape (steps, n)
        dCp along the plate.
    coefficients : ndarray of shape (steps, n_modes)
        dCp_k.
    deflection, rate : ndarray of shape (steps, n_modes)
        W and W'.
    """

    load_time: Array
    time: Array
    lift: Array
    drag: Array
    jump: Array
    coefficients: Array
    deflection: Array
    rate: Array

    @classmethod
    def of(cls, records: list[Record], dt: float) -> History:
        """Stack records of equal shape."""
        time = np.array([record.time for record in records])
        stacks = {
            name: np.array([getattr(record, name) for record in records]) if records else np.empty((0, 0))
            for name in ("jump", "coefficients", "deflection", "rate")
        }
        return cls(
            load_time=time - 0.5 * dt,
            time=time,
            lift=np.array([record.lift for record in records]),
            drag=np.array([record.drag for record in records]),
            **stacks,
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw C_L and C_D over time; see `hbnlp.plot.plot_loads`."""
        from hbnlp.plot import plot_loads

        return plot_loads(self, ax)

    def _table(self) -> Table:
        return table_of(self, _LAYOUT, axes=("time",), jump_modes=self.coefficients)

    def __repr__(self) -> str:
        if self.time.size == 0:
            return "History(no steps)"
        return (
            f"History({self.time.size} steps, t = {self.time[0]:.4g} .. {self.time[-1]:.4g},\n"
            f"        last C_L = {self.lift[-1]:.4g}, C_D = {self.drag[-1]:.4g}, "
            f"{self.deflection.shape[1]} modes of deflection)"
        )
