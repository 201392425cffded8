"""The balance of odd motions against the whole one: residual and the two blocks of the Jacobian."""

import numpy as np
import pytest

from hbnlp.balance.odd import OddBasis, even_positions, odd_positions
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.systems import chain, duffing


def places(problem):
    """Positions of odd and of even harmonics among all unknowns."""
    starts = problem.shape[1] * np.arange(problem.shape[0])[:, None]
    return tuple((starts + of(problem.n_harmonics)).ravel() for of in (odd_positions, even_positions))


def odd_motion(problem, size=0.3):
    x = size * np.random.default_rng(3).standard_normal(problem.size)
    x[places(problem)[1]] = 0.0
    return x


def test_positions_are_those_of_the_orders():
    assert list(odd_positions(4)) == [1, 2, 5, 6]
    assert list(even_positions(4)) == [0, 3, 4, 7, 8]


@pytest.mark.parametrize(("n_harmonics", "periods"), [(1, 1), (2, 1), (7, 1), (8, 1), (30, 1), (9, 3)])
@pytest.mark.parametrize("system", [duffing(), chain(4)], ids=["duffing", "chain"])
def test_residual_and_blocks_are_parts_of_the_whole(system, n_harmonics, periods):
    problem = HarmonicBalance(system, n_harmonics, periods=periods)
    odd, even = places(problem)
    x, values = odd_motion(problem), problem.values({"omega": 1.3})
    whole, residual = problem.assembly.jacobian(x, values), problem.assembly.residual(x, values)
    along = np.zeros((odd.size, odd.size))
    across = problem.odd_assembly.blocks(x, values, along)
    size = np.abs(whole).max()
    assert np.allclose(
        problem.odd_assembly.residual(x, values), residual, rtol=0.0, atol=1e-13 * np.abs(residual).max()
    )
    assert np.allclose(along, whole[np.ix_(odd, odd)], rtol=0.0, atol=1e-14 * size)
    assert np.allclose(across, whole[np.ix_(even, even)], rtol=0.0, atol=1e-14 * size)
    assert np.abs(whole[np.ix_(odd, even)]).max() <= 1e-14 * size


@pytest.mark.parametrize("n_harmonics", [7, 200])
def test_samples_of_half_a_period_give_the_coefficients_back(n_harmonics):
    basis = OddBasis(n_harmonics, 2 * n_harmonics + 1)
    coefficients = np.random.default_rng(1).standard_normal((2, 2 * n_harmonics + 1))
    coefficients[:, even_positions(n_harmonics)] = 0.0
    assert np.allclose(basis.projected(basis.sampled(coefficients)), coefficients, rtol=0.0, atol=1e-13)


def test_half_a_period_has_enough_samples():
    with pytest.raises(ValueError, match="4 samples of half a period cannot hold 4 harmonics"):
        OddBasis(4, 4)
