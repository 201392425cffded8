"""Eigensystem realisation from time records, the quasi-steady part separated.

After an impulse of acceleration at t = 0 (a unit step of velocity) the loads are

    y(t) = K t + D + C exp(A t) B,      t > 0,

so what is left of the record without its quasi-steady part K t + D holds the Markov parameters of the lag states,
whose Hankel matrix gives A, B and C (Juang and Pappa [1]_; for wings Brunton, Rowley and Williams [2]_). The added mass
M acts at t = 0 only and is given. Shifts between the samples of the Hankel matrix grow geometrically, so that fast and
slow states are both seen by a small matrix.

References
----------
.. [1] J.-N. Juang, R. S. Pappa, "An eigensystem realization algorithm for modal parameter identification and model
   reduction", J. Guidance 8 (1985) 620-627, doi:10.2514/3.20031.
.. [2] S. L. Brunton, C. W. Rowley, D. R. Williams, "Reduced-order unsteady aerodynamic models at low Reynolds numbers",
   J. Fluid Mech. 724 (2013) 203-233, doi:10.1017/jfm.2013.163.
"""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass

import numpy as np
import scipy.linalg as sl
from numpy.typing import ArrayLike, NDArray

from hbnlp.aero.arrays import check_finite
from hbnlp.aero.provenance import Provenance
from hbnlp.aero.rom import AeroROM
from hbnlp.core.checks import finite_array, instance_of, whole_number
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array

logger = logging.getLogger(__name__)


class ShortRecordWarning(UserWarning):
    """A time record ends before its transient has died out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Realisation(ReadOnlyArrays):
    """A ROM realised from time records.

    Attributes
    ----------
    rom : AeroROM
    singular_values : ndarray, shape (n,)
        Of the Hankel matrix, falling; a gap shows the order.
    error : float
        Largest difference between record and ROM, relative to the largest transient of the same motion.
    dropped : int
        Eigenvalues left out because they were unstable or faster than the sampling.
    """

    rom: AeroROM
    singular_values: Array
    error: float
    dropped: int


def realise(
    time: ArrayLike,
    loads: ArrayLike,
    *,
    n_lags: int,
    mass: ArrayLike,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    provenance: Provenance | None = None,
) -> Realisation:
    """Realise a ROM from the loads after impulses of acceleration, one experiment a motion.

    Parameters
    ----------
    time : array_like, shape (m,)
        Times from 0 on, uniform, c/U.
    loads : array_like, shape (m, N+1, N+2)
        Loads less the steady load after a unit step of velocity in each motion; the first sample just after the step.
    n_lags : int
        Number of lag states.
    mass : array_like, shape (N+1, N+2)
        M, the load of the impulse itself (its time integral). Of a step of velocity that takes a short time d it is
        ``d * (mean - 0.5 * loads[0])``, with the mean loads during the step.
    stiffness, damping : array_like, shape (N+1, N+2), optional
        K and D; by default the straight line through the last quarter of the record. The static K of a steady
        computation is better.
    provenance : Provenance, optional

    Returns
    -------
    Realisation

    Raises
    ------
    ValueError
        If the record is not uniformly sampled, too short for so many states, or holds values that are not finite.

    Warns
    -----
    ShortRecordWarning
        If the transient has not died out at the end of the record.
    """
    t, y = finite_array("time", time, (None,)), finite_array("loads", loads, (None, None, None))
    if t.size < 2 or min(y.shape) == 0:
        raise ValueError(f"time has shape {t.shape} and loads {y.shape}; give a record of some length")
    matrices = [("mass", mass), ("stiffness", stiffness), ("damping", damping)]
    for name, matrix in matrices:
        if matrix is not None or name == "mass":
            finite_array(name, matrix, y.shape[1:], advice=", as of the loads")
    instance_of("provenance", provenance, Provenance | None, "hbnlp.aero.Provenance(source=..., reynolds=...)")
    _check_record(t, y)
    whole_number(
        "n_lags", n_lags, least=1, most=min(y.shape[1], y.shape[2]) * (t.size // 4), advice=", or a longer record"
    )
    k, d = _quasi_steady(t, y, stiffness, damping)
    transient = y - k * t[:, None, None] - d
    _warn_if_short(transient)
    dt = t[1] - t[0]
    shifts = np.unique(np.geomspace(1.0, (t.size - 1) // 2, 60).astype(int)) - 1
    hankel = _hankel(transient, shifts, 0)
    u, singular, vh = np.linalg.svd(hankel, full_matrices=False)
    if n_lags > singular.size:
        raise ValueError(f"n_lags is {n_lags}, but the record allows {singular.size} lag states; give a longer record")
    root = np.sqrt(singular[:n_lags])
    left, right = (u[:, :n_lags] / root).T, vh[:n_lags].T / root
    discrete = left @ _hankel(transient, shifts, 1) @ right
    a, b = _continuous(discrete, (left @ hankel)[:, : y.shape[2]], dt)
    dropped = n_lags - len(a)
    c = _fit_output(a, b, t, transient)
    rom = AeroROM(stiffness=k, damping=d, mass=mass, lag_state=a, lag_input=b, lag_output=c, provenance=provenance)
    size = np.abs(transient).max(axis=(0, 1))
    error = float((np.abs(_decay(a, b, c, t) - transient).max(axis=(0, 1)) / np.where(size > 0.0, size, 1.0)).max())
    logger.info("%d of %d eigenvalues dropped, record error %.2e", dropped, n_lags, error)
    return Realisation(rom=rom, singular_values=singular, error=error, dropped=dropped)


def _continuous(discrete: Array, drive: Array, dt: float) -> tuple[Array, Array]:
    """Return A, B in continuous time, without the states that are unstable or faster than the sampling.

    A real logarithm exists for eigenvalues off the negative real axis only.
    """
    values, vectors = np.linalg.eig(discrete)
    keep = (np.abs(values) < 1.0) & (np.abs(values) > 1e-12) & ~((values.imag == 0.0) & (values.real < 0.0))
    if keep.all():
        return np.asarray(sl.logm(discrete)).real / dt, drive
    modal = np.linalg.solve(vectors, drive.astype(complex))
    poles = np.log(values.astype(complex)) / dt
    a_blocks, b_blocks = [], []
    for pole, row, kept in zip(poles, modal, keep, strict=True):
        if kept and pole.imag == 0.0:
            a_blocks.append(np.array([[pole.real]]))
            b_blocks.append(row.real[None])
        elif kept and pole.imag > 0.0:
            a_blocks.append(np.array([[pole.real, -pole.imag], [pole.imag, pole.real]]))
            b_blocks.append(np.stack([row.real, row.imag]))
    if not a_blocks:
        raise ValueError("no stable lag state is left; check the sign and the sampling of the record")
    return np.asarray(sl.block_diag(*a_blocks), dtype=float), np.concatenate(b_blocks)


def _check_record(t: Array, y: Array) -> None:
    if t.ndim != 1 or y.ndim != 3 or y.shape[0] != t.size or y.shape[2] != y.shape[1] + 1:
        raise ValueError(f"time {t.shape} and loads {y.shape} do not fit; give (m,) and (m, N+1, N+2)")
    if t.size < 8:
        raise ValueError(f"the record has {t.size} samples; at least 8 are needed")
    steps = np.diff(t)
    if not np.all(np.isfinite(t)) or abs(t[0]) > 1e-9 * abs(t[-1]) or np.ptp(steps) > 1e-6 * abs(steps.mean()):
        raise ValueError(
            f"time starts at {t[0]:g} with steps from {steps.min():g} to {steps.max():g}; "
            "it must start at 0 and be uniform: interpolate the record first"
        )
    check_finite("loads", y)


def _quasi_steady(t: Array, y: Array, stiffness: ArrayLike | None, damping: ArrayLike | None) -> tuple[Array, Array]:
    late = t >= 0.75 * t[-1]
    shape = y.shape[1:]
    if stiffness is None:
        slope, intercept = np.polyfit(t[late], y[late].reshape(late.sum(), -1), 1)
        k = slope.reshape(shape)
        return k, intercept.reshape(shape) if damping is None else np.asarray(damping, dtype=float)
    k = np.asarray(stiffness, dtype=float)
    if damping is not None:
        return k, np.asarray(damping, dtype=float)
    return k, (y[late] - k * t[late, None, None]).mean(axis=0)


def _warn_if_short(transient: Array) -> None:
    size = np.abs(transient).max(axis=0)
    late = np.abs(transient[len(transient) // 2 :] - transient[-1]).max(axis=0)
    rest = float((late / np.where(size > 0.0, size, 1.0)).max())
    if rest > 0.05:
        warnings.warn(
            f"the transient still changes by {rest:.0%} in the second half of the record; "
            "record for longer, or give stiffness and damping from a steady computation",
            ShortRecordWarning,
            stacklevel=3,
        )


def _hankel(transient: Array, shifts: NDArray[np.intp], offset: int) -> Array:
    """Return the matrix of blocks transient[shift_i + shift_j + offset]."""
    blocks = transient[shifts[:, None] + shifts[None, :] + offset]
    count, rows, columns = shifts.size, *transient.shape[1:]
    return np.asarray(blocks.transpose(0, 2, 1, 3).reshape(count * rows, count * columns))


def _propagate(a: Array, b: Array, t: Array) -> Array:
    """Return exp(A t) B at uniform times from 0 on, (m, n, columns)."""
    step = sl.expm(a * (t[1] - t[0]))
    states = np.empty((t.size, *b.shape))
    states[0] = b
    for k in range(1, t.size):
        states[k] = step @ states[k - 1]
    return states


def _fit_output(a: Array, b: Array, t: Array, transient: Array) -> Array:
    states = _propagate(a, b, t)
    matrix = states.transpose(0, 2, 1).reshape(-1, len(a))
    right = transient.transpose(0, 2, 1).reshape(len(matrix), -1)
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0].T)


def _decay(a: Array, b: Array, c: Array, t: Array) -> Array:
    return np.asarray(np.einsum("in,mnj->mij", c, _propagate(a, b, t)))
