"""Strain of small slopes and of the exact arc: closed forms of one mode, and derivatives against differences."""

import casadi as ca
import numpy as np
import pytest
from scipy.special import ellipe

from hbnlp.wing.strain import ExactArc, SmallSlopes

WAVE_NUMBERS = np.pi * np.arange(1.0, 4.0)
STRAINS = [SmallSlopes(WAVE_NUMBERS), ExactArc(WAVE_NUMBERS, 64)]
W = np.array([0.12, -0.05, 0.03])


@pytest.mark.parametrize("k", [1, 2, 3])
def test_elongation_of_one_sine_is_its_closed_form(k):
    # the arc of a sin(k pi x) is a complete elliptic integral of the second kind, of parameter -(a k pi)^2
    a = 0.2 * np.eye(3)[k - 1]
    small, arc = STRAINS
    assert small.elongation(a) == pytest.approx((0.2 * k * np.pi) ** 2 / 4.0, rel=1e-14)
    assert arc.elongation(a) == pytest.approx(2.0 / np.pi * ellipe(-((0.2 * k * np.pi) ** 2)) - 1.0, rel=1e-12)


@pytest.mark.parametrize("strain", STRAINS)
def test_gradient_is_the_elongations_derivative_and_curvature_the_gradients(strain):
    step = 1e-5 * np.eye(3)
    gradient = [(strain.elongation(W + e) - strain.elongation(W - e)) / 2e-5 for e in step]
    np.testing.assert_allclose(strain.gradient(W), gradient, rtol=1e-8)
    curvature = [(strain.gradient(W + e) - strain.gradient(W - e)) / 2e-5 for e in step]
    np.testing.assert_allclose(strain.curvature(W), curvature, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("strain", STRAINS)
def test_derivatives_agree_with_casadis(strain):
    symbol = ca.SX.sym("W", 3)
    hessian, gradient = ca.hessian(strain.elongation(symbol), symbol)
    function = ca.Function("d", [symbol], [ca.densify(gradient), ca.densify(hessian)])
    expected_gradient, expected_hessian = (np.array(e) for e in function(W))
    np.testing.assert_allclose(strain.gradient(W), expected_gradient[:, 0], rtol=1e-13)
    np.testing.assert_allclose(strain.curvature(W), expected_hessian, rtol=1e-12, atol=1e-13)


def test_what_slopes_add_is_nothing_for_small_ones_and_cubic_for_the_arc():
    small, arc = STRAINS
    np.testing.assert_array_equal(small.gradient_of_slopes(W), 0.0)
    sizes = [np.abs(arc.gradient_of_slopes(scale * W)).max() for scale in (1e-3, 1e-6)]
    assert sizes[0] / sizes[1] == pytest.approx(1e9, rel=1e-4)
    np.testing.assert_allclose(arc.linear_gradient(W), WAVE_NUMBERS**2 / 2.0 * W, rtol=1e-14)


@pytest.mark.parametrize("strain", STRAINS)
def test_columns_are_shapes(strain):
    shapes = np.stack([W, -0.5 * W], axis=1)
    for law in (strain.elongation, strain.gradient, strain.gradient_of_slopes):
        np.testing.assert_allclose(law(shapes), np.stack([law(W), law(-0.5 * W)], axis=-1), rtol=1e-13)
