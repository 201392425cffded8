"""A corner of the force is found where the motion meets it, and the width that is named is one that can be sampled."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.errors import ConvergenceError, CornerError
from hbnlp.solutions.cold_start import PATIENCE
from hbnlp.solutions.solving import solve
from hbnlp.systems.system import System

PARAMETERS = {"force": 1.0, "gap": 0.5, "mu": 0.1, "width": 0.01}


def oscillator(force, n=1, **options):
    return System(
        np.eye(n),
        0.2 * np.eye(n),
        np.eye(n),
        nonlinear_force=force,
        forcing=lambda tau, p: [p.force * ca.cos(tau)] + [0.0] * (n - 1),
        parameters=PARAMETERS,
        **options,
    )


def corner(force, coefficients, *, omega=1.0, n=1, periods=1):
    """Return the worst corner on the motion of these coefficients."""
    coefficients = np.atleast_2d(np.asarray(coefficients, dtype=float))
    problem = HarmonicBalance(oscillator(force, n), coefficients.shape[1] // 2, periods=periods)
    return problem.corner(coefficients.ravel(), problem.values({"omega": omega}))


ARC = np.arccos(0.5 / 2.0)  # of a motion 2 cos(tau) the part beyond the gap of 0.5 begins and ends here

AT_THE_GAP = {
    "fmax": lambda q, v, tau, p: [3.0 * ca.fmax(q[0] - p.gap, 0.0)],
    "fabs": lambda q, v, tau, p: [3.0 * ca.fabs(q[0] - p.gap)],
    "if_else": lambda q, v, tau, p: [ca.if_else(q[0] > p.gap, 3.0 * (q[0] - p.gap), 0.0)],
    "numpy": lambda q, v, tau, p: [3.0 * np.fmax(q[0] - p.gap, 0.0) + q[0] ** 3],
}


@pytest.mark.parametrize("force", AT_THE_GAP.values(), ids=AT_THE_GAP)
def test_a_gap_is_met_where_the_displacement_is_the_gap(force):
    found = corner(force, [0.0, 2.0, 0.0])
    assert found.quantity in ("(q[0]-gap)", "(gap-q[0])")
    assert (found.entry, found.jump) == (0, 0.0)
    np.testing.assert_allclose(np.sort(found.phases), [ARC, 2.0 * np.pi - ARC], atol=1e-9)
    assert found.width == pytest.approx(0.02)  # the displacement moves by 2 a radian at most
    assert "has a corner on this motion at tau = " in str(found)
    assert "0.02 or more here" in str(found)


def test_friction_is_a_step_where_the_velocity_is_zero():
    found = corner(lambda q, v, tau, p: [p.mu * ca.sign(v[0]) + 0.3 * ca.fabs(q[0])], [0.0, 2.0, 0.0], omega=3.0)
    assert found.quantity == "v[0]"
    assert found.jump == pytest.approx(0.2, rel=1e-4)
    np.testing.assert_allclose(np.cos(found.phases) ** 2, 1.0)
    assert found.width == pytest.approx(0.06)  # v = -6 sin(tau)
    assert "has a step of 0.2 on this motion" in str(found)


def test_phases_are_those_of_the_forcing_over_all_periods():
    found = corner(AT_THE_GAP["fmax"], [0.0, 2.0, 0.0], periods=2)  # 2 cos(tau / 2)
    np.testing.assert_allclose(np.sort(found.phases), [2.0 * ARC, 4.0 * np.pi - 2.0 * ARC], atol=1e-9)


def test_the_degree_of_freedom_is_named():
    found = corner(lambda q, v, tau, p: [0.0, ca.fabs(q[1] - q[0])], [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], n=2)
    assert (found.entry, found.quantity) == (1, "(q[1]-q[0])")
    np.testing.assert_allclose(np.sort(found.phases), [np.pi / 4, 5 * np.pi / 4], atol=1e-9)


GRID = np.linspace(-6.0, 6.0, 25)
TABLE = 0.1 * GRID**3


def test_a_linear_table_has_a_corner_at_each_of_its_points():
    table = ca.interpolant("spring", "linear", [GRID], TABLE)
    found = corner(lambda q, v, tau, p: [p.mu * q[0] + table(2.0 * q[0])], [0.0, 2.0, 0.0])
    assert (found.entry, found.jump, found.by_phase) == (0, 0.0, False)
    met = [point for point in GRID if 0.0 < abs(point) < 4.0] * 2  # at 0 both sides rise alike
    np.testing.assert_allclose(np.sort(4.0 * np.cos(found.phases)), np.sort(met), atol=1e-9)
    assert "that of spring((2.*q[0])), a ca.interpolant that is 'linear'" in str(found)
    assert "make it a 'bspline'" in str(found)


def test_a_linear_table_of_two_quantities_has_corners_where_either_passes_a_point():
    table = ca.interpolant("force", "linear", [GRID, GRID], np.add.outer(TABLE, GRID**2).T.ravel())
    found = corner(lambda q, v, tau, p: [0.0, table(ca.vertcat(q[0], q[1]))], [[0.0, 0.4, 0.0], [0.0, 0.0, 0.7]], n=2)
    # the first stays beside 0, where its cube's table has no corner; the second passes 0 and .5
    np.testing.assert_allclose(np.sort(np.abs(0.7 * np.sin(found.phases))), [0.0] * 2 + [0.5] * 4, atol=1e-9)
    assert "force(q[0], q[1])" in str(found)


def test_a_spline_of_low_degree_has_corners_and_a_cubic_one_has_none():
    def of_degree(degree):
        table = ca.interpolant("spring", "bspline", [GRID], TABLE, {"degree": [degree]})
        return corner(lambda q, v, tau, p: [table(q[0])], [0.0, 2.0, 0.0])

    assert "or take degree 3" in str(of_degree(1))
    assert of_degree(3) is None


def test_a_table_in_a_balance_is_told_by_its_name():
    def balance(kind):
        table = ca.interpolant("spring", kind, [GRID], TABLE)
        return HarmonicBalance(oscillator(lambda q, v, tau, p: [table(q[0])]), 5)

    with pytest.raises(ConvergenceError, match=r"that of spring\(q\[0\]\), a ca.interpolant that is 'linear'"):
        solve(balance("linear"), at={"omega": 0.7})
    smooth = solve(balance("bspline"), at={"omega": 0.7})
    cubic = solve(HarmonicBalance(oscillator(lambda q, v, tau, p: [0.1 * q[0] ** 3]), 5), at={"omega": 0.7})
    np.testing.assert_allclose(smooth.coefficients, cubic.coefficients, atol=1e-9)


WITHOUT = {
    "a sine": lambda q, v, tau, p: [ca.sin(q[0])],
    "a square of a modulus": lambda q, v, tau, p: [ca.fabs(v[0]) * v[0]],
    "a cube beyond a gap": lambda q, v, tau, p: [ca.fmax(q[0] - p.gap, 0.0) ** 3],
    "a rounded modulus": lambda q, v, tau, p: [ca.sqrt(q[0] ** 2 + 1e-4)],
    "a gap that is not reached": lambda q, v, tau, p: [ca.fmax(q[0] - 4.0 * p.gap - 1e-3, 0.0)],
    "a gap that is touched": lambda q, v, tau, p: [ca.fmax(q[0] - 4.0 * p.gap, 0.0)],
}


@pytest.mark.parametrize("force", WITHOUT.values(), ids=WITHOUT)
def test_where_there_is_no_corner_none_is_found(force):
    assert corner(force, [0.0, 2.0, 0.0]) is None


def test_a_corner_is_the_reason_why_no_number_of_samples_is_enough():
    problem = HarmonicBalance(oscillator(AT_THE_GAP["fmax"]), 3)
    message = r"corner on this motion at tau = .*where d = \(q\[0\]-gap\) is zero.*or pass n_samples"
    with pytest.raises(ConvergenceError, match=message):
        solve(problem, at={"omega": 0.7})
    known = solve(HarmonicBalance(problem.system, 3, n_samples=512), at={"omega": 0.7})
    while not problem.sampling.doubles_to_many:
        problem = problem.oversampled()
    with pytest.raises(CornerError, match=message):
        problem.samples_suffice(known.coefficients.ravel(), problem.values({"omega": 0.7}))


EVERYWHERE = {
    "a gap": AT_THE_GAP["fmax"],
    "a stiff gap": lambda q, v, tau, p: [100.0 * ca.fmax(q[0] - p.gap, 0.0)],
    "a modulus": lambda q, v, tau, p: [0.5 * ca.fabs(q[0])],
    "friction": lambda q, v, tau, p: [p.mu * ca.sign(v[0])],
    "a preload": lambda q, v, tau, p: [2.0 * ca.sign(q[0]) + q[0]],
    "steps": lambda q, v, tau, p: [0.2 * ca.floor(30.0 * q[0])],
}


@pytest.mark.parametrize("force", EVERYWHERE.values(), ids=EVERYWHERE)
def test_a_cold_start_at_a_corner_ends_before_samples_are_doubled(force):
    problem = HarmonicBalance(oscillator(force), 5)
    with pytest.raises(ConvergenceError, match=r"nonlinear_force\[0\] has a (corner|step)") as error:
        solve(problem, at={"omega": 1.3})
    assert error.value.result.problem.n_samples == problem.n_samples
    assert error.value.result.statistics["iterations"] <= PATIENCE


def test_a_corner_that_the_samples_can_bear_is_no_reason_to_end():
    solution = solve(HarmonicBalance(oscillator(lambda q, v, tau, p: [1e-3 * ca.fabs(q[0])]), 5), at={"omega": 1.3})
    assert solution.problem.n_samples > 41


def test_a_failure_beside_a_step_says_so():
    system = oscillator(lambda q, v, tau, p: [2.0 * ca.sign(q[0]) + q[0]])
    with pytest.raises(ConvergenceError, match=r"; perhaps because nonlinear_force\[0\] has a step of 4 on"):
        solve(HarmonicBalance(system, 3), at={"omega": 0.4})


ROUNDED = {
    "a gap": (
        lambda d, width: 3.0 * ca.fmax(d, 0.0),
        lambda d, width: 1.5 * (d + ca.sqrt(d**2 + width**2)),
        lambda q, v, p: q[0] - p.gap,
    ),
    "a modulus": (
        lambda d, width: 0.5 * ca.fabs(d),
        lambda d, width: 0.5 * ca.sqrt(d**2 + width**2),
        lambda q, v, p: q[0],
    ),
    "friction": (
        lambda d, width: 0.2 * ca.sign(d),
        lambda d, width: 0.2 * ca.tanh(d / width),
        lambda q, v, p: v[0],
    ),
    "a preload": (
        lambda d, width: 0.2 * ca.sign(d) + d,
        lambda d, width: 0.2 * ca.tanh(d / width) + d,
        lambda q, v, p: q[0],
    ),
}


@pytest.mark.parametrize(("sharp", "rounded", "quantity"), ROUNDED.values(), ids=ROUNDED)
def test_the_width_that_is_named_is_one_that_can_be_sampled(sharp, rounded, quantity):
    def system(law):
        return oscillator(lambda q, v, tau, p: [law(quantity(q, v, p), p.width)])

    at = {"omega": 0.7, "width": 0.1}
    wide = solve(HarmonicBalance(system(rounded), 7), at=at)
    problem = HarmonicBalance(system(sharp), 7)
    found = problem.corner(wide.coefficients, problem.values(at))
    narrow = solve(HarmonicBalance(system(rounded), 7), at=at | {"width": found.width}, start=wide)
    assert narrow.statistics["samples"] > 800
    # and it is close to the corner: the harmonics differ by what the width is beside the amplitude
    assert np.abs(narrow.coefficients - wide.coefficients).max() < 0.1 * np.abs(wide.coefficients).max()


def test_a_rounded_gap_tends_to_the_sharp_one_nearly_with_the_square_of_the_width():
    sharp, rounded, quantity = ROUNDED["a gap"]

    def solved(law, width, n_samples=None):
        system = oscillator(lambda q, v, tau, p: [law(quantity(q, v, p), p.width)])
        problem = HarmonicBalance(system, 5, n_samples=n_samples)
        return solve(problem, at={"omega": 0.7, "width": width}).coefficients

    exact = solved(sharp, 0.0, 2**15)
    size = np.abs(exact).max()
    errors = np.array([np.abs(solved(rounded, share * size) - exact).max() / size for share in (0.05, 0.02, 0.01)])
    np.testing.assert_allclose(errors, [1.5e-3, 3.5e-4, 9e-5], rtol=0.25)
    assert np.abs(solved(sharp, 0.0, 1024) - exact).max() < 1e-5 * size


def test_rounded_friction_tends_to_its_describing_function_with_the_square_of_the_width():
    """With one harmonic, mu sign(v) has the first coefficient 4 mu / pi, in phase with v."""
    omega, mu, load, damping = 0.7, 0.2, 1.0, 0.2

    def balance(a):
        return ((1.0 - omega**2) * a) ** 2 + (damping * omega * a + 4.0 * mu / np.pi) ** 2 - load**2

    exact = brentq(balance, 0.0, 5.0, xtol=1e-14)
    problem = HarmonicBalance(oscillator(lambda q, v, tau, p: [mu * ca.tanh(v[0] / p.width)]), 1)
    errors = [
        abs(solve(problem, at={"omega": omega, "width": width}).harmonics("x")[1]) - exact
        for width in (0.08, 0.04, 0.02)
    ]
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.05)
    assert abs(errors[-1]) < 1e-4 * exact
