"""A sweep to a tolerance: each solution has its own number of harmonics, and jumps are those of many harmonics."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.callbacks import Autosave, StopTracing
from hbnlp.core.kinds import Status
from hbnlp.fourier import resize
from hbnlp.sweeps.records import Sweep
from hbnlp.sweeps.sweeping import sweep
from hbnlp.systems import duffing
from hbnlp.systems.system import System

OMEGAS = np.round(np.arange(0.2, 1.4, 0.02), 6)
MANY = 21


@pytest.fixture(scope="module")
def tolerant():
    return HarmonicBalance(duffing(), tolerance=1e-6)


@pytest.fixture(scope="module")
def up(tolerant):
    return sweep(tolerant, "omega", OMEGAS)


def friction():
    """x'' + .05 x' + .3 tanh (x' / .2) + x = .6 cos w t: more harmonics at resonance than on either side."""
    return System(
        1.0,
        0.05,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [0.3 * ca.tanh(v[0] / 0.2)],
        forcing=lambda tau, p: [0.6 * ca.cos(tau)],
        parameters={"omega": 1.0},
        outputs={"acceleration": lambda s: s.ddu[0]},
    )


@pytest.mark.parametrize("direction", [1, -1], ids=["up", "down"])
def test_every_solution_is_within_the_tolerance_and_jumps_are_the_same(tolerant, direction):
    result = sweep(tolerant, "omega", OMEGAS[::direction])
    exact = sweep(HarmonicBalance(duffing(), MANY), "omega", OMEGAS[::direction])
    np.testing.assert_array_equal(result.jump_brackets, exact.jump_brackets)
    assert result.jumps.size == 1
    errors = np.linalg.norm(resize(result.coefficients, MANY) - exact.coefficients, axis=(1, 2))
    sizes = np.linalg.norm(exact.coefficients, axis=(1, 2))
    np.testing.assert_allclose(errors / sizes, result.truncation_error, rtol=0.2, atol=1e-10)
    assert result.truncation_error.max() <= 1e-6


def test_numbers_of_harmonics_rise_and_fall(up):
    assert {3, 5, 7} <= {*up.n_harmonics}
    assert up.n_harmonics[-1] < up.n_harmonics.max()
    assert np.count_nonzero(np.diff(up.n_harmonics)) <= 8


def test_rows_are_padded_and_each_is_a_solution_of_its_own_balance(up):
    assert up.coefficients.shape == (len(up), 1, 2 * up.n_harmonics.max() + 1)
    assert up.amplitudes.shape == (len(up), 1, up.n_harmonics.max() + 1)
    for k in range(0, len(up), 5):
        solution, own = up.solution(k), int(up.n_harmonics[k])
        assert solution.n_harmonics == own == solution.problem.n_harmonics
        assert solution.statistics["truncation_error"] == up.truncation_error[k]
        assert not np.any(up.coefficients[k, :, 2 * own + 1 :])
        x, values = solution.coefficients.ravel(), solution.problem.values(solution.parameters)
        assert np.abs(solution.problem.residual(x, values).full()).max() < 1e-9


def test_an_output_that_is_named_meets_the_tolerance_as_well():
    omegas = np.linspace(0.3, 1.5, 13)
    plain, named = (
        sweep(HarmonicBalance(friction(), tolerance=1e-3, outputs=outputs), "omega", omegas)
        for outputs in ((), ["acceleration"])
    )
    exact = sweep(HarmonicBalance(friction(), 61), "omega", omegas).harmonics("acceleration")
    errors = [
        np.linalg.norm(
            np.pad(each.harmonics("acceleration"), [(0, 0), (0, 62 - each.amplitudes.shape[2])]) - exact, axis=1
        )
        for each in (plain, named)
    ]
    size = np.linalg.norm(exact, axis=1)
    assert np.max(errors[0] / size) > 1e-3 >= np.max(errors[1] / size) / 1.3
    assert np.all(named.n_harmonics >= plain.n_harmonics)


def test_a_cap_that_is_met_is_said():
    result = sweep(HarmonicBalance(friction(), tolerance=1e-6, most_harmonics=9), "omega", [0.3, 0.6, 1.0, 1.4])
    missed = np.count_nonzero(result.truncation_error > 1e-6)
    assert result.message == (
        f"all 4 values reached; {missed} points not within the tolerance 1e-06 with most_harmonics = 9"
    )
    assert result.n_harmonics.max() == 9


def test_files_hold_the_numbers_and_the_problem_must_have_them(up, tolerant, tmp_path):
    up.save(tmp_path / "up.npz")
    loaded = Sweep.load(tmp_path / "up.npz", problem=tolerant)
    for name in ("coefficients", "amplitudes", "n_harmonics", "truncation_error"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(up, name))
    assert loaded.solution(40).problem is up.solution(40).problem
    assert Sweep.load(tmp_path / "up.npz").solution(0).problem is None
    with pytest.raises(ValueError, match=r"the sweep has 3 to 7 harmonics, the problem n_harmonics = 7 .* tolerance="):
        Sweep.load(tmp_path / "up.npz", problem=HarmonicBalance(duffing(), 7))


def test_of_a_fixed_number_all_have_it_and_files_from_before_load(tmp_path):
    problem = HarmonicBalance(duffing(), 5)
    result = sweep(problem, "omega", OMEGAS[:4])
    assert result.n_harmonics.tolist() == [5] * 4
    assert result.truncation_error is None
    result.save(tmp_path / "new.npz")
    arrays = dict(np.load(tmp_path / "new.npz"))
    del arrays["n_harmonics"]
    np.savez(tmp_path / "old.npz", **arrays)
    old = Sweep.load(tmp_path / "old.npz", problem=problem)
    np.testing.assert_array_equal(old.n_harmonics, result.n_harmonics)
    assert old.truncation_error is None


def test_a_sweep_that_was_stopped_is_gone_on_with_from_its_file(up, tolerant, tmp_path):
    def stop(progress):
        if progress.counts["values"] == 45 and not progress.done:
            raise StopTracing

    begun = sweep(tolerant, "omega", OMEGAS, callbacks=[stop, Autosave(tmp_path / "sweep.npz")])
    loaded = Sweep.load(tmp_path / "sweep.npz", problem=tolerant)
    assert len(loaded) == len(begun) == 45
    rest = sweep(tolerant, "omega", OMEGAS[45:], start=loaded.solution(44))
    np.testing.assert_allclose(resize(rest.coefficients, 7), resize(up.coefficients[45:], 7), rtol=0, atol=2e-6)
    np.testing.assert_array_equal(rest.jump_brackets, up.jump_brackets)
    again = sweep(tolerant, "omega", OMEGAS[45:50], start=loaded.coefficients[44])
    np.testing.assert_allclose(again.harmonics("x")[:, 1], up.harmonics("x")[45:50, 1], atol=2e-6)


def test_where_nothing_converges_a_row_is_nan_with_the_number_that_was_begun_with():
    """x'' + x' / (1 - F^2) = ..: the root is taken of what is negative beyond F = 1."""
    system = System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [ca.sqrt(1.0 - p.force**2) * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"omega": 0.5, "force": 0.1},
    )
    result = sweep(HarmonicBalance(system, tolerance=1e-4), "force", [0.5, 0.9, 1.1])
    assert result.converged.tolist() == [True, True, False]
    assert result.solution(2).status is Status.NOT_CONVERGED
    assert np.isnan(result.coefficients[2]).all()
    assert np.isnan(result.truncation_error[2])
    assert result.n_harmonics[2] == 3
    assert "no solution at 1 of them" in result.message
