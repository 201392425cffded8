"""Isolated eigenvalues by one pass of Arnoldi's process.

ARPACK (`scipy.sparse.linalg.eigs`) restarts until the number asked for has converged, which beside a continuous
spectrum takes hundreds of solutions. Here the process ends after a given number of steps, and what stands alone has
converged by then: an unstable eigenvalue in some ten to forty steps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hbnlp.core.types import ComplexArray

CONVERGED = 1e-3


def arnoldi(operator: Callable[[ComplexArray], ComplexArray], start: ComplexArray, *, steps: int) -> ComplexArray:
    """Return the Ritz values whose relative residual is below `CONVERGED`, the largest first.

    Parameters
    ----------
    operator : callable
        Takes and returns vectors of shape (n,).
    start : ndarray of complex, shape (n,)
    steps : int
        Applications of the operator, at most n.
    """
    basis = np.empty((steps + 1, start.size), dtype=complex)
    hessenberg = np.zeros((steps + 1, steps), dtype=complex)
    basis[0] = start / np.linalg.norm(start)
    for j in range(steps):
        vector = operator(basis[j])
        size = np.linalg.norm(vector)
        for _ in range(2):  # twice is enough to stay orthogonal
            parts = basis[: j + 1].conj() @ vector
            vector = vector - parts @ basis[: j + 1]
            hessenberg[: j + 1, j] += parts
        hessenberg[j + 1, j] = np.linalg.norm(vector)
        if hessenberg[j + 1, j].real < 1e-14 * size:  # the space is invariant
            steps = j + 1
            hessenberg[steps, j] = 0.0
            break
        basis[j + 1] = vector / hessenberg[j + 1, j]
    values, vectors = np.linalg.eig(hessenberg[:steps, :steps])
    residual = np.abs(hessenberg[steps, steps - 1] * vectors[-1])
    values = values[residual < CONVERGED * np.abs(values)]
    return np.asarray(values[np.argsort(-np.abs(values))], dtype=complex)
