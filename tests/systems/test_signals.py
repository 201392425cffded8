"""Fourier coefficients of forcing and motion, against closed forms: smooth pulses, steps, kinks, switches that move."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.fourier import to_complex
from hbnlp.systems.parameters import Namespace, ParameterSet
from hbnlp.systems.signals import PeriodicSignals

H = 6
ORDERS = np.arange(1, H + 1)
ODD = ORDERS % 2 == 1


def signals(rule, **parameters):
    known = ParameterSet(parameters)
    tau, p = ca.SX.sym("tau"), ca.SX.sym("p", len(known.names))
    named = Namespace("parameter", {name: p[i] for i, name in enumerate(known.names)})
    return PeriodicSignals("forcing", ca.vertcat(rule(tau, named)), tau, p, known)


def amplitudes(mean, rest):
    return np.concatenate([[mean], rest])


def pulse(a):
    root = np.sqrt(a**2 - 1.0)
    return amplitudes(1.0 / root, 2.0 / root * (a - root) ** ORDERS)


def rectangle(shift, width):
    return amplitudes(width / np.pi, 2.0 / np.pi * np.sin(ORDERS * width) / ORDERS * np.exp(-1j * ORDERS * shift))


SQUARE = amplitudes(0.0, np.where(ODD, -4j / np.pi / ORDERS, 0.0))
SAWTOOTH = amplitudes(np.pi, 2j / ORDERS)
TRIANGLE = amplitudes(np.pi / 2, np.where(ODD, -4 / np.pi / ORDERS**2, 0.0))
HALF_WAVE = amplitudes(1 / np.pi, [0.5, 2 / 3 / np.pi, 0, -2 / 15 / np.pi, 0, 2 / 35 / np.pi])

CASES = {
    "a pulse": (lambda tau, p: 1 / (p.a - ca.cos(tau)), {"a": 1.0005}, pulse(1.0005)),
    "a sharp pulse": (lambda tau, p: 1 / (p.a - ca.cos(tau)), {"a": 1.0 + 1e-5}, pulse(1.0 + 1e-5)),
    "a square": (lambda tau, p: ca.sign(ca.sin(tau)), {}, SQUARE),
    "a square by a choice": (lambda tau, p: ca.if_else(ca.sin(tau) > 0, 1.0, -1.0), {}, SQUARE),
    "a square by its slope": (lambda tau, p: ca.sin(tau) / ca.fabs(ca.sin(tau)), {}, SQUARE),
    "a sawtooth": (lambda tau, p: ca.fmod(tau, 2 * np.pi), {}, SAWTOOTH),
    "a sawtooth by a floor": (lambda tau, p: tau - 2 * np.pi * ca.floor(tau / 2 / np.pi), {}, SAWTOOTH),
    "a triangle": (lambda tau, p: ca.acos(ca.cos(tau)), {}, TRIANGLE),
    "a half wave": (lambda tau, p: ca.fmax(ca.cos(tau), 0.0), {}, HALF_WAVE),
    "a rectified wave": (lambda tau, p: 0.5 * (ca.cos(tau) + ca.sqrt(ca.cos(tau) ** 2)), {}, HALF_WAVE),
    "a rectangle": (
        lambda tau, p: ca.cos(tau - p.shift) > ca.cos(p.width),
        {"shift": 1.0, "width": 0.1},
        rectangle(1.0, 0.1),
    ),
    "a narrow rectangle": (
        lambda tau, p: ca.cos(tau - p.shift) > ca.cos(p.width),
        {"shift": 1.0, "width": 1e-3},
        rectangle(1.0, 1e-3),
    ),
    "a wide rectangle": (
        lambda tau, p: ca.cos(tau - p.shift) > ca.cos(p.width),
        {"shift": 3.0, "width": np.pi - 1e-3},
        rectangle(3.0, np.pi - 1e-3),
    ),
    "a high harmonic": (lambda tau, p: ca.cos(300 * tau) + ca.sin(2 * tau), {}, amplitudes(0, [0, -1j, 0, 0, 0, 0])),
}


@pytest.mark.parametrize(("rule", "parameters", "expected"), CASES.values(), ids=CASES)
def test_coefficients_are_those_of_the_closed_form(rule, parameters, expected):
    of = signals(rule, **parameters, omega=1.0)
    values = np.array([*parameters.values(), 1.0])
    found = to_complex(of.coefficients(values, H))[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.max(np.abs(expected)))


@pytest.mark.parametrize("a", [1.5, 1.01, 1.0 + 1e-4])
def test_a_pulse_becomes_as_steep_as_its_parameter_makes_it(a):
    of = signals(lambda tau, p: 1 / (p.a - ca.cos(tau)), a=2.0)
    np.testing.assert_allclose(to_complex(of.coefficients(np.array([a, 1.0]), H))[0], pulse(a), rtol=1e-11)


MOVING = {
    "a pulse": (lambda tau, p: 1 / (p.a - ca.cos(tau)), {"a": 2.0}, 1.3),
    "the width of a rectangle": (lambda tau, p: 3.0 * (ca.cos(tau) > ca.cos(p.a)), {"a": 0.5}, 0.3),
    "the shift of a step": (lambda tau, p: ca.sign(ca.sin(tau - p.a)), {"a": 0.5}, 0.9),
    "the shift of a triangle": (lambda tau, p: ca.asin(ca.sin(tau - p.a)), {"a": 0.5}, 0.9),
    "the shift of a sawtooth": (lambda tau, p: ca.fmod(tau + p.a, 2 * np.pi), {"a": 0.5}, 0.9),
    "the level of a limiter": (lambda tau, p: ca.fmin(ca.cos(tau), p.a), {"a": 0.5}, 0.7),
    "a switch that stays": (lambda tau, p: p.a**2 * ca.sign(ca.sin(tau)), {"a": 0.5}, 0.7),
    "a harmonic": (lambda tau, p: p.a**2 * ca.cos(tau + p.a), {"a": 0.5}, 0.7),
}


@pytest.mark.parametrize(("rule", "defaults", "value"), MOVING.values(), ids=MOVING)
def test_derivatives_by_a_parameter_and_expressions_follow_the_switches(rule, defaults, value):
    of, step = signals(rule, **defaults), 1e-5
    slope = of.slope(np.array([value, 1.0]), 0, H)
    ahead, behind = (of.coefficients(np.array([value + d, 1.0]), H) for d in (step, -step))
    np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), atol=1e-7 * np.max(np.abs(slope)))
    p = ca.MX.sym("p", 2)
    expression = of.symbolic(p, H)
    by = ca.Function("f", [p], [expression, ca.jacobian(ca.vec(expression), p)])
    found, jacobian = (e.full() for e in by([value, 1.0]))
    np.testing.assert_allclose(found, of.coefficients(np.array([value, 1.0]), H), atol=1e-11)
    np.testing.assert_allclose(jacobian[:, 0], slope[0], atol=1e-10 * np.max(np.abs(slope)))


def test_a_switch_that_is_gone_is_an_error_of_the_expression_not_a_wrong_number():
    of = signals(lambda tau, p: ca.fmin(ca.cos(tau), p.a), a=0.5)
    p = ca.MX.sym("p", 2)
    expression = ca.Function("f", [p], [of.symbolic(p, H)])
    with pytest.raises(RuntimeError, match="switch_0_of_forcing"):
        expression([1.5, 1.0])
    found = to_complex(of.coefficients(np.array([1.5, 1.0]), H))[0]
    np.testing.assert_allclose(found, np.eye(H + 1)[1], atol=1e-14)


def test_a_multiple_of_the_phase_that_is_not_whole_is_an_error_where_it_is_given():
    of = signals(lambda tau, p: ca.cos(p.order * tau), order=2.0)
    np.testing.assert_allclose(to_complex(of.coefficients(np.array([3.0, 1.0]), H))[0], np.eye(H + 1)[3], atol=1e-13)
    with pytest.raises(ValueError, match=r"not 2 pi-periodic in tau = omega t at order = 2\.5"):
        of.coefficients(np.array([2.5, 1.0]), H)


def test_what_cannot_be_resolved_is_an_error_that_says_how_far_it_is_known():
    of = signals(lambda tau, p: 1 / ca.fabs(ca.sin(tau)) ** 0.99, a=1.0)
    with pytest.raises(ValueError, match=r"harmonics of forcing are known to .* only, 1e-09 is needed"):
        of.coefficients(np.ones(2), H)


def test_what_was_asked_for_is_kept_while_no_parameter_of_its_own_changes(monkeypatch):
    of = signals(lambda tau, p: p.a * ca.sign(ca.sin(tau)), a=1.0)
    first = of.coefficients(np.array([1.0, 1.0]), H)
    monkeypatch.setattr(of, "_sampled", None)
    np.testing.assert_array_equal(of.coefficients(np.array([1.0, 2.0]), H), first)


def test_a_smooth_signal_has_the_coefficients_of_equidistant_samples_to_round_off():
    of = signals(lambda tau, p: ca.exp(ca.cos(tau)) + ca.sin(3 * tau), a=1.0)
    tau = 2 * np.pi * np.arange(128) / 128
    expected = np.fft.rfft(np.exp(np.cos(tau)) + np.sin(3 * tau))[: H + 1] / 64
    expected[0] *= 0.5
    np.testing.assert_allclose(to_complex(of.coefficients(np.ones(2), H))[0], expected, atol=1e-14)


def test_an_expression_asks_for_typical_values_where_the_default_ones_are_singular():
    of = signals(lambda tau, p: 1 / (p.a - ca.cos(tau)), a=np.nan)
    np.testing.assert_allclose(to_complex(of.coefficients(np.array([2.0, 1.0]), H))[0], pulse(2.0), rtol=1e-12)
    with pytest.raises(ValueError, match=r"forcing is singular at the default values .* give parameters typical"):
        of.symbolic(ca.MX.sym("p", 2), H)
