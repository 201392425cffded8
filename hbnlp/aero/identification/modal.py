"""Poles and residues, and the lag states that have them: A block-diagonal and real."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.types import Array, ComplexArray


def sort_poles(poles: ArrayLike, *, least_damping: float = 1e-6) -> ComplexArray:
    """Return poles closed under conjugation, stable: real ones first, then pairs, positive imaginary part first.

    Poles in the right half plane are reflected into the left, and those whose damping ratio -Re(p)/|p| is below
    ``least_damping`` are moved to it; a complex pole stands for its pair, and only one of each pair needs to be given.
    """
    given = np.atleast_1d(np.asarray(poles, dtype=complex))
    size = np.maximum(np.abs(given), 1e-12)
    real_part = -np.maximum(np.abs(given.real), least_damping * size)
    imaginary = np.where(np.abs(given.imag) < 1e-9 * size, 0.0, np.abs(given.imag))
    reals = np.sort(real_part[imaginary == 0.0])[::-1]
    upper = imaginary > 0.0
    upper &= ~((given.imag < 0.0) & np.isin(np.round(given.conj(), 12), np.round(given, 12)))
    pairs = (real_part + 1j * imaginary)[upper]
    pairs = pairs[np.argsort(np.abs(pairs))]
    return np.concatenate([reals.astype(complex), np.stack([pairs, pairs.conj()], axis=1).ravel()])


def real_basis(poles: ComplexArray, s: ComplexArray) -> ComplexArray:
    """Return functions whose real combinations are all real rational functions with these poles, (m, n).

    A real pole gives 1/(s - p); a pair gives 1/(s - p) + 1/(s - p*) and i/(s - p) - i/(s - p*).
    """
    basis = np.empty((s.size, poles.size), dtype=complex)
    i = 0
    while i < poles.size:
        fraction = 1.0 / (s - poles[i])
        if poles[i].imag == 0.0:
            basis[:, i] = fraction
            i += 1
        else:
            conjugate = 1.0 / (s - poles[i].conj())
            basis[:, i], basis[:, i + 1] = fraction + conjugate, 1j * (fraction - conjugate)
            i += 2
    return basis


def residues(poles: ComplexArray, coefficients: Array) -> ComplexArray:
    """Return the residues for coefficients of `real_basis` along the first axis; conjugate for a pair's second pole."""
    result = coefficients.astype(complex)
    first = np.flatnonzero(poles.imag > 0.0)
    result[first] = coefficients[first] + 1j * coefficients[first + 1]
    result[first + 1] = result[first].conj()
    return result


def lag_states(
    poles: ComplexArray, matrices: ComplexArray, *, weights: Array | None = None, drop: float = 1e-9
) -> tuple[Array, Array, Array]:
    """Return real A, B, C with ``C (s I - A)^(-1) B = sum_i matrices[i] / (s - poles[i])``.

    Parameters
    ----------
    poles : ndarray of complex, shape (n,)
        As `sort_poles` orders them.
    matrices : ndarray of complex, shape (n, p, m)
        Residues; those of a pair conjugate.
    weights : ndarray, shape (n, m), optional
        By which the columns of every residue are multiplied to be judged; by default each residue by its own norm, so
        that no pole is judged by another's.
    drop : float
        Singular values of a weighted residue up to this are left out, so that a pole has as many states as its residue
        has rank.

    Returns
    -------
    A : ndarray, shape (states, states)
        Block-diagonal; a pair a +- i b is a block [[a, -b], [b, a]] of multiples of the identity.
    B : ndarray, shape (states, m)
    C : ndarray, shape (p, states)
    """
    if weights is None:
        norms = np.array([np.linalg.norm(residue, 2) for residue in matrices])
        weights = np.ones(matrices.shape[::2]) / np.where(norms > 0.0, norms, 1.0)[:, None]
    a_blocks, b_blocks, c_blocks = [], [], []
    for pole, residue, weight in zip(poles, matrices, weights, strict=True):
        if pole.imag < 0.0:
            continue
        u, singular, vh = np.linalg.svd((residue if pole.imag else residue.real) * weight, full_matrices=False)
        rank = int(np.count_nonzero(singular > drop))
        b = singular[:rank, None] * vh[:rank] / weight
        # every state has input and output of the same size
        root = np.sqrt(np.linalg.norm(b, axis=1))
        c, b = u[:, :rank] * root, b / root[:, None]
        eye = np.eye(rank)
        if pole.imag == 0.0:
            a_blocks.append(pole.real * eye)
            b_blocks.append(b.real)
            c_blocks.append(c.real)
        else:
            # x = xi + conj(xi) with xi' = p xi + b u, in real and imaginary parts
            a_blocks.append(np.block([[pole.real * eye, -pole.imag * eye], [pole.imag * eye, pole.real * eye]]))
            b_blocks.append(np.concatenate([b.real, b.imag]))
            c_blocks.append(np.concatenate([2.0 * c.real, -2.0 * c.imag], axis=1))
    states = sum(len(a) for a in a_blocks)
    a = np.zeros((states, states))
    start = 0
    for block in a_blocks:
        end = start + len(block)
        a[start:end, start:end] = block
        start = end
    rows, columns = matrices.shape[1:]
    b_all = np.concatenate(b_blocks) if b_blocks else np.zeros((0, columns))
    c_all = np.concatenate(c_blocks, axis=1) if c_blocks else np.zeros((rows, 0))
    return a, b_all, c_all
