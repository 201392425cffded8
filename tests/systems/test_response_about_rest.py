"""Linear frequency response, against transfer functions written down by hand."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.systems import duffing
from hbnlp.systems.response_about_rest import linear_response
from hbnlp.systems.system import System


def with_everything():
    """Return one degree of freedom with a lag, a prescribed motion, a force and outputs of every signal."""
    return System(
        [[2.0]],
        [[0.3]],
        [[5.0]],
        nonlinear_force=lambda q, v, tau, p: [4.0 * q[0] ** 3 + 0.7 * q[0]],
        forcing=lambda tau, p: [p.force * ca.cos(tau) + 9.0],
        motion=lambda tau, p: [0.5 * ca.sin(tau) + ca.cos(3 * tau)],
        input_stiffness=[[1.1]],
        input_damping=[[1.2]],
        input_mass=[[1.3]],
        lag_state=[[-0.4]],
        lag_input=[[0.6]],
        lag_output=[[0.8]],
        lag_motion=[[0.9]],
        parameters={"force": 0.2},
        outputs={
            "q": lambda s: s.q[0],
            "load": lambda s: 1.0 + 2 * s.q[0] + 3 * s.v[0] + 4 * s.a[0] + 5 * s.x[0] + 6 * s.u[0] + 7 * s.ddu[0],
            "square": lambda s: s.q[0] ** 2,
        },
    )


def test_linear_response_is_the_transfer_function():
    omega = np.array([[0.3, 1.0], [2.5, 20.0]])
    s = 1j * omega
    u = -0.5j
    lag = 1 / (s + 0.4)
    dynamic = 5.7 + 0.3 * s + 2.0 * s**2 - 0.8 * lag * 0.6 * s**2
    q = (0.2 + (1.1 + 1.2 * s + 1.3 * s**2 + 0.8 * lag * 0.9 * s**2) * u) / dynamic
    x = lag * s**2 * (0.6 * q + 0.9 * u)
    system = with_everything()
    np.testing.assert_allclose(linear_response(system, "q", omega), q, rtol=1e-12)
    load = 2 * q + 3 * s * q + 4 * s**2 * q + 5 * x + 6 * u + 7 * s**2 * u
    np.testing.assert_allclose(linear_response(system, "load", omega), load, rtol=1e-12)
    np.testing.assert_array_equal(linear_response(system, "square", omega), 0.0)


def test_held_response_leaves_the_motion_and_its_lags():
    s = 1j * 1.7
    u = -0.5j
    expected = 5 * 0.9 * s**2 / (s + 0.4) * u + 6 * u + 7 * s**2 * u
    assert linear_response(with_everything(), "load", 1.7, held=True) == pytest.approx(expected, rel=1e-12)
    assert linear_response(with_everything(), "q", 1.7, held=True) == 0.0


def test_matrices_that_depend_on_frequency_are_followed():
    system = System([[1.0]], lambda p: [[0.1 / p.omega]], [[1.0]], forcing=lambda tau, p: [ca.sin(tau)])
    omega = np.array([0.5, 2.0])
    np.testing.assert_allclose(linear_response(system, "x", omega), -1j / (1 - omega**2 + 0.1j), rtol=1e-12)


def test_response_overrides_parameters():
    a = linear_response(duffing(force=0.1), "x", 2.0, at={"force": 0.3, "damping_ratio": 0.2})
    assert a == pytest.approx(0.3 / (1 - 4 + 2j * 0.2 * 2.0), rel=1e-13)


def test_unknown_outputs_are_refused():
    with pytest.raises(KeyError, match="unknown output 'y'"):
        linear_response(duffing(), "y", 1.0)
