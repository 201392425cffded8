"""What an expression's operations tell: its highest harmonic, its degree in the motion, where it is not smooth."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.systems.spectrum import Spectrum, spectra
from hbnlp.systems.switches import switches

TAU, Q, P = ca.SX.sym("tau"), ca.SX.sym("q"), ca.SX.sym("p", 2)

KNOWN = {
    "a number": (ca.SX(3.0), (0, 0)),
    "a parameter": (ca.exp(P[0]), (0, 0)),
    "a cosine": (P[0] * ca.cos(TAU), (0, 1)),
    "a phase": (ca.cos(3 * TAU + P[1]) ** 2, (0, 6)),
    "sums of phases": (ca.sin(TAU + TAU - 5 * TAU), (0, 3)),
    "no phase": (ca.sin(TAU - TAU), (0, 0)),
    "halves": (ca.sin(4 * TAU / 2), (0, 2)),
    "a product": (ca.cos(2 * TAU) * ca.sin(TAU - 0.3), (0, 3)),
    "parametric": (Q * ca.sin(TAU) + Q**3, (3, 1)),
    "over a parameter": (Q**2 / P[0], (2, 0)),
}


@pytest.mark.parametrize(("expression", "expected"), KNOWN.values(), ids=KNOWN)
def test_the_highest_harmonic_and_degree_are_read_off(expression, expected):
    function = ca.Function("f", [Q, TAU, P], [ca.densify(expression)])
    assert spectra(function, 1, (0,)) == [[Spectrum(*expected)]]


UNKNOWN = {
    "a fraction": 1 / (2 - ca.cos(TAU)),
    "an exponential": ca.exp(ca.cos(TAU)),
    "a step": ca.sign(ca.sin(TAU)),
    "a parameter before the phase": ca.cos(P[0] * TAU),
    "a half phase": ca.cos(TAU / 2),
    "tau": TAU,
    "the motion in a phase": ca.cos(TAU + Q),
    "the motion below": 1 / Q,
    "a root": ca.sqrt(1.0 + ca.cos(TAU)),
}


@pytest.mark.parametrize("expression", UNKNOWN.values(), ids=UNKNOWN)
def test_no_highest_harmonic_is_claimed_of_others(expression):
    assert spectra(ca.Function("f", [Q, TAU, P], [expression]), 1, (0,)) == [[None]]


@pytest.mark.parametrize(
    ("expression", "zeros"),
    [
        (ca.sign(ca.sin(TAU)), [0.0, np.pi]),
        (ca.fabs(ca.cos(TAU)), [0.5 * np.pi]),
        (ca.if_else(TAU < 2.0, 1.0, TAU), [2.0]),
        (ca.fmod(TAU, 2 * np.pi), [0.0, 2 * np.pi]),
        (ca.floor(TAU / np.pi), [0.0, np.pi]),
        (ca.fmax(ca.cos(TAU), 0.5), [np.pi / 3]),
        (ca.sqrt(1 - ca.cos(TAU)), [0.0]),
        (ca.acos(ca.cos(TAU)), [0.0, np.pi]),
        (ca.atan2(ca.sin(TAU), ca.cos(TAU)), [np.pi]),
        (ca.atan(ca.tan(TAU)), [0.5 * np.pi]),
    ],
)
def test_switches_are_zero_where_an_expression_is_not_smooth(expression, zeros):
    found = ca.Function("s", [TAU], [switches(expression, lambda e: ca.jacobian(e, TAU))])
    for zero in zeros:
        assert np.min(np.abs(found(zero).full())) < 1e-15


def test_what_is_smooth_has_no_switches():
    assert switches(ca.exp(ca.cos(TAU)) / (2 + Q**2)).numel() == 0
    assert switches(ca.SX(1.0)).numel() == 0
