"""Where a matrix between two others is singular: by eigenvalues that are known."""

import numpy as np
import pytest
from scipy.stats import ortho_group

from hbnlp.continuation.curve import Bordered
from hbnlp.continuation.pencil import singular_places

SIZE = 40


def between(crossings, *, rest=1.3, units=None):
    """Return the factors at both ends of (1 - s) A + s B, singular at the crossings s, and the sizes of the unknowns.

    B has the eigenvalues -(1 - s) / s relative to A there, and others between 1 / rest and rest.
    """
    rng = np.random.default_rng(7)
    first = rng.standard_normal((SIZE, SIZE)) + 8.0 * np.eye(SIZE)
    turn = ortho_group.rvs(SIZE, random_state=8)
    eigenvalues = np.exp(rng.uniform(-np.log(rest), np.log(rest), SIZE))
    eigenvalues[: len(crossings)] = [-(1.0 - s) / s for s in crossings]
    last = first @ turn @ np.diag(eigenvalues) @ turn.T
    scale = np.ones(SIZE) if units is None else 10.0 ** rng.uniform(-units, units, SIZE)
    return Bordered(first / scale), Bordered(last / scale), scale


@pytest.mark.parametrize("crossings", [[], [0.3], [0.3, 0.8], [0.02, 0.97], [0.45, 0.46]])
@pytest.mark.parametrize("units", [None, 6.0])
def test_places_are_those_of_the_eigenvalues(crossings, units):
    np.testing.assert_allclose(singular_places(*between(crossings, units=units)), crossings, atol=1e-3)


def test_factors_give_the_product_of_their_matrix():
    rng = np.random.default_rng(2)
    matrix, vector = rng.standard_normal((SIZE, SIZE)), rng.standard_normal(SIZE)
    np.testing.assert_allclose(Bordered(matrix.copy()).product(vector), matrix @ vector, atol=1e-12)
