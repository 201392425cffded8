"""Starts from nothing: where the linear response leads nowhere, the way from a damped linear system does."""

import casadi as ca
import numpy as np
import pytest
from independent import FirstOrder, state
from random_oscillators import RandomOscillator
from sampled_balance import SampledBalance

import hbnlp
from hbnlp.solutions.cold_start import linear_guess
from hbnlp.solutions.homotopy import from_linear_system


def oscillator(force, load, damping=0.1, stiffness=1.0, n_harmonics=7):
    system = hbnlp.System(
        1.0,
        damping,
        stiffness,
        nonlinear_force=lambda q, v, tau, p: force(q, v),
        forcing=lambda tau, p: load * ca.cos(tau),
    )
    return hbnlp.HarmonicBalance(system, n_harmonics)


@pytest.mark.parametrize("seed", [79, 169, 196, 197, 777])
def test_a_motion_is_found_where_the_curve_from_rest_closes_before_the_load_has_its_size(seed):
    """Double wells and parametric excitation: at no load there are several motions, and rest is one of them.

    At 777 the way from a linear system has 3,000 steps.
    """
    random = RandomOscillator.of(seed)
    omega = random.span[0]
    solution = hbnlp.solve(random.problem(), at={"omega": omega})
    assert solution.statistics["start"] == "from a linear system"
    balance, x = SampledBalance(random), solution.coefficients.ravel()
    assert np.abs(balance.residual(x, omega)).max() <= 1e-7 * balance.term_size(x, omega)


def test_between_wells_what_is_found_is_periodic_under_integration():
    """q'' + q'/10 - q + q^3 = 0.9 cos(1.2 t) at 31 harmonics, one period of it by Dormand and Prince."""
    problem = oscillator(lambda q, v: -2.0 * q + q**3, 0.9, n_harmonics=31)
    values = problem.values({"omega": 1.2})
    way = from_linear_system(problem, values, linear_guess(problem, values))
    solution = hbnlp.solve(problem, at={"omega": 1.2}, start=way.x.reshape(problem.shape))
    start = state(solution)
    end = FirstOrder(problem.system, {"omega": 1.2}).run(start, 2.0 * np.pi / 1.2)
    np.testing.assert_allclose(end, start, atol=1e-7)


@pytest.mark.parametrize("method", [hbnlp.Newton(), hbnlp.Rootfinder(), hbnlp.Ipopt()], ids=lambda m: type(m).__name__)
def test_at_a_resonance_without_damping_each_method_finds_the_bent_backbone(method):
    """q'' + q + q^3 = cos(tau): the linear response is infinite."""
    solution = hbnlp.solve(oscillator(lambda q, v: q**3, 1.0, damping=0.0), at={"omega": 1.0}, method=method)
    assert solution.converged
    first_order = FirstOrder(solution.problem.system, {"omega": 1.0})
    np.testing.assert_allclose(first_order.run(state(solution), 2.0 * np.pi), state(solution), atol=1e-4)


@pytest.mark.parametrize("omega", [1e-3, 1.0, 1e3])
def test_the_way_arrives_in_fast_and_slow_forcing_alike(omega):
    problem = oscillator(lambda q, v: -2.0 * q + q**3, 1.0)
    values = problem.values({"omega": omega})
    way = from_linear_system(problem, values, linear_guess(problem, values))
    assert way.x is not None
    assert np.abs(problem.assembly.residual(way.x, values)).max() <= 1e-8 * problem.assembly.term_size(way.x, values)


def test_a_system_that_escapes_is_said_to_have_perhaps_no_bounded_motion():
    """q'' + q'/10 + q + q^2 = cos(tau) leaves its only well, and integration from rest shows it."""
    problem = oscillator(lambda q, v: q**2, 1.0)
    with pytest.raises(hbnlp.ConvergenceError, match=r"grow without bound.*hbnlp\.integrate"):
        hbnlp.solve(problem, at={"omega": 1.0})
    response = hbnlp.integrate(problem.system, at={"omega": 1.0}, throw=False)
    assert response.stopped_at is not None
