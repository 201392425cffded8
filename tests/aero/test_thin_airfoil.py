"""Inviscid thin airfoil with sine modes, held to the loads of Kuessner and Schwarz by direct quadrature."""

import numpy as np
import pytest
from scipy import linalg, special

from hbnlp.aero import theodorsen_transfer, thin_airfoil
from hbnlp.aero.theodorsen import theodorsen_function, thin_airfoil_coefficients


def by_quadrature(s, n_modes, n_nodes=400):
    """Return G(s) from the defining integrals by the midpoint rule in theta, which is spectral for them.

    H. G. Kuessner, L. Schwarz, Luftfahrtforschung 17 (1940) 337-354: with v = s y + dy/dx on x = (1 + cos th)/2,
    P_n = (1/pi) int v cos(n th) dth and Theodorsen's C = K1/(K0 + K1) of s/2, a_0 = C (P_0 + P_1) - P_1,
    a_n = P_n + (s/4n) (P_{n-1} - P_{n+1}), dCp = -4 a_0 tan(th/2) - 8 sum a_n sin(n th), C_L = -2 pi (a_0 + a_1).
    """
    theta = (np.arange(n_nodes) + 0.5) * np.pi / n_nodes
    x = (1 + np.cos(theta)) / 2
    k = np.arange(1, n_modes + 1)
    sines = np.sin(np.pi * np.outer(x, k))
    shapes = np.column_stack([-x, np.ones_like(x), sines])
    slopes = np.column_stack([-np.ones_like(x), np.zeros_like(x), np.pi * k * np.cos(np.pi * np.outer(x, k))])
    v = s * shapes + slopes
    n = np.arange(n_nodes // 2)
    p = np.cos(np.outer(n, theta)) @ v / n_nodes
    z = s / 2
    c = 1.0 if s == 0 else special.kv(1, z) / (special.kv(0, z) + special.kv(1, z))
    a0 = c * (p[0] + p[1]) - p[1]
    a = p[1:-1] + s / (4 * n[1:-1, np.newaxis]) * (p[:-2] - p[2:])
    # dCp sin(theta), which is finite at the leading edge, as 2 dx = sin(theta) dtheta
    load = -(4 * np.outer(1 - np.cos(theta), a0) + 8 * (np.sin(np.outer(theta, n[1:-1])) * np.sin(theta)[:, None]) @ a)
    return np.vstack([-2 * np.pi * (a0 + a[0]), np.pi / n_nodes * sines.T @ load])


# --- known values: the digits of `by_quadrature`, which uses nothing of the package


@pytest.mark.parametrize(
    ("omega", "real", "imaginary"), [(0.1, 5.765182714, -0.235422879), (1.0, 3.681746732, 3.441567911)]
)
def test_lift_per_pitch_about_the_leading_edge(omega, real, imaginary):
    lift = theodorsen_transfer(1j * omega, n_modes=10)[0, 0]
    assert lift.real == pytest.approx(real, abs=6e-10)
    assert lift.imag == pytest.approx(imaginary, abs=6e-10)


@pytest.mark.parametrize(
    "static", [thin_airfoil(10).stiffness, theodorsen_transfer(0.0).real], ids=["rational", "exact"]
)
def test_static_values(static):
    assert static[0, 0] == pytest.approx(2 * np.pi, rel=1e-15)
    assert static[0, 1] == 0.0
    np.testing.assert_allclose(static[0, 2:5], [11.188659045, -12.010999742, 16.679112815], atol=6e-10, rtol=0)
    np.testing.assert_allclose(
        [static[1, 2], static[1, 3], static[2, 3]], [16.8697305419, -11.3384129616, 21.5269380861], atol=6e-11
    )


def test_added_masses():
    # the quadratic part of `by_quadrature`, from a_n = (s/4n) (P_{n-1} - P_{n+1}) with P_n those of v = s sin(k pi x)
    mass = thin_airfoil(10).mass
    block = -mass[1:, 2:]
    np.testing.assert_allclose(
        [block[0, 0], block[1, 1], block[2, 2], block[0, 2]],
        [1.709261, 0.718468, 0.471274, 0.124067],
        atol=6e-7,
        rtol=0,
    )
    assert mass[0, 0] == pytest.approx(np.pi / 4, rel=1e-14)
    assert mass[0, 1] == pytest.approx(-np.pi / 2, rel=1e-14)


# (k pi)^2 c_T W_k = dCp_k(W): the largest eigenvalue c_T with the static loads of `by_quadrature`
@pytest.mark.parametrize(("n_modes", "tension"), [(1, 1.709261), (10, 1.726336)])
def test_static_divergence_of_the_sail_equation(n_modes, tension):
    k = np.arange(1, n_modes + 1)
    values = linalg.eigvals(thin_airfoil(n_modes).stiffness[1:, 2:], np.diag((k * np.pi) ** 2))
    assert np.max(values.real[np.abs(values.imag) < 1e-12]) == pytest.approx(tension, abs=6e-7)


def test_static_divergence_tends_to_the_limit_of_many_modes():
    tensions = []
    for n_modes in (10, 20, 40):
        k = np.arange(1, n_modes + 1)
        tensions.append(linalg.eigvals(thin_airfoil(n_modes).stiffness[1:, 2:], np.diag((k * np.pi) ** 2)).real.max())
    # the limit, extrapolated from 80, 160 and 320 modes; the first eigenvalue of the sail equation is 4 / c_T = 2.316
    # (B. Thwaites, Proc. R. Soc. Lond. A 261 (1961) 402-422)
    gaps = 1.727453 - np.array(tensions)
    # the leading-edge singularity makes it algebraic: fourth order would be 16, observed is near 4
    np.testing.assert_allclose(gaps[:-1] / gaps[1:], 4.0, rtol=0.15)


# --- independent method


@pytest.mark.parametrize("s", [0.0, 0.3j, 2j, 30j, 0.5 + 1j])
def test_closed_form_agrees_with_quadrature_of_the_definition(s):
    exact = by_quadrature(s, 6)
    np.testing.assert_allclose(theodorsen_transfer(s, 6), exact, rtol=0, atol=1e-13 * np.abs(exact).max())


def test_many_modes_agree_with_quadrature_too():
    exact = by_quadrature(1j, 40, n_nodes=1200)
    np.testing.assert_allclose(theodorsen_transfer(1j, 40), exact, rtol=0, atol=1e-13 * np.abs(exact).max())


# --- structure of the loads


def test_added_mass_is_symmetric_and_positive_definite():
    block = -thin_airfoil(20).mass[1:, 2:]
    np.testing.assert_allclose(block, block.T, atol=1e-15)
    assert np.linalg.eigvalsh(block).min() > 0.0


def test_pitch_about_another_axis_is_pitch_and_heave_together():
    # pitch about x_p moves the chord by -alpha (x - x_p); about the three-quarter chord P_0 + P_1 has no rate
    s = 0.7j
    g = theodorsen_transfer(s, 0)[0]
    about = g[0] + 0.75 * g[1]
    wake_free = np.pi / 2 * s - np.pi / 8 * s**2
    assert about == pytest.approx(2 * np.pi * theodorsen_function(s) + wake_free, rel=1e-13)


def test_heave_at_constant_speed_is_incidence():
    # y = t: the quasi-static load of a downward flow -1, up to the lags
    rom = thin_airfoil(3)
    np.testing.assert_allclose(rom.stiffness[:, 1], 0.0, atol=1e-15)
    s = 1e-7
    np.testing.assert_allclose(theodorsen_transfer(s, 3)[:, 1] / s, -rom.stiffness[:, 0], rtol=1e-4)


def test_leading_block_does_not_depend_on_the_number_of_modes():
    large, small = thin_airfoil(12), thin_airfoil(4)
    np.testing.assert_allclose(large.truncated(4).transfer(1j), small.transfer(1j), rtol=0, atol=1e-13)


def test_rigid_airfoil_is_zero_modes():
    assert thin_airfoil(0).transfer(1j).shape == (1, 2)
    np.testing.assert_allclose(theodorsen_transfer(1j, 0)[0], theodorsen_transfer(1j, 3)[0, :2], rtol=1e-14)


# --- rational against exact


def jones_function(s):
    return 1 - 0.165 * s / (s + 0.091) - 0.335 * s / (s + 0.6)


def test_the_rom_is_the_exact_one_with_jones_function_in_place_of_theodorsens():
    s = np.concatenate([1j * np.logspace(-4, 3, 40), np.logspace(-4, 3, 40)])
    c = thin_airfoil_coefficients(10)
    z = s[:, np.newaxis, np.newaxis]
    wake = jones_function(z) * c.circulatory[:, np.newaxis] * (c.static + z * c.rate)
    expected = c.constant + z * c.linear + z**2 * c.quadratic + wake
    found = thin_airfoil(10).transfer(s)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_jones_function_is_within_its_known_error_of_theodorsens():
    s = 1j * np.logspace(-4, 4, 4001)
    error = np.abs(jones_function(s) - theodorsen_function(s))
    assert error.max() == pytest.approx(0.01453, abs=1e-5)
    assert np.max(error / np.abs(theodorsen_function(s))) == pytest.approx(0.02338, abs=1e-4)


@pytest.mark.parametrize(("k", "f", "g"), [(0.1, 0.8319, 0.1723), (0.5, 0.5979, 0.1507), (1.0, 0.5394, 0.1003)])
def test_theodorsen_function_is_the_published_table(k, f, g):
    # T. Theodorsen, NACA report 496 (1935), table I: C = F - i G of the reduced frequency per semi-chord
    assert theodorsen_function(2j * k) == pytest.approx(f - 1j * g, abs=1.1e-4)


def test_theodorsen_function_is_regular_from_rest_to_high_frequency():
    np.testing.assert_allclose(theodorsen_function([0.0, 1e-250, 1e-99j]), 1.0, rtol=1e-15)
    assert theodorsen_function(1e12j) == pytest.approx(0.5, abs=1e-12)
    inside, outside = theodorsen_function([1.999999e6j, 2.000001e6j])
    assert inside == pytest.approx(outside, abs=1e-12)


@pytest.mark.parametrize("s", [-1.0, [1j, -0.1 + 1j], np.nan, np.inf])
def test_exact_transfer_left_of_the_imaginary_axis_is_refused(s):
    with pytest.raises(ValueError, match=r"s (holds|is)"):
        theodorsen_transfer(s)


@pytest.mark.parametrize("n_modes", [-1, 2.5, True, "3"])
@pytest.mark.parametrize("function", [thin_airfoil, lambda n_modes: theodorsen_transfer(1j, n_modes)])
def test_bad_numbers_of_modes_are_refused(function, n_modes):
    with pytest.raises(ValueError, match=r"n_modes is .*give an integer from 0"):
        function(n_modes)


def test_rational_transfer_is_exact_in_both_limits_and_within_jones_error_between():
    s = 1j * np.logspace(-4, 4, 801)
    rational, exact = thin_airfoil(10).transfer(s), theodorsen_transfer(s)
    error = np.linalg.norm(rational - exact, axis=(1, 2)) / np.linalg.norm(exact, axis=(1, 2))
    assert error[0] < 1e-3
    assert error[-1] < 1e-6
    assert 0.0065 < error.max() < 0.0072
