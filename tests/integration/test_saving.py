"""A time response is one file, and the integration goes on from it."""

import dataclasses

import numpy as np
import pytest

from hbnlp.core.callbacks import Autosave, StopTracing
from hbnlp.core.errors import ConvergenceError, SaveError
from hbnlp.core.storage import load_arrays
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.exponential import ExponentialRungeKutta4
from hbnlp.integration.response import TimeResponse
from hbnlp.integration.runge_kutta import RungeKutta4
from hbnlp.integration.settling import integrate
from hbnlp.systems import duffing

METHODS = [
    RungeKutta4(),
    RungeKutta4(steps_per_period=128),
    ExponentialRungeKutta4(steps_per_period=128),
    Adaptive(rtol=1e-8, samples_per_period=32),
]


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_a_response_is_the_same_after_saving_and_loading(method, tmp_path):
    response = integrate(duffing(), at={"omega": 0.7}, method=method, periodic_tol=1e-3)
    response.save(tmp_path / "response.npz")
    loaded = TimeResponse.load(tmp_path / "response.npz")
    for part in dataclasses.fields(TimeResponse):
        np.testing.assert_array_equal(getattr(loaded, part.name), getattr(response, part.name))
    assert loaded.method == method
    assert repr(loaded) == repr(response)
    np.testing.assert_array_equal(loaded.all_harmonics(), response.all_harmonics())
    with pytest.raises(SaveError, match="could not write"):
        response.save(tmp_path / "missing" / "response.npz")


def test_a_response_that_broke_off_is_kept_as_it_is(tmp_path):
    with pytest.raises(ConvergenceError) as caught:
        integrate(duffing(), at={"omega": 1.0, "damping_ratio": -5.0})
    caught.value.result.save(tmp_path / "response.npz")
    loaded = TimeResponse.load(tmp_path / "response.npz")
    assert loaded.stopped_at == caught.value.result.stopped_at
    assert repr(loaded) == repr(caught.value.result)


def test_an_integration_is_saved_on_the_way_and_goes_on_from_the_file(tmp_path):
    def stop(progress):
        if progress.counts["periods"] == 20:
            raise StopTracing

    options = {"at": {"omega": 0.7}, "periodic_tol": 1e-300, "throw": False}
    integrate(duffing(), callbacks=[Autosave(tmp_path / "response.npz", seconds=1e-9), stop], **options)
    kept = TimeResponse.load(tmp_path / "response.npz")
    assert kept.n_periods == 20
    rest, whole = (
        integrate(duffing(), start=kept, max_periods=5, **options),
        integrate(duffing(), max_periods=25, **options),
    )
    np.testing.assert_array_equal(rest.state, whole.state)


def test_a_method_that_is_not_the_packages_is_refused_before_there_is_a_file(tmp_path):
    class Mine:
        def propagator(self, *arguments):
            return RungeKutta4().propagator(*arguments)

    response = integrate(duffing(), at={"omega": 0.7}, method=Mine(), periodic_tol=1e-2)
    with pytest.raises(
        SaveError, match=r"could not write .*its method is 'Mine'; one of RungeKutta4, ExponentialRungeKutta4, Adaptive"
    ):
        response.save(tmp_path / "response.npz")
    assert list(tmp_path.iterdir()) == []


def test_a_file_says_what_integrated(tmp_path):
    integrate(duffing(), at={"omega": 0.7}, method=METHODS[1], periodic_tol=1e-2).save(tmp_path / "response.npz")
    metadata = load_arrays(tmp_path / "response.npz", "time response")[1]
    assert metadata["method"] == {"name": "RungeKutta4", "steps_per_period": 128}
