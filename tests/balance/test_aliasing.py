"""Nothing that is sampled folds back unseen: forcing, motion and outputs of balances, solutions and branches."""

import warnings

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.core.errors import AliasingWarning
from hbnlp.fourier import basis_derivatives, basis_values, to_complex
from hbnlp.integration.settling import state_of
from hbnlp.solutions.ipopt import Ipopt
from hbnlp.solutions.solving import solve
from hbnlp.systems.response_about_rest import linear_response
from hbnlp.systems.system import System
from hbnlp.testing import check_branch

ONE = [[1.0]]


def forced(signal, **parameters):
    return System(
        ONE,
        [[0.2]],
        ONE,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        forcing=lambda tau, p: [signal(tau, p)],
        parameters=parameters,
    )


def square_wave(tau, _):
    return -26.0 * ca.sign(ca.sin(tau))


@pytest.mark.parametrize("n_harmonics", [15, 31])
def test_a_square_wave_is_its_series(n_harmonics):
    def series(tau, _):
        return -26.0 * 4.0 / np.pi * sum(ca.sin(k * tau) / k for k in range(1, n_harmonics + 1, 2))

    first, second = (
        solve(HarmonicBalance(forced(signal), n_harmonics), at={"omega": 1.1}) for signal in (square_wave, series)
    )
    np.testing.assert_allclose(first.coefficients, second.coefficients, atol=1e-11)


def test_a_square_wave_converges_to_the_motion_by_shooting():
    # x(0) of x'' + .2 x' + x + x^3 = -26 sgn sin(1.1 t), by DOP853 through the two halves to 1e-12
    errors = [
        abs(float(solve(HarmonicBalance(forced(square_wave), h), at={"omega": 1.1}).displacement([0.0])[0, 0]) - x)
        for h, x in ((31, 0.5469406238), (63, 0.5469406238))
    ]
    assert errors[0] < 3e-5
    assert errors[1] < 4e-6


SIGNALS = {
    "a pulse": (lambda tau, p: 1 / (p.a - ca.cos(tau)), 1.3, 1.0005),
    "a rectangle": (lambda tau, p: 3.0 * (ca.cos(tau - 0.4) > ca.cos(p.a)), 0.5, 0.05),
    "a triangle": (lambda tau, p: p.a * ca.asin(ca.sin(tau)), 1.0, 2.0),
}


@pytest.mark.parametrize("periods", [1, 2, 3])
@pytest.mark.parametrize(("signal", "default", "value"), SIGNALS.values(), ids=SIGNALS)
def test_numbers_and_symbols_agree_far_from_the_default_values(signal, default, value, periods):
    problem = HarmonicBalance(forced(signal, a=default, omega=1.3), 4, periods=periods)
    values, index = problem.values({"a": value}), problem.system.parameters.index("a")
    x = np.random.default_rng(5).normal(size=problem.size)
    numbers = problem.assembly.residual(x, values)
    np.testing.assert_allclose(problem.residual(x, values).full().ravel(), numbers, atol=1e-11 * np.abs(numbers).max())
    slope = problem.assembly.parameter_derivative(x, values, index)
    by = ca.Function("by", [problem.x, problem.p], [ca.jacobian(problem.g, problem.p)])(x, values).full()[:, index]
    np.testing.assert_allclose(by, slope, atol=1e-9 * np.abs(slope).max())


def test_harmonics_of_the_forcing_go_to_multiples_of_the_periods():
    problem = HarmonicBalance(forced(square_wave, omega=1.0), 7, periods=2)
    load = -problem.assembly.residual(np.zeros(problem.size), problem.values())
    expected = np.zeros(8, dtype=complex)
    expected[[2, 6]] = 26.0 * 4j / np.pi / np.array([1.0, 3.0])
    np.testing.assert_allclose(to_complex(load), expected, atol=1e-12)


def test_branches_in_what_moves_a_switch_hold_their_invariants():
    problem = HarmonicBalance(forced(lambda tau, p: 2.0 * (ca.cos(tau) > ca.cos(p.width)), width=0.3, omega=1.4), 6)
    check_branch(trace(problem, "width", (0.3, 2.5)))


def test_ipopt_agrees_with_newton_on_a_square_wave():
    problem = HarmonicBalance(forced(square_wave, omega=1.1), 9)
    np.testing.assert_allclose(solve(problem, method=Ipopt()).coefficients, solve(problem).coefficients, atol=1e-8)


# -- prescribed motion -------------------------------------------------------------------------------------------------


def moved(motion, **parameters):
    return System(
        ONE,
        [[0.2]],
        ONE,
        motion=lambda tau, p: [motion(tau, p)],
        input_stiffness=[[1.1]],
        input_damping=[[0.2]],
        input_mass=[[0.3]],
        lag_state=[[-0.4, 0.3], [0.0, -2.0]],
        lag_input=[[0.6], [0.1]],
        lag_output=[[0.8, -0.3]],
        lag_motion=[[0.9], [0.4]],
        parameters=parameters,
        outputs={"x": lambda s: s.q[0], "lag": lambda s: s.x[0], "u": lambda s: s.u[0]},
    )


def pulse(tau, p):
    return 1 / (p.a - ca.cos(tau - 0.3))


@pytest.mark.parametrize("motion", [pulse, lambda tau, p: p.a * ca.asin(ca.sin(tau - 0.3))], ids=["pulse", "triangle"])
def test_numbers_symbols_and_the_linear_response_agree_on_a_motion(motion):
    system = moved(motion, a=1.3, omega=1.7)
    problem = HarmonicBalance(system, 3)
    solution = solve(problem, at={"a": 1.001})
    x, values = solution.coefficients.ravel(), problem.values(solution.parameters)
    size = problem.assembly.term_size(x, values)
    np.testing.assert_allclose(problem.residual(x, values).full(), 0.0, atol=1e-9 * size)
    for output in ("x", "lag", "u"):
        first = linear_response(system, output, 1.7, at={"a": 1.001})
        assert solution.harmonics(output)[1] == pytest.approx(complex(first), rel=1e-10, abs=1e-12)


def test_initial_lag_states_add_up_every_harmonic_of_the_motion():
    a, omega = 1.0005, 1.7
    system = moved(pulse, a=a, omega=omega)
    root, h = np.sqrt(a**2 - 1.0), np.arange(1, 3000)
    u = 2.0 / root * (a - root) ** h * np.exp(-0.3j * h)
    s = 1j * omega * h[:, None, None]
    drive = (s**2)[:, 0] * np.array([0.9, 0.4]) * u[:, None]
    expected = np.linalg.solve(s * np.eye(2) - system.lag_state, drive[..., None])[..., 0].real.sum(axis=0)
    found = state_of(system, np.zeros((1, 3)), system.parameters.values())[2:]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_initial_lag_states_of_a_triangle_wave_are_those_of_the_periodic_motion():
    # x' = A x + B u'' with u' = +-1: between kinks x decays, at each it jumps by B times the change of u'
    omega = 1.7
    system = moved(lambda tau, p: ca.asin(ca.sin(tau - 0.3)), omega=omega)
    found = state_of(system, np.zeros((1, 3)), system.parameters.values())[2:]
    values, vectors = np.linalg.eig(system.lag_state)

    def flow(lapse):
        return (vectors * np.exp(values * lapse / omega)) @ np.linalg.inv(vectors)

    jump = system.lag_motion[:, 0] * 2.0 * omega
    # kinks: down at 0.3 + pi/2, up at 0.3 + 3 pi/2; after the one x = -y, after the other y
    after = np.linalg.solve(np.eye(2) + flow(np.pi), jump)
    expected = flow(0.5 * np.pi - 0.3) @ after
    np.testing.assert_allclose(found, expected, rtol=1e-10)


# -- outputs -----------------------------------------------------------------------------------------------------------

OUTPUTS = {
    "x": (lambda s: s.q[0], lambda q, v: q),
    "twelfth": (lambda s: s.q[0] ** 12, lambda q, v: q**12),
    "modulus": (lambda s: ca.fabs(s.q[0]), lambda q, v: abs(q)),
    "steep": (lambda s: ca.tanh(50 * s.v[0]), lambda q, v: np.tanh(50 * v)),
    "fraction": (lambda s: 1 / (s.q[0] ** 2 + 1e-3), lambda q, v: 1 / (q**2 + 1e-3)),
    "stop": (lambda s: ca.fmax(s.q[0] - 1.2, 0.0), lambda q, v: np.maximum(q - 1.2, 0.0)),
    "friction": (lambda s: ca.sign(s.v[0]), lambda q, v: np.sign(v)),
}


def system_with_outputs():
    return System(
        ONE,
        [[0.1]],
        ONE,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        forcing=lambda tau, p: [2.0 * ca.cos(tau)],
        outputs={name: rule for name, (rule, _) in OUTPUTS.items()},
    )


@pytest.mark.parametrize(("n_harmonics", "periods"), [(5, 1), (8, 2)])
def test_harmonics_of_outputs_are_those_of_very_many_samples(n_harmonics, periods):
    problem = HarmonicBalance(system_with_outputs(), n_harmonics, periods=periods)
    solution = solve(problem, at={"omega": 1.6})
    count = 2**18
    theta = 2 * np.pi * (np.arange(count) + 0.5) / count
    q = solution.coefficients @ basis_values(theta, n_harmonics).T
    v = solution.coefficients @ basis_derivatives(theta, n_harmonics).T * solution.omega / periods
    branch = trace(solution, "omega", (1.6, 1.601))
    for name, (_, rule) in OUTPUTS.items():
        signal = rule(q, v)
        expected = np.exp(-1j * np.arange(n_harmonics + 1)[:, None] * theta) @ signal[0] * 2 / count
        expected[0] *= 0.5
        # what the many samples are wrong by themselves: their spacing at a step, its square at a kink
        own = {"friction": 4e-5, "modulus": 1e-8, "stop": 1e-8}.get(name, 1e-10)
        for found in (solution.harmonics(name), branch.harmonics(name)[0]):
            np.testing.assert_allclose(found, expected, atol=own * np.abs(signal).max())


def test_a_friction_force_has_the_harmonics_of_a_square_wave():
    system = System(
        ONE,
        [[0.5]],
        ONE,
        forcing=lambda tau, p: [ca.cos(tau)],
        outputs={"friction": lambda s: ca.sign(s.v[0])},
    )
    found = solve(HarmonicBalance(system, 7), at={"omega": 0.9}).harmonics("friction")
    np.testing.assert_allclose(
        np.abs(found), [0, 4 / np.pi, 0, 4 / np.pi / 3, 0, 4 / np.pi / 5, 0, 4 / np.pi / 7], atol=1e-11
    )


def test_a_program_warns_of_an_output_that_switches_and_is_exact_for_one_that_does_not():
    problem = HarmonicBalance(system_with_outputs(), 5)
    solution = solve(problem, at={"omega": 1.6})
    for name in ("x", "twelfth", "steep", "fraction"):
        found = to_complex(solution(problem.output(name)))
        np.testing.assert_allclose(found, solution.harmonics(name), atol=1e-8 * np.abs(solution.harmonics(name)).max())
    for name, exact in (("modulus", 3e-6), ("friction", 5e-3)):
        with pytest.warns(AliasingWarning, match=f"output '{name}' switches"):
            found = to_complex(solution(problem.output(name)))
        np.testing.assert_allclose(found, solution.harmonics(name), atol=exact)


@pytest.mark.parametrize(
    ("output", "exact"),
    [
        pytest.param(lambda s: s.p.gain * s.x[0] - s.x[1] + s.q[0] ** 3, 1e-12, id="linear"),
        pytest.param(lambda s: s.x[0] * s.q[0], 1e-12, id="product"),
        pytest.param(lambda s: s.x[0] * ca.cos(s.tau), 1e-12, id="by phase"),
        pytest.param(lambda s: s.x[1] ** 2, 1e-12, id="square"),
        pytest.param(lambda s: ca.sign(s.x[0]), 5e-3, id="sign"),
        pytest.param(lambda s: ca.if_else(s.x[0] > 0.0, s.q[0], 2.0 * s.q[0]), 5e-3, id="either"),
        pytest.param(lambda s: ca.floor(4.0 * s.x[0]) + s.x[1], 2e-2, id="floor"),
        pytest.param(lambda s: ca.fabs(s.x[1]), 5e-3, id="modulus"),
    ],
)
def test_programs_know_outputs_of_lag_states(output, exact):
    """Those that are linear in them take no samples of them; a step has the derivative zero and is not linear."""
    system = System(
        ONE,
        [[0.5]],
        ONE,
        forcing=lambda tau, p: [0.5 * ca.cos(tau)],
        lag_state=np.diag([-1.0, -3.0]),
        lag_input=[[1.0], [0.5]],
        lag_output=[[0.1, 0.2]],
        parameters={"gain": 2.0},
        outputs={"output": output},
    )
    problem = HarmonicBalance(system, 5)
    solution = solve(problem, at={"omega": 1.3})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AliasingWarning)
        found = to_complex(solution(problem.output("output")))
    np.testing.assert_allclose(found, solution.harmonics("output"), atol=exact)


def test_a_singular_output_is_said_to_be_so():
    system = System(ONE, [[0.5]], ONE, forcing=lambda tau, p: [ca.cos(tau)], outputs={"inverse": lambda s: 1 / s.q[0]})
    with pytest.warns(AliasingWarning, match="outputs inverse are known to"):
        solve(HarmonicBalance(system, 2), at={"omega": 0.9})


def test_an_output_that_does_not_repeat_itself_is_said_to_have_no_harmonics():
    system = System(
        ONE,
        [[0.5]],
        ONE,
        forcing=lambda tau, p: [ca.cos(tau)],
        outputs={"slip": lambda s: s.q[0] * ca.cos(s.p.omega * s.tau), "half": lambda s: s.q[0] * ca.cos(s.tau / 2)},
    )
    with pytest.warns(AliasingWarning, match="outputs slip, half do not repeat themselves"):
        solve(HarmonicBalance(system, 2), at={"omega": 0.9})
    with pytest.warns(AliasingWarning, match="outputs slip do not repeat themselves"):
        found = solve(HarmonicBalance(system, 4, periods=2), at={"omega": 0.9}).harmonics("half")
    np.testing.assert_allclose(abs(found[1]), abs(found[3]), rtol=1e-9)
