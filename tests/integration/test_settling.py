"""Direct integration: against exact frequency responses and harmonic balance of many harmonics."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from hbnlp.core.callbacks import StopTracing
from hbnlp.core.errors import ConvergenceError
from hbnlp.fourier import to_real
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.first_order import FirstOrderForm
from hbnlp.integration.runge_kutta import RungeKutta4
from hbnlp.integration.settling import integrate, state_of
from hbnlp.systems import duffing
from hbnlp.systems.system import System
from hbnlp.wing.membrane import NonlinearMembrane

MASS = np.array([[1.0, 0.2], [0.2, 0.8]])
DAMPING = np.array([[0.3, -0.1], [-0.1, 0.4]])
STIFFNESS = np.array([[2.0, -0.7], [-0.7, 3.0]])
LAG = np.array([[-0.5, 1.0, 0.0], [-1.0, -0.5, 0.0], [0.0, 0.0, -2.0]])
LAG_INPUT = np.array([[0.3, 0.0], [0.1, -0.2], [0.0, 0.4]])
LAG_MOTION = np.array([[0.2], [0.0], [-0.5]])
LAG_OUTPUT = np.array([[0.4, -0.3, 0.2], [0.1, 0.5, -0.6]])
K_U, D_U, M_U = np.array([[0.7], [0.2]]), np.array([[0.1], [-0.3]]), np.array([[0.5], [0.4]])


def oscillators_with_lags():
    """Two oscillators with three lag states, moved by u = sin + .3 cos 2 and loaded by a constant and a cosine."""
    return System(
        MASS,
        DAMPING,
        STIFFNESS,
        forcing=lambda tau, p: [0.2, 0.5 * ca.cos(tau)],
        motion=lambda tau, p: [ca.sin(tau) + 0.3 * ca.cos(2 * tau)],
        input_stiffness=K_U,
        input_damping=D_U,
        input_mass=M_U,
        lag_state=LAG,
        lag_input=LAG_INPUT,
        lag_motion=LAG_MOTION,
        lag_output=LAG_OUTPUT,
        outputs={"x1": lambda s: s.q[0], "load": lambda s: 2 * s.x[2] + s.a[1] - s.du[0] + s.v[0]},
    )


def exact_harmonics(omega):
    """Complex harmonics 0, 1, 2 of q (2, 3) and of the output "load" (3,)."""
    q, load = np.zeros((2, 3), complex), np.zeros(3, complex)
    for h, (u, force) in enumerate([(0.0, [0.2, 0.0]), (-1j, [0.0, 0.5]), (0.3, [0.0, 0.0])]):
        s = 1j * h * omega
        lag = np.linalg.inv(s * np.eye(3) - LAG) * s**2
        dynamic = s**2 * MASS + s * DAMPING + STIFFNESS - LAG_OUTPUT @ lag @ LAG_INPUT
        right = (K_U + s * D_U + s**2 * M_U + LAG_OUTPUT @ lag @ LAG_MOTION)[:, 0] * u + np.array(force)
        q[:, h] = np.linalg.solve(dynamic, right)
        x = lag @ (LAG_INPUT @ q[:, h] + LAG_MOTION[:, 0] * u)
        load[h] = 2 * x[2] + s**2 * q[1, h] - s * u + s * q[0, h]
    return q, load


def oscillator(damping=0.0, force=0.0, **options):
    return System([[1.0]], [[damping]], [[1.0]], forcing=lambda tau, p: [force * ca.cos(tau)], **options)


def test_a_linear_system_with_lags_has_its_exact_frequency_response():
    q, load = exact_harmonics(1.3)
    response = integrate(oscillators_with_lags(), at={"omega": 1.3}, method=Adaptive(), periodic_tol=1e-9)
    assert response.periodic
    np.testing.assert_allclose(response.displacement_harmonics(2), q, atol=3e-9)
    np.testing.assert_allclose(response.harmonics("load", 2), load, atol=3e-9)
    assert np.abs(response.harmonics("load", 5)[3:]).max() < 3e-9


def test_runge_kutta_is_of_fourth_order():
    q, load = exact_harmonics(1.3)
    errors = []
    for steps in (32, 64, 128):
        method = RungeKutta4(steps_per_period=steps)
        response = integrate(oscillators_with_lags(), at={"omega": 1.3}, method=method, periodic_tol=1e-12)
        errors.append(
            np.abs(response.displacement_harmonics(2) - q).max() + np.abs(response.harmonics("load", 2) - load).max()
        )
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 4.0, atol=0.15)


def test_runge_kutta_takes_the_classical_steps_also_where_they_fill_no_chunk():
    system, omega, steps = oscillators_with_lags(), 0.9, 100
    values = system.parameters.values({"omega": omega})
    load, drive = (lambda tau, i=i: system.excitation(tau, values)[i].full().ravel() for i in (0, 1))

    def rate(y, tau):
        a = np.linalg.solve(MASS, load(tau) + LAG_OUTPUT @ y[4:] - DAMPING @ y[2:4] - STIFFNESS @ y[:2])
        return np.concatenate([y[2:4], a, LAG @ y[4:] + LAG_INPUT @ a + drive(tau)]) / omega

    start = np.arange(7.0) / 10
    y, h = start, 2 * np.pi / steps
    for tau in h * np.arange(steps):
        k1 = rate(y, tau)
        k2 = rate(y + h / 2 * k1, tau + h / 2)
        k3 = rate(y + h / 2 * k2, tau + h / 2)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(y + h * k3, tau + h))
    method = RungeKutta4(steps_per_period=steps)
    response = integrate(system, at={"omega": omega}, method=method, start=start, max_periods=1, throw=False)
    np.testing.assert_allclose(response.state, y, rtol=1e-12, atol=1e-14)
    assert response.t.shape == (steps,)
    assert response.q.shape == response.v.shape == (steps, 2)
    assert response.x.shape == (steps, 3)


@pytest.mark.parametrize("method", [Adaptive(), RungeKutta4(steps_per_period=2048)])
def test_a_start_on_the_periodic_solution_has_no_transient(method):
    system = oscillators_with_lags()
    coefficients = to_real(exact_harmonics(1.3)[0])
    response = integrate(system, at={"omega": 1.3}, method=method, start=coefficients)
    assert response.n_periods == 1
    assert response.defects[0] < 3e-10
    np.testing.assert_allclose(
        state_of(system, coefficients, system.parameters.values({"omega": 1.3})), response.state, atol=1e-9
    )
    solution = SimpleNamespace(coefficients=coefficients, problem=SimpleNamespace(periods=1))
    again = integrate(system, at={"omega": 1.3}, method=method, start=solution)
    np.testing.assert_array_equal(again.state, response.state)


@pytest.mark.parametrize(
    ("initial", "amplitude"),
    [([-0.4, 0.0], 0.4175204536), ([2.2, 1.0], 2.5091975811)],  # harmonic balance, H = 11
)
def test_both_stable_duffing_responses_are_reached(initial, amplitude):
    system = duffing(damping_ratio=0.025, cubic=0.1, force=0.18)
    options = {"at": {"omega": 1.2}, "start": initial, "periodic_tol": 1e-9}
    adaptive = integrate(system, method=Adaptive(), **options)
    assert abs(adaptive.harmonics("x")[1]) == pytest.approx(amplitude, abs=1e-8)
    fixed = integrate(system, method=RungeKutta4(steps_per_period=512), **options)
    np.testing.assert_allclose(fixed.harmonics("x"), adaptive.harmonics("x"), atol=2e-8)


def test_a_subharmonic_response_needs_two_periods():
    # principal parametric resonance: x'' + .1 x' + (1 + .5 cos 2t) x + x^3 = 0 answers with frequency 1
    system = System(
        [[1.0]],
        [[0.1]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [0.5 * ca.cos(tau) * q[0] + q[0] ** 3],
        parameters={"omega": 2.0},
    )
    with pytest.raises(ConvergenceError, match="periods=2") as caught:
        integrate(system, start=[0.5, 0.0], max_periods=300)
    assert caught.value.result.defects[-1] > 1.0
    response = integrate(system, start=caught.value.result, periods=2)
    assert response.t[-1] < 2 * np.pi < response.t[-1] + 0.02
    harmonics = np.abs(response.harmonics("x", 4))
    assert harmonics[1] > 0.5
    assert harmonics[[0, 2, 4]].max() < 1e-8
    opposite = integrate(system, start=to_real(-response.displacement_harmonics(21)), periods=2)
    np.testing.assert_allclose(opposite.state, -response.state, atol=1e-6)


def test_the_nonlinear_membrane_is_integrated_as_numpy_evaluates_it():
    membrane = NonlinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
    system = System(
        membrane.mass_matrix(),
        0.1 * np.eye(10),
        membrane.stiffness_matrix(),
        nonlinear_force=lambda q, v, tau, p: membrane.nonlinear_force(q),
        forcing=lambda tau, p: p.pressure * ca.sin(tau) * np.eye(10)[0],
        parameters={"pressure": 0.5, "omega": 2.0},
    )
    form = FirstOrderForm(system)
    y, tau = 1e-2 * np.cos(np.arange(20.0)), 0.7
    load = 0.5 * np.sin(tau) * np.eye(10)[0] - 0.1 * y[10:] - membrane.restoring_force(y[:10])
    expected = np.concatenate([y[10:], load / (2 * membrane.mass_ratio)]) / 2.0
    rate = form.rate(y, tau, form.pack(system.parameters.values())).full().ravel()
    np.testing.assert_allclose(rate, expected, rtol=1e-11, atol=1e-12)
    options = {"max_periods": 2, "throw": False}
    fixed = integrate(system, method=RungeKutta4(steps_per_period=2048), **options)
    np.testing.assert_allclose(fixed.state, integrate(system, method=Adaptive(), **options).state, atol=2e-6)


def test_a_force_that_depends_on_nothing_is_not_forgotten():
    system = System([[1.0]], [[0.8]], [[2.0]], nonlinear_force=lambda q, v, tau, p: [-3.0])
    assert integrate(system, at={"omega": 1.0}).harmonics("x")[0] == pytest.approx(1.5, rel=1e-7)


def test_an_integration_can_be_stopped_by_a_callback():
    def stop(progress):
        if progress.counts["periods"] == 3:
            raise StopTracing

    response = integrate(oscillator(0.4, 1.0), at={"omega": 1.0}, callbacks=[stop], throw=False)
    assert response.n_periods == 3
    assert not response.periodic


def test_a_response_says_what_it_is_and_reports_its_progress():
    seen = []
    response = integrate(oscillator(0.4, 1.0), at={"omega": 1.0}, callbacks=[seen.append])
    assert [p.counts["periods"] for p in seen[:-1]] == list(range(1, response.n_periods + 1))
    np.testing.assert_array_equal([p.value for p in seen[:-1]], response.defects)
    assert seen[-1].done
    assert seen[-1].result() is response
    assert len(repr(response).splitlines()) <= 5
    assert "periodic after" in repr(response)
    assert response.parameters == {"omega": 1.0}
    with pytest.raises(KeyError, match="unknown output 'y'"):
        response.signal("y")
    with pytest.raises(ValueError, match="n_harmonics is 200"):
        response.harmonics("x", 200)


def test_a_response_that_does_not_settle_is_an_error_that_carries_it():
    with pytest.raises(ConvergenceError, match=r"not periodic after 3 periods.*raise max_periods") as caught:
        integrate(oscillator(0.01, 1.0), at={"omega": 1.0}, max_periods=3)
    assert caught.value.result.n_periods == 3
    assert not caught.value.result.periodic
    response = integrate(oscillator(0.01, 1.0), at={"omega": 1.0}, max_periods=3, throw=False)
    np.testing.assert_array_equal(response.state, caught.value.result.state)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"at": {"omga": 1.0}}, KeyError, "did you mean 'omega'"),
        ({"at": {}}, ValueError, "'omega' has no value"),
        ({"at": {"omega": 0.0}}, ValueError, "omega = 0; .* omega > 0"),
        ({"start": [0.0, 0.0, 0.0]}, ValueError, r"start has shape \(3,\); give an array of shape \(2,\)"),
        ({"start": [0.0, np.nan]}, ValueError, "finite real numbers"),
        ({"start": [[0.0, 1.0]]}, ValueError, r"start has shape \(1, 2\)"),
        ({"periods": 0}, ValueError, "periods is 0"),
        ({"periods": 3, "max_periods": 2}, ValueError, "max_periods is 2; .* at least 3"),
        ({"periodic_tol": 0.0}, ValueError, "periodic_tol is 0.0"),
        ({"method": "rk4"}, TypeError, r"method is 'rk4'; give RungeKutta4\(...\), Exponential.* or Adaptive"),
        ({"method": RungeKutta4}, TypeError, r"method is <class .*; give RungeKutta4\(...\)"),
        ({"callbacks": print}, TypeError, r"callbacks is .*; give a list of callables"),
    ],
)
def test_bad_input_is_named(options, error, message):
    with pytest.raises(error, match=message):
        integrate(oscillator(0.1, 1.0), **{"at": {"omega": 1.0}, **options})


def test_a_singular_mass_matrix_is_named():
    with pytest.raises(ValueError, match="mass matrix is singular"):
        integrate(System([[0.0]], [[1.0]], [[1.0]]), at={"omega": 1.0})
