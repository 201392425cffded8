"""The estimated error of truncation against the true one, and the choice of the number of harmonics."""

import casadi as ca
import numpy as np
import pytest
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.continuation.newton import Newton, correct
from hbnlp.solutions.equations import along_parameter


@pytest.fixture(scope="module")
def duffing():
    return hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=0.5)


@pytest.fixture(scope="module")
def branch(duffing):
    return hbnlp.trace(hbnlp.HarmonicBalance(duffing, n_harmonics=5), "omega", (0.15, 3.0), stability=None)


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
    at = {"omega": omega, "pitch_amplitude": np.radians(2.5)}
    solution, true = solution_and_true_error(wing, at, n_harmonics, 17)
    estimate = hbnlp.truncation_error(solution)
    if true < 0.1:
        assert estimate == pytest.approx(true, rel=0.35)
    else:  # one Newton step tells a large error from a small one, not how large it is
        assert estimate > 0.1


def test_a_linear_system_needs_one_harmonic():
    system = hbnlp.systems.duffing(damping_ratio=0.05, cubic=0.0, force=0.5)
    solution = hbnlp.solve(hbnlp.HarmonicBalance(system, n_harmonics=1), at={"omega": 0.9})
    assert hbnlp.truncation_error(solution) < 1e-14


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_every_point_meets_the_tolerance_normal_to_the_branch_also_at_folds(duffing, branch, tolerance):
    resolved = hbnlp.resolve_harmonics(branch, tolerance, at_most=25)
    assert resolved.reached.all()
    reference = hbnlp.HarmonicBalance(duffing, n_harmonics=35)
    assert len(set(resolved.n_harmonics)) > 2
    for i in range(0, len(resolved), 5):
        solution = resolved.solution(i)
        ends = [branch.coefficients[k].ravel() for k in (max(i - 1, 0), min(i + 1, len(branch) - 1))]
        change = branch.parameter[min(i + 1, len(branch) - 1)] - branch.parameter[max(i - 1, 0)]
        curve = along_parameter(reference, reference.values(solution.parameters), "omega", span=(0.0, 3.0))
        guess = np.append(reference.vector(solution.coefficients), solution.omega)
        tangent = np.append(reference.vector((ends[1] - ends[0]).reshape(branch.coefficients[0].shape)), change)
        row = tangent / curve.scale(guess) ** 2
        exact = correct(curve, guess, row / np.linalg.norm(row), Newton())
        assert exact.converged
        error = np.linalg.norm(exact.y[:-1] - guess[:-1]) / np.linalg.norm(guess[:-1])
        assert error < 1.5 * tolerance


def test_a_resolved_branch_is_padded_with_zeros_saved_and_drawn(branch, tmp_path):
    resolved = hbnlp.resolve_harmonics(branch, 1e-3)
    size = resolved.n_harmonics.max()
    assert resolved.coefficients.shape == (len(branch), 1, 2 * size + 1)
    assert resolved.harmonics("x").shape == (len(branch), size + 1)
    poorest = int(np.argmin(resolved.n_harmonics))
    solution = resolved.solution(poorest)
    assert solution.n_harmonics == resolved.n_harmonics[poorest] < size
    assert not resolved.coefficients[poorest, :, solution.coefficients.shape[1] :].any()
    assert hbnlp.truncation_error(solution) < 5e-3
    assert hbnlp.floquet(solution).converged
    resolved.save(tmp_path / "resolved.npz")
    again = hbnlp.ResolvedBranch.load(tmp_path / "resolved.npz")
    assert repr(again) == repr(resolved)
    np.testing.assert_array_equal(again.coefficients, resolved.coefficients)
    assert again.solution(3).parameters == resolved.solution(3).parameters
    ax = again.plot("x")
    drawn = np.vstack([np.asarray(points.get_offsets()) for points in ax.collections])
    expected = np.column_stack([resolved.parameter, abs(resolved.harmonics("x")[:, 1])])
    np.testing.assert_allclose(drawn, expected)
    plt.close("all")


def test_an_interrupt_keeps_the_points_resolved_so_far(branch, caplog):
    def stop(progress):
        if progress.counts["points"] == 7 and not progress.done:
            raise KeyboardInterrupt

    resolved = hbnlp.resolve_harmonics(branch, 1e-3, callbacks=[stop])
    assert len(resolved) == 7
    assert resolved.message == f"interrupted after 7 of {len(branch)} points"
    assert resolved.message in caplog.text
    whole = hbnlp.resolve_harmonics(branch, 1e-3)
    np.testing.assert_array_equal(resolved.truncation_error, whole.truncation_error[:7])


def test_too_few_harmonics_are_said_not_hidden(branch):
    resolved = hbnlp.resolve_harmonics(branch, 1e-6, at_most=3)
    assert not resolved.reached.all()
    assert resolved.n_harmonics.max() == 3
    assert "not reached at" in repr(resolved)


def test_bad_input(branch, tmp_path):
    with pytest.raises(ValueError, match="tolerance"):
        hbnlp.resolve_harmonics(branch, 0.0)
    with pytest.raises(ValueError, match="less than 1"):
        hbnlp.resolve_harmonics(branch, 2.0)
    with pytest.raises(ValueError, match="at_most"):
        hbnlp.resolve_harmonics(branch, 1e-3, least=5, at_most=3)
    branch.save(tmp_path / "branch.npz")
    loaded = hbnlp.Branch.load(tmp_path / "branch.npz")
    with pytest.raises(ValueError, match="from a file"):
        hbnlp.resolve_harmonics(loaded, 1e-3)
    with pytest.raises(ValueError, match="from a file"):
        hbnlp.truncation_error(loaded.solution(0))


def test_a_branch_that_begins_at_rest_is_resolved(duffing):
    problem = hbnlp.HarmonicBalance(duffing, n_harmonics=5)
    branch = hbnlp.trace(problem, "force", (0.0, 0.2), at={"omega": 0.8}, stability=None)
    resolved = hbnlp.resolve_harmonics(branch, 1e-3)
    assert resolved.reached.all()
    assert resolved.n_harmonics[0] == 1
    assert resolved.n_harmonics.max() < 8


def test_samples_that_were_given_or_raised_are_kept_with_another_number_of_harmonics(duffing, friction):
    given = hbnlp.HarmonicBalance(duffing, n_harmonics=5, n_samples=256)
    assert given.with_harmonics(1).n_samples == 256
    assert given.with_harmonics(10).n_samples == 512
    assert given.with_harmonics(10).samples_are_settled
    assert hbnlp.HarmonicBalance(duffing, n_harmonics=5).with_harmonics(10).n_samples == 41
    branch = hbnlp.trace(hbnlp.HarmonicBalance(friction, n_harmonics=5), "omega", (1.2, 1.6), stability=None)
    resolved = hbnlp.resolve_harmonics(branch, 1e-4)
    i = int(np.argmax(resolved.n_harmonics))
    assert resolved.solution(i).problem.n_samples > 4 * resolved.n_harmonics[i] + 1
    assert branch.problem.n_samples > 100


def test_a_fold_curve_has_the_samples_that_its_fold_needs(friction):
    problem = hbnlp.HarmonicBalance(friction, n_harmonics=5)
    branch = hbnlp.trace(problem, "omega", (0.6, 3.6), stability=None)
    fold = branch.folds[-1]
    curve = hbnlp.follow(fold, "force", span=(0.39, 0.41))
    k = int(np.argmin(abs(curve.second - 0.4)))
    assert curve.first[k] == pytest.approx(fold.value, abs=1e-8)
