"""Fewer lag states: balanced truncation, weighted by the band and by the columns, and refitted to the data.

The Gramians of the lag states are integrals over frequency; taken over the band of the data, with the weights in which
the error is stated, they balance what is seen there (Enns [1]_; Gawronski and Juang [2]_). Over all frequencies with
unit weights they are Moore's, and the truncation is stable by theorem. K stays, and D, M, B and C are then fitted to
the response again, a linear problem for (D, M, C) with B given and for (D, M, B) with C given.

References
----------
.. [1] D. F. Enns, "Model reduction with balanced realizations: an error bound and a frequency weighted
   generalization", Proc. 23rd IEEE Conf. Decision and Control (1984) 127-132, doi:10.1109/CDC.1984.272286.
.. [2] W. Gawronski, J.-N. Juang, "Model reduction in limited time and frequency intervals", Int. J. Systems Sci. 21
   (1990) 349-376, doi:10.1080/00207729008910366.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.linalg as sl

from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.identification.least_squares import real_least_squares
from hbnlp.aero.rom import AeroROM
from hbnlp.core.checks import instance_of, list_of, whole_number
from hbnlp.core.types import Array, ComplexArray

NEGLIGIBLE = 1e-14
"""Hankel singular values up to this part of the largest are zero to round-off."""


class Balanced(NamedTuple):
    """A balanced truncation.

    Attributes
    ----------
    rom : AeroROM
    singular_values : ndarray, shape (n,)
        Hankel singular values of the lag states before truncation, falling.
    """

    rom: AeroROM
    singular_values: Array


def balanced_truncation(rom: AeroROM, n_lags: int) -> Balanced:
    """Keep the ``n_lags`` most observable and controllable lag states (Moore); K, D and M stay, stability with them.

    Parameters
    ----------
    rom : AeroROM
    n_lags : int
        From 0 to the number of the ROM's lag states.

    Raises
    ------
    ValueError
        If ``n_lags`` is out of range.
    """
    instance_of("rom", rom, AeroROM, "an AeroROM, such as the `rom` of a fit")
    n = whole_number("n_lags", n_lags, least=0, most=rom.n_lags)
    a, b, c = rom.lag_state, rom.lag_input, rom.lag_output
    control = np.asarray(sl.solve_continuous_lyapunov(a, -b @ b.T), dtype=float)
    observe = np.asarray(sl.solve_continuous_lyapunov(a.T, -c.T @ c), dtype=float)
    left, right, values = _balancing(control, observe, n)
    return Balanced(replace(rom, lag_state=left.T @ a @ right, lag_input=left.T @ b, lag_output=c @ right), values)


def reduce_to_band(
    rom: AeroROM, response: FrequencyResponse, *, n_lags: int, sweeps: int = 20, known: Sequence[int] = ()
) -> AeroROM:
    """Return a ROM of at most ``n_lags`` lag states, balanced over the band of a response and refitted to it.

    Parameters
    ----------
    rom : AeroROM
        With at least ``n_lags`` lag states, fitted to the response.
    response : FrequencyResponse
        The data, at the frequencies that count.
    n_lags : int
    sweeps : int
        Alternations between the fit of (D, M, C) and of (D, M, B).
    known : sequence of int
        Columns of D that stay as they are.

    Raises
    ------
    ValueError
        If ``n_lags`` is out of range.
    """
    instance_of("rom", rom, AeroROM, "an AeroROM, such as the `rom` of a fit")
    instance_of("response", response, FrequencyResponse, "the FrequencyResponse that it is fitted to")
    if response.values.shape[1:] != rom.stiffness.shape:
        raise ValueError(f"response has {response.n_modes} modes and rom {rom.n_modes}; give those of one wing")
    whole_number("sweeps", sweeps, least=0)
    list_of("known", known, int, "a list of columns, counted from 0")
    n = whole_number("n_lags", n_lags, least=0, most=rom.n_lags)
    omega = response.omega
    weights = omega[:, None] ** 2 / response.column_sizes
    shifted = 1j * omega[:, None, None] * np.eye(rom.n_lags) - rom.lag_state
    measure = (np.gradient(np.log(omega)) if omega.size > 1 else np.ones(1))[:, None, None]
    states = np.linalg.solve(shifted, rom.lag_input[None].astype(complex)) * weights[:, None, :]
    adjoint = np.linalg.solve(shifted.conj().transpose(0, 2, 1), rom.lag_output.T[None].astype(complex))
    adjoint = adjoint * weights.min(axis=1)[:, None, None]
    control = np.sum(measure * (states @ states.conj().transpose(0, 2, 1)).real, axis=0)
    observe = np.sum(measure * (adjoint @ adjoint.conj().transpose(0, 2, 1)).real, axis=0)
    left, right, _ = _balancing(control, observe, n)
    a, basis = _stable_part(left.T @ rom.lag_state @ right)
    b, c = basis.T @ left.T @ rom.lag_input, rom.lag_output @ right @ basis
    reduced = replace(rom, lag_state=a, lag_input=b, lag_output=c)
    for _ in range(sweeps):
        reduced = refit_output(refit_input(reduced, response, known=known), response, known=known)
    return reduced


def refit_output(rom: AeroROM, response: FrequencyResponse, *, known: Sequence[int] = ()) -> AeroROM:
    """Fit D, M and C to a response with A and B given, in the norm of the relative error of columns."""
    s = np.asarray(1j * response.omega, dtype=complex)
    _, rows, columns = response.values.shape
    states = _states(rom.lag_state, rom.lag_input, s)
    weights = 1.0 / response.column_sizes
    eye = np.eye(columns)
    free = [column for column in range(columns) if column not in known]
    fixed = rom.damping.copy()
    fixed[:, free] = 0.0
    # unknowns of one load: [C (n), D (free columns), M (columns)]
    matrix = np.concatenate(
        [
            (s**2)[:, None, None] * states.transpose(0, 2, 1),
            s[:, None, None] * eye[None][:, :, free],
            (s**2)[:, None, None] * eye[None],
        ],
        axis=2,
    )
    matrix = (weights[:, :, None] * matrix).reshape(s.size * columns, -1)
    right = weights[:, :, None] * (response.values - rom.stiffness - s[:, None, None] * fixed).transpose(0, 2, 1)
    solution = real_least_squares(matrix, right.reshape(s.size * columns, rows))
    n = rom.n_lags
    fixed[:, free] = solution[n : n + len(free)].T
    return replace(rom, damping=fixed, mass=solution[n + len(free) :].T, lag_output=solution[:n].T)


def refit_input(rom: AeroROM, response: FrequencyResponse, *, known: Sequence[int] = ()) -> AeroROM:
    """Fit D, M and B to a response with A and C given, in the norm of the relative error of columns."""
    s: ComplexArray = np.asarray(1j * response.omega, dtype=complex)
    m, rows, columns = response.values.shape
    n = rom.n_lags
    outputs = _states(rom.lag_state.T, rom.lag_output.T, s).transpose(0, 2, 1)
    eye = np.broadcast_to(np.eye(rows), (m, rows, rows))
    basis = np.concatenate(
        [(s**2)[:, None, None] * outputs, s[:, None, None] * eye, (s**2)[:, None, None] * eye], axis=2
    )
    solution = np.empty((n + 2 * rows, columns))
    for column in range(columns):
        weights = 1.0 / response.column_sizes[:, column]
        unknown = np.ones(n + 2 * rows, dtype=bool)
        right = response.values[:, :, column] - rom.stiffness[:, column]
        if column in known:
            unknown[n : n + rows] = False
            solution[n : n + rows, column] = rom.damping[:, column]
            right = right - s[:, None] * rom.damping[:, column]
        matrix = (weights[:, None, None] * basis[:, :, unknown]).reshape(m * rows, -1)
        solution[unknown, column] = real_least_squares(matrix, (weights[:, None] * right).reshape(-1, 1))[:, 0]
    return replace(rom, damping=solution[n : n + rows], mass=solution[n + rows :], lag_input=solution[:n])


def _states(a: Array, b: Array, s: ComplexArray) -> ComplexArray:
    shifted = s[:, None, None] * np.eye(len(a)) - a
    drive = np.broadcast_to(b.astype(complex), (s.size, *b.shape))
    return np.asarray(np.linalg.solve(shifted, drive), dtype=complex)


def _balancing(control: Array, observe: Array, n: int) -> tuple[Array, Array, Array]:
    """Return the left and right projections on ``n`` balanced states, and all Hankel singular values.

    States beyond round-off of the largest value cannot be balanced, so there may be fewer than ``n``.
    """
    root_c, root_o = _root(control), _root(observe)
    u, singular, vh = np.linalg.svd(root_o.T @ root_c)
    n = min(n, int(np.count_nonzero(singular > NEGLIGIBLE * singular.max(initial=0.0))))
    scale = 1.0 / np.sqrt(singular[:n])
    return root_o @ u[:, :n] * scale, root_c @ vh[:n].T * scale, singular


def _stable_part(a: Array) -> tuple[Array, Array]:
    """Return A on its stable invariant subspace, and an orthonormal basis of that.

    Balancing over a band does not keep stability by theorem; what becomes unstable are states of next to no weight.
    """
    form, basis, stable = sl.schur(a, output="real", sort="lhp")
    return np.asarray(form[:stable, :stable], dtype=float), np.asarray(basis[:, :stable], dtype=float)


def _root(gramian: Array) -> Array:
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None)))
