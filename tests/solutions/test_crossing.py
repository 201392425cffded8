"""The solutions of a branch at a value of its parameter, and their stability."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.systems import chain, duffing


@pytest.fixture(scope="module")
def branch():
    problem = hbnlp.HarmonicBalance(duffing(damping_ratio=0.025, cubic=0.1, force=0.18), n_harmonics=11)
    return hbnlp.trace(problem, "omega", (0.5, 1.6))


def amplitudes(solutions):
    return np.array([abs(s.harmonics("x")[1]) for s in solutions])


def test_the_three_solutions_between_the_folds_have_the_known_amplitudes_and_multipliers(branch):
    # the numbers of test_multipliers.py, of which the amplitudes are those of tests/numpy_balance.py
    found = branch.at(1.2)
    np.testing.assert_allclose(amplitudes(found), [2.5091975811, 2.2605488905, 0.4175204536], rtol=1e-10)
    expected = [0.80986415 + 0.33732103j, 1.31490727, 0.48848659 + 0.72872921j]
    np.testing.assert_allclose([hbnlp.floquet(s).multipliers[0] for s in found], expected, atol=6e-9)
    assert [hbnlp.floquet(s).stable for s in found] == [True, False, True]
    assert all(s.parameters["omega"] == 1.2 for s in found)


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-9, 1e-11])
def test_near_a_fold_both_solutions_are_found_as_far_apart_as_a_square_root(branch, distance):
    up = min(branch.folds, key=lambda fold: fold.value)
    at_fold, reference = (amplitudes([s])[0] for s in (up.solution, branch.at(up.value + 1e-3)[1]))
    upper, lower = amplitudes(branch.at(up.value + distance))[1:] - at_fold
    spread = (reference - at_fold) * np.sqrt(distance / 1e-3)
    assert upper > 0.0 > lower
    assert upper == pytest.approx(spread, rel=0.05)
    assert lower == pytest.approx(-spread, rel=0.07)
    assert len(branch.at(up.value - distance)) == 1


def test_points_of_the_branch_are_found_once_and_values_beyond_it_not_at_all(branch):
    assert len(branch.at(branch.parameter[0])) == 1
    assert len(branch.at(branch.parameter[5])) == 1
    assert branch.at(1.7) == ()


def test_a_chain_is_passed_as_often_as_its_points_say_and_each_solution_balances():
    branch = hbnlp.trace(hbnlp.HarmonicBalance(chain(10), n_harmonics=3), "omega", (2.5, 0.6), stability=None)
    value = 1.06
    passed = np.count_nonzero(np.diff(np.sign(branch.parameter - value)))
    found = branch.at(value)
    assert len(found) == passed > 3
    for solution in found:
        again = hbnlp.solve(branch.problem, at=solution.parameters, start=solution)
        size = np.linalg.norm(solution.coefficients)
        assert np.linalg.norm(again.coefficients - solution.coefficients) < 1e-8 * size


def test_a_branch_from_a_file_is_refused(branch, tmp_path):
    branch.save(tmp_path / "branch.npz")
    with pytest.raises(ValueError, match="from a file has no problem"):
        hbnlp.Branch.load(tmp_path / "branch.npz").at(1.2)


def test_stability_needs_a_solution_that_converged_and_its_problem(branch):
    solution = branch.solution(3)
    with pytest.raises(ValueError, match="did not converge"):
        hbnlp.floquet(dataclasses.replace(solution, status=hbnlp.Status.NOT_CONVERGED))
    with pytest.raises(ValueError, match="from a file has no problem"):
        hbnlp.floquet(dataclasses.replace(solution, problem=None))


def test_a_closed_branch_has_each_solution_once_also_where_it_begins():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.tuned_absorber(force=0.15), n_harmonics=5)
    largest = hbnlp.find_all(problem, at={"omega": 1.9})[-1]
    isola = hbnlp.trace(problem, "omega", (0.8, 2.6), start=largest, stability=None)
    assert isola.closed
    found = isola.at(1.9)
    assert len(found) == 2
    np.testing.assert_allclose(found[0].coefficients, largest.coefficients, atol=1e-9)
    assert len(isola.at(2.0)) == 2


def test_near_rest_the_solutions_of_a_branch_that_begins_there_are_found():
    problem = hbnlp.HarmonicBalance(duffing(), n_harmonics=5)
    branch = hbnlp.trace(problem, "force", (0.0, 0.2), at={"omega": 1.0}, stability=None)
    value = 0.5 * branch.parameter[1]
    (solution,) = branch.at(value)
    again = hbnlp.solve(problem, at={"omega": 1.0, "force": value})
    np.testing.assert_allclose(solution.coefficients, again.coefficients, atol=1e-9 * value)


def test_a_system_without_mass_is_refused():
    system = hbnlp.System([[0.0]], [[1.0]], [[1.0]], forcing=lambda tau, p: [ca.cos(tau)])
    with pytest.raises(ValueError, match=r"mass matrix is singular \(row 0 is zero\)"):
        hbnlp.solve(hbnlp.HarmonicBalance(system, 1), at={"omega": 1.0})
