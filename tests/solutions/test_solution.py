"""A Solution as a record: harmonics, signals, and expressions of the program."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.extrema import peaks
from hbnlp.branches.following import follow
from hbnlp.branches.switching import switch_branch
from hbnlp.branches.tracing import trace
from hbnlp.continuation.newton import Newton
from hbnlp.core.errors import SaveError
from hbnlp.solutions.search import Search, find_all
from hbnlp.solutions.solution import Solution
from hbnlp.solutions.solving import solve
from hbnlp.sweeps.sweeping import sweep
from hbnlp.systems import chain, duffing
from hbnlp.systems.system import System


@pytest.fixture(scope="module")
def solution():
    return solve(HarmonicBalance(duffing(), 7), at={"omega": 1.2})


def test_harmonics_are_those_of_the_coefficients(solution):
    a = solution.coefficients[0]
    np.testing.assert_allclose(solution.harmonics("x"), [a[0], *(a[1::2] - 1j * a[2::2])], atol=1e-15)


def test_signals_satisfy_the_equation_of_motion(solution):
    """x'' + 2 z x' + x + g x^3 = F cos(w t), x'' by differences of the velocity."""
    t = np.linspace(0.0, 6.0, 50)
    x, v = solution.displacement(t)[0], solution.velocity(t)[0]
    a = (solution.velocity(t + 1e-4)[0] - solution.velocity(t - 1e-4)[0]) / 2e-4
    np.testing.assert_allclose(a + 0.05 * v + x + 0.1 * x**3, 0.18 * np.cos(1.2 * t), atol=1e-7)
    np.testing.assert_allclose(solution.signal("x", t), x, atol=1e-14)
    np.testing.assert_allclose((solution.signal("x", t + 1e-5) - solution.signal("x", t - 1e-5)) / 2e-5, v, atol=1e-8)


def test_signals_over_two_periods_repeat_after_two():
    twice = solve(HarmonicBalance(duffing(), 10, periods=2), at={"omega": 1.2})
    once = solve(HarmonicBalance(duffing(), 5), at={"omega": 1.2})
    t = np.linspace(0.0, 20.0, 40)
    np.testing.assert_allclose(twice.displacement(t), once.displacement(t), atol=1e-9)
    np.testing.assert_allclose(twice.velocity(t), once.velocity(t), atol=1e-9)
    np.testing.assert_allclose(twice.signal("x", t), once.signal("x", t), atol=1e-9)


def test_one_time_gives_one_value(solution):
    assert np.shape(solution.signal("x", 0.5)) == ()
    assert solution.displacement(0.5).shape == (1,)
    assert solution.velocity(0.5).shape == (1,)


def test_an_expression_of_the_program_is_evaluated(solution):
    problem = solution.problem
    assert solution(problem.amplitude_squared("x")) == pytest.approx(abs(solution.harmonics("x")[1]) ** 2)
    assert solution(problem.symbol("force") * 2.0) == pytest.approx(0.36)
    np.testing.assert_allclose(solution(problem.output("x")), solution.coefficients[0], atol=1e-14)
    work = ca.vertcat(problem.coefficients(0)[2] * problem.symbol("omega"), 1.0)
    np.testing.assert_allclose(solution(work), [1.2 * solution.coefficients[0, 2], 1.0])


def test_it_knows_where_and_how_it_was_found(solution):
    assert solution.converged
    assert solution.omega == 1.2
    assert solution.n_harmonics == 7
    assert dict(solution.parameters) == {"damping_ratio": 0.025, "cubic": 0.1, "force": 0.18, "omega": 1.2}
    assert {"start", "method", "iterations", "residual", "samples"} <= set(solution.statistics)


def test_an_unknown_output_is_refused_with_the_known_ones(solution):
    with pytest.raises(KeyError, match=r"unknown output 'y' \(known: x\)"):
        solution.harmonics("y")


def test_the_repr_is_at_most_five_lines():
    many = solve(HarmonicBalance(chain(6), 3), at={"omega": 2.5})
    assert repr(many).startswith("Solution (converged), 3 harmonics of omega")
    assert len(repr(many).splitlines()) <= 5


def test_a_solution_from_a_file_says_that_it_has_no_problem(tmp_path):
    problem = HarmonicBalance(duffing(), 1)
    trace(problem, "omega", (0.5, 0.6), stability=None).save(tmp_path / "branch.npz")
    loaded = Branch.load(tmp_path / "branch.npz").solution(0)
    assert loaded.harmonics("x").shape == (2,)
    with pytest.raises(ValueError, match="a solution from a file has no problem"):
        loaded(problem.amplitude_squared("x"))


# -- files -------------------------------------------------------------------------------------------------------------


def equal(one, other):
    np.testing.assert_array_equal(one.coefficients, other.coefficients)
    np.testing.assert_array_equal(one.amplitudes, other.amplitudes)
    return repr(one) == repr(other)


def test_a_solution_is_the_same_after_saving_and_loading(solution, tmp_path):
    solution.save(tmp_path / "solution.npz")
    loaded = Solution.load(tmp_path / "solution.npz")
    assert equal(loaded, solution)
    assert loaded.problem is None
    again = Solution.load(tmp_path / "solution.npz", problem=HarmonicBalance(duffing(), 7))
    assert equal(again, solution)
    assert again(again.problem.symbol("force")) == 0.18
    assert again.is_odd
    with pytest.raises(SaveError, match="could not write"):
        solution.save(tmp_path / "missing" / "solution.npz")


def test_whatever_gives_a_solution_gives_one_that_can_be_kept(tmp_path):
    problem = HarmonicBalance(duffing(), 3)
    branch = trace(problem, "omega", (0.9, 1.4), stability=None)
    solutions = [
        branch.solution(5),
        branch.at(1.2)[0],
        branch.folds[0].solution,
        peaks(branch, "x")[0].solution,
        follow(branch.folds[0], "force", span=(0.17, 0.19)).solution(0),
        trace(HarmonicBalance(duffing(), tolerance=1e-2), "omega", (0.9, 1.4), stability=None).solution(3),
        sweep(problem, "omega", [0.7, 0.8]).solution(1),
        find_all(problem, at={"omega": 0.8}, method=Search(n_starts=0))[0],
    ]
    for place, each in enumerate(solutions):
        each.save(tmp_path / f"{place}.npz")
        assert equal(Solution.load(tmp_path / f"{place}.npz", problem=each.problem), each)
    integrated = sweep(duffing(), "omega", [0.7]).solution(0)
    integrated.save(tmp_path / "integrated.npz")
    assert equal(Solution.load(tmp_path / "integrated.npz"), integrated)


def test_a_solution_that_did_not_converge_is_kept_with_its_reason(tmp_path):
    failed = solve(HarmonicBalance(duffing(), 3), at={"omega": 1.2}, method=Newton(max_iterations=1), throw=False)
    failed.save(tmp_path / "failed.npz")
    loaded = Solution.load(tmp_path / "failed.npz", problem=HarmonicBalance(duffing(), 3))
    assert equal(loaded, failed)
    assert (loaded.status, loaded.message) == (failed.status, failed.message)


def test_a_start_that_was_switched_to_leads_away_from_its_origin_also_from_a_file(tmp_path):
    branch = trace(HarmonicBalance(chain(3), 2), "omega", (2.5, 0.4), stability=None)
    point = branch.branch_points[0]
    start = switch_branch(point)[0]
    start.save(tmp_path / "start.npz")
    loaded = Solution.load(tmp_path / "start.npz", problem=branch.problem)
    assert equal(loaded.origin, point.solution)
    one, other = (trace(each, "omega", (0.4, 2.5), stability=None) for each in (start, loaded))
    np.testing.assert_array_equal(one.coefficients, other.coefficients)


def test_a_loaded_solution_has_as_many_samples_as_it_was_solved_with(tmp_path):
    friction = System(
        1.0,
        0.05,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [0.1 * ca.tanh(20.0 * v[0]) + q[0] ** 3],
        forcing=lambda tau, p: [0.5 * ca.cos(tau)],
    )
    solved = solve(HarmonicBalance(friction, 5), at={"omega": 1.0})
    assert solved.problem.n_samples > HarmonicBalance(friction, 5).n_samples
    solved.save(tmp_path / "solution.npz")
    loaded = Solution.load(tmp_path / "solution.npz", problem=HarmonicBalance(friction, 5))
    assert loaded.problem.n_samples == solved.problem.n_samples


def test_a_problem_that_is_not_the_solutions_is_refused(solution, tmp_path):
    solution.save(tmp_path / "solution.npz")
    for other, message in (
        (HarmonicBalance(duffing(), 5), r"the solution has coefficients of shape \(1, 15\)"),
        (HarmonicBalance(chain(1), 7), "the solution has parameters"),
    ):
        with pytest.raises(ValueError, match=message):
            Solution.load(tmp_path / "solution.npz", problem=other)
