"""Enough samples of the force: exact for polynomials, doubled until the residual no longer moves for the rest."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.balance.sampling import ALIASING_TOL, polynomial_degree, sufficient_samples
from hbnlp.branches.tracing import trace
from hbnlp.core.errors import ConvergenceError
from hbnlp.solutions.solving import solve
from hbnlp.systems import chain, duffing, tuned_absorber
from hbnlp.systems.system import System
from hbnlp.testing import check_branch


def oscillator(force, *, load=1.0, damping=0.1, stiffness=1.0, parameters=None):
    return System(
        1.0,
        damping,
        stiffness,
        nonlinear_force=lambda q, v, tau, p: [force(q[0], v[0], tau, p)],
        forcing=lambda tau, p: [load * ca.cos(tau)],
        parameters=parameters or {},
    )


POLYNOMIALS = {
    "a constant": (lambda x, v, tau, p: 2.0, 1),
    "a linear force": (lambda x, v, tau, p: 2.0 * x - v, 1),
    "x^2": (lambda x, v, tau, p: x**2, 2),
    "x^3": (lambda x, v, tau, p: x**3, 3),
    "x^2 v": (lambda x, v, tau, p: x**2 * v, 3),
    "v^3": (lambda x, v, tau, p: v**3, 3),
    "x^5": (lambda x, v, tau, p: x**5, 5),
    "x^9": (lambda x, v, tau, p: x**9, 9),
    "x^3 with a parameter that is zero": (lambda x, v, tau, p: p.zero * x**3, 3),
    "x^3 with a parameter without value": (lambda x, v, tau, p: p.omega * x**3, 3),
    "x^3 in small units": (lambda x, v, tau, p: 1e-14 * x**3, 3),
    "x^3 in large units": (lambda x, v, tau, p: 1e14 * x**3, 3),
    "x beside a weak x^3": (lambda x, v, tau, p: 1e5 * x + 1e-2 * x**3, 3),
}


@pytest.mark.parametrize(("force", "degree"), POLYNOMIALS.values(), ids=POLYNOMIALS)
def test_the_degree_of_a_polynomial_is_found(force, degree):
    assert polynomial_degree(oscillator(force, parameters={"zero": 0.0})) == degree


OTHERS = {
    "|x| x": lambda x, v, tau, p: ca.fabs(x) * x,
    "|v| v": lambda x, v, tau, p: ca.fabs(v) * v,
    "sin x": lambda x, v, tau, p: ca.sin(x),
    "sin of x in other units": lambda x, v, tau, p: 100.0 * ca.sin(0.01 * x),
    "a fraction": lambda x, v, tau, p: x / (1.0 + x**2),
    "a root": lambda x, v, tau, p: x / ca.sqrt(1.0 + x**2),
    "a steep friction": lambda x, v, tau, p: ca.tanh(1000.0 * v),
    "a stop": lambda x, v, tau, p: ca.fmax(x - 0.5, 0.0),
    "a stop far away": lambda x, v, tau, p: ca.fmax(x - 100.0, 0.0),
    "what is not finite everywhere": lambda x, v, tau, p: ca.log(x),
    "a force that depends on the phase": lambda x, v, tau, p: ca.cos(tau) * x,
}


@pytest.mark.parametrize("force", OTHERS.values(), ids=OTHERS)
def test_what_is_no_polynomial_has_no_degree(force):
    assert polynomial_degree(oscillator(force)) is None
    assert not HarmonicBalance(oscillator(force), 3).samples_are_settled


def test_the_supplied_systems_are_cubic_and_a_linear_one_needs_no_more_than_its_harmonics():
    assert [polynomial_degree(system) for system in (duffing(), chain(4), tuned_absorber())] == [3, 3, 3]
    assert polynomial_degree(System(1.0, 0.1, 1.0)) == 1


def test_a_weak_polynomial_beside_a_strong_one_in_another_degree_of_freedom_is_seen():
    system = System(
        np.eye(2), np.eye(2), np.eye(2), nonlinear_force=lambda q, v, tau, p: [1e12 * q[0], 1e-3 * q[1] ** 3]
    )
    assert polynomial_degree(system) == 3


@pytest.mark.parametrize("degree", [1, 2, 3, 5, 9])
@pytest.mark.parametrize("n_harmonics", [1, 4])
def test_d_plus_1_times_H_plus_1_samples_are_exact_and_one_fewer_is_not(degree, n_harmonics):
    system = oscillator(lambda x, v, tau, p: x**degree)
    problem = HarmonicBalance(system, n_harmonics)
    assert problem.samples_are_settled
    assert problem.n_samples == (degree + 1) * n_harmonics + 1 == sufficient_samples(n_harmonics, degree)
    x, values = np.random.default_rng(1).normal(size=problem.size), problem.values({"omega": 1.0})

    def residual(n_samples):
        return HarmonicBalance(system, n_harmonics, n_samples=n_samples).assembly.residual(x, values)

    exact = residual(40 * problem.n_samples)
    size = np.abs(exact).max()
    np.testing.assert_allclose(problem.assembly.residual(x, values), exact, atol=1e-12 * size)
    if degree > 1:
        assert np.abs(residual(problem.n_samples - 1) - exact).max() > 1e-8 * size


# -- doubling ----------------------------------------------------------------------------------------------------------


def test_a_pendulum_answers_with_bessel_functions():
    """With one harmonic, sin(A cos) has the first coefficient 2 J_1(A): (1 - w^2) A -> 2 J_1(A) - w^2 A."""
    omega, damping, load = 0.6, 0.2, 0.5
    system = oscillator(lambda x, v, tau, p: ca.sin(x), load=load, damping=damping, stiffness=0.0)
    solution = solve(HarmonicBalance(system, 1), at={"omega": omega})

    def balance(a):
        return (2.0 * jv(1, a) - omega**2 * a) ** 2 + (damping * omega * a) ** 2 - load**2

    amplitude = abs(solution.harmonics("x")[1])
    assert amplitude == pytest.approx(brentq(balance, 0.9 * amplitude, 1.1 * amplitude, xtol=1e-14), rel=1e-9)


def test_quadratic_drag_is_sampled_until_the_residual_no_longer_moves():
    """With one harmonic, |v| v has the first coefficient 8/(3 pi) V^2, V = w A, in phase with v."""
    omega, drag = 1.1, 0.3
    problem = HarmonicBalance(oscillator(lambda x, v, tau, p: drag * ca.fabs(v) * v, damping=0.0), 1)
    solution = solve(problem, at={"omega": omega})
    drag *= 8.0 / (3.0 * np.pi)
    exact = brentq(lambda a: ((1 - omega**2) * a) ** 2 + (drag * (omega * a) ** 2) ** 2 - 1.0, 0.0, 5.0, xtol=1e-14)
    assert abs(solution.harmonics("x")[1]) == pytest.approx(exact, rel=1e-8)

    used = solution.problem
    assert solution.statistics["samples"] == used.n_samples > problem.n_samples
    assert np.log2(used.n_samples / problem.n_samples) % 1.0 == 0.0
    x, values = solution.coefficients.ravel(), used.values(solution.parameters)
    moved = np.abs(used.oversampled().assembly.residual(x, values)).max()
    assert moved <= ALIASING_TOL * used.assembly.term_size(x, values)


def test_a_smooth_force_needs_no_doubling():
    problem = HarmonicBalance(oscillator(lambda x, v, tau, p: ca.sin(x)), 3)
    assert solve(problem, at={"omega": 0.7}).statistics["samples"] == problem.n_samples == 25


def test_a_stop_that_is_reached_is_sampled_however_far_away_it_is():
    """x -> L x: the same oscillator in other units of length has the same solution."""

    def amplitude(gap):
        system = oscillator(lambda x, v, tau, p: ca.fmax(x - gap, 0.0) ** 3 / gap**2, load=gap, damping=0.2)
        return abs(solve(HarmonicBalance(system, 5), at={"omega": 1.0}).harmonics("x")[1]) / gap

    assert amplitude(1.0) > 1.1
    assert amplitude(100.0) == pytest.approx(amplitude(1.0), rel=1e-8)


def test_a_trace_records_the_samples_of_every_point_and_they_suffice():
    problem = HarmonicBalance(oscillator(lambda x, v, tau, p: 0.3 * ca.fabs(v) * v), 3)
    branch = trace(problem, "omega", (0.6, 1.4), stability=None)
    check_branch(branch)
    assert branch.n_samples[0] > problem.n_samples
    assert np.all(np.diff(branch.n_samples) >= 0)
    fine = HarmonicBalance(problem.system, 3, n_samples=4096)
    for k in range(0, len(branch), 5):
        solution = branch.solution(k)
        x, values = solution.coefficients.ravel(), fine.values(solution.parameters)
        assert np.abs(fine.assembly.residual(x, values)).max() <= 2e-9 * fine.assembly.term_size(x, values)


def test_a_force_with_a_kink_is_refused_with_a_remedy_that_works():
    system = oscillator(lambda x, v, tau, p: ca.fmax(x - 0.5, 0.0))
    with pytest.raises(ConvergenceError, match=r"has a corner on this motion.* round it .* or pass n_samples"):
        solve(HarmonicBalance(system, 3), at={"omega": 0.7})
    solution = solve(HarmonicBalance(system, 3, n_samples=512), at={"omega": 0.7})
    assert solution.statistics["samples"] == 512
