"""From NGSolve's matrices and spaces to SciPy's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

if TYPE_CHECKING:
    import ngsolve


def to_csr(matrix: ngsolve.BaseMatrix) -> sp.csr_matrix:
    """Return the matrix in compressed rows."""
    rows, columns, values = matrix.COO()
    shape = (matrix.height, matrix.width)
    return sp.csr_matrix((np.array(values), (np.array(rows), np.array(columns))), shape=shape)


def free_unknowns(space: ngsolve.FESpace) -> NDArray[np.intp]:
    """Return the indices of the unknowns that carry no Dirichlet value."""
    return np.flatnonzero(np.array(space.FreeDofs()))
