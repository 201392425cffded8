"""Runs around bodies that keep their shape: the circular cylinder, and the plate at one degree."""

from __future__ import annotations

import math

import numpy as np
from results import Result
from running import advance, settings

from hbnlp import dns


def cylinder(
    reynolds: float,
    spacing: float,
    until: float,
    *,
    x: tuple[float, float] = (-1.0, 2.0),
    y: tuple[float, float] = (-1.0, 1.0),
    levels: int = 6,
) -> Result:
    """Circular cylinder: mean drag, lift amplitude and Strouhal number over the last cycles, wake length at Re = 40.

    The fine box covers x and y.
    """
    grid = dns.Grid.box(spacing=spacing, x=x, y=y, levels=levels)

    def pulse(t: float) -> tuple[float, float, float]:
        """Brief incidence that starts the shedding."""
        return (0.3 * math.exp(-((t - 3.0) ** 2)) if reynolds > 50.0 else 0.0), 0.0, 0.0

    flow = dns.Simulation(
        grid,
        dns.circle(spacing),
        reynolds=reynolds,
        dt=(0.375 if reynolds < 150.0 else 0.3) * spacing,
        motion=dns.Motion(pitch=pulse),
    )
    history = advance(flow, until, f"cylinder Re = {reynolds:g}")
    late = history.load_time > 0.7 * until
    t, lift, drag = history.load_time[late], history.lift[late], history.drag[late]
    result: Result = {**settings(flow), "C_D": float(drag[-1])}
    if reynolds < 50.0:
        return {**result, "wake_length": _wake_length(flow, 0.5)}
    up = np.flatnonzero((lift[:-1] < 0.0) & (lift[1:] >= 0.0))
    crossings = t[up] - lift[up] * flow.dt / (lift[up + 1] - lift[up])
    whole = slice(int(up[0]), int(up[-1]))
    return {
        **result,
        "C_D": float(drag[whole].mean()),
        "C_L": float(0.5 * (lift[whole].max() - lift[whole].min())),
        "St": float((crossings.size - 1) / (crossings[-1] - crossings[0])),
        "cycles": int(crossings.size - 1),
    }


def _wake_length(flow: dns.Simulation, rear: float) -> float:
    """Distance from the rear of the body to where the velocity on the axis turns positive."""
    for level in range(flow.grid.levels):
        h = flow.grid.cell(level)
        x, y = flow.grid.nodes(level)
        middle = int(np.argmin(np.abs(y)))
        u = 1.0 + (flow.psi[level][:, middle + 1] - flow.psi[level][:, middle - 1]) / (2.0 * h)
        turn = np.flatnonzero((u[:-1] < 0.0) & (u[1:] >= 0.0) & (x[:-1] > rear))
        if turn.size:
            i = int(turn[-1])
            return float(x[i] - u[i] * h / (u[i + 1] - u[i]) - rear)
    return math.nan


def plate(cells: int, levels: int, until: float = 60.0) -> Result:
    """Rigid plate at one degree: drag and lift slope per radian."""
    flow = dns.Simulation(
        dns.Grid.around_plate(cells=cells, levels=levels),
        dns.SharpPlate(),
        dt=0.4 / cells,
        motion=dns.Motion.at_incidence(1.0),
    )
    history = advance(flow, until, f"plate {cells}")
    slope = history.lift / math.radians(1.0)
    early = int(np.searchsorted(history.load_time, until - 5.0))
    return {
        **settings(flow),
        "C_D": float(history.drag[-1]),
        "lift_slope": float(slope[-1]),
        "change_in_5": float(slope[-1] - slope[early]),
    }
