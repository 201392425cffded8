"""Blocks that multiply by a sampled function: what sampling and projection give, however many samples and harmonics."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance import multiplication
from hbnlp.balance.multiplication import Multiplication, Table, ToeplitzHankel
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.fourier import FourierBasis
from hbnlp.systems import chain
from hbnlp.systems.system import System


def exact_blocks(samples, n_harmonics, *, derivative=False):
    """Sampling, product and projection written out, with phases that have lost no digits."""
    n_samples = len(samples)
    h = np.arange(1, n_harmonics + 1)
    turns = 2.0 * np.pi / n_samples * (np.multiply.outer(np.arange(n_samples), h) % n_samples)
    sampling = np.ones((n_samples, 2 * n_harmonics + 1))
    sampling[:, 1::2], sampling[:, 2::2] = np.cos(turns), np.sin(turns)
    slope = np.zeros_like(sampling)
    slope[:, 1::2], slope[:, 2::2] = -h * np.sin(turns), h * np.cos(turns)
    weights = np.full(2 * n_harmonics + 1, 2.0 / n_samples)
    weights[0] *= 0.5
    seen = slope if derivative else sampling
    return np.stack([weights[:, None] * (sampling.T @ (g[:, None] * seen)) for g in samples.T])


@pytest.mark.parametrize("derivative", [False, True])
@pytest.mark.parametrize(
    ("n_harmonics", "n_samples"),
    [(1, 3), (1, 4), (2, 5), (3, 7), (3, 8), (3, 9), (3, 13), (7, 15), (7, 29), (7, 64), (30, 61), (30, 62), (30, 121)],
)
def test_toeplitz_and_hankel_are_the_discrete_sums_aliasing_included(n_harmonics, n_samples, derivative):
    # random samples have all harmonics, so that all of them fold back
    samples = np.random.default_rng(n_samples).normal(size=(n_samples, 3))
    exact = exact_blocks(samples, n_harmonics, derivative=derivative)
    for way in (Table, ToeplitzHankel):
        found = way(FourierBasis(n_harmonics, n_samples), derivative)(samples)
        np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-14 * np.abs(exact).max(), err_msg=way.__name__)


@pytest.mark.parametrize("n_harmonics", [2, 20, 40, 160], ids=["table", "at once", "in parts", "one by one"])
@pytest.mark.parametrize("full", [True, False])
def test_blocks_are_added_at_their_places(n_harmonics, full):
    n, n_samples, rng = 5, 2 * n_harmonics + 2, np.random.default_rng(1)
    # column by column, as CasADi counts nonzeros
    columns, rows = np.nonzero(np.ones((n, n)) if full else np.abs(np.subtract.outer(range(n), range(n))) != 1)
    samples = rng.normal(size=(n_samples, len(rows)))
    before = rng.normal(size=(n, 2 * n_harmonics + 1) * 2)
    matrix = before.copy()
    Multiplication(FourierBasis(n_harmonics, n_samples), (rows, columns)).add(matrix, samples)
    expected = before.copy()
    for row, column, block in zip(rows, columns, exact_blocks(samples, n_harmonics), strict=True):
        expected[row, :, column, :] += block
    np.testing.assert_allclose(matrix, expected, rtol=0.0, atol=1e-13)


def coupled():
    """Two degrees of freedom with a force of displacements, velocities, phase and omega."""
    return System(
        np.diag([1.0, 0.8]),
        0.1 * np.eye(2),
        np.array([[2.0, -0.7], [-0.7, 3.0]]),
        nonlinear_force=lambda q, v, tau, p: [
            p.a * q[0] ** 3 + q[1] ** 2 * v[0],
            q[0] * ca.cos(tau) + v[1] ** 3 + p.omega * q[0] * q[1],
        ],
        parameters={"a": 0.7},
    )


@pytest.mark.parametrize(("periods", "n_samples"), [(1, 41), (1, 42), (2, 81), (3, 100)])
def test_the_jacobian_of_many_harmonics_is_that_of_the_program(periods, n_samples):
    problem = HarmonicBalance(coupled(), 20, periods=periods, n_samples=n_samples)
    x = np.random.default_rng(2).normal(size=problem.size) / 8.0
    values = problem.values({"omega": 1.3})
    exact = problem.jacobian(x, values).full()
    found = problem.assembly.jacobian(x, values)
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-13 * np.abs(exact).max())


@pytest.mark.parametrize("system", [coupled(), chain(4)], ids=["velocities", "displacements"])
def test_both_ways_give_the_same_slopes_of_the_jacobian(system, monkeypatch):
    values = system.parameters.values({"omega": 1.3})
    slopes = []
    for limit in (0, 10**9):
        monkeypatch.setattr(multiplication, "LARGEST_TABLE", limit)
        problem = HarmonicBalance(system, 6, periods=2)
        x, dx = np.random.default_rng(4).normal(size=(2, problem.size))
        slopes.append([problem.assembly.jacobian_along(x, values, dx, index) for index in (None, *range(values.size))])
    scale = np.abs(slopes).max()
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=0.0, atol=1e-14 * scale)
