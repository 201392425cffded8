"""Describing functions against the closed forms of the textbooks (Gelb and Vander Velde 1968, appendix B)."""

import casadi as ca
import numpy as np
import pytest

import hbnlp

A = np.array([0.3, 1.0, 1.2, 3.0, 40.0])


def saturated(ratio):
    """f(ratio) of a unit slope that ends at 1, ratio = limit / amplitude."""
    r = np.minimum(ratio, 1.0)
    return 2.0 / np.pi * (np.arcsin(r) + r * np.sqrt(1.0 - r**2))


CLOSED = {
    "linear": (lambda q, v: 2.0 * q + 0.1 * v, lambda a: 2.0 + 0.1j * 1.5 + 0.0 * a),
    "cubic": (lambda q, v: 0.7 * q**3, lambda a: 0.75 * 0.7 * a**2),
    "quintic": (lambda q, v: q**5, lambda a: 0.625 * a**4),
    "saturation": (lambda q, v: ca.fmin(ca.fmax(q, -1.0), 1.0), lambda a: saturated(1.0 / a)),
    "dead zone": (lambda q, v: q - ca.fmin(ca.fmax(q, -1.0), 1.0), lambda a: 1.0 - saturated(1.0 / a)),
    "relay": (lambda q, v: 0.5 * ca.sign(q), lambda a: 4.0 * 0.5 / (np.pi * a)),
    "dry friction": (lambda q, v: 0.5 * ca.sign(v), lambda a: 4.0j * 0.5 / (np.pi * a)),
    "quadratic damping": (lambda q, v: v * ca.fabs(v), lambda a: 8.0j / (3.0 * np.pi) * 1.5**2 * a),
}


@pytest.mark.parametrize("name", CLOSED)
def test_describing_functions_are_those_of_the_textbooks(name):
    force, closed = CLOSED[name]
    found = hbnlp.describing_function(force, A, omega=1.5)
    assert found.shape == A.shape
    assert np.allclose(found, closed(A), rtol=1e-9, atol=1e-9)


def test_a_bias_lets_even_forces_act():
    assert hbnlp.describing_function(lambda q, v: q**2, 2.0, bias=0.4) == pytest.approx(0.8)
    assert hbnlp.describing_function(lambda q, v: q**3, 2.0, bias=0.4) == pytest.approx(0.75 * 4.0 + 3.0 * 0.16)


def test_it_is_harmonic_balance_with_one_harmonic():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=0.025, cubic=0.1, force=0.18), 1)
    a_1 = hbnlp.solve(problem, at={"omega": 0.9}).harmonics("x")[1]
    gain = hbnlp.describing_function(lambda q, v: 0.1 * q**3, abs(a_1))
    assert (1.0 - 0.9**2 + 2j * 0.025 * 0.9 + gain) * a_1 == pytest.approx(0.18)


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ((lambda q, v: q, 0.0), ValueError, "amplitude is 0.0; give amplitudes above zero"),
        ((lambda q: q, 1.0), TypeError, r"it is called with \(q, v\)"),
        ((lambda q, v: [q, v], 1.0), ValueError, "force returned 2 expressions; 1 is needed"),
        ((3.0, 1.0), TypeError, "a function of"),
        (
            (lambda q, v: ca.sqrt(q), 2.0),
            hbnlp.NonFiniteError,
            "not finite everywhere on a sine of amplitude 2 about 0",
        ),
    ],
)
def test_what_is_wrong_is_said(arguments, error, said):
    with pytest.raises(error, match=said):
        hbnlp.describing_function(*arguments)
