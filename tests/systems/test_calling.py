"""Whatever goes wrong in a user's function is said in one sentence, with what to write; numpy's functions are right."""

import math
import subprocess
import sys
import threading

import casadi as ca
import numpy as np
import pytest

from hbnlp.systems.system import System

ONE = [[1.0]]


def system(force=None, n=1, **options):
    return System(np.eye(n), np.eye(n), np.eye(n), nonlinear_force=force, parameters={"gap": 0.5}, **options)


NO_TRUTH, NO_NUMBER, NO_ENTRY = (
    "neither true nor false.*write {}",
    "has no number yet.*write {}",
    "no such entry; q, v: {}",
)

# what a force of one degree of freedom is written as, and what its error says
MISTAKES = {
    "if": (lambda q, v, tau, p: [q[0] if q[0] > p.gap else 0.0], NO_TRUTH.format(r"ca\.if_else")),
    "max": (lambda q, v, tau, p: [max(q[0], 0)], NO_TRUTH.format(r"ca\.fmax")),
    "min": (lambda q, v, tau, p: [min(q[0], 0)], NO_TRUTH.format(r"ca\.fmin")),
    "and": (lambda q, v, tau, p: [q[0] and 1.0], NO_TRUTH.format(r"ca\.logic_and")),
    "between": (lambda q, v, tau, p: [(-1 < q[0] < 1) * q[0]], NO_TRUTH.format(r"ca\.logic_and")),
    "not": (lambda q, v, tau, p: [not q[0]], NO_TRUTH.format(r"ca\.logic_not")),
    "math.sin": (lambda q, v, tau, p: [math.sin(q[0])], NO_NUMBER.format(r"ca\.sin")),
    "math.sqrt": (lambda q, v, tau, p: [q[0] + math.sqrt(2 * q[0])], NO_NUMBER.format(r"ca\.sqrt")),
    "float": (lambda q, v, tau, p: [float(q[0])], NO_NUMBER.format("functions of CasADi")),
    "int": (lambda q, v, tau, p: [int(q[0])], NO_NUMBER.format("functions of CasADi")),
    "a hidden if": (lambda q, v, tau, p: [1.0 if float(q[0]) > 0 else 0.0], NO_NUMBER.format("functions of CasADi")),
    "a hidden max": (lambda q, v, tau, p: [max(0.0, float(q[0]))], "has no number yet"),
    "isnan": (lambda q, v, tau, p: [np.isnan(q[0])], "has no number yet"),
    "a Bessel function": (lambda q, v, tau, p: [np.i0(q[0])], "has no number yet"),
    "an array of numbers": (lambda q, v, tau, p: np.array([1.0, 2.0]).__setitem__(0, q[0]), "has no number yet"),
    "an inverse": (lambda q, v, tau, p: np.linalg.inv(np.array([[q[0]]])), "has no number yet"),
    "nothing said": (lambda q, v, tau, p: next(iter([])), "StopIteration$"),
    "q[1]": (lambda q, v, tau, p: [q[1]], NO_ENTRY.format(r"1 entry, \[0\]$")),
    "q[-2]": (lambda q, v, tau, p: [q[-2]], NO_ENTRY.format(r"1 entry, \[0\]$")),
    "q of text": (lambda q, v, tau, p: [q["x"]], "CasADi's get does not take these arguments"),
    "len": (lambda q, v, tau, p: [len(q) * q[0]], r"no numpy array; write .*a\.numel\(\)"),
    "a loop": (lambda q, v, tau, p: [each**3 for each in q], r"no numpy array; write .*ca\.vertsplit"),
    "a method of arrays": (lambda q, v, tau, p: [q.dot(v)], r"no numpy array; write .*ca\.dot"),
    "a name": (lambda q, v, tau, p: [p.k * q[0]], r"unknown parameter 'k' \(known: gap, omega\)$"),
    "an item": (lambda q, v, tau, p: [p["k"] * q[0]], r"unknown parameter 'k' \(known: gap, omega\)$"),
    "a near name": (lambda q, v, tau, p: [p.gapp * q[0]], "unknown parameter 'gapp'; did you mean 'gap'"),
    "a program's symbol": (lambda q, v, tau, p: [ca.MX.sym("x") * q[0]], "MX symbols stand beside SX symbols"),
    "a parameter that is a method": (lambda q, v, tau, p: [p.get * q[0]], r"a method stands where .* p\['values'\]$"),
    "an error": (lambda q, v, tau, p: [undefined * q[0]], "NameError: name 'undefined' is not defined"),  # noqa: F821
    "text": (lambda q, v, tau, p: "q[0]", "has the entry 'q\\[0\\]'; a number or an expression"),
    "a dictionary": (lambda q, v, tau, p: {"x": q[0]}, "has the entry {'x'"),
    "a truth value": (lambda q, v, tau, p: [True], "has the entry True"),
    "a generator": (lambda q, v, tau, p: (q[i] for i in range(1)), "has the entry <generator"),
    "a hidden nan": (lambda q, v, tau, p: [q[0] + np.nan], "has the number nan in it"),
    "an array of two": (lambda q, v, tau, p: np.array([q[0], v[0]]), "returned 2 expressions; 1 is needed"),
    "none": (lambda q, v, tau, p: None, "returned None; end it with return"),
}


@pytest.mark.parametrize(("force", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_in_a_force_is_answered(force, message):
    with pytest.raises(ValueError, match=rf"^nonlinear_force.*{message}") as caught:
        system(force)
    assert "\n" not in str(caught.value)


def test_columns_in_a_list_are_answered():
    with pytest.raises(ValueError, match=r"a list with columns in it; one column, such as ca\.vertcat"):
        system(lambda q, v, tau, p: [q**3, v[0]], n=2)
    with pytest.raises(ValueError, match=r"q, v: 2 entries, \[0\] to \[1\]"):
        system(lambda q, v, tau, p: [q[2], 0.0], n=2)


def test_functions_of_other_arguments_are_answered():
    with pytest.raises(TypeError, match=r"nonlinear_force takes \(q, v, p\); it is called with \(q, v, tau, p\)"):
        system(lambda q, v, p: [q[0]])
    with pytest.raises(TypeError, match=r"forcing takes \(t\); it is called with \(tau, p\): write lambda tau, p:"):
        system(forcing=lambda t: [ca.cos(t)])
    with pytest.raises(TypeError, match=r"output 'y' takes \(q, v\); it is called with \(s\)"):
        system(outputs={"y": lambda q, v: q[0]})
    with pytest.raises(TypeError, match=r"forcing is \[1\.0\]; give a function of \(tau, p\)"):
        system(forcing=[1.0])
    system(lambda q, v, tau, p, stiffness=2.0: [stiffness * q[0] ** 3])


def test_every_function_of_a_user_is_answered_with_its_name_and_line():
    for name, options in {
        "forcing": {"forcing": lambda tau, p: [math.cos(tau)]},
        "motion": {"motion": lambda tau, p: [math.cos(tau)]},
        "stiffness": {},
        "output 'y'": {"outputs": {"y": lambda s: math.sin(s.q[0])}},
    }.items():
        stiffness = (lambda p: [[math.sqrt(p.gap)]]) if name == "stiffness" else ONE
        with pytest.raises(
            ValueError, match=rf"^{name} \(line \d+ of test_calling\.py: `.*has no number yet"
        ) as caught:
            System(ONE, ONE, stiffness, parameters={"gap": 0.5}, **options)
        assert isinstance(caught.value.__cause__, TypeError)


def test_a_function_may_write_into_its_arguments():
    def force(q, *_):
        q[0] = q[0] - 0.5
        return [q[0] ** 3]

    def shifted(s):
        s.q[0] = s.q[0] + 7.0
        return s.q[0]

    written = system(force, outputs={"shifted": shifted, "x": lambda s: s.q[0]})
    assert float(written.compiled_force.value(2.5, 0.0, 0.0, [0.5, 1.0])) == 8.0
    np.testing.assert_array_equal(written.outputs(2.5, 0, 0, [], 0, [0.5, 1.0]).full().ravel(), [9.5, 2.5])


def spring(x):
    return max(x, 0.0)


def test_the_line_is_the_users_own_where_a_function_calls_another():
    with pytest.raises(ValueError, match=r"of test_calling\.py, in spring: `return max\(x, 0\.0\)`\)"):
        system(lambda q, v, tau, p: [spring(q[0])])


def test_the_number_of_a_symbol_is_refused_in_a_users_function_alone():
    symbol = ca.SX.sym("x")
    elsewhere = []

    def force(q, *_):
        other = threading.Thread(target=lambda: elsewhere.append(float(symbol)))
        other.start()
        other.join()
        return [float(ca.SX(2.0)) * q[0]]

    system(force)
    assert np.isnan(elsewhere[0])
    assert np.isnan(float(symbol))


# -- numpy's functions -------------------------------------------------------------------------------------------------

FULL = hasattr(ca.GlobalOptions, "getNumpyMode")
"""CasADi 3.8 knows most functions of numpy; earlier ones refuse them, and take np.mod as ca.remainder."""
later = pytest.mark.skipif(not FULL, reason="an earlier CasADi knows few functions of numpy")

UNARY = (np.sin, np.cos, np.tan, np.arctan, np.sinh, np.cosh, np.tanh, np.arcsinh, np.exp, np.expm1, np.fabs, np.sign)
UNARY += (np.floor, np.ceil)
LATER_UNARY = (np.exp2, np.cbrt, np.square, np.abs, np.negative, np.reciprocal, np.trunc, np.rint, np.sinc)
BINARY = (np.fmax, np.fmin, np.hypot, np.arctan2, np.copysign)
LATER_BINARY = (np.maximum, np.minimum, np.mod, np.fmod, np.floor_divide, np.heaviside, np.logaddexp)
EXPRESSIONS = {
    "sqrt": lambda q, v: [np.sqrt(1.0 + q[0] ** 2), np.log1p(v[1] ** 2)],
    "column": lambda q, v: np.sin(q) + np.tanh(v),
    "array": lambda q, v: np.tanh(np.array([q[0], v[1]])) * np.array([2.0, 3.0]),
    "matrix": lambda q, v: np.array([[1.0, 2.0], [3.0, 4.0]]) @ q + np.array([2.0, 3.0]) * v,
}
LATER_EXPRESSIONS = {
    "where": lambda q, v: [np.where(q[0] > 0, q[0], v[0]), np.clip(q[1], -1.0, 1.0)],
    "select": lambda q, v: [np.select([q[0] > 1, q[0] > 0], [q[0], v[0]], 0.0), np.interp(q[1], [-1, 0, 1], [2, 0, 3])],
    "sums": lambda q, v: [np.sum(q * v), np.linalg.norm(q)],
    "dot": lambda q, v: [np.dot(q, v), np.vdot(q, q)],
    "pieces": lambda q, v: np.concatenate([q[:1], v[1:]]),
}


def values_of(force, n):
    """Return the force at random states, from symbols as a system has it and from numpy's numbers."""
    compiled = system(lambda q, v, tau, p: force(q, v), n).compiled_force.value
    states = np.random.default_rng(3).uniform(-2.0, 2.0, (20, 2, n))
    return (
        [compiled(q, v, 0.0, [0.5, 1.0]).full().ravel() for q, v in states],
        [np.ravel(np.array(force(q, v), dtype=float)) for q, v in states],
    )


@pytest.mark.parametrize("function", [*UNARY, *(pytest.param(each, marks=later) for each in LATER_UNARY)])
def test_functions_of_numpy_have_their_values(function):
    np.testing.assert_allclose(*values_of(lambda q, v: [function(q[0])], 1), rtol=1e-14)


@pytest.mark.parametrize("function", [*BINARY, *(pytest.param(each, marks=later) for each in LATER_BINARY)])
def test_functions_of_numpy_of_two_arguments_have_their_values(function):
    np.testing.assert_allclose(*values_of(lambda q, v: [function(q[0], v[0])], 1), rtol=1e-13, atol=1e-15)


@later
@pytest.mark.parametrize("force", LATER_EXPRESSIONS.values(), ids=LATER_EXPRESSIONS)
def test_more_expressions_with_numpy_have_their_values(force):
    np.testing.assert_allclose(*values_of(force, 2), rtol=1e-13)


@pytest.mark.parametrize("force", EXPRESSIONS.values(), ids=EXPRESSIONS)
def test_expressions_with_numpy_have_their_values(force):
    np.testing.assert_allclose(*values_of(force, 2), rtol=1e-13)


SCRIPT = """
import numpy as np, hbnlp
hbnlp.System([[1.0]], [[0.1]], [[1.0]], nonlinear_force=lambda q, v, tau, p: [np.tanh(q[0]) + np.exp(v[0])])
"""


def test_functions_of_numpy_raise_no_warning_in_a_script():
    done = subprocess.run([sys.executable, "-W", "always", "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert "numpy" not in done.stderr


@later
def test_the_users_setting_of_casadi_is_left_as_it_was():
    try:
        ca.GlobalOptions.setNumpyMode(1)
        system(lambda q, v, tau, p: np.sin(q), n=2)
        assert ca.GlobalOptions.getNumpyMode() == 1
    finally:
        ca.GlobalOptions.setNumpyMode(0)


class Cube(ca.Callback):
    """A function that CasADi does not look into."""

    def __init__(self, **options):
        super().__init__()
        self.construct("cube", options)

    def eval(self, arguments):
        return [float(arguments[0]) ** 3]


def test_a_callback_without_a_derivative_is_refused_and_one_with_finite_differences_is_not():
    blind, seeing = Cube(), Cube(enable_fd=True)
    with pytest.raises(ValueError, match=r"nonlinear_force calls 'cube', which has no derivative.*enable_fd"):
        system(lambda q, v, tau, p: [q[0] + blind(q[0])])
    seen = system(lambda q, v, tau, p: [q[0] + seeing(q[0])])
    tangent, _ = seen.compiled_force.tangents([2.0], [0.0], 0.0, [0.5, 1.0])
    np.testing.assert_allclose(tangent, 13.0, rtol=1e-5)
