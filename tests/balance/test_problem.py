"""The balance: equations of motion projected onto harmonics, with exact derivatives, as equations and as a program."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.fourier import FourierBasis, resize, shift, to_complex, to_real
from hbnlp.systems import chain, duffing, tuned_absorber
from hbnlp.systems.system import System

examples = settings(max_examples=20, deadline=None)

MASS = np.array([[1.0, 0.2], [0.2, 0.8]])
DAMPING = np.array([[0.3, -0.1], [-0.1, 0.4]])
STIFFNESS = np.array([[2.0, -0.7], [-0.7, 3.0]])
LAG = np.array([[-0.5, 1.0, 0.0], [-1.0, -0.5, 0.0], [0.0, 0.0, -2.0]])
LAG_INPUT = np.array([[0.3, 0.0], [0.1, -0.2], [0.0, 0.4]])
LAG_MOTION = np.array([[0.2], [0.0], [-0.5]])
LAG_OUTPUT = np.array([[0.4, -0.3, 0.2], [0.1, 0.5, -0.6]])
K_U, D_U, M_U = np.array([[0.7], [0.2]]), np.array([[0.1], [-0.3]]), np.array([[0.5], [0.4]])
PARAMETERS = {"a": 0.7, "b": -0.4, "c": 0.9, "mean": 0.2, "lag": 1.1, "load": 0.6, "omega": 1.3}


def force(q, v, tau, p):
    """Couples the degrees of freedom; of displacement, velocity, phase, parameters and omega."""
    return [
        p.a * q[0] ** 3 + p.b * q[1] ** 2 * v[0],
        p.c * q[0] * ca.cos(tau) + p.a * v[1] ** 3 + p.omega * q[0] * q[1],
    ]


def everything(*, matrices_with_omega=False):
    """A system with every term of the coupled form, each with a parameter in it."""
    return System(
        lambda p: p.c * ca.DM(MASS),
        lambda p: ca.DM(DAMPING) * (p.a + (0.3 * p.omega if matrices_with_omega else 0.0)),
        lambda p: ca.DM(STIFFNESS) + p.b * ca.DM.eye(2),
        nonlinear_force=force,
        forcing=lambda tau, p: [0.2 + p.load * ca.sin(tau), p.b * ca.cos(3 * tau + 0.5)],
        parameters=PARAMETERS,
        lag_state=LAG,
        lag_input=LAG_INPUT,
        lag_motion=LAG_MOTION,
        lag_output=lambda p: p.lag * ca.DM(LAG_OUTPUT),
        motion=lambda tau, p: [p.mean + ca.sin(tau) + p.c * ca.cos(2 * tau)],
        input_stiffness=lambda p: p.a * ca.DM(K_U),
        input_damping=D_U,
        input_mass=lambda p: ca.DM(M_U) * (p.c + (0.2 * p.omega if matrices_with_omega else 0.0)),
        outputs={
            "x1": lambda s: s.q[0],
            "v2": lambda s: s.v[1],
            "a1": lambda s: s.a[0],
            "lag3": lambda s: s.x[2],
            "motion": lambda s: s.u[0],
            "rate": lambda s: s.du[0],
            "square": lambda s: s.q[0] ** 2,
        },
    )


SYSTEMS = {
    "everything": (everything(), 3, 1),
    "everything over two periods": (everything(), 4, 2),
    "everything over three periods": (everything(), 3, 3),
    "matrices that depend on omega": (everything(matrices_with_omega=True), 2, 1),
    "linear with lags": (
        System(MASS, DAMPING, STIFFNESS, lag_state=LAG, lag_input=LAG_INPUT, lag_output=LAG_OUTPUT),
        3,
        1,
    ),
    "Duffing": (duffing(), 5, 1),
    "absorber": (tuned_absorber(), 3, 1),
    "chain": (chain(3), 3, 1),
}


@pytest.fixture(params=SYSTEMS.values(), ids=SYSTEMS.keys(), scope="module")
def point(request):
    """A balance with a random point and parameter values off their defaults."""
    system, n_harmonics, periods = request.param
    problem = HarmonicBalance(system, n_harmonics, periods=periods)
    rng = np.random.default_rng(5)
    values = problem.values({"omega": 1.3}) * rng.uniform(0.9, 1.1, len(system.parameters.names))
    return problem, rng.uniform(-1.0, 1.0, problem.size), values


def differences(function, at, index, step=1e-5):
    """The central difference of fourth order by one entry of ``at``."""
    unit = np.zeros_like(at)
    unit[index] = step * max(1.0, abs(at[index]))
    near, far = function(at + unit) - function(at - unit), function(at + 2 * unit) - function(at - 2 * unit)
    return (8.0 * near - far) / (12.0 * unit[index])


# -- the residual ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("periods", [1, 2, 3])
def test_the_residual_is_the_equation_of_motion_projected_on_the_harmonics(periods):
    """Everything sampled in time, lag states by a linear solve for each harmonic, in plain numpy."""
    problem = HarmonicBalance(everything(), 4, periods=periods)
    p = dict(PARAMETERS, omega=1.7)
    x = np.random.default_rng(2).uniform(-1.0, 1.0, problem.shape)
    rate = p["omega"] / periods
    basis = FourierBasis(40, 400)
    tau, h = periods * basis.theta, np.arange(41)

    def signal(amplitudes, order):
        return np.real(((1j * rate * h) ** order * amplitudes) @ np.exp(1j * np.multiply.outer(h, basis.theta)))

    q_h = to_complex(resize(x, 40))
    u_h = to_complex(basis.projection @ (p["mean"] + np.sin(tau) + p["c"] * np.cos(2 * tau)))[None]
    (q, v, a), (u, du, ddu) = ([signal(each, k) for k in range(3)] for each in (q_h, u_h))
    drive = (1j * rate * h) ** 2 * (LAG_INPUT @ q_h + LAG_MOTION @ u_h)
    lag_h = np.stack([np.linalg.solve(1j * rate * k * np.eye(3) - LAG, drive[:, k]) for k in h], axis=1)
    cubic = [
        p["a"] * q[0] ** 3 + p["b"] * q[1] ** 2 * v[0],
        p["c"] * q[0] * np.cos(tau) + p["a"] * v[1] ** 3 + p["omega"] * q[0] * q[1],
    ]
    left = p["c"] * MASS @ a + p["a"] * DAMPING @ v + (STIFFNESS + p["b"] * np.eye(2)) @ q + np.array(cubic)
    right = p["lag"] * LAG_OUTPUT @ signal(lag_h, 0) + p["a"] * K_U @ u + D_U @ du + p["c"] * M_U @ ddu
    right += [0.2 + p["load"] * np.sin(tau), p["b"] * np.cos(3 * tau + 0.5)]
    expected = ((left - right) @ basis.projection.T)[:, : problem.shape[1]].ravel()

    fine = HarmonicBalance(problem.system, 4, periods=periods, n_samples=64)
    np.testing.assert_allclose(fine.assembly.residual(x.ravel(), fine.values(p)), expected, atol=1e-12)


def test_the_program_and_the_assembly_have_the_same_residual(point):
    problem, x, values = point
    symbolic = problem.residual(x, values).full().ravel()
    size = problem.assembly.term_size(x, values)
    np.testing.assert_allclose(problem.assembly.residual(x, values), symbolic, atol=1e-12 * size)


def test_the_load_scales_the_excitation_alone(point):
    problem, x, values = point
    residual, slope = problem.assembly.residual, problem.assembly.load_derivative(values)
    at_rest = residual(np.zeros_like(x), values, 0.0) - residual(np.zeros_like(x), values, 1.0)
    np.testing.assert_allclose(slope, -at_rest, atol=1e-13)
    np.testing.assert_allclose(residual(x, values, 2.5), residual(x, values, 0.0) + 2.5 * slope, atol=1e-12)


def test_arrays_from_the_assembly_belong_to_the_caller(point):
    problem, x, values = point
    assembly = problem.assembly
    calls = [assembly.residual, assembly.jacobian, lambda *a: assembly.jacobian_along(*a, x)]
    calls.append(lambda *a: assembly.parameter_derivative(*a, 0))
    first = [call(x, values) for call in calls]
    copies = [array.copy() for array in first]
    for call in calls:
        call(x + 0.1, values + 0.1)
    for array, copy in zip(first, copies, strict=True):
        np.testing.assert_array_equal(array, copy)


# -- derivatives -------------------------------------------------------------------------------------------------------


def test_the_jacobian_is_exact(point):
    problem, x, values = point
    assembled, symbolic = problem.assembly.jacobian(x, values), problem.jacobian(x, values).full()
    size = np.abs(symbolic).max()
    np.testing.assert_allclose(assembled, symbolic, atol=1e-12 * size)
    columns = [differences(lambda y: problem.assembly.residual(y, values), x, j) for j in range(x.size)]
    np.testing.assert_allclose(assembled, np.transpose(columns), atol=1e-9 * size)


def test_the_derivative_by_every_parameter_is_exact(point):
    problem, x, values = point
    names = problem.system.parameters.names
    symbolic = ca.Function("by_p", [problem.x, problem.p], [ca.jacobian(problem.g, problem.p)])(x, values).full()
    for index, name in enumerate(names):
        assembled = problem.assembly.parameter_derivative(x, values, index)
        size = max(1.0, np.abs(assembled).max())
        np.testing.assert_allclose(assembled, symbolic[:, index], atol=1e-12 * size, err_msg=name)
        by_difference = differences(lambda p: problem.assembly.residual(x, p), values, index)
        np.testing.assert_allclose(assembled, by_difference, atol=1e-8 * size, err_msg=name)


def test_the_derivative_by_a_parameter_scales_its_excitation_with_the_load(point):
    problem, x, values = point
    for index in range(values.size):
        assembled = problem.assembly.parameter_derivative(x, values, index, 0.3)
        by_difference = differences(lambda p: problem.assembly.residual(x, p, 0.3), values, index)
        np.testing.assert_allclose(assembled, by_difference, atol=1e-8 * max(1.0, np.abs(assembled).max()))


def test_the_jacobian_along_a_direction_is_its_derivative(point):
    problem, x, values = point
    along = np.random.default_rng(8).uniform(-1.0, 1.0, x.size)
    for index in (None, *range(values.size)):
        unit = np.zeros(values.size) if index is None else np.eye(values.size)[index]
        for dx in (along, None):
            if dx is None and index is None:
                continue
            direction = np.zeros(x.size) if dx is None else dx

            def jacobian(step, direction=direction, unit=unit):
                return problem.assembly.jacobian(x + step[0] * direction, values + step[0] * unit)

            found = problem.assembly.jacobian_along(x, values, dx, index)
            size = max(1.0, np.abs(found).max())
            np.testing.assert_allclose(found, differences(jacobian, np.zeros(1), 0, 1e-4), atol=1e-8 * size)


def test_derivatives_follow_when_a_parameter_changes_and_changes_back():
    """Matrices and excitation are kept while their parameters stay: nothing stale may come out."""
    problem = HarmonicBalance(everything(matrices_with_omega=True), 2)
    x = np.random.default_rng(1).uniform(-1.0, 1.0, problem.size)
    here = problem.values()
    for index in range(here.size):
        there = here.copy()
        there[index] *= 1.3
        for values in (here, there, here):
            fresh = HarmonicBalance(problem.system, 2).assembly
            np.testing.assert_array_equal(problem.assembly.residual(x, values), fresh.residual(x, values))
            np.testing.assert_array_equal(problem.assembly.jacobian(x, values), fresh.jacobian(x, values))
            for k in range(here.size):
                slope = fresh.parameter_derivative(x, values, k)
                np.testing.assert_array_equal(problem.assembly.parameter_derivative(x, values, k), slope)


# -- known responses ---------------------------------------------------------------------------------------------------


def linear_solution(problem, at):
    x, values = np.zeros(problem.size), problem.values(at)
    x = -np.linalg.solve(problem.assembly.jacobian(x, values), problem.assembly.residual(x, values))
    assert np.abs(problem.assembly.residual(x, values)).max() < 1e-12
    return x, values


def test_a_linear_oscillator_answers_every_harmonic_and_the_static_load():
    """q_h = F_h / (k - h^2 w^2 m + i h w c) for h = 0, 1, 2, 5, each with its own phase."""
    mass, damping, stiffness, omega = 1.3, 0.2, 2.1, 0.8
    loads = {0: 0.4, 1: 0.5 - 0.2j, 2: 0.3j, 5: -0.7 + 0.1j}

    def forcing(tau, _):
        return [sum(f.real * ca.cos(h * tau) - f.imag * ca.sin(h * tau) for h, f in loads.items())]

    problem = HarmonicBalance(System(mass, damping, stiffness, forcing=forcing), 6)
    x, values = linear_solution(problem, {"omega": omega})
    found = problem.output_harmonics(x, values)[0, 0]
    exact = np.zeros(7, dtype=complex)
    for h, f in loads.items():
        exact[h] = f / (stiffness - (h * omega) ** 2 * mass + 1j * h * omega * damping)
    np.testing.assert_allclose(found, exact, atol=1e-14)


def test_a_moved_base_drives_through_spring_and_damper_with_its_inertia():
    """m (q'' + u'') + c q' + k q = 0 for the displacement relative to a base that moves by u."""
    mass, damping, stiffness, omega = 1.3, 0.2, 2.1, 0.9
    motions = {0: 0.3, 1: -1j, 3: 0.4}
    system = System(
        mass,
        damping,
        stiffness,
        motion=lambda tau, p: [0.3 + ca.sin(tau) + 0.4 * ca.cos(3 * tau)],
        input_mass=[[-mass]],
    )
    problem = HarmonicBalance(system, 4)
    x, values = linear_solution(problem, {"omega": omega})
    for h, u in motions.items():
        s = 1j * h * omega
        exact = -mass * s**2 * u / (mass * s**2 + damping * s + stiffness)
        assert problem.output_harmonics(x, values)[0, 0, h] == pytest.approx(exact, abs=1e-14)


def test_lag_states_act_through_their_transfer_function():
    system = SYSTEMS["linear with lags"][0]
    forced = System(
        MASS,
        DAMPING,
        STIFFNESS,
        lag_state=LAG,
        lag_input=LAG_INPUT,
        lag_output=LAG_OUTPUT,
        forcing=lambda tau, p: [0.3 + ca.cos(tau), ca.sin(2 * tau)],
        outputs={**{f"x{i + 1}": lambda s, i=i: s.q[i] for i in range(2)}, "lag": lambda s: s.x[1]},
    )
    assert system.n_lags == 3
    problem = HarmonicBalance(forced, 2)
    x, values = linear_solution(problem, {"omega": 1.1})
    found = problem.output_harmonics(x, values)[0]
    for h, load in enumerate([[0.3, 0.0], [1.0, 0.0], [0.0, -1j]]):
        s = 1.1j * h
        lag = s**2 * np.linalg.solve(s * np.eye(3) - LAG, LAG_INPUT)
        q = np.linalg.solve(s**2 * MASS + s * DAMPING + STIFFNESS - LAG_OUTPUT @ lag, load)
        np.testing.assert_allclose(found[:2, h], q, atol=1e-14)
        assert found[2, h] == pytest.approx((lag @ q)[1], abs=1e-14)


def test_the_duffing_residual_with_one_harmonic_is_the_closed_form():
    """(1 - W^2 + 3/4 g A^2) (a, b) + 2 z W (b, -a) - (F, 0)."""
    problem = HarmonicBalance(duffing(damping_ratio=0.05, cubic=0.3, force=0.2), 1)
    a, b, w = 0.7, -0.4, 1.4
    detuning, drag = 1 - w**2 + 0.75 * 0.3 * (a**2 + b**2), 2 * 0.05 * w
    residual = problem.assembly.residual(np.array([0.0, a, b]), problem.values({"omega": w}))
    np.testing.assert_allclose(residual, [0.0, detuning * a + drag * b - 0.2, detuning * b - drag * a], atol=1e-15)


# -- symmetries --------------------------------------------------------------------------------------------------------


@examples
@given(st.integers(0, 2**32 - 1), st.sampled_from([duffing(), chain(2), tuned_absorber()]))
def test_a_sign_flip_with_a_shift_by_half_a_period_takes_residuals_to_residuals(seed, system):
    problem = HarmonicBalance(system, 3)
    x = np.random.default_rng(seed).normal(size=problem.shape)
    values = problem.values({"omega": 1.2})

    def mirrored(coefficients):
        return -shift(coefficients.reshape(problem.shape), np.pi).ravel()

    image = problem.assembly.residual(mirrored(x), values)
    np.testing.assert_allclose(image, mirrored(problem.assembly.residual(x.ravel(), values)), atol=1e-11)


@examples
@given(st.integers(0, 2**32 - 1), st.floats(-10.0, 10.0))
def test_without_forcing_any_shift_in_time_takes_residuals_to_residuals(seed, phase):
    problem = HarmonicBalance(duffing(force=0.0), 4)
    x = np.random.default_rng(seed).normal(size=problem.shape)
    values = problem.values({"omega": 1.2})
    image = problem.assembly.residual(shift(x, phase).ravel(), values)
    expected = shift(problem.assembly.residual(x.ravel(), values).reshape(problem.shape), phase)
    np.testing.assert_allclose(image, expected.ravel(), atol=1e-10)


@examples
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_other_units_of_length_and_time_scale_the_residual(seed, length, time):
    """x -> L x, t -> T t: the residual of the equation per mass scales with L / T^2."""
    x = np.random.default_rng(seed).normal(size=7)

    def residual(length, time):
        system = System(
            1.0,
            0.1 / time,
            1.0 / time**2,
            nonlinear_force=lambda q, v, tau, p: [
                0.3 / (length * time) ** 2 * q[0] ** 3 + 0.1 * time / length**2 * v[0] ** 3
            ],
            forcing=lambda tau, p: [length / time**2 * ca.cos(tau)],
        )
        problem = HarmonicBalance(system, 3)
        return problem.assembly.residual(length * x, problem.values({"omega": 1.2 / time})) * time**2 / length

    np.testing.assert_allclose(residual(length, time), residual(1.0, 1.0), atol=1e-10)


@examples
@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_more_periods_hold_the_solutions_of_one_period_unchanged(seed, periods):
    """Harmonic h of the period is harmonic h times ``periods`` of the long period, the others rest."""
    one = HarmonicBalance(everything(), 2, n_samples=40)
    more = HarmonicBalance(everything(), 2 * periods, periods=periods, n_samples=40 * periods)
    x = np.random.default_rng(seed).normal(size=one.shape)
    amplitudes = np.zeros((2, 2 * periods + 1), dtype=complex)
    amplitudes[:, ::periods] = to_complex(x)
    values = one.values()
    found = to_complex(more.assembly.residual(to_real(amplitudes).ravel(), values).reshape(more.shape))
    expected = np.zeros_like(found)
    expected[:, ::periods] = to_complex(one.assembly.residual(x.ravel(), values).reshape(one.shape))
    np.testing.assert_allclose(found, expected, atol=1e-11)


# -- outputs -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("periods", [1, 2])
def test_outputs_have_the_harmonics_of_their_signals(periods):
    problem = HarmonicBalance(everything(), 4, periods=periods)
    x = np.random.default_rng(4).normal(size=problem.shape)
    values = problem.values()
    h = np.arange(5)
    s = 1.3j * h / periods
    q, u = to_complex(x), np.zeros(5, dtype=complex)
    u[[0, periods, 2 * periods]] = 0.2, -1j, 0.9
    found = dict(zip(problem.system.output_names, problem.output_harmonics(x.ravel(), values)[0], strict=True))
    drive = s**2 * (LAG_INPUT @ q + LAG_MOTION @ u[None])
    lags = np.stack([np.linalg.solve(s[k] * np.eye(3) - LAG, drive[:, k]) for k in h], axis=1)
    square = FourierBasis(8, 40)
    samples = square.sampling[:, :9] @ x[0]
    expected = {"x1": q[0], "v2": s * q[1], "a1": s**2 * q[0], "lag3": lags[2], "motion": u, "rate": s * u}
    expected["square"] = to_complex(square.projection @ samples**2)[:5]
    for name, harmonics in expected.items():
        np.testing.assert_allclose(found[name], harmonics, atol=1e-12, err_msg=name)


def test_amplitudes_and_coefficients_of_outputs_are_expressions_of_the_program():
    problem = HarmonicBalance(everything(), 3)
    x, values = np.random.default_rng(4).normal(size=problem.size), problem.values()
    rows = [
        problem.output("v2"),
        problem.amplitude_squared("v2", 2),
        problem.coefficients(1),
        problem.symbol("load"),
    ]
    v2, squared, second, load = (e.full().ravel() for e in ca.Function("f", [problem.x, problem.p], rows)(x, values))
    harmonics = problem.output_harmonics(x, values)[0, problem.system.output_index("v2")]
    np.testing.assert_allclose(v2, to_real(harmonics), atol=1e-14)
    assert squared[0] == pytest.approx(abs(harmonics[2]) ** 2, rel=1e-13)
    np.testing.assert_array_equal(second, x[7:])
    assert load == 0.6


def test_many_points_are_evaluated_at_once():
    problem = HarmonicBalance(duffing(), 3)
    rng = np.random.default_rng(0)
    x, values = rng.normal(size=(5, problem.size)), np.tile(problem.values({"omega": 1.0}), (5, 1))
    together = problem.output_harmonics(x, values)
    assert together.shape == (5, 1, 4)
    np.testing.assert_array_equal(together, [problem.output_harmonics(x[i], values[i])[0] for i in range(5)])
    np.testing.assert_allclose(together[:, 0], to_complex(x), atol=1e-14)


def test_a_system_without_outputs_has_none():
    problem = HarmonicBalance(System(1.0, 0.1, 1.0, outputs={}), 2)
    assert problem.output_harmonics(np.zeros((3, 5)), np.ones((3, 1))).shape == (3, 0, 3)


# -- the program -------------------------------------------------------------------------------------------------------

# x'' + .05 x' + x + .1 x^3 = .18 cos 1.2 t, H = 11: the smallest of three solutions (test_solving.py)
SMALLEST = 0.4175204536


def test_casadi_solves_the_program_as_it_is():
    problem = HarmonicBalance(duffing(), 11)
    values = problem.values({"omega": 1.2})
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-12}}
    solver = ca.nlpsol("solver", "ipopt", problem.nlp, options)
    by_ipopt = solver(x0=0.0, p=values, lbg=0.0, ubg=0.0)["x"].full().ravel()
    assert solver.stats()["success"]
    equations = {"x": problem.x, "p": problem.p, "g": problem.g}
    by_newton = ca.rootfinder("root", "newton", equations)(x0=0.0, p=values)["x"].full().ravel()
    function = ca.rootfinder("root", "newton", problem.residual)(np.zeros(problem.size), values).full().ravel()
    for x in (by_ipopt, by_newton, function):
        assert np.hypot(x[1], x[2]) == pytest.approx(SMALLEST, abs=1e-10)


def test_the_program_can_be_given_an_objective_and_a_free_parameter():
    """The least force that reaches amplitude 1 at resonance of the linear oscillator is 2 z."""
    problem = HarmonicBalance(duffing(damping_ratio=0.05, cubic=0.0), 1)
    free = ca.MX.sym("force")
    names = problem.system.parameters.names
    at = ca.vertcat(*(free if name == "force" else problem.symbol(name) for name in names))
    g = ca.vertcat(ca.substitute(problem.g, problem.p, at), problem.amplitude_squared("x") - 1.0)
    program = {"x": ca.vertcat(problem.x, free), "p": problem.p, "f": free, "g": g}
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-12}}
    solver = ca.nlpsol("solver", "ipopt", program, options)
    answer = solver(x0=[0.0, 0.1, 0.5, 0.3], p=problem.values({"omega": 1.0}), lbx=[-10, -10, -10, 0], lbg=0.0, ubg=0.0)
    assert solver.stats()["success"]
    assert float(answer["f"]) == pytest.approx(0.1, abs=1e-10)


# -- construction ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["n_harmonics", "periods"])
@pytest.mark.parametrize("value", [0, -1, 2.5, "3", None])
def test_numbers_of_harmonics_and_periods_are_whole_and_positive(name, value):
    if (name, value) == ("n_harmonics", None):  # which means that there is a tolerance
        with pytest.raises(TypeError, match=r"neither is given; give n_harmonics=7.* or tolerance=1e-4"):
            HarmonicBalance(duffing())
        return
    options = {"n_harmonics": 3, "periods": 1, name: value}
    with pytest.raises(ValueError, match=f"{name} is {value!r}; give an integer from 1"):
        HarmonicBalance(duffing(), **options)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"n_harmonics": 3, "tolerance": 1e-4}, TypeError, "n_harmonics is 3, tolerance 0.0001; give n_harmonics=7"),
        ({"n_harmonics": 3, "most_harmonics": 9}, TypeError, "most_harmonics is 9, which goes with a tolerance"),
        ({"n_harmonics": 3, "outputs": ["x"]}, TypeError, "outputs is .*, which goes with a tolerance"),
        (
            {"tolerance": 1e-13},
            ValueError,
            "tolerance is 1e-13; give a finite number of at least 1e-09",
        ),
        ({"tolerance": 0.5}, ValueError, "tolerance is 0.5; give .* and of at most 0.1"),
        ({"tolerance": 1e-4, "outputs": "x"}, TypeError, r"outputs is 'x'; give a list of names, \['x'\]"),
        ({"tolerance": 1e-4, "outputs": ["y"]}, KeyError, "unknown output 'y'"),
        ({"tolerance": 1e-4, "most_harmonics": 0}, ValueError, "most_harmonics is 0; give an integer from 1"),
        ({"tolerance": 1e-4, "most_harmonics": 2, "periods": 3}, ValueError, "most_harmonics is 2; .* from 3"),
    ],
)
def test_a_tolerance_that_is_none_is_refused(options, error, message):
    with pytest.raises(error, match=message):
        HarmonicBalance(duffing(), **options)


def test_a_cap_below_the_harmonics_of_the_excitation_is_refused():
    system = System(1.0, 0.1, 1.0, forcing=lambda tau, p: [ca.cos(5 * tau)], parameters={"omega": 1.0})
    with pytest.raises(ValueError, match=r"most_harmonics is 4; give an integer from 5 .*those of the excitation"):
        HarmonicBalance(system, tolerance=1e-4, most_harmonics=4)
    assert HarmonicBalance(system, tolerance=1e-4).n_harmonics == 5


@pytest.mark.parametrize("n_samples", [0, 6, 20.5, "many"])
def test_samples_that_cannot_hold_the_harmonics_are_refused(n_samples):
    with pytest.raises(ValueError, match=r"6 samples cannot hold 3 harmonics|n_samples is .*; give an integer"):
        HarmonicBalance(duffing(), 3, n_samples=n_samples)


def test_what_is_no_system_is_refused():
    with pytest.raises(TypeError, match="system"):
        HarmonicBalance(np.eye(2), 3)


def test_a_vector_of_unknowns_is_the_array_row_by_row_cut_or_padded():
    problem = HarmonicBalance(chain(2), 2)
    array = np.arange(1.0, 15.0).reshape(2, 7)
    np.testing.assert_array_equal(problem.vector(array), [1, 2, 3, 4, 5, 8, 9, 10, 11, 12])
    np.testing.assert_array_equal(problem.vector([[1.0], [2.0]]), [1, 0, 0, 0, 0, 2, 0, 0, 0, 0])
    for shape in [(3, 5), (2, 4), (10,)]:
        with pytest.raises(ValueError, match=r"coefficients .*; give an array .*shape \(2, "):
            problem.vector(np.zeros(shape))


def test_a_harmonic_that_is_not_retained_has_no_amplitude():
    problem = HarmonicBalance(duffing(), 3)
    for harmonic in (0, 4):
        with pytest.raises(ValueError, match=f"harmonic is {harmonic}; give an integer from 1 to 3"):
            problem.amplitude_squared("x", harmonic)
    with pytest.raises(KeyError, match="unknown output 'y'"):
        problem.output("y")


def test_the_repr_says_size_samples_and_whether_they_are_exact():
    text = repr(HarmonicBalance(duffing(), 3, periods=2))
    assert text.splitlines() == [
        "HarmonicBalance of 'Duffing oscillator': 3 harmonics, 2 forcing periods, 7 unknowns",
        "  13 samples a period (settled)",
    ]
