"""A search to a tolerance: the motions that one with many harmonics finds, each with as many as it needs."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.callbacks import Autosave, StopTracing
from hbnlp.fourier import resize
from hbnlp.solutions.attempt import attempt
from hbnlp.solutions.identity import same_motion
from hbnlp.solutions.motions import WITHIN, Motions
from hbnlp.solutions.search import Search, find_all
from hbnlp.solutions.solution import Solution
from hbnlp.solutions.solution_set import SolutionSet
from hbnlp.solutions.solving import solve
from hbnlp.systems import duffing
from hbnlp.systems.system import System

AT = {"omega": 1.2}
MANY = 21


def double_well(damping=0.1, force=0.2, omega=1.0):
    """x'' + d x' - x + x^3 = f cos w t: with the first values nine motions, most with a mirror image."""
    return System(
        1.0,
        damping,
        -1.0,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        forcing=lambda tau, p: [force * ca.cos(tau)],
        parameters={"omega": omega},
    )


def ending_at(start):
    def end(progress):
        if progress.value == start and not progress.done:
            raise StopTracing

    return end


def check_within(found, exact, tolerance):
    """The same motions, each within the tolerance of one with many harmonics."""
    assert len(found) == len(exact)
    for one in found:
        full = resize(one.coefficients, MANY)
        size = np.linalg.norm(full)
        # of the mirror images, which are as large, the nearest
        assert min(np.linalg.norm(full - other.coefficients) for other in exact) <= 2.0 * tolerance * size
        assert one.statistics["truncation_error"] <= tolerance
        assert one.problem.n_harmonics == one.n_harmonics


@pytest.fixture(scope="module")
def duffing_motions():
    return find_all(HarmonicBalance(duffing(), MANY), at=AT)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-5, 1e-9])
def test_each_motion_has_the_harmonics_that_it_needs(duffing_motions, tolerance):
    found = find_all(HarmonicBalance(duffing(), tolerance=tolerance), at=AT)
    check_within(found, duffing_motions, tolerance)
    assert found[0].n_harmonics <= found[-1].n_harmonics < MANY
    assert (found[0].n_harmonics < found[-1].n_harmonics) == (tolerance < 1e-2)


def test_a_crowd_of_motions_and_mirror_images_is_told_apart():
    exact = find_all(HarmonicBalance(double_well(), MANY))
    found = find_all(HarmonicBalance(double_well(), tolerance=1e-4))
    assert len(found) == 9
    check_within(found, exact, 1e-4)


def test_motions_over_three_periods_count_once_with_harmonics_of_all_three():
    problem = HarmonicBalance(duffing(damping_ratio=0.02, cubic=1.0, force=2.0), tolerance=1e-4, periods=3)
    found = find_all(problem, at={"omega": 4.5}, method=Search(n_starts=20))
    subharmonic = [s for s in found if abs(s.harmonics("x")[1]) > 1e-3]
    assert (len(found), len(subharmonic)) == (5, 2)
    assert all(s.n_harmonics % 3 == 0 for s in found)


def test_one_motion_with_two_numbers_of_harmonics_is_known():
    """With five harmonics it is off by a thousandth, a hundred times the separation."""
    problem, options = HarmonicBalance(double_well(force=0.3), tolerance=1e-2), Search()
    largest, values = find_all(problem)[-1], problem.values()
    motions = Motions(problem, values, options.newton, options.separation)
    motions.add(largest)
    more = problem.with_harmonics(11)
    again = attempt(more, values, more.vector(largest.coefficients), options.newton, start="with more")
    assert again.n_harmonics == 11 > largest.n_harmonics
    assert not same_motion(largest, again, tol=10.0 * options.separation)
    assert motions.has(again)


def test_two_motions_that_are_near_for_the_tolerance_are_two():
    """A hair above the lower fold of the Duffing oscillator."""
    small, middle, _ = find_all(HarmonicBalance(duffing(), tolerance=1e-2), at={"omega": 1.1158})
    assert small.n_harmonics == middle.n_harmonics
    assert same_motion(small, middle, tol=WITHIN * 1e-2)


def test_known_solutions_of_any_number_of_harmonics_are_among_the_result(duffing_motions):
    problem = HarmonicBalance(duffing(), tolerance=1e-5)
    found = find_all(problem, at=AT, known=list(duffing_motions), method=Search(n_starts=0, largest_load=0.0))
    check_within(found, duffing_motions, 1e-5)


def test_a_set_is_saved_and_gone_on_with_as_if_it_had_not_ended(tmp_path):
    problem = HarmonicBalance(double_well(0.2, 0.5, 0.4), tolerance=1e-2)
    whole = find_all(problem)
    assert whole.state.spurious
    begun = find_all(problem, callbacks=[ending_at(3), Autosave(tmp_path / "found.npz")])
    assert len({s.n_harmonics for s in begun}) > 1
    loaded = SolutionSet.load(tmp_path / "found.npz", problem=problem)
    assert [s.n_harmonics for s in loaded] == [s.n_harmonics for s in begun]
    assert loaded.state == begun.state
    for known in (begun, loaded, SolutionSet.load(tmp_path / "found.npz")):
        again = find_all(problem, known=known)
        assert again.state == whole.state
        for one, other in zip(again, whole, strict=True):
            np.testing.assert_array_equal(one.coefficients, other.coefficients)
    with pytest.raises(ValueError, match="the solution set has 3 to 11 harmonics, the problem n_harmonics = 5 for all"):
        SolutionSet.load(tmp_path / "found.npz", problem=HarmonicBalance(problem.system, 5))


def test_a_solution_from_a_file_gets_the_balance_with_its_own_number(tmp_path):
    problem = HarmonicBalance(duffing(), tolerance=1e-6)
    solution = solve(problem, at={"omega": 1.0})
    assert solution.n_harmonics > problem.n_harmonics
    solution.save(tmp_path / "solution.npz")
    loaded = Solution.load(tmp_path / "solution.npz", problem=problem)
    assert loaded.problem is solution.problem
    assert loaded.statistics["truncation_error"] == solution.statistics["truncation_error"]


def test_an_expression_of_another_number_of_harmonics_is_refused():
    problem = HarmonicBalance(duffing(), tolerance=1e-6)
    solution = solve(problem, at={"omega": 1.0})
    assert solution(solution.problem.x[1]) == solution.coefficients[0, 1]
    with pytest.raises(ValueError, match=r"the symbol x of another problem.* write it with solution\.problem\.x"):
        solution(problem.x[1])
