"""Whether the Jacobian was singular on the way between two points of a curve, its determinant having one sign at both.

Of two regular matrices A and B the pencil (1 - s) A + s B is singular where B^-1 A has the eigenvalue -s / (1 - s):
each negative one tells a place 0 < s < 1 where the matrix, linear in between, has lost a rank. Two eigenvalues of the
Jacobian that cross zero within one step leave the sign of its determinant as it was and both show here. (One that
crosses twice does not: see `dips`.) Where the matrices are close, B^-1 A is near the unit matrix, and what is negative
is what is farthest from it: Arnoldi's method finds that first (Saad 2011, section 6.2, doi:10.1137/1.9781611970739).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hbnlp.continuation.curve import Bordered
from hbnlp.core.types import Array

FIRST, MOST = 3, 8
"""Vectors of the Krylov space, the first few of which tell whether anything is far from the unit matrix."""
FAR = 0.5
"""Eigenvalues of B^-1 A no farther from 1 than this, as seen by the first vectors, are all positive."""
KNOWN = 0.1
"""A Ritz value counts if its residual is below this part of its distance from 1."""


def singular_places(begin: Bordered, end: Bordered, scale: Array) -> list[float]:
    """Return the places between 0 and 1 where the matrix between two factored ones is singular, in rising order.

    Parameters
    ----------
    begin, end : Bordered
        Factors of the matrices at the ends.
    scale : array (size + 1,)
        Sizes of the unknowns.
    """
    size = scale.size
    basis = np.zeros((MOST + 1, size))
    hessenberg = np.zeros((MOST + 1, MOST))
    basis[0] = _start(size)
    for k in range(min(MOST, size)):
        vector = end.solve(begin.product(scale * basis[k])) / scale - basis[k]
        for _ in range(2):  # the second time for what round-off left of the first
            along = basis[: k + 1] @ vector
            vector -= along @ basis[: k + 1]
            hessenberg[: k + 1, k] += along
        rest = float(np.linalg.norm(vector))
        hessenberg[k + 1, k] = rest
        if k + 1 == FIRST and np.linalg.norm(hessenberg[:FIRST, :FIRST]) < FAR:
            return []
        if rest <= 1e-12 * np.linalg.norm(hessenberg[: k + 1, k]):
            break
        basis[k + 1] = vector / rest
    values, vectors = np.linalg.eig(hessenberg[: k + 1, : k + 1])
    unknown = hessenberg[k + 1, k] * np.abs(vectors[-1]) > KNOWN * np.abs(values)
    real = np.abs(values.imag) <= 1e-8 * np.abs(values)
    ratios = -(1.0 + values.real[real & ~unknown])
    return sorted(float(ratio / (1.0 + ratio)) for ratio in ratios if ratio > 0.0)


@lru_cache(maxsize=16)
def _start(size: int) -> Array:
    """Return a unit vector that has a part of every direction."""
    start = np.random.default_rng(0).standard_normal(size)
    return np.asarray(start / np.linalg.norm(start))
