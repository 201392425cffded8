"""The integrators: their energy rates, their stability limits, and what they say where they cannot go on."""

import re

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import hbnlp
from hbnlp.core.errors import ConvergenceError
from hbnlp.integration.automatic import automatic
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.exponential import ExponentialRungeKutta4
from hbnlp.integration.first_order import FirstOrderForm
from hbnlp.integration.runge_kutta import RungeKutta4
from hbnlp.integration.settling import integrate
from hbnlp.systems import chain, duffing
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


def window(method, system, state, omega):
    form = FirstOrderForm(system)
    packed = form.pack(system.parameters.values({"omega": omega}))
    return method.propagator(form, packed, np.asarray(state), 1)(np.asarray(state))


def test_the_exponential_scheme_is_exact_for_a_linear_system_under_a_constant_load():
    # of some steps a period only: x'' + .2 x' + x = 1 + x_l, x_l' = -40 x_l + 3 x''
    system = System(
        [[1.0]],
        [[0.2]],
        [[1.0]],
        lag_state=[[-40.0]],
        lag_input=[[3.0]],
        lag_output=[[1.0]],
        forcing=lambda tau, p: [1],
    )
    omega, start = 0.7, np.array([0.3, -0.2, 0.5])
    states = window(ExponentialRungeKutta4(steps_per_period=4), system, start, omega).states
    # the rates of (x, x', x_l), beside them those of a constant
    matrix = np.array([[0, 1, 0, 0], [-1, -0.2, 1, 1], [-3, -0.6, -37, 3], [0, 0, 0, 0]])
    exact = [(expm(matrix * t) @ np.append(start, 1.0))[:3] for t in 2 * np.pi / omega * np.arange(5) / 4]
    np.testing.assert_allclose(states, exact, atol=1e-13)


def test_the_exponential_scheme_is_of_fourth_order_for_a_forced_nonlinear_system():
    start, omega = [1.3, -0.4], 0.6
    system = duffing(damping_ratio=0.05, cubic=0.8, force=0.5)
    exact = window(Adaptive(rtol=1e-13, atol=1e-14, samples_per_period=4), system, start, omega).states[-1]
    errors = [
        np.linalg.norm(window(ExponentialRungeKutta4(steps_per_period=n), system, start, omega).states[-1] - exact)
        for n in (128, 256, 512)
    ]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.2)


def test_the_exponential_schemes_steps_do_not_hang_on_the_lag_states():
    slow, fast = (
        oscillator(0.1, 1.0, lag_state=[[-rate]], lag_input=[[rate]], lag_output=[[0.1]]) for rate in (1.0, 1e5)
    )
    steps = [len(window(ExponentialRungeKutta4(), each, np.zeros(3), 1.1).states) - 1 for each in (slow, fast)]
    assert steps[0] == steps[1] == 256
    # |h s| <= 0.75 of the oscillator's frequency, 1
    steps = len(window(ExponentialRungeKutta4(), fast, np.zeros(3), 0.01).states) - 1
    assert steps == np.ceil(2 * np.pi / 0.01 / 0.75)


@pytest.mark.parametrize("rate", [1e5, 1e8])
def test_the_exponential_scheme_takes_lag_states_that_are_much_faster_than_the_load(rate):
    system = oscillator(0.1, 1.0, lag_state=[[-rate]], lag_input=[[rate]], lag_output=[[0.1]])
    s = 1.1j
    exact = 1.0 / (s**2 + 0.1 * s + 1.0 - 0.1 * s**2 * rate / (s + rate))
    response = integrate(system, at={"omega": 1.1}, method=ExponentialRungeKutta4(), periodic_tol=1e-9)
    assert response.harmonics("x")[1] == pytest.approx(exact, rel=1e-7)


def test_lag_states_much_faster_than_the_steps_lower_the_exponential_schemes_order():
    # x'' + .1 x' + x + .8 x^3 + .3 x'^3 = -3 x_l, x_l' = 1e5 (x'' - x_l): to three
    system = oscillator(
        0.1,
        lag_state=[[-1e5]],
        lag_input=[[1e5]],
        lag_output=[[-3.0]],
        nonlinear_force=lambda q, v, tau, p: [0.8 * q[0] ** 3 + 0.3 * v[0] ** 3],
    )
    lags = {}
    for n in (64, 128, 256, 16384):
        method = ExponentialRungeKutta4(steps_per_period=n)
        lags[n] = window(method, system, [1.0, -0.4, 0.0], 0.8).states[-1, 2]
    errors = np.abs([lags[n] - lags[16384] for n in (64, 128, 256)])
    assert errors[0] < 1e-6
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), 3.0, atol=0.2)


def test_the_classical_schemes_steps_for_the_wing_are_bound_by_its_fastest_lag_state():
    # as the theory says of it, and of the exponential one
    wing = hbnlp.membrane_wing(
        hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10),
        hbnlp.aero.flat_plate_re100(n_modes=10),
    )
    options = {"at": {"omega": 4.0, "pitch_amplitude": np.radians(2.5)}, "max_periods": 1, "throw": False}
    assert len(integrate(wing, method=RungeKutta4(), **options).t) == 1344
    assert len(integrate(wing, **options).t) == 256
    with pytest.raises(ValueError, match="stability limit"):
        integrate(wing, method=RungeKutta4(steps_per_period=465), **options)
    assert integrate(wing, method=RungeKutta4(steps_per_period=475), **options).stopped_at is None


@pytest.mark.parametrize("membrane", [hbnlp.QuasiLinearMembrane, hbnlp.NonlinearMembrane])
def test_the_exponential_scheme_integrates_the_wing_as_the_classical_one(membrane):
    wing = hbnlp.membrane_wing(
        membrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10), hbnlp.aero.flat_plate_re100(n_modes=10)
    )
    options = {"at": {"omega": 4.0, "pitch_amplitude": 0.05}, "throw": False}
    start = integrate(wing, max_periods=5, **options)
    assert start.method == ExponentialRungeKutta4()
    classical, *exponential = (
        integrate(wing, method=method, start=start, max_periods=1, **options).state
        for method in (
            RungeKutta4(steps_per_period=2560),
            ExponentialRungeKutta4(),
            ExponentialRungeKutta4(steps_per_period=512),
        )
    )
    coarse, fine = (np.linalg.norm(state - classical) / np.linalg.norm(classical) for state in exponential)
    assert coarse < 1e-5
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.5)


def chosen(system, omega=1.0):
    return automatic(FirstOrderForm(system), system.parameters.values({"omega": omega}), np.zeros(system.n_state))


def test_large_systems_and_fast_lag_states_get_the_exponential_scheme():
    assert chosen(duffing()) == RungeKutta4()
    assert chosen(chain(10)) == ExponentialRungeKutta4()
    lags = {"lag_input": [[1.0]], "lag_output": [[0.1]]}
    assert chosen(oscillator(0.1, 1.0, lag_state=[[-5.0]], **lags)) == RungeKutta4()
    assert chosen(oscillator(0.1, 1.0, lag_state=[[-5e4]], **lags)) == ExponentialRungeKutta4()


@pytest.mark.parametrize("stiffness", [70.0, 1000.0])
def test_a_force_that_cancels_the_stiffness_has_the_steps_that_it_needs(stiffness):
    # whatever the two stiffnesses, the motion is that of x'' + .2 x' + x^3 = .3 cos tau
    def system(k, n):
        return System(
            np.eye(n),
            0.2 * np.eye(n),
            k * np.eye(n),
            nonlinear_force=lambda q, v, tau, p: -k * q + q**3,
            forcing=lambda tau, p: [0.3 * ca.cos(tau)] * n,
        )

    options = {"at": {"omega": 0.1}, "max_periods": 50, "periodic_tol": 1e-7}
    wanted = integrate(system(0.0, 1), method=Adaptive(), **options).harmonics("x")[1]
    response = integrate(system(stiffness, 9), **options)
    assert response.method == ExponentialRungeKutta4()
    assert response.harmonics("x1")[1] == pytest.approx(wanted, rel=1e-5)


def test_lag_states_that_take_mass_away_have_the_steps_that_they_need():
    # x'' - .9 x'' of them: the structure moves three times as fast as its lag states held
    n = 9
    system = System(
        np.eye(n),
        0.05 * np.eye(n),
        np.eye(n),
        lag_state=-300.0 * np.eye(n),
        lag_input=300.0 * np.eye(n),
        lag_output=0.9 * np.eye(n),
        nonlinear_force=lambda q, v, tau, p: q**3 + 0.2 * v**3,
        forcing=lambda tau, p: [2.0 * ca.cos(tau + i) for i in range(n)],
    )
    start = np.concatenate([np.zeros(n), np.ones(n), np.zeros(n)])
    options = {"at": {"omega": 0.1}, "start": start, "max_periods": 1, "throw": False}
    exact, found = integrate(system, method=Adaptive(), **options), integrate(system, **options)
    assert len(found.t) > 256
    assert np.linalg.norm(found.state - exact.state) < 1e-4 * np.linalg.norm(exact.state)


def test_steps_that_do_not_do_are_said():
    # chaotic: no steps give the state after fifty periods in one window
    system = System(
        [[1.0]],
        [[0.3]],
        [[-1.0]],
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        forcing=lambda tau, p: [0.5 * ca.cos(tau)],
    )
    options = {"at": {"omega": 1.2}, "start": [0.1, 0.0], "periods": 50, "max_periods": 50, "throw": False}
    response = integrate(system, method=ExponentialRungeKutta4(), **options)
    assert len(response.t) == 50 * 256 * 2**4
    said = r"4096 steps a period leave an estimated error of \S+ of the state$"
    assert re.search("; " + said, response.message)
    options = {"start": [0.1, 0.0], "periods": 50, "max_periods": 50, "method": ExponentialRungeKutta4()}
    marched = hbnlp.sweep(system, "omega", [1.2], **options)
    assert re.search("all 1 values reached; at 1 of them, the last at omega = 1.2: " + said, marched.message)


def test_steps_that_are_not_needed_any_more_are_given_up():
    # the force stiffens the beginning, thirty times as large as the motion to which it decays, by far
    method, system = ExponentialRungeKutta4(), duffing(damping_ratio=0.2, cubic=1.0, force=0.1)
    form = FirstOrderForm(system)
    run = method.propagator(form, form.pack(system.parameters.values({"omega": 1.0})), np.zeros(2), 1)
    state, steps = np.array([30.0, 0.0]), []
    for _ in range(16):
        window = run(state)
        state = window.states[-1]
        steps.append(len(window.states) - 1)
    assert steps[0] > 256
    assert steps[-1] == 256


@pytest.mark.parametrize("unit", [1e-24, 1e12])
def test_the_exponential_scheme_is_the_same_in_all_units(unit):
    def state(c):
        system = System(
            [[c]],
            [[0.1 * c]],
            [[c]],
            lag_state=[[-5.0]],
            lag_input=[[1.0]],
            lag_output=[[0.1 * c]],
            nonlinear_force=lambda q, v, tau, p: [0.3 * c * q[0] ** 3],
            forcing=lambda tau, p: [0.3 * c * ca.cos(tau)],
        )
        return window(ExponentialRungeKutta4(steps_per_period=256), system, [1.0, 0.0, 0.0], 1.1).states[-1]

    np.testing.assert_allclose(state(unit), state(1.0), rtol=1e-12)


@pytest.mark.parametrize(
    "method", [RungeKutta4(steps_per_period=2000), ExponentialRungeKutta4(steps_per_period=2000), Adaptive()]
)
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
        lambda: ExponentialRungeKutta4(steps_per_period=0),
        lambda: Adaptive(rtol=0.0),
        lambda: Adaptive(atol=np.nan),
        lambda: Adaptive(samples_per_period=0),
    ],
)
def test_bad_options_are_refused_at_construction(make):
    with pytest.raises(ValueError, match=r"is (0|10\.5|nan|0\.0); give"):
        make()
