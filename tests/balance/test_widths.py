"""What a width costs where dry friction sticks, as docs/contact.md tells it, against integration by events."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.solutions.solving import solve
from hbnlp.systems.system import System

FRICTION, DAMPING, OMEGA = 0.7, 0.1, 0.5
PERIOD = 2.0 * np.pi / OMEGA
ACCURATE = {"rtol": 1e-10, "atol": 1e-12, "dense_output": True}


def event(function, direction):
    function.terminal, function.direction = True, direction
    return function


def pulled(t, x):
    """Return the force on the mass but for damping and friction."""
    return np.cos(OMEGA * t) - x


def one_piece(t, y, way, end):
    """Integrate x'' + c x' + f sign x' + x = cos omega t until it stops, or, stuck (way 0), until it is torn loose."""
    if way == 0:
        loose = event(lambda t, z: abs(pulled(t, y[0])) - FRICTION, 1)
        return solve_ivp(lambda t, z: [0.0, 0.0], (t, end), y, events=loose, max_step=PERIOD / 200, **ACCURATE)

    def moving(t, z):
        return [z[1], pulled(t, z[0]) - DAMPING * z[1] - way * FRICTION]

    stops = event(lambda t, z: z[1] * way, -1)
    return solve_ivp(moving, (t, end), y, events=stops, method="DOP853", first_step=1e-3, **ACCURATE)


def by_events(n_periods=15, n_samples=2048):
    """Return the harmonics of the last period, and for which part of it the mass is stuck."""
    t, y, way, pieces, stuck = 0.0, np.array([0.0, 1e-9]), 1, [], 0.0
    end = n_periods * PERIOD
    while t < end - 1e-9:
        piece = one_piece(t, y, way, end)
        pieces.append(piece)
        if way == 0:
            stuck += max(piece.t[-1] - max(t, end - PERIOD), 0.0)
        t, y = piece.t[-1], np.array([piece.y[0, -1], 0.0])
        pull = pulled(t, y[0])
        way = 0 if way != 0 and abs(pull) <= FRICTION else int(np.sign(pull))
    times = end - PERIOD + PERIOD * np.arange(n_samples) / n_samples
    ends = np.array([piece.t[-1] for piece in pieces])
    x = [pieces[np.searchsorted(ends, each)].sol(each)[0] for each in times]
    return np.fft.rfft(x) / n_samples * 2.0, stuck / PERIOD


def test_the_first_harmonic_of_a_sticking_mass_is_too_small_by_as_much_as_the_page_says():
    exact, stuck = by_events()
    assert stuck == pytest.approx(0.28, abs=0.01)
    system = System(
        1.0,
        DAMPING,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [FRICTION * ca.tanh(v[0] / p.width)],
        forcing=lambda tau, p: [ca.cos(tau)],
        parameters={"width": 0.1, "omega": OMEGA},
    )
    problem, solution, errors = HarmonicBalance(system, 15), None, []
    for part in (0.2, 0.1, 0.05, 0.02, 0.01, 0.005):
        solution = solve(problem, at={"width": part * OMEGA * abs(exact[1])}, start=solution)
        errors.append(1.0 - abs(solution.harmonics("x")[1]) / abs(exact[1]))
    np.testing.assert_allclose(errors, [0.23, 0.14, 0.080, 0.034, 0.018, 0.012], rtol=0.05)
