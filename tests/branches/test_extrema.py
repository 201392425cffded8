"""Peaks of an output along a branch: closed forms, and every maximum of a traced branch."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.extrema import locate_peak, peaks
from hbnlp.branches.tracing import trace
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.kinds import Kind
from hbnlp.solutions.ipopt import Ipopt
from hbnlp.solutions.search import find_all
from hbnlp.solutions.solving import solve
from hbnlp.systems import duffing, tuned_absorber
from hbnlp.systems.system import System
from hbnlp.testing import check_branch


def exact_peak(z, g, force):
    """(W, A) of 3 z^2 g A^4 + 4 z^2 (1 - z^2) A^2 = F^2 and W^2 = 1 + 3/4 g A^2 - 2 z^2.

    There A is stationary by W^2 in the balance of one harmonic, ((1 - W^2 + 3/4 g A^2)^2 + 4 z^2 W^2) A^2 = F^2.
    """
    a, b = 3 * z**2 * g, 4 * z**2 * (1 - z**2)
    square = 2 * force**2 / (b + np.sqrt(b**2 + 4 * a * force**2))
    return np.sqrt(1 + 0.75 * g * square - 2 * z**2), np.sqrt(square)


@pytest.mark.parametrize("case", [(0.025, 0.1, 0.18), (0.05, 1.0, 0.5), (0.2, 0.3, 0.4), (0.1, 0.0, 1.0)])
def test_the_peak_of_duffing_with_one_harmonic_is_the_closed_form(case):
    z, g, force = case
    problem = HarmonicBalance(duffing(damping_ratio=z, cubic=g, force=force), 1)
    branch = trace(problem, "omega", (0.3, 3.0), stability=None)
    check_branch(branch)
    (peak,) = peaks(branch, "x")
    assert peak.kind is Kind.PEAK
    assert peak.refined
    omega, amplitude = exact_peak(z, g, force)
    assert abs(peak.solution.harmonics("x")[1]) == pytest.approx(amplitude, rel=1e-10)
    assert peak.value == pytest.approx(omega, rel=1e-10)
    assert peak.solution.parameters["omega"] == peak.value
    assert abs(branch.parameter[peak.index] - peak.value) < 0.1


@settings(max_examples=15, deadline=None)
@given(st.floats(0.02, 0.3), st.floats(0.0, 0.5), st.floats(0.05, 0.5), st.floats(0.001, 0.1))
def test_a_peak_is_reached_from_below_it(z, g, force, shift):
    omega, amplitude = exact_peak(z, g, force)
    problem = HarmonicBalance(duffing(damping_ratio=z, cubic=g, force=force), 1)
    answer = force / (1.0 - omega**2 + 0.75 * g * amplitude**2 + 2j * z * omega)
    guess = [[0.0, answer.real, -answer.imag]]
    near = solve(problem, at={"omega": omega * (1.0 - shift * z)}, start=guess)
    peak = locate_peak(problem, "x", "omega", near)
    assert abs(peak.solution.harmonics("x")[1]) == pytest.approx(amplitude, rel=1e-9)
    assert peak.value == pytest.approx(omega, rel=1e-8)


def test_a_peak_in_the_force_there_is_none():
    """The amplitude rises with the force on the lower leg for ever."""
    problem = HarmonicBalance(duffing(damping_ratio=0.3), 1)
    branch = trace(problem, "force", (0.01, 1.0), at={"omega": 0.9}, stability=None)
    check_branch(branch)
    assert peaks(branch, "x") == []


def test_a_linear_oscillator_has_its_peak_of_velocity_at_resonance_and_of_displacement_below():
    z = 0.1
    system = System(
        1.0,
        2 * z,
        1.0,
        forcing=lambda tau, p: [ca.cos(tau)],
        outputs={"x": lambda s: s.q[0], "v": lambda s: s.v[0], "a": lambda s: s.a[0]},
    )
    branch = trace(HarmonicBalance(system, 1), "omega", (0.5, 2.0), stability=None)
    check_branch(branch)
    exact = {"x": np.sqrt(1 - 2 * z**2), "v": 1.0, "a": 1.0 / np.sqrt(1 - 2 * z**2)}
    for output, omega in exact.items():
        (peak,) = peaks(branch, output)
        assert peak.value == pytest.approx(omega, rel=1e-8)


def test_higher_harmonics_have_peaks_of_their_own():
    """The third harmonic of the Duffing oscillator is largest near a third of the resonance, and near the resonance."""
    problem = HarmonicBalance(duffing(damping_ratio=0.1, cubic=0.2, force=0.5), 5)
    branch = trace(problem, "omega", (0.25, 2.0), stability=None)
    check_branch(branch)
    found = peaks(branch, "x", harmonic=3)
    assert len(found) >= 2
    assert found[0].value == pytest.approx(1.0 / 3.0, abs=0.1)
    for peak in found:
        here = abs(peak.solution.harmonics("x")[3])
        for shift in (-1e-3, 1e-3):
            beside = solve(problem, at={"omega": peak.value + shift}, start=peak.solution)
            assert abs(beside.harmonics("x")[3]) < here


def test_all_maxima_along_a_folded_branch_are_found_in_order():
    problem = HarmonicBalance(tuned_absorber(force=0.15), 5)
    branch = trace(problem, "omega", (0.5, 3.0), stability=None)
    check_branch(branch)
    for output in ("x1", "x2"):
        amplitude = np.abs(branch.harmonics(output)[:, 1])
        tops = 1 + np.flatnonzero((amplitude[1:-1] >= amplitude[:-2]) & (amplitude[1:-1] > amplitude[2:]))
        found = peaks(branch, output)
        np.testing.assert_array_equal([peak.index for peak in found], tops)
        for peak, top in zip(found, tops, strict=True):
            assert abs(peak.solution.harmonics(output)[1]) >= amplitude[top] * (1 - 1e-9)
            low, high = peak.bracket
            assert low <= peak.value <= high
            values = problem.values(peak.solution.parameters)
            assert np.abs(problem.assembly.residual(peak.solution.coefficients.ravel(), values)).max() < 1e-9


def test_the_peak_of_a_closed_branch_is_found_wherever_it_begins():
    problem = HarmonicBalance(tuned_absorber(force=0.15), 5)
    large = find_all(problem, at={"omega": 1.9})[-1]
    isola = trace(problem, "omega", (0.8, 2.6), start=large, stability=None)
    assert isola.closed
    (peak,) = peaks(isola, "x1")
    again = trace(problem, "omega", (0.8, 2.6), start=peak.solution, stability=None)
    assert again.closed
    (at_the_seam,) = peaks(again, "x1")
    assert at_the_seam.index == 0
    assert at_the_seam.value == pytest.approx(peak.value, rel=1e-9)
    for output, harmonic in (("x2", 1), ("x1", 3)):
        one, other = (sorted(p.value for p in peaks(loop, output, harmonic=harmonic)) for loop in (isola, again))
        assert one == pytest.approx(other, rel=1e-9)


def test_a_branch_from_a_file_needs_its_problem(tmp_path):
    problem = HarmonicBalance(duffing(), 3)
    branch = trace(problem, "omega", (0.5, 1.6), stability=None)
    branch.save(tmp_path / "branch.npz")
    loaded = Branch.load(tmp_path / "branch.npz")
    with pytest.raises(ValueError, match=r"from a file has no problem.* pass the problem .* problem=\.\.\."):
        peaks(loaded, "x")
    again, first = peaks(loaded, "x", problem=problem), peaks(branch, "x")
    assert [p.value for p in again] == pytest.approx([p.value for p in first], rel=1e-9)


def test_where_there_is_no_peak_the_error_says_what_to_do():
    problem = HarmonicBalance(duffing(), 1)
    near = solve(problem, at={"omega": 0.5})
    with pytest.raises(
        ConvergenceError, match=r"no peak of 'x' found near omega = 0\.5 .* start from the largest point"
    ) as e:
        locate_peak(problem, "x", "omega", near, method=Ipopt(max_iterations=2))
    assert not e.value.result.converged


def test_names_and_harmonics_are_checked():
    problem = HarmonicBalance(duffing(), 3)
    near = solve(problem, at={"omega": 1.2})
    with pytest.raises(KeyError, match="unknown output 'y'"):
        locate_peak(problem, "y", "omega", near)
    with pytest.raises(KeyError, match="unknown parameter 'omga'"):
        locate_peak(problem, "x", "omga", near)
    with pytest.raises(ValueError, match="harmonic is 7; give an integer from 1 to 3"):
        locate_peak(problem, "x", "omega", near, harmonic=7)
    branch = trace(problem, "omega", (0.5, 0.7), stability=None)
    for harmonic in (0, 4):
        with pytest.raises(ValueError, match=f"harmonic is {harmonic}; give an integer from 1 to 3"):
            peaks(branch, "x", harmonic=harmonic)
