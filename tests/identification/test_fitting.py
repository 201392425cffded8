"""Parameters identified from measured amplitudes, and their errors: exact data, differences, repeated experiments."""

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.design import Variables
from hbnlp.identification import Identification

ZETA, CUBIC, FORCE = 0.025, 0.1, 0.18
UPPER, LOWER = (0.9, 1.0, 1.1, 1.18, 1.22), (1.15, 1.2, 1.3, 1.4)


@pytest.fixture(scope="module")
def problem():
    return hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=ZETA, cubic=CUBIC, force=FORCE), n_harmonics=3)


@pytest.fixture(scope="module")
def branch(problem):
    return hbnlp.trace(problem, "omega", (0.7, 1.6), stability=None)


def on_both_branches(branch):
    """Points of a branch with two folds near the frequencies above, and these."""
    down, up = branch.folds
    parts = ((UPPER, np.arange(down.index + 1)), (LOWER, np.arange(up.index + 1, len(branch))))
    near = [(omega, part[np.argmin(abs(branch.parameter[part] - omega))]) for some, part in parts for omega in some]
    return [({"omega": omega}, branch.solution(int(index))) for omega, index in near]


@pytest.fixture(scope="module")
def amplitudes(problem, branch):
    def amplitude(set_to, near, **changed):
        solution = hbnlp.solve(problem, at={**near.parameters, **set_to, **changed}, start=near)
        return abs(solution.harmonics("x")[1])

    return lambda **changed: np.array([amplitude(*point, **changed) for point in on_both_branches(branch)])


@pytest.fixture(scope="module")
def identification(problem, branch):
    shared = Variables({"cubic": (0.02, 0.5), "force": (0.05, 0.5)})
    return Identification(shared, problem, on_both_branches(branch), "x")


def test_exact_amplitudes_give_back_the_parameters(problem, amplitudes):
    guess = {"cubic": 0.11, "force": 0.2}
    guessed = hbnlp.trace(problem, "omega", (0.7, 1.6), at=guess, stability=None)
    shared = Variables({"cubic": (0.02, 0.5), "force": (0.05, 0.5)})
    fit = Identification(shared, problem, on_both_branches(guessed), "x").fit(amplitudes(), guess, noise=0.01)
    assert fit.values["cubic"] == pytest.approx(CUBIC, rel=1e-7)
    assert fit.values["force"] == pytest.approx(FORCE, rel=1e-7)
    assert np.abs(fit.residuals).max() < 1e-7


def test_covariance_is_that_of_differences_of_resolved_responses(identification, amplitudes):
    fit = identification.fit(amplitudes(), {"cubic": CUBIC, "force": FORCE}, noise=0.02)
    step = 1e-5
    jacobian = np.column_stack(
        [
            (amplitudes(**{name: value + step}) - amplitudes(**{name: value - step})) / (2.0 * step)
            for name, value in (("cubic", CUBIC), ("force", FORCE))
        ]
    )
    assert np.allclose(fit.covariance, 0.02**2 * np.linalg.inv(jacobian.T @ jacobian), rtol=1e-5)


def test_repeated_experiments_scatter_as_the_covariance_says(identification, amplitudes):
    rng, sigma, count = np.random.default_rng(0), 0.005, 200
    exact = amplitudes()
    first = identification.fit(exact, {"cubic": CUBIC, "force": FORCE}, noise=sigma)
    noisy = exact + sigma * rng.standard_normal((count, exact.size))
    fits = [identification.fit(measured, first) for measured in noisy]
    estimates = np.array([list(fit.values.values()) for fit in fits])
    scatter = np.cov(estimates.T)
    # the estimated variances have a relative standard deviation of sqrt(2 / (count - 1)) = 0.1: three of them
    assert np.allclose(np.diag(scatter) / np.diag(first.covariance), 1.0, atol=0.3)
    correlation = [c[0, 1] / np.sqrt(c[0, 0] * c[1, 1]) for c in (scatter, first.covariance)]
    assert correlation[0] == pytest.approx(correlation[1], abs=0.05)
    assert np.abs(estimates.mean(axis=0) - [CUBIC, FORCE]).max() < 4.0 * np.sqrt(np.diag(scatter).max() / count)
    # the noise estimated from the residuals is unbiased in the square
    assert np.mean([fit.noise**2 for fit in fits]) == pytest.approx(sigma**2, rel=0.15)


def test_measurements_that_do_not_determine_the_variables_are_an_error():
    system = hbnlp.System(
        [[1.0]],
        [[0.05]],
        lambda p: [[p.a * p.b]],
        nonlinear_force=lambda q, v, tau, p: [0.1 * q[0] ** 3],
        forcing=lambda tau, p: [0.1 * ca.cos(tau)],
        parameters={"a": 1.0, "b": 1.0},
    )
    problem = hbnlp.HarmonicBalance(system, n_harmonics=1)
    points = [({}, hbnlp.solve(problem, at={"omega": omega})) for omega in (0.5, 0.6, 0.7)]
    measured = [abs(near.harmonics("x")[1]) for _, near in points]
    shared = Variables({"a": (0.5, 2.0), "b": (0.5, 2.0)})
    with pytest.raises(ValueError, match="do not determine a and b together"):
        Identification(shared, problem, points, "x").fit(measured, {"a": 1.0, "b": 1.0}, noise=0.01)
    alone = Variables({"a": (0.5, 2.0)})
    with pytest.raises(ValueError, match="give noise"):
        Identification(alone, problem, points[:1], "x").fit(measured[:1], {"a": 1.1})


def test_the_summary_states_values_and_errors(identification, amplitudes):
    fit = identification.fit(amplitudes(), {"cubic": CUBIC, "force": FORCE}, noise=0.01)
    assert repr(fit).startswith("Identified from 9 amplitudes: cubic = 0.1 +- 0.00")


@pytest.mark.parametrize(("limits", "limit"), [((0.02, 0.09), 0.09), ((0.105, 0.5), 0.105)])
def test_a_variable_at_its_limit_has_no_interval_and_the_others_are_conditional(
    problem, branch, amplitudes, limits, limit
):
    points, measured = on_both_branches(branch), amplitudes()
    fit = Identification(Variables({"cubic": limits, "force": (0.05, 0.5)}), problem, points, "x").fit(
        measured, {"cubic": min(max(0.1, limits[0] + 0.01), limits[1] - 0.01), "force": FORCE}
    )
    assert fit.at_limit == {"cubic": limit}
    assert fit.values["cubic"] == pytest.approx(limit, rel=1e-5)
    assert np.isnan(fit.standard_errors["cubic"])
    assert np.all(np.isnan(fit.covariance[0]))
    assert f"cubic = {limit:g} at its limit, force = " in repr(fit)
    assert f"limits that bind: cubic {limit:g}" in repr(fit)
    at_limit = [({**set_to, "cubic": limit}, near) for set_to, near in points]
    alone = Identification(Variables({"force": (0.05, 0.5)}), problem, at_limit, "x").fit(measured, {"force": FORCE})
    assert alone.at_limit == {}
    assert fit.values["force"] == pytest.approx(alone.values["force"], rel=1e-4)
    assert fit.standard_errors["force"] == pytest.approx(alone.standard_errors["force"], rel=1e-2)
    assert fit.noise == pytest.approx(alone.noise, rel=1e-3)


def test_only_what_users_need_is_shown():
    for name in hbnlp.identification.__all__:
        assert getattr(hbnlp.identification, name).__module__.startswith("hbnlp.identification.")


def test_weights_are_repetitions_of_a_measurement_and_zero_leaves_it_out(problem, branch, identification, amplitudes):
    start, measured = {"cubic": CUBIC, "force": FORCE}, amplitudes() + 0.01 * np.cos(np.arange(9.0))
    twice = identification.fit(measured, start, weights=[2.0, 0.0, *[1.0] * 7], noise=0.01)
    points = on_both_branches(branch)
    repeated = Identification(
        Variables({"cubic": (0.02, 0.5), "force": (0.05, 0.5)}), problem, [points[0], points[0], *points[2:]], "x"
    ).fit([measured[0], measured[0], *measured[2:]], start, noise=0.01)
    for name in start:
        assert twice.values[name] == pytest.approx(repeated.values[name], rel=1e-6)
    assert np.allclose(twice.covariance, repeated.covariance, rtol=1e-5)
    assert identification.fit(measured, start, weights=[1.0, 0.0, *[1.0] * 7]).freedom == 6.0
    with pytest.raises(ValueError, match="weights that are not negative"):
        identification.fit(measured, start, weights=-np.ones(9))


def test_intervals_are_students_where_the_noise_is_estimated_and_normal_where_it_is_given(identification, amplitudes):
    start, measured = {"cubic": CUBIC, "force": FORCE}, amplitudes() + 0.01 * np.cos(np.arange(9.0))
    for noise, reach in ((None, 2.3646), (0.01, 1.9600)):  # tables, of seven degrees of freedom and of infinitely many
        fit = identification.fit(measured, start, noise=noise)
        low, high = fit.confidence(0.95)["force"]
        assert 0.5 * (low + high) == pytest.approx(fit.values["force"])
        assert 0.5 * (high - low) == pytest.approx(reach * fit.standard_errors["force"], rel=1e-4)


def test_responses_begin_where_they_are_told_to(branch, identification, amplitudes):
    start, near = {"cubic": CUBIC, "force": FORCE}, [solution for _, solution in on_both_branches(branch)]
    lower = on_both_branches(branch)[5:]
    other = [*near[:3], lower[0][1], *near[4:]]  # the fourth, measured on the upper branch, begins on the lower
    fit = identification.fit(amplitudes(), start, near=other, weights=[*[1.0] * 3, 0.0, *[1.0] * 5], noise=0.01)
    assert fit.residuals[3] < -1.0
    assert np.abs(np.delete(fit.residuals, 3)).max() < 1e-6
    with pytest.raises(ValueError, match="a solution for each of the 9 responses"):
        identification.fit(amplitudes(), start, near=near[:2])
