"""Conversion of a ROM's arrays to and from ``control.StateSpace``.

The realisation is the one from accelerations, L(s) = G(s)/s^2, with input u'' and states [u, u', x]::

    [u ]'   [0 I 0] [u ]   [0]
    [u']  = [0 0 0] [u'] + [I] u'',     y - y_b + K u_b = [K D C] [u u' x]^T + M u''
    [x ]    [0 0 A] [x ]   [B]

so that K, D, M, A, B and C are stored as they are and a round trip changes no bit.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from hbnlp.core.extras import from_extra
from hbnlp.core.types import Array

if TYPE_CHECKING:
    import control


def pack(
    *, stiffness: Array, damping: Array, mass: Array, lag_state: Array, lag_input: Array, lag_output: Array
) -> control.StateSpace:
    """Return the realisation from accelerations with named inputs, states and outputs.

    Raises
    ------
    ImportError
        If the package ``control`` is not installed.
    """
    control = from_extra("control", "control", "a control.StateSpace")
    rows, m = stiffness.shape
    n = lag_state.shape[0]
    modes = range(1, rows)
    motion = ["alpha", "z", *(f"W{k}" for k in modes)]
    return control.StateSpace(
        np.block(
            [
                [np.zeros((m, m)), np.eye(m), np.zeros((m, n))],
                [np.zeros((m, 2 * m + n))],
                [np.zeros((n, 2 * m)), lag_state],
            ]
        ),
        np.vstack([np.zeros((m, m)), np.eye(m), lag_input]),
        np.hstack([stiffness, damping, lag_output]),
        mass,
        inputs=[f"{name}_acceleration" for name in motion],
        outputs=["C_L", *(f"dCp{k}" for k in modes)],
        states=[*motion, *(f"{name}_velocity" for name in motion), *(f"lag{i + 1}" for i in range(n))],
        name="AeroROM",
        remove_useless_states=False,
    )


def unpack(system: control.StateSpace) -> dict[str, Array]:
    """Return the arrays of a ROM, by name, from a realisation from accelerations.

    The first 2 (N+2) states must be u and u', as `pack` orders them.

    Raises
    ------
    ValueError
        If the system is in discrete time or is not of that form.
    TypeError
        If it is no state-space system.
    """
    if not all(hasattr(system, name) for name in ("A", "B", "C", "D", "dt")):
        raise TypeError(
            f"system is {textwrap.shorten(repr(system), 120)}; give a control.StateSpace, such as to_statespace() gives"
        )
    if system.dt not in (None, 0):
        raise ValueError(f"the system has the sampling time {system.dt}; give a continuous-time one (dt = 0)")
    a, b, c, d = (np.asarray(matrix, dtype=float) for matrix in (system.A, system.B, system.C, system.D))
    rows, m = d.shape
    n = a.shape[0] - 2 * m
    form = "inputs u'' (N+2), states [u, u', lag states], outputs C_L and dCp_1..dCp_N (N+1)"
    if m != rows + 1 or n < 0:
        raise ValueError(
            f"the system has {m} inputs, {rows} outputs and {a.shape[0]} states; needed are {form}, "
            "as to_statespace() gives"
        )
    top = np.block([[np.zeros((m, m)), np.eye(m), np.zeros((m, n))], [np.zeros((m, 2 * m + n))]])
    if (
        not np.array_equal(a[: 2 * m], top)
        or np.any(a[2 * m :, : 2 * m])
        or not np.array_equal(b[: 2 * m], np.vstack([np.zeros((m, m)), np.eye(m)]))
    ):
        raise ValueError(
            f"the first {2 * m} states are not u and u', or the lag states depend on them; needed are {form}: "
            "undo any change of state coordinates"
        )
    return {
        "stiffness": c[:, :m],
        "damping": c[:, m : 2 * m],
        "mass": d,
        "lag_state": a[2 * m :, 2 * m :],
        "lag_input": b[2 * m :],
        "lag_output": c[:, 2 * m :],
    }
