"""The estimated error of truncation against the true one, and solutions and branches that meet a tolerance by it."""

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.continuation.newton import Newton, correct
from hbnlp.solutions.equations import along_parameter
from hbnlp.testing import check_branch

SPAN = (0.15, 3.0)
PITCHING = {"pitch_amplitude": np.radians(2.5)}


@pytest.fixture(scope="module")
def duffing():
    return hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=0.5)


@pytest.fixture(scope="module")
def exact(duffing):
    """What all is compared with."""
    return hbnlp.HarmonicBalance(duffing, n_harmonics=35)


@pytest.fixture(scope="module")
def tolerant(duffing):
    return hbnlp.HarmonicBalance(duffing, tolerance=1e-4)


@pytest.fixture(scope="module")
def branch(tolerant):
    return hbnlp.trace(tolerant, "omega", SPAN)


@pytest.fixture(scope="module")
def wing():
    membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=4)
    return hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=4))


@pytest.fixture(scope="module")
def friction():
    return hbnlp.System(
        [[1.0]],
        [[0.02]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [0.1 * ca.tanh(v[0] / 0.1) + q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": 0.4},
    )


# -- the estimate ------------------------------------------------------------------------------------------------------


def solution_and_true_error(system, at, n_harmonics, enough):
    """Begin with the better solution: where a harmonic resonates, the poorer one does not lead there."""
    exact = hbnlp.solve(hbnlp.HarmonicBalance(system, n_harmonics=enough), at=at).coefficients
    problem = hbnlp.HarmonicBalance(system, n_harmonics=n_harmonics)
    solution = hbnlp.solve(problem, at=at, start=exact[:, : problem.shape[1]])
    mine = np.zeros_like(exact)
    mine[:, : problem.shape[1]] = solution.coefficients
    return solution, np.linalg.norm(mine - exact) / np.linalg.norm(solution.coefficients)


@pytest.mark.parametrize("omega", [0.4, 0.6, 0.9, 1.3, 2.6])
@pytest.mark.parametrize("n_harmonics", [1, 2, 3, 5, 7])
def test_the_estimate_is_the_true_error_of_a_duffing_oscillator(duffing, omega, n_harmonics):
    solution, true = solution_and_true_error(duffing, {"omega": omega}, n_harmonics, 25)
    assert hbnlp.truncation_error(solution) == pytest.approx(true, rel=0.35)


@pytest.mark.parametrize("omega", [0.5, 1.5, 3.0, 6.0])
@pytest.mark.parametrize("n_harmonics", [1, 3, 5])
def test_the_estimate_is_the_true_error_of_a_wing(wing, omega, n_harmonics):
    solution, true = solution_and_true_error(wing, {"omega": omega, **PITCHING}, n_harmonics, 17)
    estimate = hbnlp.truncation_error(solution)
    if true < 0.1:
        assert estimate == pytest.approx(true, rel=0.35)
    else:  # one Newton step tells a large error from a small one, not how large it is
        assert estimate > 0.1


def test_a_linear_system_needs_one_harmonic():
    system = hbnlp.systems.duffing(damping_ratio=0.05, cubic=0.0, force=0.5)
    solution = hbnlp.solve(hbnlp.HarmonicBalance(system, n_harmonics=1), at={"omega": 0.9})
    assert hbnlp.truncation_error(solution) < 1e-14
    branch = hbnlp.trace(hbnlp.HarmonicBalance(system, tolerance=1e-9), "omega", (0.5, 1.5), stability=None)
    assert branch.n_harmonics[-1] == 1
    assert branch.truncation_error.max() < 1e-12


def test_a_solution_from_a_file_has_no_estimate(branch, tmp_path):
    branch.save(tmp_path / "branch.npz")
    with pytest.raises(ValueError, match="from a file"):
        hbnlp.truncation_error(hbnlp.Branch.load(tmp_path / "branch.npz").solution(0))


# -- solutions ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [1e-2, 1e-5, 1e-8])
@pytest.mark.parametrize("omega", [0.35, 0.9, 2.6])
def test_a_solution_has_as_many_harmonics_as_the_tolerance_asks_for(duffing, exact, tolerance, omega):
    solution = hbnlp.solve(hbnlp.HarmonicBalance(duffing, tolerance=tolerance), at={"omega": omega})
    true = exact.vector(hbnlp.solve(exact, at={"omega": omega}, start=solution).coefficients)
    error = np.linalg.norm(exact.vector(solution.coefficients) - true) / np.linalg.norm(true)
    assert error < 1.35 * tolerance
    assert solution.statistics["truncation_error"] == pytest.approx(error, rel=0.35)
    assert solution.problem.n_harmonics == solution.n_harmonics
    if solution.n_harmonics > 3:  # with fewer of those that are tried it would not do
        fewer = hbnlp.HarmonicBalance(duffing, solution.n_harmonics - 4)
        assert hbnlp.truncation_error(hbnlp.solve(fewer, at={"omega": omega}, start=solution)) > 0.3 * tolerance


def test_a_start_with_many_harmonics_is_solved_with_those_that_matter(tolerant, exact):
    many = hbnlp.solve(exact, at={"omega": 0.9})
    assert hbnlp.solve(tolerant, at={"omega": 0.9}, start=many).n_harmonics < 15


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_an_output_that_is_named_meets_the_tolerance_as_well(tolerance):
    """The harmonics of an acceleration fall more slowly than those of the displacement."""
    system = hbnlp.System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        forcing=lambda tau, p: [0.5 * ca.cos(tau)],
        outputs={"acceleration": lambda s: s.a[0]},
        parameters={"omega": 0.35},
    )
    exact = hbnlp.solve(hbnlp.HarmonicBalance(system, 35)).harmonics("acceleration")
    errors = []
    for outputs in ((), ["acceleration"]):
        solution = hbnlp.solve(hbnlp.HarmonicBalance(system, tolerance=tolerance, outputs=outputs))
        missing = exact.copy()
        missing[: solution.n_harmonics + 1] -= solution.harmonics("acceleration")
        errors.append(np.linalg.norm(missing) / np.linalg.norm(exact))
    assert errors[1] < 1.35 * tolerance < errors[0]
    assert solution.statistics["truncation_error"] == pytest.approx(errors[1], rel=0.35)


# -- branches ----------------------------------------------------------------------------------------------------------


def true_errors(branch, exact, every):
    """The true errors of points, each displacement against its own size, in the plane normal to the branch."""
    for i in range(1, len(branch) - 1, every):
        solution = branch.solution(i)
        curve = along_parameter(exact, exact.values(solution.parameters), branch.name, span=branch.span)
        before, here, after = (
            curve.point(exact.vector(branch.coefficients[k]).reshape(exact.shape), branch.parameter[k])
            for k in (i - 1, i, i + 1)
        )
        row = (after - before) / curve.scale(here) ** 2
        found = correct(curve, here, row / np.linalg.norm(row), Newton())
        assert found.converged
        change = np.linalg.norm(curve.coefficients(found.y - here), axis=1)
        yield i, float(np.max(change / np.linalg.norm(solution.coefficients, axis=1)))


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_every_point_meets_the_tolerance_normal_to_the_branch_also_at_folds(duffing, exact, tolerance):
    branch = hbnlp.trace(hbnlp.HarmonicBalance(duffing, tolerance=tolerance), "omega", SPAN, stability=None)
    check_branch(branch)
    assert branch.complete
    assert branch.truncation_error.max() <= tolerance
    for i, error in true_errors(branch, exact, 5):
        assert error < 1.5 * tolerance
        if error > 0.01 * tolerance:
            assert branch.truncation_error[i] == pytest.approx(error, rel=0.6)


def test_numbers_of_harmonics_rise_and_fall_along_a_branch_without_flapping(branch, tolerant):
    steps = np.diff(branch.n_harmonics)
    assert np.any(steps > 0)
    assert np.any(steps < 0)
    assert np.count_nonzero(steps) < 12
    assert branch.n_harmonics[0] > 2 * branch.n_harmonics[-1]  # superharmonic resonances, and beyond them all
    assert f"{branch.n_harmonics.min()} to {branch.n_harmonics.max()} harmonics" in repr(branch)
    back = hbnlp.trace(tolerant, "omega", SPAN[::-1], stability=None)
    assert np.any(np.diff(back.n_harmonics) > 0)


def test_points_are_padded_with_zeros_and_each_is_a_solution_of_its_own_problem(branch):
    size = branch.n_harmonics.max()
    assert branch.coefficients.shape == (len(branch), 1, 2 * size + 1)
    assert branch.harmonics("x").shape == (len(branch), size + 1)
    poorest = int(np.argmin(branch.n_harmonics))
    solution = branch.solution(poorest)
    assert solution.n_harmonics == branch.n_harmonics[poorest] == solution.problem.n_harmonics < size
    assert not branch.coefficients[poorest, :, solution.coefficients.shape[1] :].any()
    assert hbnlp.truncation_error(solution) < 1e-3
    floquet = hbnlp.floquet(solution)
    np.testing.assert_allclose(floquet.multipliers, branch.multipliers[poorest], atol=1e-6)


def test_special_points_and_stability_are_those_of_a_large_fixed_number(branch, exact):
    reference = hbnlp.trace(exact, "omega", SPAN)
    assert len(branch.folds) == len(reference.folds) == len(branch.special_points)
    for fold, true in zip(branch.folds, reference.folds, strict=True):
        assert fold.value == pytest.approx(true.value, rel=1e-5)
        assert fold.multiplier == pytest.approx(1.0, abs=1e-4)
        assert fold.converged is True
        assert 0.0 <= fold.truncation_error <= 1e-4
        assert fold.n_harmonics == fold.solution.n_harmonics < 15
    turns = np.flatnonzero(np.diff(branch.stable.astype(int)))
    assert [fold.index for fold in branch.folds] == list(turns)


def test_special_points_of_the_truncated_equations_alone_are_not_told(wing):
    """With five harmonics a wing has two folds and two branch points, with thirty-one it has none."""
    five = hbnlp.trace(hbnlp.HarmonicBalance(wing, 5), "omega", (0.5, 8.0), at=PITCHING, stability=None)
    assert len(five.special_points) > 2
    branch = hbnlp.trace(hbnlp.HarmonicBalance(wing, tolerance=1e-2), "omega", (0.5, 8.0), at=PITCHING, stability=None)
    check_branch(branch)
    assert branch.complete
    assert branch.special_points == ()
    assert branch.truncation_error.max() <= 1e-2
    exact = hbnlp.HarmonicBalance(wing, 31)
    assert max(error for _, error in true_errors(branch, exact, 10)) < 1.5e-2


def test_a_cap_that_is_met_is_said_by_the_end_and_by_the_points(duffing):
    problem = hbnlp.HarmonicBalance(duffing, tolerance=1e-6, most_harmonics=5)
    branch = hbnlp.trace(problem, "omega", SPAN, stability=None)
    assert branch.complete
    assert branch.n_harmonics.max() == 5
    beyond = np.count_nonzero(branch.truncation_error > 1e-6)
    assert 0 < beyond < len(branch)
    assert f"{beyond} points not within the tolerance 1e-06 with most_harmonics = 5" in branch.message
    assert branch.message in repr(branch)
    assert [fold.converged for fold in branch.folds] == [False, False]
    assert "not converged in harmonics" in repr(branch.folds[0])
    solution = hbnlp.solve(problem, at={"omega": 0.9})
    assert solution.converged
    assert solution.statistics["truncation_error"] > 1e-6


def values_of(branch):
    return [(point.kind, point.value) for point in branch.special_points]


def agree(one, other, tolerance):
    assert [kind for kind, _ in one] == [kind for kind, _ in other]
    np.testing.assert_allclose([value for _, value in one], [value for _, value in other], rtol=tolerance)


def test_a_branch_that_is_resumed_goes_on_as_if_it_had_not_been_interrupted(branch, tolerant, tmp_path):
    half = hbnlp.trace(tolerant, "omega", SPAN, method=hbnlp.PseudoArclength(max_points=len(branch) // 2))
    half.save(tmp_path / "half.npz")
    for part in (half, hbnlp.Branch.load(tmp_path / "half.npz")):
        whole = hbnlp.trace(tolerant, "omega", SPAN, resume=part)
        check_branch(whole)
        assert whole.complete
        agree(values_of(whole), values_of(branch), 1e-6)
        assert whole.truncation_error.max() <= 1e-4
        np.testing.assert_array_equal(whole.n_harmonics[: len(half) - 1], half.n_harmonics[:-1])


def test_a_branch_that_is_traced_back_has_the_same_special_points(branch, tolerant):
    back = hbnlp.trace(tolerant, "omega", SPAN[::-1], start=branch.solution(len(branch) - 1))
    check_branch(back)
    agree(values_of(back)[::-1], values_of(branch), 1e-6)


def test_files_hold_all_of_it(branch, tolerant, tmp_path):
    branch.save(tmp_path / "branch.npz")
    for problem in (None, tolerant):
        again = hbnlp.Branch.load(tmp_path / "branch.npz", problem=problem)
        assert repr(again) == repr(branch)
        for name in ("coefficients", "amplitudes", "n_harmonics", "truncation_error"):
            np.testing.assert_array_equal(getattr(again, name), getattr(branch, name))
        for one, other in zip(again.folds, branch.folds, strict=True):
            assert (one.n_harmonics, one.truncation_error, one.converged) == (
                other.n_harmonics,
                other.truncation_error,
                other.converged,
            )
        assert again.solution(3).parameters == branch.solution(3).parameters
        assert again.solution(3).coefficients.shape == branch.solution(3).coefficients.shape
    check_branch(again)


def test_solutions_between_points_of_different_numbers_are_found(branch, exact):
    for k in np.flatnonzero(np.diff(branch.n_harmonics)):
        value = 0.5 * (branch.parameter[k] + branch.parameter[k + 1])
        near = [s for s in branch.at(value) if abs(s.omega - value) < 1e-12]
        assert near
        for solution in near:
            true = hbnlp.solve(exact, at={"omega": value}, start=solution)
            apart = np.linalg.norm(exact.vector(solution.coefficients) - true.coefficients.ravel())
            assert apart < 3e-4 * np.linalg.norm(true.coefficients)


def test_an_interrupt_keeps_the_points_so_far(branch, tolerant):
    def stop(progress):
        if progress.counts["points"] == 7 and not progress.done:
            raise KeyboardInterrupt

    part = hbnlp.trace(tolerant, "omega", SPAN, callbacks=[stop])
    assert len(part) == 7
    np.testing.assert_array_equal(part.truncation_error, branch.truncation_error[:7])


def test_a_branch_that_begins_at_rest_has_few_harmonics_there(duffing):
    problem = hbnlp.HarmonicBalance(duffing, tolerance=1e-3)
    branch = hbnlp.trace(problem, "force", (0.0, 0.2), at={"omega": 0.8}, stability=None)
    assert branch.truncation_error.max() <= 1e-3
    assert branch.n_harmonics[0] == 3
    assert branch.n_harmonics.max() < 8


# -- samples -----------------------------------------------------------------------------------------------------------


def test_samples_that_were_given_are_kept_and_a_tolerance_finds_those_of_more_harmonics(duffing, friction):
    given = hbnlp.HarmonicBalance(duffing, n_harmonics=5, n_samples=256)
    assert given.with_harmonics(1).n_samples == 256
    assert given.with_harmonics(10).n_samples == 512
    assert given.with_harmonics(10).samples_are_settled
    assert hbnlp.HarmonicBalance(duffing, n_harmonics=5).with_harmonics(10).n_samples == 41
    branch = hbnlp.trace(hbnlp.HarmonicBalance(friction, tolerance=1e-4), "omega", (1.2, 1.6), stability=None)
    check_branch(branch)
    assert branch.truncation_error.max() <= 1e-4
    assert np.all(branch.n_samples > 4 * branch.n_harmonics + 1)
    assert branch.solution(3).problem.n_samples >= 64


def test_a_fold_curve_has_the_samples_that_its_fold_needs(friction):
    problem = hbnlp.HarmonicBalance(friction, n_harmonics=5)
    branch = hbnlp.trace(problem, "omega", (0.6, 3.6), stability=None)
    fold = branch.folds[-1]
    curve = hbnlp.follow(fold, "force", span=(0.39, 0.41))
    k = int(np.argmin(abs(curve.second - 0.4)))
    assert curve.first[k] == pytest.approx(fold.value, abs=1e-8)
