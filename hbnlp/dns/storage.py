"""Saving and restarting the flow solver, in the files of `hbnlp.core.storage`."""

from __future__ import annotations

import os

from hbnlp.core.checks import instance_of
from hbnlp.core.layout import Column, Layout
from hbnlp.core.records import loaded, save_columns, save_record
from hbnlp.dns.flow import Simulation
from hbnlp.dns.history import History

_STATE = Layout(
    kind="flow state",
    columns={
        "grid": Column("6"),
        "clock": Column("3"),
        "reynolds": Column(""),
        "psi": Column("levels nx ny"),
        "gamma": Column("levels nx ny"),
        "psi_before": Column("nx ny"),
        "convection": Column("..."),  # empty before the first step
    },
    more={"wall_": Column("...")},
)
_HISTORY = Layout(
    kind="flow history",
    columns={
        "load_time": Column("steps"),
        "time": Column("steps"),
        "lift": Column("steps"),
        "drag": Column("steps"),
        "jump": Column("steps points"),
        "coefficients": Column("steps modes"),
        "deflection": Column("steps shapes"),
        "rate": Column("steps shapes"),
    },
)


def save_state(simulation: Simulation, path: str | os.PathLike[str]) -> None:
    """Save a running simulation for a restart, whole or not at all.

    Raises
    ------
    SaveError
        (An `OSError`.) If the file cannot be written; an older file of that name is as it was.
    """
    instance_of("simulation", simulation, Simulation, "a Simulation")
    save_columns(path, _STATE, simulation.state())


def load_state(simulation: Simulation, path: str | os.PathLike[str]) -> None:
    """Continue a simulation, built with the same grid, from a saved state; see `Simulation.restore`.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    LoadError
        (A `ValueError`.) If the file is damaged or holds something else.
    ValueError
        If it belongs to another grid.
    """
    instance_of("simulation", simulation, Simulation, "a Simulation")
    # the first version wrote arrays alone
    with loaded(path, _STATE, plain=True) as state:
        pass
    simulation.restore(state)


def save_history(history: History, path: str | os.PathLike[str]) -> None:
    """Save loads and deflections, whole or not at all.

    Raises
    ------
    SaveError
        (An `OSError`.) If the file cannot be written; an older file of that name is as it was.
    """
    instance_of("history", history, History, "a History, as Simulation.run returns it")
    save_record(history, path, _HISTORY)


def load_history(path: str | os.PathLike[str]) -> History:
    """Read loads and deflections.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    LoadError
        (A `ValueError`.) If the file is damaged or holds something else.
    """
    with loaded(path, _HISTORY, plain=True) as content:
        return History(**content)
