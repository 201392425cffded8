"""The three membranes: static shapes in closed form, limits of small slopes, energy."""

import pickle
from dataclasses import FrozenInstanceError, replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

from hbnlp.wing.membrane import LinearMembrane, NonlinearMembrane, QuasiLinearMembrane

MODELS = [LinearMembrane, QuasiLinearMembrane, NonlinearMembrane]
quick = settings(deadline=None, max_examples=30)
amplitudes = hnp.arrays(float, (4,), elements=st.floats(-0.1, 0.1))


def uniform_load(pressure, n_modes):
    k = np.arange(1, n_modes + 1)
    return 2 * pressure * (1 - (-1.0) ** k) / (k * np.pi)


def static_shape(membrane, load):
    """Solve restoring_force(W) = load by Newton with CasADi's derivative."""
    symbol = ca.SX.sym("W", membrane.n_modes)
    force = membrane.restoring_force(symbol)
    function = ca.Function("f", [symbol], [force, ca.jacobian(force, symbol)])
    W = np.zeros(membrane.n_modes)
    W[0] = 0.05
    for _ in range(30):
        value, slope = (np.array(e) for e in function(W))
        step = np.linalg.solve(slope, load - value[:, 0])
        W = W + step
        if np.abs(step).max() < 1e-15:
            break
    np.testing.assert_allclose(membrane.restoring_force(W), load, atol=1e-12)
    return W


def circular_arc(pressure, stiffness, prestrain):
    """Return camber and tension of the exact membrane, an arc of half-angle f: p = 2 c_T sin f, delta = f/sin f - 1.

    The load is the tension times the curvature 2 sin f that an arc over the chord 1 has; its length is f/sin f.
    """

    def tension(f):
        return 2 * stiffness * (prestrain + f / np.sin(f) - 1)

    f = brentq(lambda f: 2 * tension(f) * np.sin(f) - pressure, 1e-6, 1.5, xtol=1e-15)
    return np.tan(f / 2) / 2, tension(f)


# --- known values


def test_one_mode_in_vacuum_is_the_duffing_oscillator():
    mu, Eh, delta0, W = 0.7, 30.0, 0.01, np.array([0.08])
    membrane = QuasiLinearMembrane(mass_ratio=mu, stiffness=Eh, prestrain=delta0, n_modes=1)
    expected = np.pi**2 * 2 * Eh * delta0 * W + np.pi**4 / 2 * Eh * W**3
    np.testing.assert_allclose(membrane.restoring_force(W), expected, rtol=1e-14)
    assert float(membrane.mass_matrix()) == pytest.approx(2 * mu)


def test_quasi_linear_static_tension_of_ten_modes():
    # W_k = 4 p / (pi^3 k^3 c_T) and delta = pi^2/4 sum k^2 W_k^2 over odd k, with c_T = 2 Eh (delta0 + delta):
    # c_T^3 - 2 Eh delta0 c_T^2 - (8/pi^4) Eh p^2 sum k^-4 = 0
    odd = np.arange(1, 10, 2)
    exact = max(np.roots([1.0, -1.0, 0.0, -8 / np.pi**4 * 250 * 0.25 * np.sum(1.0 / odd**4)]).real)
    assert exact == pytest.approx(2.1385981022, abs=6e-11)
    membrane = QuasiLinearMembrane()
    W = static_shape(membrane, uniform_load(0.5, 10))
    assert membrane.tension(W) == pytest.approx(2.1385981022, abs=6e-11)


def test_quasi_linear_static_tension_tends_to_the_cubics_root_as_the_cube_of_the_modes():
    # c_T^3 - 2 Eh delta0 c_T^2 - Eh p^2/12 = 0: the sum of k^-4 over all odd k is pi^4/96
    exact = max(np.roots([1.0, -1.0, 0.0, -250 * 0.25 / 12]).real)
    assert exact == pytest.approx(2.1386869361, abs=6e-11)
    errors = []
    for n_modes in (15, 31, 63):
        membrane = QuasiLinearMembrane(n_modes=n_modes)
        errors.append(exact - membrane.tension(static_shape(membrane, uniform_load(0.5, n_modes))))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 3.0, atol=0.1)


@pytest.mark.parametrize(("pressure", "stiffness"), [(0.5, 250.0), (2.0, 10.0)])
def test_nonlinear_static_shape_tends_to_the_circular_arc_as_the_cube_of_the_modes(pressure, stiffness):
    camber, tension = circular_arc(pressure, stiffness, 0.002)
    errors = []
    for n_modes in (15, 31, 63):
        membrane = NonlinearMembrane(stiffness=stiffness, n_modes=n_modes)
        W = static_shape(membrane, uniform_load(pressure, n_modes))
        errors.append([abs(membrane.tension(W) / tension - 1), abs(membrane.camber(W) / camber - 1)])
    assert max(errors[-1]) < 4e-6
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 3.0, atol=0.3)


# --- the nonlinear membrane's integrals


def test_nonlinear_force_is_the_galerkin_integral_of_the_membrane_equation():
    membrane = NonlinearMembrane(n_modes=3, stiffness=20.0, prestrain=0.01)
    W = np.array([0.1, -0.05, 0.02])
    k = membrane.wave_numbers

    def slope(x):
        return np.sum(W * k * np.cos(k * x))

    def curvature(x):
        return -np.sum(W * k**2 * np.sin(k * x)) / (1 + slope(x) ** 2) ** 1.5

    delta = quad(lambda x: np.sqrt(1 + slope(x) ** 2) - 1, 0, 1, epsabs=1e-14)[0]
    tension = 2 * 20.0 * (0.01 + delta)
    force = [-2 * tension * quad(lambda x, j=j: curvature(x) * np.sin(j * x), 0, 1, epsabs=1e-13)[0] for j in k]
    assert membrane.elongation(W) == pytest.approx(delta, rel=1e-12)
    np.testing.assert_allclose(membrane.restoring_force(W), force, rtol=1e-11)


@pytest.mark.parametrize("n_modes", [1, 5, 10, 20])
@pytest.mark.parametrize(("decay", "tolerance"), [(3, 1e-12), (2, 1e-7)])
def test_doubling_the_nodes_changes_nothing(n_modes, decay, tolerance):
    k = np.arange(1, n_modes + 1)
    W = np.random.default_rng(1).choice([-1.0, 1.0], n_modes) / k**decay
    membrane = NonlinearMembrane(n_modes=n_modes)
    slopes = membrane._strain.slopes
    W /= np.abs(slopes @ W).max()
    twice = NonlinearMembrane(n_modes=n_modes, n_nodes=2 * len(slopes))
    exact = twice.restoring_force(W)
    change = np.abs(membrane.restoring_force(W) - exact).max() / np.abs(exact).max()
    assert change < tolerance


def test_quadrature_converges_exponentially():
    W = np.array([0.2, 0.05])
    exact = NonlinearMembrane(n_modes=2, n_nodes=200).elongation(W)
    errors = [abs(NonlinearMembrane(n_modes=2, n_nodes=n).elongation(W) / exact - 1) for n in (6, 10, 14, 18)]
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all(ratios > 30)


# --- limits and symmetries


def test_nonlinear_tends_to_quasi_linear_and_that_to_linear_as_the_square_of_slopes():
    W = np.array([0.3, -0.2, 0.1])
    scales = np.array([0.1, 0.05, 0.025])
    linear, quasi, full = (model(n_modes=3) for model in MODELS)

    def distances(a, b):
        return [np.abs(a.restoring_force(e * W) / b.restoring_force(e * W) - 1).max() for e in scales]

    for a, b in ((quasi, linear), (full, quasi)):
        d = np.array(distances(a, b))
        np.testing.assert_allclose(np.log2(d[:-1] / d[1:]), 2.0, atol=0.2)
    # the shape's nonlinearity alone, at constant tension: elongations differ by -1/8 int w_x^4
    d = np.array([quasi.elongation(e * W) - full.elongation(e * W) for e in scales])
    k = full.wave_numbers
    fourth = quad(lambda x: np.sum(W * k * np.cos(k * x)) ** 4 / 8, 0, 1)[0]
    np.testing.assert_allclose(d / scales**4, fourth, rtol=0.25)
    np.testing.assert_allclose(d[-1] / scales[-1] ** 4, fourth, rtol=0.02)


@pytest.mark.parametrize("model", MODELS)
@quick
@given(W=amplitudes)
def test_force_is_odd_and_mirrored_shapes_have_mirrored_forces(model, W):
    membrane = model(n_modes=4)
    mirror = np.array([1, -1, 1, -1])
    force = membrane.restoring_force(W)
    np.testing.assert_array_equal(membrane.restoring_force(-W), -force)
    np.testing.assert_allclose(membrane.restoring_force(mirror * W), mirror * force, atol=1e-10)
    np.testing.assert_allclose(membrane.elongation(mirror * W), membrane.elongation(W), rtol=1e-12)


@pytest.mark.parametrize("model", MODELS)
@quick
@given(W=amplitudes)
def test_tangent_is_the_forces_derivative_and_symmetric(model, W):
    membrane = model(n_modes=4)
    symbol = ca.SX.sym("W", 4)
    derivative = ca.Function("t", [symbol], [ca.jacobian(membrane.restoring_force(symbol), symbol)])
    tangent = membrane.tangent_stiffness(W)
    np.testing.assert_allclose(tangent, np.array(derivative(W)), rtol=1e-11, atol=1e-9)
    np.testing.assert_allclose(tangent, tangent.T, atol=1e-10)


@pytest.mark.parametrize("model", MODELS)
@quick
@given(W=amplitudes)
def test_force_is_the_gradient_of_the_energy_and_the_tangent_its_curvature(model, W):
    membrane = model(n_modes=4)
    symbol = ca.SX.sym("W", 4)
    gradient = ca.Function("g", [symbol], [ca.gradient(membrane.energy(symbol), symbol)])
    np.testing.assert_allclose(membrane.restoring_force(W), np.array(gradient(W))[:, 0], rtol=1e-11, atol=1e-11)
    h = 1e-5
    energies = [(membrane.energy(W + h * e) - membrane.energy(W - h * e)) / (2 * h) for e in np.eye(4)]
    np.testing.assert_allclose(membrane.restoring_force(W), energies, atol=1e-4)
    forces = [(membrane.restoring_force(W + h * e) - membrane.restoring_force(W - h * e)) / (2 * h) for e in np.eye(4)]
    np.testing.assert_allclose(membrane.tangent_stiffness(W), np.column_stack(forces), rtol=1e-5, atol=1e-3)


def test_energy_at_rest_is_that_of_the_prestress():
    for model in MODELS:
        assert model(stiffness=30.0, prestrain=0.01).energy(np.zeros(10)) == pytest.approx(2 * 30.0 * 0.01**2)


# --- numbers and symbols


@pytest.mark.parametrize("model", MODELS)
def test_symbols_and_numbers_give_the_same_laws(model):
    membrane = model(n_modes=4)
    W = np.random.default_rng(0).normal(size=(4, 3)) * 0.05
    symbol = ca.SX.sym("W", 4)
    p = SimpleNamespace(mass_ratio=0.3, stiffness=ca.SX.sym("Eh"), prestrain=ca.SX.sym("delta0"))
    laws = [membrane.restoring_force(symbol, p), membrane.nonlinear_force(symbol, p), membrane.tension(symbol, p)]
    function = ca.Function("laws", [symbol, p.stiffness, p.prestrain], [ca.densify(e) for e in laws])
    numbers = SimpleNamespace(mass_ratio=0.3, stiffness=90.0, prestrain=0.01)
    for j in range(3):
        force, remainder, tension = (np.array(e) for e in function(W[:, j], 90.0, 0.01))
        np.testing.assert_allclose(force[:, 0], membrane.restoring_force(W, numbers)[:, j], rtol=1e-12)
        np.testing.assert_allclose(force[:, 0], membrane.restoring_force(W[:, j], numbers), rtol=1e-12)
        np.testing.assert_allclose(remainder[:, 0], membrane.nonlinear_force(W[:, j], numbers), atol=1e-11)
        linear = np.array(membrane.stiffness_matrix(numbers)) @ W[:, j]
        np.testing.assert_allclose(linear + remainder[:, 0], force[:, 0], atol=1e-11)
        np.testing.assert_allclose(tension[0, 0], membrane.tension(W, numbers)[j], rtol=1e-13)
    np.testing.assert_array_equal(np.array(membrane.mass_matrix(numbers)), 0.6 * np.eye(4))


def test_stiffness_is_the_forces_tangent_at_rest():
    for model in MODELS:
        membrane = model(n_modes=3)
        symbol = ca.SX.sym("W", 3)
        tangent = ca.Function("t", [symbol], [ca.jacobian(membrane.restoring_force(symbol), symbol)])
        expected = np.array(membrane.stiffness_matrix())
        np.testing.assert_allclose(np.array(tangent(0)), expected, atol=1e-12)
        np.testing.assert_allclose(np.diag(expected), np.pi**2 * np.array([1, 4, 9]), rtol=1e-14)


def test_displacement_and_shape_are_sine_sums_with_pinned_ends():
    membrane = LinearMembrane(n_modes=3)
    W = np.array([[0.1, 0.0], [0.0, 0.2], [0.0, -0.1]])
    x = np.linspace(0, 1, 11)
    expected = np.column_stack([0.1 * np.sin(np.pi * x), 0.2 * np.sin(2 * np.pi * x) - 0.1 * np.sin(3 * np.pi * x)])
    np.testing.assert_allclose(membrane.displacement(W, x), expected, atol=1e-15)
    np.testing.assert_allclose(membrane.shape([0.0, 1.0]), 0.0, atol=1e-14)


@quick
@given(W=amplitudes)
def test_camber_is_the_largest_displacement(W):
    membrane = LinearMembrane(n_modes=4)
    fine = np.abs(membrane.displacement(W, np.linspace(0, 1, 20001))).max()
    assert membrane.camber(W) == pytest.approx(fine, rel=1e-6, abs=1e-12)
    np.testing.assert_allclose(
        membrane.camber(np.stack([W, 2 * W], axis=1)), [membrane.camber(W), 2 * membrane.camber(W)]
    )


def test_camber_of_the_first_mode_is_its_amplitude():
    assert LinearMembrane(n_modes=5).camber([-0.07, 0, 0, 0, 0]) == pytest.approx(0.07, rel=1e-14)


def test_camber_is_that_of_the_higher_of_two_peaks_whatever_the_nodes_see():
    # the third mode's peaks at 1/6 and 5/6 lie between nodes, that at 1/2, which is lower, on one
    membrane, W = LinearMembrane(n_modes=4), np.array([2e-5, 0.0, 0.0625, 0.0])
    exact = minimize_scalar(lambda x: -membrane.displacement(W, [x])[0], bounds=(0.1, 0.25), options={"xatol": 1e-12})
    assert membrane.camber(W) == pytest.approx(-exact.fun, rel=1e-9)


# --- bad input


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"mass_ratio": -0.1}, ValueError, r"mass_ratio is -0\.1; give a finite number of at least 0"),
        ({"stiffness": 0.0}, ValueError, r"stiffness is 0\.0; give a finite number greater than 0"),
        ({"prestrain": np.nan}, ValueError, "prestrain is nan"),
        ({"prestrain": "taut"}, TypeError, "prestrain is 'taut'"),
        ({"n_modes": 0}, ValueError, "n_modes is 0; give an integer from 1"),
        ({"n_modes": 2.5}, ValueError, r"n_modes is 2\.5"),
        ({"pre_strain": 0.1}, TypeError, "pre_strain"),
    ],
)
def test_bad_properties_are_refused_with_their_value(model, changes, error, message):
    with pytest.raises(error, match=message):
        model(**changes)


def test_too_few_nodes_are_refused():
    with pytest.raises(ValueError, match=r"n_nodes is 10; give an integer from 11 to 100000, more than the 10 modes"):
        NonlinearMembrane(n_nodes=10)


@pytest.mark.parametrize("model", MODELS)
def test_a_membrane_survives_pickling_also_after_use(model):
    membrane = model(n_modes=3, prestrain=0.01)
    W = np.array([0.1, 0.0, -0.02])
    force = membrane.restoring_force(W)
    copy = pickle.loads(pickle.dumps(membrane))  # noqa: S301 - our own bytes
    assert copy == membrane
    np.testing.assert_array_equal(copy.restoring_force(W), force)


def test_a_copy_with_other_modes_has_their_strain():
    membrane = NonlinearMembrane(n_modes=3)
    assert membrane.elongation(np.full(3, 0.1)) > 0.0
    assert replace(membrane, n_modes=1).restoring_force(np.array([0.1])).shape == (1,)


def test_the_linear_membrane_has_no_nonlinear_force_as_an_expression_either():
    for symbol in (ca.SX.sym("W", 3), ca.MX.sym("W", 3)):
        assert LinearMembrane(n_modes=3).nonlinear_force(symbol).is_zero()
        assert not QuasiLinearMembrane(n_modes=3).nonlinear_force(symbol).is_zero()


@pytest.mark.parametrize("model", [QuasiLinearMembrane, NonlinearMembrane])
def test_nonlinear_force_of_small_shapes_is_cubic_without_cancellation(model):
    membrane, W = model(n_modes=3), np.array([0.3, -0.2, 0.1])
    small, tenfold = membrane.nonlinear_force(1e-6 * W), membrane.nonlinear_force(1e-5 * W)
    np.testing.assert_allclose(1000.0 * small, tenfold, rtol=1e-6)


def test_membranes_are_frozen_records():
    membrane = QuasiLinearMembrane()
    assert membrane == QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
    assert membrane != NonlinearMembrane()
    assert hash(membrane) == hash(QuasiLinearMembrane())
    assert repr(membrane) == "QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)"
    with pytest.raises(FrozenInstanceError):
        membrane.stiffness = 1.0
