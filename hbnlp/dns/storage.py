"""Saving and restarting: plain npz files, written whole or not at all."""

from __future__ import annotations

import os
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from hbnlp.core.types import Array
from hbnlp.dns.flow import Simulation
from hbnlp.dns.history import History


def write_arrays(path: str | os.PathLike[str], arrays: dict[str, Array]) -> None:
    """Write arrays to an npz file by way of a partial file, so that an interruption never leaves half a file.

    Parameters
    ----------
    path : path-like
        File to write or replace.
    arrays : dict
        Arrays by name.
    """
    target = Path(path)
    partial = target.with_name(target.name + ".part")
    with partial.open("wb") as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]
        stream.flush()
        os.fsync(stream.fileno())
    partial.replace(target)


def read_arrays(path: str | os.PathLike[str]) -> dict[str, Array]:
    """Read all arrays of an npz file, refusing pickled objects.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not an npz file of plain arrays.
    """
    try:
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}
    except FileNotFoundError:
        raise
    except (EOFError, OSError, ValueError, TypeError, AttributeError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is no npz file of plain arrays as this package writes it: {error}") from error


def save_state(simulation: Simulation, path: str | os.PathLike[str]) -> None:
    """Save a running simulation for a restart."""
    write_arrays(path, simulation.state())


def load_state(simulation: Simulation, path: str | os.PathLike[str]) -> None:
    """Continue a simulation, built with the same grid, from a saved state; see `Simulation.restore`."""
    simulation.restore(read_arrays(path))


def save_history(history: History, path: str | os.PathLike[str]) -> None:
    """Save loads and deflections."""
    write_arrays(path, {part.name: getattr(history, part.name) for part in fields(History)})


def load_history(path: str | os.PathLike[str]) -> History:
    """Read loads and deflections.

    Raises
    ------
    ValueError
        If the file holds something else.
    """
    arrays = read_arrays(path)
    names = {part.name for part in fields(History)}
    if arrays.keys() != names:
        raise ValueError(f"{path} holds {sorted(arrays)}, but a history has {sorted(names)}")
    return History(**arrays)
