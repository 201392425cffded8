"""Sparse direct solution with many right-hand sides at once: PARDISO of the MKL, or SuperLU where it is missing.

All motions share one factorisation a frequency, and PARDISO solves them as one block, which is several times faster
than one by one. The Python package ``mkl`` only brings the shared library, so it is called here by ctypes.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib.metadata
import logging
from functools import cache
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

logger = logging.getLogger(__name__)

_REAL_UNSYMMETRIC, _COMPLEX_UNSYMMETRIC = 11, 13
_ANALYSE_AND_FACTOR, _SOLVE, _RELEASE = 12, 33, -1
_PARAMETERS = {
    0: 1,  # these values, not the defaults
    1: 2,  # nested dissection
    7: 2,  # steps of iterative refinement
    9: 13,  # pivots below 1e-13 are perturbed
    10: 1,  # scaling, and
    12: 1,  # matching: the matrix is indefinite, with zeros on the diagonal
    34: 1,  # indices count from zero
}


class Factorisation(Protocol):
    """A factorised matrix, to be used as a context so that its memory is given back."""

    def solve(self, right: NDArray[Any]) -> NDArray[Any]:
        """Return X with A X = right, for right of shape (n,) or (n, m)."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *exception: object) -> None: ...


def factorise(matrix: sp.csr_matrix) -> Factorisation:
    """Factorise a sparse matrix.

    Parameters
    ----------
    matrix : csr_matrix of float or complex, shape (n, n)

    Raises
    ------
    RuntimeError
        If the matrix is singular, or memory does not suffice.
    """
    library = _pardiso_library()
    return _SuperLU(matrix) if library is None else _Pardiso(library, matrix)


def solver_name() -> str:
    """Return which direct solver `solve` uses on this machine."""
    return "SuperLU" if _pardiso_library() is None else "MKL PARDISO"


@cache
def _pardiso_library() -> ctypes.CDLL | None:
    """Find the runtime library of the MKL, of the Python package first."""
    names = []
    try:
        files = importlib.metadata.files("mkl") or []
        names = [str(Path(str(file.locate())).resolve()) for file in files if "mkl_rt" in file.name]
    except importlib.metadata.PackageNotFoundError:
        pass
    system = ctypes.util.find_library("mkl_rt")
    for name in [*names, *([system] if system else [])]:
        try:
            return ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL)
        except OSError as error:
            logger.debug("cannot load %s: %s", name, error)
    logger.warning(
        "the MKL is not installed: SuperLU is used instead, many times slower; pip install 'hbnlp[flow]' brings it"
    )
    return None


class _SuperLU:
    def __init__(self, matrix: sp.csr_matrix) -> None:
        self._factors = splu(matrix.tocsc())

    def solve(self, right: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(self._factors.solve(right))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        del self._factors


class _Pardiso:
    def __init__(self, library: ctypes.CDLL, matrix: sp.csr_matrix) -> None:
        self._library = library
        self._dtype = np.complex128 if np.iscomplexobj(matrix) else np.float64
        matrix = matrix.astype(self._dtype).tocsr()
        matrix.sort_indices()
        self._size = matrix.shape[0]
        self._values = matrix.data
        self._rows, self._columns = matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32)
        self._handle = np.zeros(64, dtype=np.int64)
        self._parameters = np.zeros(64, dtype=np.int32)
        for index, value in _PARAMETERS.items():
            self._parameters[index] = value
        nothing = np.zeros((1, 1), dtype=self._dtype)
        self._call(_ANALYSE_AND_FACTOR, nothing, nothing)

    def solve(self, right: NDArray[Any]) -> NDArray[Any]:
        block = np.asfortranarray(right.reshape(self._size, -1), dtype=self._dtype)
        solution = np.zeros_like(block, order="F")
        self._call(_SOLVE, block, solution)
        if not np.all(np.isfinite(solution)):
            raise RuntimeError("the matrix is singular; check that the mesh has the plate and its boundaries")
        return solution.reshape(right.shape)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        nothing = np.zeros((1, 1), dtype=self._dtype)
        self._call(_RELEASE, nothing, nothing)

    def _call(self, phase: int, right: NDArray[Any], solution: NDArray[Any]) -> None:
        kind = _COMPLEX_UNSYMMETRIC if self._dtype is np.complex128 else _REAL_UNSYMMETRIC
        error = ctypes.c_int(0)
        integers = [ctypes.byref(ctypes.c_int(value)) for value in (1, 1, kind, phase, self._size)]
        self._library.pardiso(
            _pointer(self._handle), *integers, _pointer(self._values), _pointer(self._rows), _pointer(self._columns),
            None, ctypes.byref(ctypes.c_int(right.shape[1])), _pointer(self._parameters), ctypes.byref(ctypes.c_int(0)),
            _pointer(right), _pointer(solution), ctypes.byref(error),
        )  # fmt: skip
        if error.value:
            reason = {-2: "not enough memory", -4: "zero pivot"}.get(error.value, "see the MKL manual")
            raise RuntimeError(f"PARDISO stopped with code {error.value} ({reason}) for {self._size} unknowns")


def _pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
