"""Marching by direct integration: it jumps at the folds, only there, and loses nothing."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

from hbnlp.core.errors import TaskError
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.runge_kutta import RungeKutta4
from hbnlp.integration.settling import integrate
from hbnlp.sweeps.by_integration import march
from hbnlp.sweeps.records import TimeSweep
from hbnlp.systems import duffing
from hbnlp.systems.system import System

# converged folds of x'' + .05 x' + x + .1 x^3 = .18 cos(omega t), from test_duffing_folds.py
FOLD_UP, FOLD_DOWN = 1.115700251771, 1.2696019555


def short_sweep(**options):
    return march(duffing(damping_ratio=0.2), "omega", [0.8, 1.0, 1.2], **options)


@pytest.mark.parametrize(
    ("values", "fold"),
    [
        (np.concatenate([np.arange(1.1, 1.26, 0.04), np.arange(1.26, 1.28, 0.002)]), FOLD_DOWN),
        (np.concatenate([np.arange(1.3, 1.125, -0.04), np.arange(1.125, 1.105, -0.002)]), FOLD_UP),
    ],
)
def test_a_sweep_jumps_at_the_fold_and_nowhere_else(values, fold):
    sweep = march(duffing(damping_ratio=0.025, cubic=0.1, force=0.18), "omega", values)
    assert sweep.complete
    assert sweep.periodic.all()
    assert sweep.jumps.shape == (1,)
    low, high = sorted(sweep.jump_brackets[0])
    assert low < fold < high
    assert high - low == pytest.approx(0.002)
    index = sweep.jumps[0]
    np.testing.assert_array_equal(sweep.jump_brackets[0], values[index - 1 : index + 1])
    amplitude = np.abs(sweep.harmonics("x")[:, 1])
    assert abs(amplitude[index] - amplitude[index - 1]) > 1.0


def test_a_steep_resonance_is_no_jump():
    system = System([[1.0]], [[0.05]], [[1.0]], forcing=lambda tau, p: [ca.cos(tau)])
    sweep = march(system, "omega", np.linspace(0.9, 1.1, 9))
    exact = 1.0 / (1.0 - sweep.parameter**2 + 0.05j * sweep.parameter)
    np.testing.assert_allclose(sweep.harmonics("x")[:, 1], exact, rtol=1e-5)
    assert np.abs(np.diff(np.abs(exact))).max() > 5.0
    assert sweep.jumps.size == 0


def test_the_state_is_carried_over_and_ends_where_an_integration_ends():
    sweep = march(duffing(), "force", [0.1, 0.15], at={"omega": 1.2}, method=Adaptive(), n_harmonics=7)
    first = integrate(duffing(), at={"omega": 1.2, "force": 0.1}, method=Adaptive())
    second = integrate(duffing(), at={"omega": 1.2, "force": 0.15}, method=Adaptive(), start=first)
    np.testing.assert_array_equal(sweep.states, [first.state, second.state])
    np.testing.assert_array_equal(sweep.amplitudes[:, 0], [first.harmonics("x", 7), second.harmonics("x", 7)])
    np.testing.assert_array_equal(sweep.n_periods, [first.n_periods, second.n_periods])
    assert "force" not in sweep.parameters
    assert sweep.parameters["omega"] == 1.2


def test_responses_that_do_not_settle_are_kept_and_marked():
    sweep = short_sweep(max_periods=2)
    assert len(sweep) == 3
    assert not sweep.periodic.any()
    assert np.all(sweep.defects > 1e-8)
    assert sweep.jumps.size == 0


def test_an_interrupt_keeps_what_there_is_and_says_so():
    def stop(progress):
        if progress.counts["values"] == 2 and not progress.done:
            raise KeyboardInterrupt

    sweep = short_sweep(callbacks=[stop])
    assert not sweep.complete
    assert "interrupted after 2 of 3" in sweep.message
    whole = short_sweep()
    np.testing.assert_array_equal(sweep.amplitudes, whole.amplitudes[:2])
    rest = march(duffing(damping_ratio=0.2), "omega", [1.2], start=sweep.states[-1])
    np.testing.assert_array_equal(rest.states[0], whole.states[2])


def test_an_error_of_a_callback_keeps_what_there_is():
    def fail(progress):
        raise ValueError(f"a third is {progress.fraction:.3f}")

    with pytest.raises(TaskError, match=r"a third is 0\.333") as caught:
        short_sweep(callbacks=[fail])
    assert isinstance(caught.value.__cause__, ValueError)
    assert len(caught.value.result) == 1


def test_a_sweep_ends_where_the_response_diverges():
    system = duffing(damping_ratio=0.2, cubic=-1.0, force=0.1)
    sweep = march(system, "force", [0.1, 0.2, 5.0, 0.1], at={"omega": 0.5})
    assert not sweep.complete
    np.testing.assert_array_equal(sweep.parameter, [0.1, 0.2])
    assert "ended at force = 5: stopped at t = " in sweep.message


def test_a_sweep_ends_where_the_fixed_step_is_too_long():
    sweep = march(duffing(damping_ratio=0.2), "omega", [1.0, 0.5, 0.1], method=RungeKutta4(steps_per_period=20))
    assert not sweep.complete
    np.testing.assert_array_equal(sweep.parameter, [1.0, 0.5])
    assert "stability limit of RK4" in sweep.message


def test_a_sweep_without_any_response_is_still_a_record(tmp_path):
    sweep = march(duffing(cubic=-1.0), "force", [50.0], at={"omega": 0.5})
    assert len(sweep) == 0
    assert sweep.amplitudes.shape == (0, 1, 6)
    sweep.save(tmp_path / "none.npz")
    assert repr(TimeSweep.load(tmp_path / "none.npz")) == repr(sweep)


def test_a_saved_sweep_comes_back_whole(tmp_path):
    sweep = march(duffing(), "omega", [1.26, 1.29], start=[2.5, 0.0], n_harmonics=3)
    sweep.save(tmp_path / "sweep.npz")
    loaded = TimeSweep.load(tmp_path / "sweep.npz")
    assert loaded.system is None
    assert TimeSweep.load(tmp_path / "sweep.npz", system=sweep.system).system is sweep.system
    softer = System([[1.0]], [[0.05]], [[0.9]], parameters=dict(sweep.system.parameters.defaults))
    with pytest.raises(ValueError, match=r"at omega = 1.29 does not repeat itself in this system: its state"):
        TimeSweep.load(tmp_path / "sweep.npz", system=softer)
    with pytest.raises(TypeError, match=r"no argument 'problem'; it takes path, system"):
        TimeSweep.load(tmp_path / "sweep.npz", problem=sweep.system)
    for name, value in vars(dataclasses.replace(sweep, system=None)).items():
        other = getattr(loaded, name)
        assert type(other) is type(value), name
        np.testing.assert_array_equal(other, value, err_msg=name)
        assert np.asarray(other).dtype == np.asarray(value).dtype
    assert list(tmp_path.iterdir()) == [tmp_path / "sweep.npz"]
    assert len(repr(loaded).splitlines()) <= 5
    with pytest.raises(KeyError, match="unknown output"):
        loaded.harmonics("y")


@pytest.mark.parametrize(
    ("name", "values", "options", "error", "message"),
    [
        ("omga", [1.0], {}, KeyError, "did you mean 'omega'"),
        ("omega", [], {}, ValueError, "at least one"),
        ("omega", [1.0, np.nan], {}, ValueError, "finite"),
        ("omega", [1.0, 0.0], {}, ValueError, "values of omega reach 0; .* omega > 0"),
        ("omega", [1.0], {"n_harmonics": 0}, ValueError, "n_harmonics is 0"),
        ("force", [1.0], {}, ValueError, "'omega' has no value"),
        ("omega", [1.0], {"method": RungeKutta4(steps_per_period=4), "at": {"cubic": 0.0}}, None, ""),
        ("omega", [0.1], {"method": RungeKutta4(steps_per_period=20)}, ValueError, "stability limit"),
    ],
)
def test_bad_input_is_named(name, values, options, error, message):
    if error is None:
        assert march(duffing(damping_ratio=0.2), name, values, **{**options, "n_harmonics": 1}).complete
        return
    with pytest.raises(error, match=message):
        march(duffing(), name, values, **options)


def test_arguments_of_another_kind_are_named():
    with pytest.raises(TypeError, match="system is 'duffing'; give a System"):
        march("duffing", "omega", [1.0])
    for option in ("method", "callbacks"):
        with pytest.raises(TypeError, match=f"{option} is 'x'; give"):
            march(duffing(), "omega", [1.0], **{option: "x"})
