"""A step in the force and a given number of samples: no tolerance is met by many harmonics, and that is said."""

import casadi as ca
import pytest

import hbnlp
from hbnlp.solutions import ipopt


@pytest.fixture
def friction():
    return hbnlp.System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [0.1 * ca.sign(v[0])],
        forcing=lambda tau, p: [0.4 * ca.cos(tau)],
        parameters={"omega": 0.9},
    )


def test_a_solve_ends_soon_and_says_how_far_it_came_and_what_a_larger_program_would_take(friction, monkeypatch):
    monkeypatch.setattr(ipopt, "LARGEST_PROGRAM", 10_000)  # or the test would take as long as what it is to show
    problem = hbnlp.HarmonicBalance(friction, tolerance=1e-9, n_samples=1025, most_harmonics=255)
    with pytest.raises(hbnlp.ConvergenceError) as caught:
        hbnlp.solve(problem)
    said = str(caught.value)
    assert "harmonics lead to a motion with an error of" in said
    assert "a step of 0.2" in said
    assert "IPOPT, which would take" in said
    assert caught.value.result.n_harmonics > 15


def test_a_program_of_seconds_an_iteration_is_not_quick(friction):
    assert ipopt.is_quick(hbnlp.HarmonicBalance(friction, 37, n_samples=8192))
    assert not ipopt.is_quick(hbnlp.HarmonicBalance(friction, 73, n_samples=16384))
