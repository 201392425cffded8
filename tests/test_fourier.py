"""The truncated Fourier basis: closed forms, and properties that hold for all coefficients."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hbnlp.fourier import (
    FourierBasis,
    basis_derivatives,
    basis_values,
    differentiated,
    differentiation,
    n_coefficients,
    resize,
    shift,
    stretch,
    to_complex,
    to_real,
)

numbers = st.floats(-10.0, 10.0, allow_subnormal=False)
phases = st.floats(-20.0, 20.0)
examples = settings(max_examples=30, deadline=None)


@st.composite
def signals(draw, most=8):
    """Coefficients (2H+1,) of a signal with up to ``most`` harmonics."""
    n_harmonics = draw(st.integers(1, most))
    return draw(arrays(float, n_coefficients(n_harmonics), elements=numbers))


def value(coefficients, theta):
    """The signal as the paper writes it, a_0 + sum a_{2h-1} cos h theta + a_{2h} sin h theta."""
    total = coefficients[0]
    for h in range(1, len(coefficients) // 2 + 1):
        total = total + coefficients[2 * h - 1] * np.cos(h * theta) + coefficients[2 * h] * np.sin(h * theta)
    return total


def test_cosine_and_sine_stand_in_the_order_of_the_paper():
    theta = np.array([0.3, 1.9])
    expected = [np.ones(2), np.cos(theta), np.sin(theta), np.cos(2 * theta), np.sin(2 * theta)]
    np.testing.assert_allclose(basis_values(theta, 2).T, expected, rtol=1e-15)


def test_one_phase_gives_one_row():
    assert basis_values(0.5, 3).shape == (7,)
    assert basis_values([0.5], 3).shape == (1, 7)


def test_the_complex_amplitude_of_the_papers_pitch_is_minus_i():
    np.testing.assert_array_equal(to_complex([0.5, 0.0, 1.0]), [0.5, -1j])


def test_the_projection_of_cos_cubed_is_three_quarters_and_one_quarter():
    basis = FourierBasis(3, 13)
    np.testing.assert_allclose(basis.projection @ np.cos(basis.theta) ** 3, [0, 0.75, 0, 0, 0, 0.25, 0], atol=1e-15)


@examples
@given(signals(), phases)
def test_basis_values_sum_to_the_signal(a, theta):
    np.testing.assert_allclose(basis_values([theta], len(a) // 2)[0] @ a, value(a, theta), atol=1e-11)


@examples
@given(signals(), st.integers(0, 20))
def test_projection_undoes_sampling(a, extra):
    basis = FourierBasis(len(a) // 2, len(a) + extra)
    np.testing.assert_allclose(basis.projection @ (basis.sampling @ a), a, atol=1e-13 * (1 + np.abs(a).max()))


@examples
@given(signals(), phases, st.integers(1, 4))
def test_differentiation_agrees_with_the_derivatives_of_cosine_and_sine(a, theta, order):
    h = np.arange(1, len(a) // 2 + 1)
    exact = ((1j * h) ** order * to_complex(a)[1:] * np.exp(1j * h * theta)).real.sum()
    bound = 1e-12 * (1.0 + np.abs(a).max()) * h[-1] ** (order + 1)
    assert abs(basis_derivatives([theta], h[-1], order)[0] @ a - exact) <= bound
    derived = np.linalg.matrix_power(differentiation(h[-1]), order) @ a
    assert abs(value(derived, theta) - exact) <= bound


@examples
@given(signals(most=5))
def test_derivative_sampling_samples_the_derivative(a):
    basis = FourierBasis(len(a) // 2, 2 * len(a))
    derived = differentiation(len(a) // 2) @ a
    np.testing.assert_allclose(
        basis.derivative_sampling @ a, basis.sampling @ derived, atol=1e-12 * (1 + np.abs(a).max())
    )


@examples
@given(st.integers(1, 12))
def test_differentiation_is_skew_so_that_no_signal_does_work_on_itself(n_harmonics):
    matrix = differentiation(n_harmonics)
    np.testing.assert_array_equal(matrix, -matrix.T)


@examples
@given(signals())
def test_real_and_complex_coefficients_are_inverses(a):
    np.testing.assert_array_equal(to_real(to_complex(a)), a)


@examples
@given(signals(), phases)
def test_the_real_part_of_the_complex_amplitudes_is_the_signal(a, theta):
    c = to_complex(a)
    np.testing.assert_allclose((c * np.exp(1j * np.arange(c.size) * theta)).real.sum(), value(a, theta), atol=1e-11)


@examples
@given(signals(), phases, phases)
def test_a_shift_is_a_shift_of_the_argument(a, phase, theta):
    assert abs(value(shift(a, phase), theta) - value(a, theta + phase)) <= 1e-11


@examples
@given(signals(), phases, phases)
def test_shifts_add_up(a, one, other):
    np.testing.assert_allclose(shift(shift(a, one), other), shift(a, one + other), atol=1e-10)


@examples
@given(signals())
def test_half_a_period_turns_the_sign_of_odd_harmonics(a):
    harmonic = (np.arange(len(a)) + 1) // 2
    np.testing.assert_allclose(shift(a, np.pi), a * (-1.0) ** harmonic, atol=1e-12)


@examples
@given(signals(), st.integers(1, 4), phases)
def test_a_signal_stretched_over_more_periods_is_the_same_signal(a, factor, theta):
    assert abs(value(stretch(a, factor), theta / factor) - value(a, theta)) <= 1e-10


@examples
@given(signals(), signals())
def test_resizing_keeps_the_common_harmonics_and_pads_with_zeros(a, other):
    n_harmonics = len(other) // 2
    resized = resize(a, n_harmonics)
    common = min(len(a), len(other))
    assert resized.shape == (n_coefficients(n_harmonics),)
    np.testing.assert_array_equal(resized[:common], a[:common])
    np.testing.assert_array_equal(resized[common:], 0.0)


@examples
@given(st.integers(1, 7), st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_d_plus_1_times_H_plus_1_samples_project_a_power_d_exactly(degree, n_harmonics, seed):
    a = np.random.default_rng(seed).uniform(-1.0, 1.0, n_coefficients(n_harmonics))

    def projected(n_samples):
        basis = FourierBasis(n_harmonics, n_samples)
        return basis.projection @ (basis.sampling @ a) ** degree

    exact = projected(8 * (degree + 1) * n_harmonics)
    enough = projected((degree + 1) * n_harmonics + 1)
    np.testing.assert_allclose(enough, exact, atol=1e-12 * max(1.0, np.abs(exact).max()))


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_one_sample_fewer_folds_a_harmonic_back(degree):
    n_harmonics = 4
    a = np.zeros(n_coefficients(n_harmonics))
    a[-2] = 1.0  # cos(H theta): its power d reaches the harmonic d H

    def projected(n_samples):
        basis = FourierBasis(n_harmonics, n_samples)
        return basis.projection @ (basis.sampling @ a) ** degree

    exact = projected(1000)
    assert np.abs(projected((degree + 1) * n_harmonics + 1) - exact).max() < 1e-14
    assert np.abs(projected((degree + 1) * n_harmonics) - exact).max() > 1e-2


@examples
@given(st.integers(1, 10), st.integers(0, 30))
def test_samples_are_equidistant_phases_of_one_period(n_harmonics, extra):
    n_samples = n_coefficients(n_harmonics) + extra
    theta = FourierBasis(n_harmonics, n_samples).theta
    assert theta[0] == 0.0
    np.testing.assert_allclose(np.diff(theta), 2.0 * np.pi / n_samples, rtol=1e-12)
    assert theta[-1] < 2.0 * np.pi


def test_too_few_samples_are_refused_with_the_number_that_is_needed():
    with pytest.raises(ValueError, match=r"6 samples cannot hold 3 harmonics: at least 2H \+ 1 = 7"):
        FourierBasis(3, 6)


def test_coefficients_of_many_signals_keep_their_leading_axes():
    a = np.arange(30.0).reshape(2, 3, 5)
    assert to_complex(a).shape == (2, 3, 3)
    assert shift(a, 1.0).shape == a.shape
    assert resize(a, 4).shape == (2, 3, 9)
    np.testing.assert_array_equal(to_real(to_complex(a)), a)


@pytest.mark.parametrize(("n_harmonics", "n_samples"), [(3, 7), (3, 8), (60, 121), (100, 401), (150, 301), (150, 302)])
def test_signals_are_sampled_and_projected_alike_by_matrices_and_by_transforms(n_harmonics, n_samples):
    basis, rng = FourierBasis(n_harmonics, n_samples), np.random.default_rng(0)
    assert basis.is_small is (n_harmonics < 100)
    a, samples = rng.normal(size=(2, 3, 2 * n_harmonics + 1)), rng.normal(size=(2, 3, n_samples))
    np.testing.assert_allclose(basis.sampled(a), a @ basis.sampling.T, atol=1e-13)
    np.testing.assert_allclose(basis.projected(samples), samples @ basis.projection.T, atol=1e-14)
    np.testing.assert_array_equal(differentiated(a), a @ differentiation(n_harmonics).T)
