"""Marching by Newton's method: it follows a branch to its fold, jumps there and nowhere else, and records it."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.aero import flat_plate_re100
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.continuation.newton import Newton
from hbnlp.core.callbacks import Autosave, StopTracing
from hbnlp.core.errors import NonFiniteError, SaveError, TaskError
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.runge_kutta import RungeKutta4
from hbnlp.solutions.solving import solve
from hbnlp.sweeps.records import Sweep, TimeSweep
from hbnlp.sweeps.sweeping import sweep
from hbnlp.systems import duffing, tuned_absorber
from hbnlp.systems.system import System
from hbnlp.testing import check_branch
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.membrane import QuasiLinearMembrane

# converged folds of x'' + .05 x' + x + .1 x^3 = .18 cos w t: of tests/numpy_balance.py, as test_duffing_folds.py tests
UP, DOWN = 1.115700251771, 1.2696019555
OMEGAS = np.round(np.arange(0.9, 1.4, 0.005), 6)


@pytest.fixture(scope="module")
def problem():
    return HarmonicBalance(duffing(), 7)


@pytest.fixture(scope="module", params=[1, -1], ids=["up", "down"])
def marched(request, problem):
    return request.param, sweep(problem, "omega", OMEGAS[:: request.param])


def test_a_sweep_jumps_at_the_fold_and_nowhere_else(marched):
    direction, result = marched
    assert result.converged.all()
    assert result.jumps.size == 1
    low, high = sorted(result.jump_brackets[0])
    assert low < (DOWN if direction == 1 else UP) < high
    assert high - low == pytest.approx(0.005)
    k = result.jumps[0]
    np.testing.assert_array_equal(result.jump_brackets[0], result.parameter[k - 1 : k + 1])
    size = np.abs(result.harmonics("x")[:, 1])
    assert abs(size[k] - size[k - 1]) > 0.5


def test_every_solution_of_a_sweep_is_on_the_traced_branch_and_stable(marched, problem):
    _, result = marched
    for k in range(0, len(result), 7):
        values = problem.values({"omega": result.parameter[k]})
        x = result.coefficients[k].ravel()
        assert np.abs(problem.residual(x, values).full()).max() < 1e-9
    branch = trace(problem, "omega", (0.9, 1.4))
    check_branch(branch)
    for k in range(0, len(result), 7):
        distance = np.linalg.norm(branch.coefficients - result.coefficients[k], axis=(1, 2))
        assert branch.stable[np.argmin(distance)]


def test_sweeps_up_and_down_agree_outside_of_the_hysteresis_and_differ_within(problem):
    up, down = sweep(problem, "omega", OMEGAS), sweep(problem, "omega", OMEGAS[::-1])
    np.testing.assert_array_equal(down.parameter[::-1], up.parameter)
    distance = np.abs(up.harmonics("x")[:, 1] - down.harmonics("x")[::-1, 1])
    within = (OMEGAS > UP) & (OMEGAS < DOWN)
    assert distance[~within].max() < 1e-8
    assert distance[within].min() > 0.1


def test_a_steep_resonance_is_no_jump():
    system = System(1.0, 0.01, 1.0, forcing=lambda tau, p: [ca.cos(tau)])
    result = sweep(HarmonicBalance(system, 1), "omega", np.linspace(0.9, 1.1, 11))
    exact = 1.0 / (1.0 - result.parameter**2 + 0.01j * result.parameter)
    np.testing.assert_allclose(result.harmonics("x")[:, 1], exact, rtol=1e-9)
    assert result.jumps.size == 0


def test_what_goes_on_until_just_before_a_fold_is_no_jump():
    """From 0.2 % before the fold at 76.187 a Newton step of 4 % back comes to another solution."""
    membrane = QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
    problem = HarmonicBalance(membrane_wing(membrane, flat_plate_re100(n_modes=10)), n_harmonics=1)
    values = np.geomspace(100.0, 0.01, 240)[:9]
    result = sweep(problem, "omega", values, at={"pitch_amplitude": np.radians(4.0)})
    traced = trace(result.solution(6), "omega", (values[6], values[8]), stability=None)
    assert [fold.value for fold in traced.folds] == [pytest.approx(76.1872, abs=1e-4)]
    np.testing.assert_allclose(result.jump_brackets, [values[1:3], values[7:9]])  # not from values[6] to values[7]


def test_steps_too_long_for_newton_are_divided_and_are_no_jumps(problem):
    """Below the hysteresis there is one solution: however it is reached, it is that of short steps."""
    result = sweep(problem, "omega", [0.5, 1.1], method=Newton(max_iterations=6))
    fine = sweep(problem, "omega", np.linspace(0.5, 1.1, 111))
    assert result.converged.all()
    np.testing.assert_allclose(result.coefficients[-1], fine.coefficients[-1], atol=1e-8)
    assert result.jumps.size == fine.jumps.size == 0


def test_any_parameter_is_marched_and_the_rest_kept(problem):
    result = sweep(problem, "force", np.linspace(0.05, 0.5, 40), at={"omega": 1.2})
    assert result.jumps.size == 1
    low, high = result.jump_brackets[0]
    branch = trace(problem, "force", (0.05, 0.5), at={"omega": 1.2}, stability=None)
    check_branch(branch)
    assert low < branch.folds[0].value < high
    assert result.parameters == {"damping_ratio": 0.025, "cubic": 0.1, "omega": 1.2}
    assert result.name == "force"


def test_a_sweep_begins_from_a_solution_that_is_given(problem):
    start = solve(problem, at={"omega": 1.2}, start=[[0.0, 1.37, 2.1]])
    result = sweep(problem, "omega", [1.21, 1.25], start=start)
    assert result.jumps.size == 0
    assert abs(result.harmonics("x")[0, 1]) > 2.4
    low = sweep(problem, "omega", [1.21, 1.25])
    assert abs(low.harmonics("x")[0, 1]) < 0.5


def test_what_does_not_converge_is_nan_and_nothing_else_is_lost():
    """An undamped linear oscillator has no response at its resonance."""
    system = System(1.0, 0.0, 1.0, forcing=lambda tau, p: [ca.cos(tau)])
    result = sweep(HarmonicBalance(system, 1), "omega", [0.5, 1.0, 2.0])
    np.testing.assert_array_equal(result.converged, [True, False, True])
    assert np.isnan(result.coefficients[1]).all()
    assert np.isnan(result.harmonics("x")[1]).all()
    np.testing.assert_allclose(result.harmonics("x")[[0, 2], 1], [4.0 / 3.0, -1.0 / 3.0], rtol=1e-9)


def test_a_sweep_is_the_same_after_saving_and_loading(marched, tmp_path):
    _, result = marched
    result.save(tmp_path / "sweep.npz")
    loaded = Sweep.load(tmp_path / "sweep.npz")
    for name in ("parameter", "coefficients", "amplitudes", "converged", "jumps", "jump_brackets"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(result, name))
    for name in ("name", "output_names", "periods"):
        assert getattr(loaded, name) == getattr(result, name)
    assert dict(loaded.parameters) == dict(result.parameters)
    assert repr(loaded) == repr(result)
    assert len(repr(result).splitlines()) <= 5
    with pytest.raises(SaveError, match="could not write"):
        result.save(tmp_path / "missing" / "sweep.npz")


def test_a_sweep_without_jumps_or_with_holes_survives_the_file(tmp_path):
    system = System(1.0, 0.0, 1.0, forcing=lambda tau, p: [ca.cos(tau)])
    result = sweep(HarmonicBalance(system, 1), "omega", [0.5, 1.0])
    result.save(tmp_path / "sweep.npz")
    loaded = Sweep.load(tmp_path / "sweep.npz")
    np.testing.assert_array_equal(loaded.coefficients, result.coefficients)
    assert loaded.jump_brackets.shape == (0, 2)


@pytest.mark.parametrize("method", [None, RungeKutta4(steps_per_period=256), Adaptive()], ids=str)
def test_a_system_is_marched_by_direct_integration(method):
    system = duffing(damping_ratio=0.2)
    by_time = sweep(system, "omega", [0.8, 1.0], method=method)
    by_newton = sweep(HarmonicBalance(system, 7), "omega", [0.8, 1.0])
    assert isinstance(by_time, TimeSweep)
    np.testing.assert_allclose(by_time.harmonics("x")[:, 1], by_newton.harmonics("x")[:, 1], atol=1e-6)


def test_a_balance_over_two_periods_is_marched_over_two():
    problem = HarmonicBalance(tuned_absorber(force=0.05), 4, periods=2)
    result = sweep(problem, "omega", [0.6, 0.7])
    assert result.periods == 2
    np.testing.assert_allclose(result.harmonics("x1")[:, 1::2], 0.0, atol=1e-12)


def test_bad_arguments_are_refused(problem):
    with pytest.raises(KeyError, match="unknown parameter 'omga'; did you mean 'omega'"):
        sweep(problem, "omga", [1.0])
    with pytest.raises(ValueError, match="parameter 'omega' has no value"):
        sweep(problem, "force", [1.0])
    for values in ([], [np.nan], [[1.0, 2.0]]):
        with pytest.raises(ValueError, match=r"values is .*; give a sequence of finite numbers"):
            sweep(problem, "omega", values)
    with pytest.raises(TypeError, match=r"method is RungeKutta4.*; a HarmonicBalance is marched by Newton"):
        sweep(problem, "omega", [1.0], method=RungeKutta4())
    with pytest.raises(TypeError, match="method"):
        sweep(duffing(), "omega", [1.0], method=Newton())
    with pytest.raises(TypeError, match=r"has no argument 'strt'; did you mean 'start'"):
        sweep(problem, "omega", [1.0], strt=None)
    with pytest.raises(TypeError, match="HarmonicBalance"):
        sweep("a system", "omega", [1.0])
    for subject in (problem, duffing()):
        with pytest.raises(TypeError, match=r"callbacks is .*; give a list of callables"):
            sweep(subject, "omega", [1.0], callbacks=print)


def test_an_unknown_output_is_refused(marched):
    with pytest.raises(KeyError, match=r"unknown output 'y' \(known: x\)"):
        marched[1].harmonics("y")


def test_a_sweep_tells_its_progress_and_its_jumps(problem):
    seen = []
    result = sweep(problem, "omega", OMEGAS, callbacks=[seen.append])
    assert [p.counts["values"] for p in seen] == [*range(1, len(result) + 1), len(result)]
    assert seen[-1].counts["jumps"] == 1
    assert [p.done for p in seen] == [False] * len(result) + [True]
    np.testing.assert_allclose([p.fraction for p in seen[:-1]], np.arange(1, len(result) + 1) / len(result))
    assert seen[-1].result() is result
    assert seen[3].result().parameter.size == len(result)
    assert result.complete


@pytest.mark.parametrize(("stop", "word"), [(KeyboardInterrupt(), "interrupted"), (StopTracing(), "stopped by")])
def test_a_sweep_that_ends_early_keeps_what_it_has_and_can_be_gone_on_with(problem, tmp_path, caplog, stop, word):
    def end(progress):
        if progress.counts["values"] == 60 and not progress.done:
            raise stop

    whole = sweep(problem, "omega", OMEGAS)
    part = sweep(problem, "omega", OMEGAS, callbacks=[end, Autosave(tmp_path / "sweep.npz")])
    assert not part.complete
    assert part.message.startswith(word)
    assert "after 60 of 100 values; go on from start=sweep.coefficients[59]" in part.message
    assert part.message in caplog.text
    np.testing.assert_array_equal(part.coefficients, whole.coefficients[:60])
    assert Sweep.load(tmp_path / "sweep.npz").message == part.message
    rest = sweep(problem, "omega", OMEGAS[60:], start=part.coefficients[-1])
    np.testing.assert_allclose(rest.coefficients, whole.coefficients[60:], atol=1e-9)
    assert len(part.jumps) + len(rest.jumps) == 1


def test_a_sweep_interrupted_at_once_is_empty(problem, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("hbnlp.sweeps.by_newton.solved", interrupted)
    part = sweep(problem, "omega", OMEGAS)
    assert len(part) == 0
    assert part.coefficients.shape == (0, *problem.shape)
    assert "0 values, 0 converged" in repr(part)


def test_an_error_on_the_way_keeps_the_sweep(problem):
    def fail(progress):
        if progress.counts["values"] == 5:
            raise RuntimeError("from a callback")

    with pytest.raises(TaskError, match=r"marching omega failed; .* from a callback") as caught:
        sweep(problem, "omega", OMEGAS, callbacks=[fail])
    assert len(caught.value.result) == 5
    assert "RuntimeError after 5 of 100 values" in caught.value.result.message


def test_a_march_that_loses_its_solution_goes_on_where_rest_is_singular():
    """A spring, a pull and a repulsion: x + x^(-3/2) = pull, none below pull = (5/3) 1.5^(2/5) = 1.96."""
    system = System(
        1.0,
        0.1,
        0.0,
        nonlinear_force=lambda q, v, tau, p: [p.pull - q[0] - 1.0 / (q[0] * ca.sqrt(q[0]))],
        forcing=lambda tau, p: [1e-3 * ca.cos(tau)],
        parameters={"pull": 3.0, "omega": 0.1},
    )
    problem = HarmonicBalance(system, 3)
    with pytest.raises(NonFiniteError, match="give a start"):
        sweep(problem, "pull", [1.0, 2.5])
    for start in (None, [[2.9, 0.0, 0.0]]):
        marched = sweep(problem, "pull", [3.0, 2.5, 1.0, 2.5], start=start)
        assert marched.complete
        assert marched.converged.tolist() == [True, True, False, True]
