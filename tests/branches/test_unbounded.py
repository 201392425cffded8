"""Motions that grow without bound: a linear system at resonance and at thresholds of parametric excitation.

q'' + d q' + (1 + depth cos 2 tau) q = load cos tau with one harmonic has its threshold where
(1 - w^2)^2 + d^2 w^2 = depth^2 / 4: at w = 1, depth = 2 d.
"""

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.testing import check_branch

DAMPING = 0.02


def mathieu(load, *, cubic=0.0, n_harmonics=1, damping=DAMPING):
    system = hbnlp.System(
        1.0,
        damping,
        1.0,
        nonlinear_force=lambda q, v, tau, p: p.depth * ca.cos(2 * tau) * q + (cubic * q**3 if cubic else 0.0),
        forcing=lambda tau, p: load * ca.cos(tau),
        parameters={"depth": 0.0},
    )
    return hbnlp.HarmonicBalance(system, n_harmonics)


@pytest.mark.parametrize(("n_harmonics", "load"), [(1, 1e-6), (1, 1e6), (5, 1.0)])
def test_a_linear_response_ends_at_its_threshold(n_harmonics, load):
    branch = hbnlp.trace(mathieu(load, n_harmonics=n_harmonics), "depth", (0.0, 1.0), at={"omega": 1.0})
    assert branch.end is hbnlp.End.UNBOUNDED
    assert not branch.complete
    assert "without bound" in branch.message
    assert branch.parameter[-1] == pytest.approx(2.0 * DAMPING, rel=1e-9 if n_harmonics == 1 else 1e-4)
    assert len(branch) < 200
    assert branch.special_points == ()
    check_branch(branch)


@pytest.mark.parametrize("span", [(0.5, 1.5), (1.5, 0.5)])
def test_a_tongue_of_a_linear_system_is_entered_from_neither_side(span):
    depth = 0.3
    branch = hbnlp.trace(mathieu(1.0), "omega", span, at={"depth": depth})
    roots = np.sqrt(np.roots([1.0, DAMPING**2 - 2.0, 1.0 - depth**2 / 4.0]).real)
    assert branch.end is hbnlp.End.UNBOUNDED
    assert branch.parameter[-1] == pytest.approx(min(roots) if span[0] < 1.0 else max(roots), rel=1e-9)
    assert branch.folds == ()


def test_the_far_side_of_a_resonance_without_damping_is_traced_from_a_start_there():
    system = hbnlp.System(1.0, 0.0, 1.0, forcing=lambda tau, p: ca.cos(tau))
    problem = hbnlp.HarmonicBalance(system, 1)
    for span in [(0.6, 1.5), (1.5, 0.6)]:
        branch = hbnlp.trace(problem, "omega", span)
        assert branch.end is hbnlp.End.UNBOUNDED
        assert branch.parameter[-1] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(("name", "span"), [("depth", (0.0, 1.0)), ("omega", (0.5, 1.5))])
def test_at_rest_motions_of_any_size_cross_at_the_threshold(name, span):
    at = {"omega": 1.0} if name == "depth" else {"depth": 0.3}
    rest = hbnlp.trace(mathieu(0.0, n_harmonics=5), name, span, at=at)
    assert rest.end is hbnlp.End.SPAN_END
    crossing = rest.branch_points[0]
    for start in hbnlp.switch_branch(crossing):
        vertical = hbnlp.trace(start, name, span)
        assert vertical.end is hbnlp.End.UNBOUNDED
        assert vertical.parameter == pytest.approx(crossing.value, rel=1e-12)
        assert len(vertical) < 100
        assert vertical.special_points == ()


def test_a_doubling_of_rest_of_a_linear_system_is_vertical_as_well():
    system = hbnlp.System(
        1.0, DAMPING, 1.0, nonlinear_force=lambda q, v, tau, p: p.depth * ca.cos(tau) * q, parameters={"depth": 0.3}
    )
    rest = hbnlp.trace(hbnlp.HarmonicBalance(system, 5), "omega", (1.5, 2.5))
    doubling = rest.of_kind("PD")[0]
    vertical = hbnlp.trace(hbnlp.switch_branch(doubling)[0], "omega", (1.5, 2.5))
    assert vertical.end is hbnlp.End.UNBOUNDED


@pytest.mark.parametrize("cubic", [1e-9, 1.0, 1e9])
def test_a_cubic_stiffness_however_small_bounds_the_response(cubic):
    """The branch goes past the threshold, and ends at the span's end."""
    branch = hbnlp.trace(mathieu(1e-3, cubic=cubic, n_harmonics=3), "depth", (0.0, 1.0), at={"omega": 1.0})
    assert branch.complete
    check_branch(branch)


def test_the_branch_that_leaves_rest_does_not_stand_still_for_ever():
    """Its parameter is stationary at the pitchfork: small motions grow there too."""
    rest = hbnlp.trace(mathieu(0.0, cubic=1.0, n_harmonics=3), "depth", (0.0, 1.0), at={"omega": 1.0})
    branch = hbnlp.trace(hbnlp.switch_branch(rest.branch_points[0])[0], "depth", (0.0, 1.0))
    assert branch.complete


def test_a_light_damping_bounds_the_response():
    system = hbnlp.System(1.0, 1e-6, 1.0, forcing=lambda tau, p: ca.cos(tau))
    branch = hbnlp.trace(hbnlp.HarmonicBalance(system, 1), "omega", (0.6, 1.5))
    assert branch.complete
    assert np.abs(branch.coefficients).max() == pytest.approx(1e6, rel=1e-2)


def test_a_start_in_the_problems_place_brings_its_other_parameters():
    """omega has no value of its own: it is the start's."""
    problem = mathieu(1.0)
    start = hbnlp.solve(problem, at={"omega": 1.3, "depth": 0.0})
    assert hbnlp.trace(start, "depth", (0.0, 0.01)).parameters["omega"] == 1.3


@pytest.mark.parametrize("span", [(-0.5, 0.5), (0.5, -0.5)])
def test_a_resonance_at_a_parameter_of_zero_is_an_end(span):
    """(detuning) q = cos tau in the first harmonic: the response is 1 / detuning."""
    system = hbnlp.System(
        1.0, 0.0, lambda p: 1.0 + p.detuning, forcing=lambda tau, p: ca.cos(tau), parameters={"detuning": 0.1}
    )
    branch = hbnlp.trace(hbnlp.HarmonicBalance(system, 1), "detuning", span, at={"omega": 1.0})
    assert branch.end is hbnlp.End.UNBOUNDED
    assert branch.parameter[-1] == pytest.approx(0.0, abs=1e-9)


def test_at_a_resonance_without_damping_the_response_to_a_growing_force_is_bounded():
    """3/4 q^3 = force with one harmonic: where the force is zero, the response grows with an infinite slope."""
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=0.0, cubic=1.0, force=0.0), 1)
    start = np.array([[0.0, (4.0 / 3.0 * 0.1) ** (1.0 / 3.0), 0.0]])
    branch = hbnlp.trace(problem, "force", (1.0, -1.0), at={"omega": 1.0, "force": 0.1}, start=start)
    assert branch.end is hbnlp.End.SPAN_END
    assert branch.coefficients[-1, 0, 1] == pytest.approx(-((4.0 / 3.0) ** (1.0 / 3.0)), rel=1e-8)
