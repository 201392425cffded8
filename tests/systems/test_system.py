"""A System is what its equations say, and refuses what cannot be one."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.core.errors import NonFiniteError
from hbnlp.systems.system import System

ONE = [[1.0]]
PARAMETERS = {"cubic": 0.1, "omega": 1.3}

MASS = np.array([[1.0, 0.2], [0.2, 0.8]])
DAMPING = np.array([[0.3, -0.1], [-0.1, 0.4]])
STIFFNESS = np.array([[2.0, -0.7], [-0.7, 3.0]])
LAG = np.array([[-0.5, 1.0, 0.0], [-1.0, -0.5, 0.0], [0.0, 0.0, -2.0]])
LAG_INPUT = np.array([[0.3, 0.0], [0.1, -0.2], [0.0, 0.4]])
LAG_OUTPUT = np.array([[0.4, -0.3, 0.2], [0.1, 0.5, -0.6]])


def with_lags(**options):
    return System(
        MASS,
        DAMPING,
        STIFFNESS,
        lag_state=LAG,
        lag_input=LAG_INPUT,
        lag_output=LAG_OUTPUT,
        parameters=PARAMETERS,
        **options,
    )


# -- what it holds -----------------------------------------------------------------------------------------------------


def test_arrays_callables_and_casadi_matrices_say_the_same():
    values = np.array([0.1, 1.3])
    forms = [
        [[2.0, 0.1], [0.1, 1.0]],
        np.array([[2.0, 0.1], [0.1, 1.0]]),
        ca.DM([[2.0, 0.1], [0.1, 1.0]]),
        lambda p: [[2.0, p.cubic], [p.cubic, 1.0]],
        lambda p: ca.vertcat(ca.horzcat(2.0, p.cubic), ca.horzcat(p.cubic, 1.0)),
    ]
    for form in forms:
        system = System(form, np.eye(2), np.eye(2), parameters=PARAMETERS)
        np.testing.assert_array_equal(system.matrices(values)[0].full(), [[2.0, 0.1], [0.1, 1.0]])


def test_one_degree_of_freedom_may_be_written_with_numbers():
    system = System(2.0, lambda p: p.cubic, 3.0, nonlinear_force=lambda q, v, tau, p: q**3, parameters=PARAMETERS)
    mass, damping, stiffness, _ = system.state_matrices(np.array([0.1, 1.3]))
    assert (mass, damping, stiffness) == (2.0, 0.1, 3.0)


def test_a_force_may_be_a_list_a_column_or_a_row():
    forms = [lambda q, v, tau, p: [q[0] ** 3, v[1]], lambda q, v, tau, p: ca.vertcat(q[0] ** 3, v[1])]
    forms.append(lambda q, v, tau, p: ca.horzcat(q[0] ** 3, v[1]))
    for form in forms:
        system = System(np.eye(2), np.eye(2), np.eye(2), nonlinear_force=form)
        force = ca.Function("f", [system.q, system.v], [system.force])
        np.testing.assert_array_equal(force([2.0, 3.0], [5.0, 7.0]).full().ravel(), [8.0, 7.0])


def test_the_linearisation_is_that_of_the_lag_form():
    """q'' = M^-1 (-K q - D q' + L_x x), and x' = A x + B q'' (docs/theory.md, under Stability)."""
    inverse = np.linalg.inv(MASS)
    acceleration = np.hstack([-inverse @ STIFFNESS, -inverse @ DAMPING, inverse @ LAG_OUTPUT])
    expected = np.vstack([np.eye(2, 7, k=2), acceleration, LAG_INPUT @ acceleration])
    expected[4:, 4:] += LAG
    np.testing.assert_allclose(with_lags().linearisation(), expected, atol=1e-14)


def test_the_linearisation_takes_the_tangent_of_the_force_where_it_is_asked_to():
    system = System(ONE, ONE, ONE, nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3], parameters=PARAMETERS)
    np.testing.assert_allclose(system.linearisation(), [[0.0, 1.0], [-1.0, -1.0]])
    np.testing.assert_allclose(system.linearisation(rest=[2.0]), [[0.0, 1.0], [-2.2, -1.0]])


def test_the_force_and_its_derivatives_are_compiled_once_and_agree_with_differences():
    def force(q, v, tau, p):
        return [p.cubic * q[0] ** 3 * v[1] + p.omega * q[1], ca.cos(tau) * q[1] * v[1] ** 2]

    compiled = System(np.eye(2), np.eye(2), np.eye(2), nonlinear_force=force, parameters=PARAMETERS).compiled_force
    assert compiled.derivatives is compiled.derivatives
    rng, tau = np.random.default_rng(0), 0.4
    q, v, dq, dv, p, dp = rng.uniform(-1.0, 1.0, (6, 2))
    by_q, by_v = compiled.tangents(q, v, tau, p)
    h = 1e-6
    for matrix, move_q, move_v in ((by_q, 1.0, 0.0), (by_v, 0.0, 1.0)):
        for unit, column in zip(np.eye(2), matrix.T, strict=True):
            up, down = (
                compiled.value(q + s * move_q * unit, v + s * move_v * unit, tau, p).full().ravel() for s in (h, -h)
            )
            np.testing.assert_allclose(column, (up - down) / (2 * h), atol=1e-9)
    for function, slope in ((compiled.value, compiled.along), (compiled.derivatives, compiled.derivatives_along)):
        up, down = (function(q + s * dq, v + s * dv, tau, p + s * dp).full() for s in (h, -h))
        np.testing.assert_allclose(slope(q, v, tau, p, dq, dv, dp).full(), (up - down) / (2 * h), atol=1e-9)
    np.testing.assert_array_equal(compiled.depends_on, [True, True])


def test_a_tangent_that_is_not_finite_at_rest_is_named():
    system = System(ONE, ONE, ONE, nonlinear_force=lambda q, v, tau, p: [ca.sqrt(q[0])])
    with pytest.raises(
        NonFiniteError, match="the derivative of nonlinear_force is not finite at rest; smooth it there"
    ):
        system.linearisation()


def test_the_derivatives_of_the_motion_are_by_time():
    system = System(
        ONE,
        ONE,
        ONE,
        motion=lambda tau, p: [ca.sin(tau) + 0.3 * ca.cos(2 * tau)],
        input_mass=ONE,
        parameters=PARAMETERS,
    )
    function = ca.Function("motion", [system.tau, system.p], [system.motion, *system.motion_derivatives])
    t, omega = 0.7, 1.3
    u, du, ddu = (float(e) for e in function(omega * t, [0.1, omega]))
    s, c2 = np.sin(omega * t), np.cos(2 * omega * t)
    assert u == pytest.approx(s + 0.3 * c2)
    assert du == pytest.approx(omega * np.cos(omega * t) - 0.6 * omega * np.sin(2 * omega * t))
    assert ddu == pytest.approx(-(omega**2) * s - 1.2 * omega**2 * c2)


def test_outputs_see_every_signal():
    signals = {
        "displacement": lambda s: s.q[1],
        "velocity": lambda s: s.v[0],
        "acceleration": lambda s: s.a[0],
        "lag": lambda s: s.x[2],
        "motion": lambda s: s.u[0] + 10.0 * s.du[0] + 100.0 * s.ddu[0],
        "phase": lambda s: s.tau,
        "parameter": lambda s: s.p.cubic,
        "nonlinear": lambda s: s.q[0] * s.v[1],
        "constant": lambda s: 4.0,
    }
    system = with_lags(motion=lambda tau, p: [ca.sin(tau)], outputs=signals)
    assert system.output_names == tuple(signals)
    found = system.outputs([1.0, 2.0], [3.0, 5.0], [7.0, 11.0], [13.0, 17.0, 19.0], np.pi, [0.1, 2.0]).full().ravel()
    np.testing.assert_allclose(found, [2.0, 3.0, 7.0, 19.0, -20.0, np.pi, 0.1, 5.0, 4.0], atol=1e-12)


def test_displacements_are_the_outputs_by_default():
    assert System(ONE, ONE, ONE).output_names == ("x",)
    assert with_lags().output_names == ("x1", "x2")
    assert System(ONE, ONE, ONE, outputs={}).output_names == ()


def test_a_linear_system_has_no_force_and_a_constant_one_is_kept():
    assert not System(ONE, ONE, ONE).is_nonlinear
    assert not System(ONE, ONE, ONE, nonlinear_force=lambda q, v, tau, p: [0.0]).is_nonlinear
    assert System(ONE, ONE, ONE, nonlinear_force=lambda q, v, tau, p: [1.0]).is_nonlinear


def test_the_repr_says_what_it_is_in_three_lines():
    system = with_lags(name="beam")
    assert repr(system).splitlines() == [
        "System 'beam': 2 degrees of freedom, 3 lag states",
        "  parameters: cubic=0.1, omega=1.3",
        "  outputs: x1, x2",
    ]


# -- what it refuses ---------------------------------------------------------------------------------------------------

FOREIGN, MX = ca.SX.sym("foreign"), ca.MX.sym("program")
SAME_NAME = ca.SX.sym("q")

BAD_MATRICES = {
    "a vector": ([1.0, 2.0], r"mass has shape \(2,\); a matrix is needed"),
    "not square": ([[1.0, 2.0]], r"mass has shape \(1, 2\); \(1, 1\) is needed"),
    "ragged": ([[1.0, 2.0], [1.0]], "mass has shape"),
    "nan": ([[np.nan]], "mass has entries that are not finite"),
    "infinite": ([[np.inf]], "mass has entries that are not finite"),
    "nothing": (None, "mass .*None"),
    "text": ("heavy", "mass .*heavy"),
    "complex": ([[1j]], "mass .*1j"),
    "a symbol of a program": (lambda p: [[MX]], "mass .*program"),
    "a foreign symbol": (lambda p: [[FOREIGN]], "mass uses 'foreign'"),
    "a callable of another shape": (lambda p: [[p.cubic, 0.0]], r"mass has shape \(1, 2\)"),
    "a callable that returns nothing": (lambda p: None, "mass .*None"),
    "a callable that is not finite": (lambda p: [[np.inf]], "mass has entries that are not finite"),
}


@pytest.mark.parametrize(("given", "message"), BAD_MATRICES.values(), ids=BAD_MATRICES)
def test_a_bad_matrix_is_refused_by_name(given, message):
    with pytest.raises(ValueError, match=message):
        System(given, ONE, ONE, parameters=PARAMETERS)


@pytest.mark.parametrize("what", ["damping", "stiffness"])
def test_matrices_must_have_the_size_of_the_mass_matrix(what):
    matrices = {"mass": np.eye(2), "damping": np.eye(2), "stiffness": np.eye(2), what: ONE}
    with pytest.raises(ValueError, match=rf"{what} has shape \(1, 1\); \(2, 2\) is needed"):
        System(**matrices)


BAD_FORCES = {
    "too many": (
        lambda q, v, tau, p: [q[0], q[0]],
        "returned 2 expressions; 1 is needed, one for each degree of freedom",
    ),
    "a matrix": (lambda q, v, tau, p: ca.SX.zeros(2, 2), r"returned a matrix of shape \(2, 2\)"),
    "nothing": (lambda q, v, tau, p: None, "nonlinear_force .*None"),
    "text": (lambda q, v, tau, p: "stiff", "nonlinear_force .*stiff"),
    "a symbol of a program": (lambda q, v, tau, p: [MX * 2.0], "nonlinear_force .*program"),
    "a foreign symbol": (
        lambda q, v, tau, p: [FOREIGN],
        "nonlinear_force uses 'foreign', which is neither its argument",
    ),
    "a foreign symbol that is called q": (lambda q, v, tau, p: [SAME_NAME**3], "nonlinear_force uses 'q'"),
    "infinite": (lambda q, v, tau, p: [np.inf], "nonlinear_force has entries that are not finite"),
}


@pytest.mark.parametrize(("given", "message"), BAD_FORCES.values(), ids=BAD_FORCES)
def test_a_bad_force_is_refused_by_name(given, message):
    with pytest.raises(ValueError, match=message):
        System(ONE, ONE, ONE, nonlinear_force=given)


BAD_SIGNALS = {
    "too many": (lambda tau, p: [0.0, 1.0], "returned 2 expressions; 1 is needed"),
    "nothing": (lambda tau, p: None, "None"),
    "a foreign symbol": (
        lambda tau, p: [FOREIGN],
        "forcing uses 'foreign', which is neither its argument nor a parameter",
    ),
    "not finite": (lambda tau, p: [np.nan], "forcing has entries that are not finite"),
}


@pytest.mark.parametrize(("given", "message"), BAD_SIGNALS.values(), ids=BAD_SIGNALS)
def test_a_bad_forcing_is_refused_by_name(given, message):
    with pytest.raises(ValueError, match=message):
        System(ONE, ONE, ONE, forcing=given)


NOT_PERIODIC = {
    "omega t": (lambda tau, p: ca.cos(p.omega * tau), r"tau = omega t holds omega already: write cos\(tau\)"),
    "twice omega t": (lambda tau, p: p.omega * ca.cos(2 * p.omega * tau), "holds omega already"),
    "a step of omega t": (lambda tau, p: ca.sign(ca.sin(p.omega * tau)), "holds omega already"),
    "over omega": (lambda tau, p: ca.cos(tau / p.omega), "holds omega already"),
    "a half": (lambda tau, p: ca.cos(tau / 2), "after 2 periods: let omega be the frequency of the whole, 1/2 of"),
    "two thirds": (lambda tau, p: ca.cos(2 * tau / 3) + ca.cos(tau), "write tau for tau / 3 and 3 tau for tau"),
    "tau": (lambda tau, p: tau, r"or of fmod\(tau, 2 pi\)"),
    "incommensurable": (lambda tau, p: ca.cos(1.234 * tau), "whole multiples of tau"),
    "a small part": (lambda tau, p: ca.cos(tau) + 1e-6 * ca.cos(p.omega * tau), "holds omega already"),
}


@pytest.mark.parametrize("omega", [1.0, 2.0, np.nan])
@pytest.mark.parametrize(("signal", "message"), NOT_PERIODIC.values(), ids=NOT_PERIODIC)
def test_what_is_not_periodic_is_refused_whatever_omega_is_by_default(signal, message, omega):
    given = {
        "forcing": lambda tau, p: [signal(tau, p)],
        "motion": lambda tau, p: [signal(tau, p)],
        "nonlinear_force": lambda q, v, tau, p: [1e6 * q[0] ** 3 + q[0] * signal(tau, p)],
    }
    for what, value in given.items():
        with pytest.raises(ValueError, match=f"{what} is not 2 pi-periodic.*{message}"):
            System(ONE, ONE, ONE, parameters={"omega": omega}, **{what: value})


@pytest.mark.parametrize(
    "signal",
    [
        lambda tau, p: p.omega**2 * ca.cos(tau),
        lambda tau, p: ca.fmod(tau, 2 * np.pi),
        lambda tau, p: ca.cos(p.omega * ca.fmod(tau, 2 * np.pi)),
        lambda tau, p: tau - 2 * np.pi * ca.floor(tau / 2 / np.pi),
        lambda tau, p: ca.cos(p.order * tau),
        lambda tau, p: ca.cos(1000 * tau),
        lambda tau, p: ca.sin(tau) ** 2 + ca.cos(tau) ** 2,
        lambda tau, p: ca.exp((ca.cos(tau - 1.0) - 1.0) / 1e-4),
    ],
)
def test_what_is_periodic_is_accepted(signal):
    System(ONE, ONE, ONE, parameters={"order": 3.0}, forcing=lambda tau, p: [signal(tau, p)])


@pytest.mark.parametrize("what", ["forcing", "motion", "nonlinear_force"])
def test_what_is_not_2_pi_periodic_in_tau_is_refused(what):
    def signal(*arguments):
        return [ca.cos(0.5 * arguments[-2])]

    with pytest.raises(ValueError, match=f"{what} .*periodic"):
        System(ONE, ONE, ONE, **{what: signal})


def test_a_misspelt_parameter_is_refused_with_the_right_one():
    message = "unknown parameter 'cubc'; did you mean 'cubic'"
    for bad in (
        {"nonlinear_force": lambda q, v, tau, p: [p.cubc * q[0] ** 3]},
        {"forcing": lambda tau, p: [p.cubc]},
        {"motion": lambda tau, p: [p.cubc]},
        {"input_stiffness": lambda p: [[p.cubc]], "motion": lambda tau, p: [ca.sin(tau)]},
    ):
        with pytest.raises(ValueError, match=message):
            System(ONE, ONE, ONE, parameters=PARAMETERS, **bad)
    with pytest.raises(ValueError, match=message):
        System(ONE, lambda p: [[p.cubc]], ONE, parameters=PARAMETERS)


BAD_OUTPUTS = {
    "two expressions": (lambda s: ca.vertcat(s.q, s.v), "output 'y' returned 2 expressions; 1 is"),
    "an unknown signal": (lambda s: s.velocity, "output 'y'.*unknown signal 'velocity'"),
    "a foreign symbol": (lambda s: FOREIGN, "output 'y' uses 'foreign'"),
    "nothing": (lambda s: None, "output 'y' .*None"),
}


@pytest.mark.parametrize(("rule", "message"), BAD_OUTPUTS.values(), ids=BAD_OUTPUTS)
def test_a_bad_output_is_refused_at_construction(rule, message):
    with pytest.raises(ValueError, match=message):
        System(ONE, ONE, ONE, outputs={"y": rule})


def test_an_unknown_output_is_refused_with_the_nearest_one():
    with pytest.raises(KeyError, match="unknown output 'lft'; did you mean 'lift'"):
        System(ONE, ONE, ONE, outputs={"lift": lambda s: s.q[0]}).output_index("lft")


BAD_LAGS = {
    "a vector": ({"lag_state": [-1.0]}, r"lag_state has shape \(1,\)"),
    "not square": ({"lag_state": [[-1.0, 2.0]]}, r"lag_state has shape \(1, 2\); give a square matrix"),
    "nan": ({"lag_state": [[np.nan]]}, r"lag_state\[0, 0\] is nan; give an array of finite real numbers"),
    "wide input": (
        {"lag_state": [[-1.0]], "lag_input": [[1.0, 2.0]]},
        r"lag_input has shape .* of shape \(1, 1\)",
    ),
    "tall output": (
        {"lag_state": [[-1.0]], "lag_output": [[1.0], [2.0]]},
        r"lag_output has shape \(2, 1\); \(1, 1\) is",
    ),
    "input without states": (
        {"lag_input": [[1.0]]},
        r"lag_state is None; give .* or leave lag_input out",
    ),
    "motion without motion": (
        {"lag_state": [[-1.0]], "lag_motion": [[1.0]]},
        "motion is None; give the motion that lag_motion multiplies",
    ),
    "stiffness without motion": (
        {"input_stiffness": [[1.0]]},
        "motion is None; give the motion that input_stiffness multiplies",
    ),
}


@pytest.mark.parametrize(("options", "message"), BAD_LAGS.values(), ids=BAD_LAGS)
def test_bad_lag_and_input_matrices_are_refused_by_name(options, message):
    with pytest.raises(ValueError, match=message):
        System(ONE, ONE, ONE, **options)


def test_an_unknown_option_is_refused():
    with pytest.raises(TypeError, match="nonlinear"):
        System(ONE, ONE, ONE, nonlinear=lambda q, v, tau, p: [0.0])
