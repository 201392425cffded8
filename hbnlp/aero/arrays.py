"""Checks of arrays: that values are finite, and that those of a ROM fit together and have stable lag states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbnlp.core.types import Array

MATRICES = ("stiffness", "damping", "mass", "lag_state", "lag_input", "lag_output")
ARRAYS = (*MATRICES, "base_motion", "base_load")


def check_finite(name: str, array: NDArray[Any], *, advice: str = "") -> None:
    """Raise a ValueError that names the first value that is not finite, if there is one."""
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        where = tuple(bad[0].tolist())
        raise ValueError(f"{name}{list(where)} is {array[where]}; all values must be finite{advice}")


def checked_arrays(given: Mapping[str, ArrayLike | None]) -> dict[str, Array]:
    """Return the `ARRAYS` of a ROM, by name, as new read-only arrays.

    An empty array fits any empty shape, and a base that is None is zero.

    Raises
    ------
    ValueError
        If shapes disagree, a value is complex or not finite, or A is not strictly stable.
    """
    k = _real("stiffness", given["stiffness"])
    if k.ndim != 2 or k.shape[0] < 1 or k.shape[1] != k.shape[0] + 1:
        raise ValueError(
            f"stiffness has shape {k.shape}; (N+1, N+2) is needed: "
            "rows C_L, dCp_1..dCp_N and columns alpha, z, W_1..W_N"
        )
    rows, columns = k.shape
    a = _real("lag_state", given["lag_state"])
    a = a.reshape(0, 0) if a.size == 0 else a
    n = a.shape[0] if a.ndim else 1
    shapes = {
        "stiffness": (rows, columns),
        "damping": (rows, columns),
        "mass": (rows, columns),
        "lag_state": (n, n),
        "lag_input": (n, columns),
        "lag_output": (rows, n),
        "base_motion": (columns,),
        "base_load": (rows,),
    }
    arrays = {}
    for name, shape in shapes.items():
        zero = given[name] is None and name in {"base_motion", "base_load"}
        array = np.zeros(shape) if zero else _real(name, given[name])
        if array.size == 0 and 0 in shape:
            array = array.reshape(shape)
        if array.shape != shape:
            raise ValueError(
                f"{name} has shape {array.shape}; {shape} is needed, because stiffness {k.shape} "
                f"means N = {rows - 1} modes and lag_state {a.shape} means n = {n} lag states"
            )
        arrays[name] = array
    _check_stable(a)
    for array in arrays.values():
        array.flags.writeable = False
    return arrays


def _check_stable(lag_state: Array) -> None:
    unstable = [pole for pole in np.linalg.eigvals(lag_state) if not pole.real < 0.0] if lag_state.size else []
    if unstable:
        raise ValueError(
            f"lag_state has the eigenvalue {max(unstable, key=np.real):.6g}; all must have a negative real part: "
            "identify the ROM again with stable poles, or drop the lag states that are not"
        )


def _real(name: str, value: ArrayLike | None) -> Array:
    """Return a new real array, or raise the ValueError that names what is wrong with it."""
    try:
        array = np.array(value)
        number = array.astype(float) if not np.iscomplexobj(array) else None
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        raise ValueError(f"{name} is not an array of real numbers ({error}); give an array of floats") from error
    if number is None:
        raise ValueError(f"{name} is not an array of real numbers (it is complex); give an array of floats")
    check_finite(name, number, advice=": identify the ROM again")
    return number
