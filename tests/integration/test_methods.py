"""The integrators: their energy rates, their stability limits, and what they say where they cannot go on."""

import re

import casadi as ca
import numpy as np
import pytest

from hbnlp.core.errors import ConvergenceError
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.runge_kutta import RungeKutta4
from hbnlp.integration.settling import integrate
from hbnlp.systems.system import System


def oscillator(damping=0.0, force=0.0, **options):
    return System([[1.0]], [[damping]], [[1.0]], forcing=lambda tau, p: [force * ca.cos(tau)], **options)


def exploding():
    """x'' = 2 x^3, of which x = 1/(1 - t) is a solution."""
    return System([[1.0]], [[0.0]], [[0.0]], nonlinear_force=lambda q, v, tau, p: [-2 * q[0] ** 3])


def test_runge_kutta_loses_energy_at_its_known_rate():
    # |R(i z)|^2 = 1 - z^6/72 + z^8/576 for the amplification R of one step, z = h times the frequency
    steps, omega, n = 24, 0.7, 20
    response = integrate(
        oscillator(),
        at={"omega": omega},
        method=RungeKutta4(steps_per_period=steps),
        start=[1.0, 0.0],
        max_periods=n,
        throw=False,
    )
    z = 2 * np.pi / (steps * omega)
    assert response.state @ response.state == pytest.approx((1 - z**6 / 72 + z**8 / 576) ** (steps * n), rel=1e-11)


def test_the_adaptive_method_keeps_the_energy_to_its_tolerance():
    response = integrate(
        oscillator(), at={"omega": 0.7}, method=Adaptive(), start=[1.0, 0.0], max_periods=20, throw=False
    )
    assert response.state @ response.state == pytest.approx(1.0, abs=3e-7)


def test_lag_states_much_faster_than_the_motion_are_no_trouble_for_the_stiff_method():
    system = oscillator(0.1, 1.0, lag_state=[[-1e5]], lag_input=[[1e5]], lag_output=[[0.1]])
    response = integrate(system, at={"omega": 1.1}, method=Adaptive(stiff=True), periodic_tol=1e-7)
    s = 1.1j
    exact = 1.0 / (s**2 + 0.1 * s + 1.0 - 0.1 * s**2 * 1e5 / (s + 1e5))
    assert response.harmonics("x")[1] == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("method", [RungeKutta4(steps_per_period=2000), Adaptive()])
def test_a_diverging_response_names_the_time_at_which_it_does(method):
    options = {"at": {"omega": 1.0}, "method": method, "start": [1.0, 1.0]}
    with pytest.raises(ConvergenceError, match=r"stopped at t = (0.9[89]|1.0)\d*, in period 1"):
        integrate(exploding(), **options)
    response = integrate(exploding(), **options, throw=False)
    assert response.stopped_at == pytest.approx(1.0, abs=0.02)
    assert np.all(np.isfinite(response.state))
    np.testing.assert_allclose(response.signal("x")[:200], 1 / (1 - response.t[:200]), rtol=1e-5)
    with pytest.raises(ValueError, match="broke off"):
        response.harmonics("x")


def test_the_stability_limit_is_that_of_the_scheme():
    # undamped oscillator of frequency 1: h = 2 pi / (steps omega), stable up to 2 sqrt 2
    def run(h, steps=12):
        method = RungeKutta4(steps_per_period=steps)
        at = {"omega": 2 * np.pi / (steps * h)}
        return integrate(oscillator(1e-9), at=at, method=method, start=[1.0, 0.0], max_periods=200, throw=False)

    assert np.linalg.norm(run(2.82).state) <= 1.0
    with pytest.raises(ValueError, match=r"12 is beyond the stability limit of RK4: \|h lambda\| = 2.84") as caught:
        run(2.84)
    enough = int(re.search(r"steps_per_period >= (\d+)", str(caught.value))[1])
    assert np.linalg.norm(run(2.84 * 12 / enough, enough).state) <= 1.0


@pytest.mark.parametrize(
    "make",
    [
        lambda: RungeKutta4(steps_per_period=0),
        lambda: RungeKutta4(steps_per_period=10.5),
        lambda: Adaptive(rtol=0.0),
        lambda: Adaptive(atol=np.nan),
        lambda: Adaptive(samples_per_period=0),
    ],
)
def test_bad_options_are_refused_at_construction(make):
    with pytest.raises(ValueError, match=r"is (0|10\.5|nan|0\.0); give"):
        make()
