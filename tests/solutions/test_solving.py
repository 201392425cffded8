"""One periodic solution at one parameter point: known ones by three methods, from nothing, errors with remedies."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy_balance import CubicBalance

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Newton
from hbnlp.core.errors import ConvergenceError, NonFiniteError
from hbnlp.core.kinds import Status
from hbnlp.fourier import shift
from hbnlp.solutions.ipopt import Ipopt
from hbnlp.solutions.rootfinder import Rootfinder
from hbnlp.solutions.solving import solve
from hbnlp.systems import chain, duffing, tuned_absorber
from hbnlp.systems.system import System

METHODS = [Newton(), Ipopt(), Rootfinder(), Rootfinder(plugin="fast_newton"), Rootfinder(plugin="kinsol")]
# x'' + .05 x' + x + .1 x^3 = .18 cos 1.2 t: first harmonics of the three solutions with H = 11, by
# tests/numpy_balance.py, as tested below
AMPLITUDES = [0.4175204536, 2.2605488905, 2.5091975811]


def frequencies(amplitude, z, g, force):
    """Both frequencies of one harmonic: (1 - W^2 + 3/4 g A^2)^2 + (2 z W)^2 = (F / A)^2, a quadratic in W^2."""
    s = 0.75 * g * amplitude**2
    middle, product = 1.0 + s - 2.0 * z**2, (1.0 + s) ** 2 - (force / amplitude) ** 2
    return np.sqrt(middle + np.array([-1.0, 1.0]) * np.sqrt(middle**2 - product))


def one_harmonic(amplitude, omega, z, g, force):
    """The coefficients [0, a_1, a_2] of that closed form."""
    answer = force / (1.0 - omega**2 + 0.75 * g * amplitude**2 + 2j * z * omega)
    return np.array([[0.0, answer.real, -answer.imag]])


def oscillator(force, load=1.0, damping=0.1):
    return System(
        1.0,
        damping,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [force(q[0], v[0])],
        forcing=lambda tau, p: [load * ca.cos(tau)],
    )


# -- known answers -----------------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(st.floats(0.05, 3.0), st.floats(0.01, 0.2), st.floats(0.01, 1.0), st.sampled_from([0, 1]))
def test_duffing_with_one_harmonic_is_the_closed_form(amplitude, z, g, side):
    force = 2.2 * z * amplitude * np.sqrt(1.0 + 0.75 * g * amplitude**2)
    omega = frequencies(amplitude, z, g, force)[side]
    exact = one_harmonic(amplitude, omega, z, g, force)
    assert np.hypot(*exact[0, 1:]) == pytest.approx(amplitude, rel=1e-9)
    problem = HarmonicBalance(duffing(damping_ratio=z, cubic=g, force=force), 1)
    solution = solve(problem, at={"omega": omega}, start=exact * (1.0 + 1e-4))
    size = np.linalg.norm(np.linalg.inv(problem.assembly.jacobian(exact.ravel(), problem.values({"omega": omega}))))
    np.testing.assert_allclose(solution.coefficients, exact, atol=1e-9 * amplitude + 1e-14 * size)


@pytest.mark.parametrize("amplitude", AMPLITUDES)
def test_the_tabulated_solutions_are_those_of_a_balance_in_numpy(amplitude):
    start = np.zeros(23)
    start[:3] = one_harmonic(amplitude, 1.2, 0.025, 0.1, 0.18)
    x = CubicBalance(1.0, 0.05, 1.0, 1.0, 0.1, 1.0, 11).solve(start, 1.2, 0.18)
    assert np.hypot(x[1], x[2]) == pytest.approx(amplitude, abs=1e-10)


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("amplitude", AMPLITUDES)
def test_all_methods_find_the_three_tabulated_solutions(method, amplitude):
    omega, (z, g, force) = 1.2, (0.025, 0.1, 0.18)
    problem = HarmonicBalance(duffing(damping_ratio=z, cubic=g, force=force), 11)
    guess = one_harmonic(amplitude, omega, z, g, force)
    solution = solve(problem, at={"omega": omega}, start=guess, method=method)
    assert solution.converged
    assert abs(solution.harmonics("x")[1]) == pytest.approx(amplitude, abs=1e-10)
    values = problem.values(solution.parameters)
    assert np.abs(problem.residual(solution.coefficients.ravel(), values).full()).max() < 1e-10


def test_all_methods_agree_on_the_absorber_and_on_a_short_chain():
    for system, at in ((tuned_absorber(), {"omega": 0.7, "force": 0.05}), (chain(3), {"omega": 0.8, "force": 0.05})):
        problem = HarmonicBalance(system, 5)
        first, *others = (solve(problem, at=at, method=method).coefficients for method in METHODS)
        for other in others:
            np.testing.assert_allclose(other, first, atol=1e-9 * np.abs(first).max())


def test_a_linear_system_takes_one_step_and_one_that_measures_the_error():
    system = System(1.0, 0.1, 1.0, forcing=lambda tau, p: [ca.cos(tau)])
    solution = solve(HarmonicBalance(system, 3), at={"omega": 0.7})
    assert solution.statistics["iterations"] == 2
    assert solution.harmonics("x")[1] == pytest.approx(1.0 / (1.0 - 0.49 + 0.07j), rel=1e-12)


def test_another_sign_of_the_load_is_the_solution_half_a_period_later():
    problem = HarmonicBalance(tuned_absorber(), 5)
    one, other = (solve(problem, at={"omega": 0.7, "force": force}).coefficients for force in (0.05, -0.05))
    np.testing.assert_allclose(other, shift(one, np.pi), atol=1e-12)


def test_a_solution_over_two_periods_is_that_of_one():
    once = solve(HarmonicBalance(duffing(), 5), at={"omega": 1.2})
    twice = solve(HarmonicBalance(duffing(), 10, periods=2), at={"omega": 1.2})
    np.testing.assert_allclose(twice.harmonics("x")[::2], once.harmonics("x"), atol=1e-10)
    np.testing.assert_allclose(twice.harmonics("x")[1::2], 0.0, atol=1e-14)


# -- from nothing ------------------------------------------------------------------------------------------------------


def test_the_ten_mass_chain_at_its_slowest_is_reached_from_nothing():
    """Newton's method from zero or from the linear response alone does not converge there: another start is needed."""
    problem = HarmonicBalance(chain(10), 7)
    solution = solve(problem, at={"omega": 0.2})
    assert solution.converged
    assert solution.statistics["start"] != "linear response"
    values = problem.values({"omega": 0.2})
    assert np.abs(problem.residual(solution.coefficients.ravel(), values).full()).max() < 1e-10


@pytest.mark.parametrize("omega", [0.8, 1.1, 1.2, 1.5, 2.5])
def test_the_absorber_is_reached_from_nothing(omega):
    solution = solve(HarmonicBalance(tuned_absorber(force=0.18), 5), at={"omega": omega})
    assert solution.converged


def test_an_undamped_oscillator_at_its_linear_resonance_is_reached_from_nothing():
    """3/4 g A^3 = F with one harmonic: only the spring's stiffening bounds the response."""
    solution = solve(HarmonicBalance(duffing(damping_ratio=0.0, cubic=0.1, force=0.18), 1), at={"omega": 1.0})
    assert abs(solution.harmonics("x")[1]) == pytest.approx((0.18 / 0.075) ** (1.0 / 3.0), rel=1e-9)


def test_rest_is_the_answer_to_no_load():
    solution = solve(HarmonicBalance(duffing(force=0.0), 3), at={"omega": 1.2})
    np.testing.assert_array_equal(solution.coefficients, 0.0)


# -- guesses -----------------------------------------------------------------------------------------------------------


def test_a_guess_may_be_a_solution_of_another_number_of_harmonics_or_an_array():
    at = {"omega": 1.2}
    guess = one_harmonic(AMPLITUDES[2], 1.2, 0.025, 0.1, 0.18)
    few = solve(HarmonicBalance(duffing(), 3), at=at, start=guess)
    many = solve(HarmonicBalance(duffing(), 11), at=at, start=few)
    again = solve(HarmonicBalance(duffing(), 11), at=at, start=few.coefficients.tolist())
    assert abs(many.harmonics("x")[1]) == pytest.approx(AMPLITUDES[2], abs=1e-10)
    np.testing.assert_array_equal(again.coefficients, many.coefficients)


def test_a_guess_is_left_as_it_was():
    guess = np.array([[0.0, 0.4, 0.1]])
    solve(HarmonicBalance(duffing(), 3), at={"omega": 1.2}, start=guess)
    np.testing.assert_array_equal(guess, [[0.0, 0.4, 0.1]])


def test_a_guess_of_another_shape_is_refused():
    for guess in (np.zeros(3), np.zeros((2, 3)), np.zeros((1, 4))):
        with pytest.raises(ValueError, match=r"has shape .*; give an array .*of shape \(1, (any|2H\+1)\)"):
            solve(HarmonicBalance(duffing(), 3), at={"omega": 1.2}, start=guess)


# -- errors ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "method", [Newton(max_iterations=3), Ipopt(max_iterations=1), Rootfinder(max_iterations=1)], ids=str
)
def test_a_solve_that_does_not_converge_says_where_why_and_what_to_do_and_keeps_what_it_has(method):
    problem = HarmonicBalance(duffing(), 5)
    guess = np.full((1, 11), 50.0)
    with pytest.raises(ConvergenceError, match=r"no solution at .*omega=1\.2: .+ try another start") as caught:
        solve(problem, at={"omega": 1.2}, start=guess, method=method)
    result = caught.value.result
    assert result.status is Status.NOT_CONVERGED
    assert not result.converged
    assert result.coefficients.shape == (1, 11)
    assert result.parameters["omega"] == 1.2
    returned = solve(problem, at={"omega": 1.2}, start=guess, method=method, throw=False)
    assert returned.status is Status.NOT_CONVERGED
    assert returned.statistics["reason"]


def test_a_load_without_a_periodic_answer_does_not_converge():
    """An undamped linear oscillator at resonance."""
    system = System(1.0, 0.0, 1.0, forcing=lambda tau, p: [ca.cos(tau)])
    with pytest.raises(ConvergenceError, match=r"no solution at omega=1: .+ try another start"):
        solve(HarmonicBalance(system, 3), at={"omega": 1.0})


@pytest.mark.parametrize("method", [Newton(), Ipopt(), Rootfinder()], ids=str)
@pytest.mark.parametrize("force", [lambda x, v: ca.sqrt(x), lambda x, v: ca.sqrt(x - 9.0)], ids=["derivative", "value"])
def test_a_force_that_is_not_finite_at_rest_is_named_with_a_remedy(method, force):
    with pytest.raises(
        NonFiniteError, match=r"nonlinear_force.* is not finite at rest .*smooth it there, or give a start"
    ):
        solve(HarmonicBalance(oscillator(force), 3), at={"omega": 1.2}, method=method)


def test_a_force_that_is_not_finite_at_rest_alone_is_solved_from_a_guess():
    """A pendulum of two charges: 1/x on the way, singular at rest."""
    system = oscillator(lambda x, v: -1.0 / x, load=0.1)
    solution = solve(HarmonicBalance(system, 5, n_samples=64), at={"omega": 0.5}, start=[[1.0, 0.0, 0.0]])
    assert solution.harmonics("x")[0].real == pytest.approx(1.0, abs=0.02)


def test_a_start_that_fails_leaves_the_others_alone():
    """A loaded Hertz contact that stays closed; the linear response leads to a bouncing motion that is not smooth.

    Mean .984223 and |x_1| = .352391 by scipy's DOP853 over 150 periods from x = 1 (least x: .653).
    """
    system = System(
        1.0,
        0.05,
        0.0,
        nonlinear_force=lambda q, v, tau, p: [ca.if_else(q[0] > 0.0, q[0] ** 1.5, 0.0)],
        forcing=lambda tau, p: [1.0 + 0.3 * ca.cos(tau)],
    )
    problem = HarmonicBalance(system, 11)
    solution = solve(problem, at={"omega": 0.8})
    assert np.abs(solution.harmonics("x")[:2]) == pytest.approx([0.984223, 0.352391], rel=1e-5)


def test_a_motion_on_which_the_force_is_too_rough_is_the_reason_of_its_start_alone():
    system = oscillator(lambda x, v: ca.fmax(x - 0.5, 0.0))
    failed = solve(HarmonicBalance(system, 3), at={"omega": 0.7}, throw=False)
    assert not failed.converged
    assert "has a corner on this motion" in failed.message
    assert np.all(np.isfinite(failed.coefficients))


@pytest.mark.parametrize("plugin", ["newton", "fast_newton"])
def test_a_rootfinder_that_fails_says_so(plugin):
    """Forces of 1e8 are balanced to 1e-16 of them, not to 1e-12; the plugin ends without a word for it."""
    problem = HarmonicBalance(duffing(cubic=1e-19, force=1.8e8), 5)
    solution = solve(problem, at={"omega": 0.9}, method=Rootfinder(plugin=plugin), throw=False)
    assert solution.converged or solution.statistics["reason"]
    assert abs(solution.harmonics("x")[1]) == pytest.approx(7.57934e8, rel=1e-4)


def test_a_guess_that_is_not_finite_is_refused():
    with pytest.raises((NonFiniteError, ValueError), match="start"):
        solve(HarmonicBalance(duffing(), 3), at={"omega": 1.2}, start=np.full((1, 7), np.nan))


@pytest.mark.parametrize("method", ["newton", 3, Newton])
def test_what_is_no_method_is_refused_with_those_that_are(method):
    with pytest.raises(TypeError, match=r"method.*Newton"):
        solve(HarmonicBalance(duffing(), 3), at={"omega": 1.2}, method=method)


def test_a_system_is_no_problem():
    with pytest.raises(TypeError, match=r"problem is System .*; give a HarmonicBalance\(system, n_harmonics"):
        solve(duffing(), at={"omega": 1.2})


def test_parameters_are_checked_by_name_and_value():
    problem = HarmonicBalance(duffing(), 3)
    with pytest.raises(ValueError, match="parameter 'omega' has no value; give one"):
        solve(problem)
    with pytest.raises(KeyError, match="unknown parameter 'omeg'; did you mean 'omega'"):
        solve(problem, at={"omeg": 1.2})
    with pytest.raises(ValueError, match="parameter 'force' is nan; give a finite number"):
        solve(problem, at={"omega": 1.2, "force": np.nan})


BAD_OPTIONS = [
    (Newton, {"tol": 0.0}, "tol is 0.0; give a finite number greater than 0 and less than 0.01"),
    (Newton, {"tol": -1.0}, "tol is -1.0"),
    (Newton, {"max_iterations": 0}, "max_iterations is 0; give an integer of at least 1"),
    (Ipopt, {"tol": 1.0}, "tol is 1.0; give a finite number"),
    (Ipopt, {"max_iterations": 0}, "max_iterations is 0; give an integer of at least 1"),
    (Rootfinder, {"plugin": "broyden"}, "plugin is 'broyden'; give one of newton, fast_newton, kinsol"),
    (Rootfinder, {"tol": 0.0}, "tol is 0.0"),
    (Rootfinder, {"max_iterations": 0}, "max_iterations is 0; give an integer of at least 1"),
]


@pytest.mark.parametrize(("kind", "options", "message"), BAD_OPTIONS)
def test_options_that_make_no_sense_are_refused_with_their_value(kind, options, message):
    with pytest.raises(ValueError, match=message):
        kind(**options)


def test_options_are_by_keyword_and_unknown_ones_are_refused():
    with pytest.raises(TypeError):
        Newton(1e-8)
    with pytest.raises(TypeError, match="tolerance"):
        Newton(tolerance=1e-8)


def test_a_solution_of_one_period_starts_a_problem_of_two():
    one = HarmonicBalance(duffing(), 3)
    two = HarmonicBalance(duffing(), 6, periods=2)
    solution = solve(one, at={"omega": 1.1})
    again = solve(two, at={"omega": 1.1}, start=solution)
    assert again.statistics["iterations"] <= 2
    np.testing.assert_allclose(again.coefficients[:, 3:5], solution.coefficients[:, 1:3], atol=1e-12)
    with pytest.raises(ValueError, match=r"2 period\(s\) and the problem 1"):
        solve(one, at={"omega": 1.1}, start=again)
