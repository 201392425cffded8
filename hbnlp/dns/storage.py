"""Saving and restarting the flow solver, in the files of `hbnlp.core.storage`."""

from __future__ import annotations

import os
from dataclasses import fields

from hbnlp.core.checks import instance_of
from hbnlp.core.storage import load_arrays, save_arrays
from hbnlp.dns.flow import Simulation
from hbnlp.dns.history import History

_STATE, _HISTORY = "flow state", "flow history"


def save_state(simulation: Simulation, path: str | os.PathLike[str]) -> None:
    """Save a running simulation for a restart, whole or not at all.

    Raises
    ------
    SaveError
        (An `OSError`.) If the file cannot be written; an older file of that name is as it was.
    """
    instance_of("simulation", simulation, Simulation, "a Simulation")
    save_arrays(path, _STATE, simulation.state(), {})


def load_state(simulation: Simulation, path: str | os.PathLike[str]) -> None:
    """Continue a simulation, built with the same grid, from a saved state; see `Simulation.restore`.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file holds something else or belongs to another grid.
    """
    instance_of("simulation", simulation, Simulation, "a Simulation")
    # the first version wrote arrays alone
    simulation.restore(load_arrays(path, _STATE, plain=True)[0])


def save_history(history: History, path: str | os.PathLike[str]) -> None:
    """Save loads and deflections, whole or not at all.

    Raises
    ------
    SaveError
        (An `OSError`.) If the file cannot be written; an older file of that name is as it was.
    """
    instance_of("history", history, History, "a History, as Simulation.run returns it")
    save_arrays(path, _HISTORY, {part.name: getattr(history, part.name) for part in fields(History)}, {})


def load_history(path: str | os.PathLike[str]) -> History:
    """Read loads and deflections.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file holds something else.
    """
    arrays, _ = load_arrays(path, _HISTORY, plain=True)
    names = {part.name for part in fields(History)}
    if arrays.keys() != names:
        raise ValueError(f"{os.fspath(path)!r} holds {sorted(arrays)}, but a history has {sorted(names)}")
    return History(**arrays)
