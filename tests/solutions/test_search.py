"""All solutions at one parameter point, by deflation, random starts and varied load."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.continuation.newton import Newton
from hbnlp.core.errors import NonFiniteError
from hbnlp.core.kinds import End
from hbnlp.solutions.attempt import attempt
from hbnlp.solutions.cold_start import linear_guess
from hbnlp.solutions.deflation import deflated_newton
from hbnlp.solutions.identity import same_motion
from hbnlp.solutions.motions import Motions
from hbnlp.solutions.search import Search, find_all
from hbnlp.solutions.solving import solve
from hbnlp.systems import chain, duffing, tuned_absorber
from hbnlp.systems.system import System
from hbnlp.testing import check_branch

# first harmonics of the three solutions at W = 1.2, H = 11: of tests/numpy_balance.py, as test_solving.py tests
AMPLITUDES = [0.4175204536, 2.2605488905, 2.5091975811]
SEEDS = [0, 1, 20080]


def pendulum(force=0.2, **options):
    """x'' + .1 x' + sin x = F cos(w t)."""
    return System(
        1.0,
        0.1,
        0.0,
        nonlinear_force=lambda q, v, tau, p: [ca.sin(q[0])],
        forcing=lambda tau, p: [force * ca.cos(tau)],
        **options,
    )


def check_solutions(problem, solutions):
    """All of them balance, no two are the same, and they come by rising size."""
    sizes = [np.linalg.norm(s.coefficients) for s in solutions]
    assert sizes == sorted(sizes)
    for k, solution in enumerate(solutions):
        assert solution.converged
        values = problem.values(solution.parameters)
        residual = np.abs(problem.residual(solution.coefficients.ravel(), values).full()).max()
        assert residual <= 1e-8 * problem.assembly.term_size(solution.coefficients.ravel(), values)
        for other in solutions[:k]:
            assert np.linalg.norm(solution.coefficients - other.coefficients) > 1e-5 * sizes[k]


@pytest.mark.parametrize("seed", SEEDS)
def test_duffing_has_the_three_tabulated_solutions(seed):
    problem = HarmonicBalance(duffing(), 11)
    solutions = find_all(problem, at={"omega": 1.2}, rng=np.random.default_rng(seed))
    check_solutions(problem, solutions)
    assert [abs(s.harmonics("x")[1]) for s in solutions] == pytest.approx(AMPLITUDES, abs=1e-10)


@pytest.mark.parametrize("options", [Search(largest_load=0.0), Search(n_deflated=0), Search(n_starts=0)], ids=str)
def test_each_two_of_its_three_ways_find_all(options):
    problem = HarmonicBalance(duffing(), 3)
    solutions = find_all(problem, at={"omega": 1.2}, method=options)
    check_solutions(problem, solutions)
    assert len(solutions) == 3


def test_where_there_is_one_solution_it_finds_one():
    problem = HarmonicBalance(duffing(), 3)
    for omega in (0.6, 1.5):
        (solution,) = find_all(problem, at={"omega": omega})
        np.testing.assert_allclose(solution.coefficients, solve(problem, at={"omega": omega}).coefficients, atol=1e-9)


def test_a_linear_system_has_one():
    system = System(1.0, 0.1, 1.0, forcing=lambda tau, p: [1.0])
    (solution,) = find_all(HarmonicBalance(system, 2), at={"omega": 0.7}, method=Search(n_starts=5))
    np.testing.assert_allclose(solution.coefficients, [[1.0, 0.0, 0.0, 0.0, 0.0]], atol=1e-12)


def test_a_buckled_beam_has_three_at_rest():
    """-x + x^3 = 0 without load: rest and both buckled states, which come in either order."""
    system = System(1.0, 0.3, -1.0, nonlinear_force=lambda q, v, tau, p: [q[0] ** 3])
    problem = HarmonicBalance(system, 1)
    solutions = find_all(problem, at={"omega": 1.0})
    check_solutions(problem, solutions)
    static = sorted(s.coefficients[0, 0] for s in solutions if np.abs(s.coefficients[0, 1:]).max() < 1e-9)
    np.testing.assert_allclose(static, [-1.0, 0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_mirror_images_are_never_missed(seed):
    """Rest, an unstable and a stable pair: with x(t) also -x(t) solves the equations.

    For one harmonic (1 - w^2 + 3/4 A^2)^2 + w^2 (g + eta A^2/4)^2 = lam^2/4 has two roots A.
    """
    system = System(
        1.0,
        0.005,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [
            -0.03 * ca.cos(2 * tau) * q[0] + q[0] ** 3 + 0.3 * q[0] ** 2 * v[0],
        ],
    )
    problem = HarmonicBalance(system, 5)
    solutions = find_all(problem, at={"omega": 1.02}, rng=np.random.default_rng(seed))
    check_solutions(problem, solutions)
    first = sorted(float(s.harmonics("x")[1].real) for s in solutions)
    assert len(first) == 5
    assert first == pytest.approx([-0.2428, -0.0526, 0.0, 0.0526, 0.2428], abs=1e-4)
    for solution in solutions:
        image = solution.image(system.symmetries_at(solution.parameters)[1])
        assert sum(same_motion(image, other) for other in solutions) == 1


@pytest.mark.parametrize("seed", SEEDS)
def test_a_pendulum_hangs_or_stands_and_its_turns_are_no_other_motions(seed):
    problem = HarmonicBalance(pendulum(angles=["x"]), 5)
    hanging, standing = find_all(problem, at={"omega": 2.0}, rng=np.random.default_rng(seed))
    check_solutions(problem, [hanging, standing])
    assert hanging.harmonics("x")[0].real == pytest.approx(0.0, abs=1e-9)
    assert standing.harmonics("x")[0].real == pytest.approx(np.pi, abs=1e-9)
    # about rest (1 - w^2 + i d w) x = F, about the top with -1; sin x is softer than x by less than x^2 / 8
    for solution, slope in ((hanging, 1.0), (standing, -1.0)):
        linear = 0.2 / abs(slope - 4.0 + 0.2j)
        assert abs(solution.harmonics("x")[1]) == pytest.approx(linear, rel=2e-3)


def test_a_start_that_takes_too_many_samples_does_not_end_the_search():
    """At an amplitude of 25,000 the sine has as many harmonics."""
    problem = HarmonicBalance(pendulum(force=1e5), 5)
    values = problem.values({"omega": 2.0})
    far = linear_guess(problem, values)
    reached = attempt(problem, values, far, Newton(), start="far")
    assert not reached.converged
    assert "samples a period would be needed for the force" in reached.statistics["reason"]
    motions = Motions(problem, values, Newton(), 1e-5)
    motions.polish(far, "far")
    assert motions.found == []


@pytest.mark.parametrize("seed", [0, 1])
def test_motions_over_three_periods_count_once(seed):
    """Two of one period at the resonance, one away from it, and two of three periods, each from three beginnings."""
    problem = HarmonicBalance(duffing(damping_ratio=0.02, cubic=1.0, force=2.0), 9, periods=3)
    solutions = find_all(problem, at={"omega": 4.5}, rng=np.random.default_rng(seed))
    check_solutions(problem, solutions)
    subharmonic = [s for s in solutions if abs(s.harmonics("x")[1]) > 1e-3]
    assert (len(solutions), len(subharmonic)) == (5, 2)
    assert all(s.is_odd for s in solutions)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_absorbers_isola_is_found_and_traced_round(seed):
    problem = HarmonicBalance(tuned_absorber(force=0.15), 5)
    solutions = find_all(problem, at={"omega": 1.9}, rng=np.random.default_rng(seed))
    check_solutions(problem, solutions)
    assert len(solutions) == 3
    small, *isola = solutions
    main = trace(problem, "omega", (0.5, 3.0), start=small, stability=None)
    assert main.end is End.SPAN_END
    for start in isola:
        branch = trace(problem, "omega", (0.5, 3.0), start=start, stability=None)
        check_branch(branch)
        assert branch.closed
        assert sorted(f.value for f in branch.folds) == pytest.approx([1.5658235396, 2.3185469325], rel=1e-10)


def test_the_solutions_of_a_fold_set_are_those_that_a_trace_passes():
    problem = HarmonicBalance(chain(2), 3)
    branch = trace(problem, "omega", (2.5, 0.5), stability=None)
    check_branch(branch)
    at = 0.5 * (branch.folds[0].value + branch.folds[1].value)
    crossings = np.flatnonzero(np.diff(np.sign(branch.parameter - at)))
    solutions = find_all(problem, at={"omega": at})
    check_solutions(problem, solutions)
    for k in crossings:
        share = (at - branch.parameter[k]) / (branch.parameter[k + 1] - branch.parameter[k])
        guess = (1 - share) * branch.coefficients[k] + share * branch.coefficients[k + 1]
        passed = solve(problem, at={"omega": at}, start=guess).coefficients
        distances = [np.linalg.norm(passed - s.coefficients) for s in solutions]
        assert min(distances) < 1e-6 * np.linalg.norm(passed)


def test_the_same_call_finds_the_same():
    problem = HarmonicBalance(duffing(), 3)
    one, other = (find_all(problem, at={"omega": 1.2}, method=Search(n_starts=8)) for _ in range(2))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.coefficients, b.coefficients)


def test_known_solutions_are_among_the_result_and_the_generator_is_the_callers():
    problem = HarmonicBalance(duffing(), 3)
    known = find_all(problem, at={"omega": 1.2})[1:]
    rng = np.random.default_rng(3)
    solutions = find_all(problem, at={"omega": 1.2}, known=known, method=Search(n_starts=2), rng=rng)
    check_solutions(problem, solutions)
    assert len(solutions) == 3
    assert rng.bit_generator.state != np.random.default_rng(3).bit_generator.state


def test_deflation_leads_away_from_what_is_known():
    problem = HarmonicBalance(duffing(), 1)
    values = problem.values({"omega": 1.2})
    found = []
    for _ in range(3):
        x = deflated_newton(problem, values, np.array([0.0, 1.0, 1.0]), found, 200)
        if x is None:
            break
        found.append(x)
    assert len(found) >= 2
    for k, x in enumerate(found):
        assert np.abs(problem.assembly.residual(x, values)).max() < 1e-4
        assert all(np.linalg.norm(x - other) > 1e-3 for other in found[:k])


def test_names_values_and_options_are_checked():
    problem = HarmonicBalance(duffing(), 3)
    with pytest.raises(KeyError, match="unknown parameter 'omga'; did you mean 'omega'"):
        find_all(problem, at={"omga": 1.2})
    with pytest.raises(ValueError, match="parameter 'omega' has no value"):
        find_all(problem)
    for options, message in (
        ({"n_starts": -1}, "n_starts is -1"),
        ({"n_deflated": -1}, "n_deflated is -1"),
        ({"amplitudes": (2.0, 1.0)}, "amplitudes"),
        ({"amplitudes": (0.0, 1.0)}, "amplitudes"),
        ({"separation": 0.0}, "separation is 0.0"),
        ({"largest_load": -1.0}, "largest_load is -1.0"),
        ({"max_iterations": 0}, "max_iterations is 0"),
    ):
        with pytest.raises(ValueError, match=message):
            Search(**options)
    with pytest.raises(TypeError, match="starts"):
        Search(starts=3)


def test_an_interrupted_search_returns_what_it_found_and_says_so(caplog):
    problem, seen = HarmonicBalance(duffing(), 3), []

    def end(progress):
        seen.append(progress)
        if progress.value == 2 and not progress.done:
            raise KeyboardInterrupt

    found = find_all(problem, at={"omega": 1.2}, callbacks=[end])
    check_solutions(problem, found)
    assert f"searching: {found.message}" in caplog.text
    assert found.message == "interrupted after 2 of 40 random starts; go on with find_all(problem, known=found)"
    assert [p.value for p in seen] == [0, 1, 2, 2]
    assert seen[-1].result() is found
    assert seen[-1].fraction == 2 / 40


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "deflation"}, r"method is 'deflation'; give hbnlp.Search"),
        ({"rng": 3}, r"rng is 3; give a Generator, numpy.random.default_rng\(seed\)"),
        ({"callbacks": print}, r"callbacks is .*; give a list of callables"),
    ],
)
def test_arguments_of_another_kind_are_named(options, message):
    problem = HarmonicBalance(duffing(), 1)
    with pytest.raises(TypeError, match=message):
        find_all(problem, at={"omega": 1.2}, **options)
    with pytest.raises(TypeError, match=r"problem is System .*; give a HarmonicBalance"):
        find_all(problem.system, at={"omega": 1.2})


def magnet():
    """x'' + .1 x' + x - 1 / x^2 = .05 cos tau: rest about x = 1, no force at x = 0."""
    return System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [-1.0 / q[0] ** 2],
        forcing=lambda tau, p: [0.05 * ca.cos(tau)],
    )


def test_a_search_goes_on_where_rest_is_singular():
    problem = HarmonicBalance(magnet(), 5)
    known = solve(problem, at={"omega": 1.0}, start=[[1.0, 0.0, 0.0]])
    for options in ({"known": [known], "method": Search(n_starts=2)}, {"method": Search(n_starts=20)}):
        found = find_all(problem, at={"omega": 1.0}, **options)
        assert min(np.linalg.norm(s.coefficients - known.coefficients) for s in found) < 1e-8


def test_a_search_that_finds_nothing_says_that_rest_is_singular():
    system = System(1.0, 0.1, 1.0, nonlinear_force=lambda q, v, tau, p: [ca.sqrt(-1.0 - q[0] ** 2)])
    with pytest.raises(NonFiniteError, match="not finite at rest"):
        find_all(HarmonicBalance(system, 2), at={"omega": 1.0}, method=Search(n_starts=2))


def test_a_search_among_rough_motions_finds_the_smooth_one():
    """The contact of test_solving.py: from x = 0 the motions bounce."""
    system = System(
        1.0,
        0.05,
        0.0,
        nonlinear_force=lambda q, v, tau, p: [ca.if_else(q[0] > 0.0, q[0] ** 1.5, 0.0)],
        forcing=lambda tau, p: [1.0 + 0.3 * ca.cos(tau)],
    )
    found = find_all(HarmonicBalance(system, 11), at={"omega": 0.8}, method=Search(n_starts=1, n_deflated=1))
    assert min(abs(abs(s.harmonics("x")[1]) - 0.352391) for s in found) < 1e-5


@pytest.mark.parametrize("subject", [tuned_absorber(), pendulum(angles=[0])], ids=lambda system: system.name)
def test_starts_that_workers_run_ahead_find_what_a_loop_finds_and_leave_the_generator_where_it_leaves_it(subject):
    problem, values, method = HarmonicBalance(subject, 3), {"omega": 0.9}, Search(n_starts=25, n_deflated=1)
    loop = find_all(problem, at=values, method=method)
    with ThreadPoolExecutor(2) as threads:
        ahead = find_all(problem, at=values, method=method, executor=threads)
        stopped = find_all(problem, at=values, method=replace(method, n_starts=9), executor=threads)
        resumed = find_all(problem, at=values, method=method, known=stopped, executor=threads)
    for found in (ahead, resumed):
        assert found.state == loop.state
        assert len(found) == len(loop)
        for one, other in zip(found, loop, strict=True):
            np.testing.assert_array_equal(one.coefficients, other.coefficients)
