"""Continuation in an amplitude from and to rest, in stiffness, in damping, and of the membrane wing."""

import numpy as np
import pytest

from hbnlp.aero import thin_airfoil
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.core.kinds import End
from hbnlp.solutions.solving import solve
from hbnlp.systems import duffing
from hbnlp.testing import check_branch
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.membrane import QuasiLinearMembrane


def test_an_amplitude_is_continued_from_rest():
    """F^2 = A^2 ((1 - W^2 + 3/4 g A^2)^2 + (2 z W)^2) is stationary in A^2 at both folds of the force, exactly."""
    z, g, omega = 0.025, 0.1, 1.2
    problem = HarmonicBalance(duffing(), 1)
    branch = trace(problem, "force", (0.0, 0.5), at={"omega": omega})
    check_branch(branch)
    np.testing.assert_array_equal(branch.coefficients[0], 0.0)
    assert branch.end is End.SPAN_END
    detuning, drag = 1 - omega**2, (2 * z * omega) ** 2
    k = 0.75 * g
    squares = np.sort(np.roots([3 * k**2, 4 * k * detuning, detuning**2 + drag]))
    exact = np.sqrt(squares * ((detuning + k * squares) ** 2 + drag))
    np.testing.assert_allclose([fold.value for fold in branch.folds], exact, rtol=1e-10)


def test_an_amplitude_is_continued_down_to_rest_and_through_it():
    problem = HarmonicBalance(duffing(), 3)
    up = trace(problem, "force", (0.0, 0.5), at={"omega": 1.2}, stability=None)
    down = trace(problem, "force", (0.5, 0.0), at={"omega": 1.2}, stability=None)
    through = trace(problem, "force", (-0.5, 0.5), at={"omega": 1.2}, stability=None)
    for branch in (down, through):
        check_branch(branch)
        assert branch.end is End.SPAN_END
    assert down.parameter[-1] == 0.0
    np.testing.assert_allclose(down.coefficients[-1], 0.0, atol=1e-12)
    values = [fold.value for fold in up.folds]
    np.testing.assert_allclose([fold.value for fold in down.folds], values[::-1], rtol=1e-11)
    mirrored = [-values[1], -values[0], *values]
    np.testing.assert_allclose([fold.value for fold in through.folds], mirrored, rtol=1e-11)


@pytest.mark.parametrize(
    ("name", "span"), [("cubic", (0.0, 1.0)), ("damping_ratio", (0.3, 0.01)), ("cubic", (-0.1, 1.0))]
)
def test_any_parameter_can_be_continued_in(name, span):
    problem = HarmonicBalance(duffing(), 3)
    branch = trace(problem, name, span, at={"omega": 1.2})
    check_branch(branch)
    assert branch.end is End.SPAN_END
    at = {"omega": 1.2, name: branch.parameter[-1]}
    again = solve(problem, at=at, start=branch.solution(len(branch) - 1))
    np.testing.assert_allclose(again.coefficients, branch.coefficients[-1], atol=1e-8)


def test_a_membrane_wing_is_traced_in_frequency_and_in_pitch_from_rest():
    wing = membrane_wing(QuasiLinearMembrane(prestrain=0.008, n_modes=2), thin_airfoil(2))
    problem = HarmonicBalance(wing, 3)
    up = trace(problem, "pitch_amplitude", (0.0, 0.1), at={"omega": 2.0})
    check_branch(up)
    np.testing.assert_array_equal(up.amplitudes[0, :1], 0.0)
    across = trace(problem, "omega", (0.5, 2.0), at={"pitch_amplitude": 0.1})
    check_branch(across)
    np.testing.assert_allclose(across.coefficients[-1], up.coefficients[-1], atol=1e-9)
    assert across.harmonics("C_L").shape == (len(across), 4)
