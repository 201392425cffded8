"""Folds two ways, by Newton's method and as a nonlinear program, and their derivatives by every parameter."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.aero import thin_airfoil
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.folds import fold_by_newton, fold_by_program, fold_sensitivity, left_null_vector
from hbnlp.branches.tracing import trace
from hbnlp.continuation.newton import Newton
from hbnlp.solutions.ipopt import Ipopt
from hbnlp.systems import chain, duffing, tuned_absorber
from hbnlp.systems.system import System
from hbnlp.testing import check_branch
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.membrane import QuasiLinearMembrane


def wing():
    """A wing that hardens so much at this pitch amplitude that its response folds."""
    return membrane_wing(QuasiLinearMembrane(prestrain=0.008, n_modes=2), thin_airfoil(2))


CASES = {
    "Duffing, one harmonic": (duffing(), 1, "omega", (0.5, 1.6), {}),
    "Duffing, strong": (duffing(damping_ratio=0.05, cubic=1.0, force=0.5), 7, "omega", (0.5, 3.0), {}),
    "Duffing, in the force": (duffing(), 5, "force", (0.05, 0.5), {"omega": 1.2}),
    "absorber": (tuned_absorber(force=0.15), 5, "omega", (0.9, 1.5), {}),
    "chain of three": (chain(3), 3, "omega", (2.5, 0.6), {}),
}


@pytest.fixture(params=CASES.values(), ids=CASES.keys(), scope="module")
def traced(request):
    system, n_harmonics, name, span, at = request.param
    problem = HarmonicBalance(system, n_harmonics)
    branch = trace(problem, name, span, at=at, stability=None)
    check_branch(branch)
    assert len(branch.folds) >= 2
    return problem, name, branch


def point(problem, fold):
    return fold.solution.coefficients.ravel(), problem.values(fold.solution.parameters)


def test_the_program_and_newton_find_the_same_folds(traced):
    """Of the folds of a branch, those where the parameter turns downward are maxima of it along the branch."""
    problem, name, branch = traced
    for fold in branch.folds:
        maximum = fold.value >= max(fold.bracket)
        x, values = point(problem, fold)
        values[problem.system.parameters.index(name)] *= 1.0 - 1e-4 * (1 if maximum else -1)
        by_program = fold_by_program(problem, x, values, name, Ipopt(), maximum=maximum)
        by_newton = fold_by_newton(problem, x, values, name, Newton())
        assert by_program.converged, by_program.reason
        assert by_newton.converged, by_newton.reason
        assert by_program.value == pytest.approx(by_newton.value, rel=1e-10)
        assert fold.value == pytest.approx(by_newton.value, rel=1e-10)
        np.testing.assert_allclose(by_program.x, by_newton.x, atol=1e-5 * np.abs(x).max())


def test_the_multiplier_of_the_program_is_the_left_null_vector(traced):
    problem, name, branch = traced
    for fold in branch.folds:
        maximum = fold.value >= max(fold.bracket)
        x, values = point(problem, fold)
        found = fold_by_program(problem, x, values, name, Ipopt(), maximum=maximum)
        values[problem.system.parameters.index(name)] = found.value
        jacobian = problem.assembly.jacobian(found.x, values)
        assert np.linalg.norm(found.left) == pytest.approx(1.0)
        assert np.abs(found.left @ jacobian).max() <= 1e-7 * np.abs(jacobian).max()
        left = left_null_vector(problem, x, problem.values(fold.solution.parameters), name, fold.null.ravel())
        assert abs(found.left @ left) / np.linalg.norm(left) == pytest.approx(1.0, abs=1e-8)


def test_null_vectors_annul_the_jacobian_from_both_sides(traced):
    problem, name, branch = traced
    for fold in branch.folds:
        x, values = point(problem, fold)
        jacobian, null = problem.assembly.jacobian(x, values), fold.null.ravel()
        size = np.abs(jacobian).max()
        assert np.linalg.norm(null) == pytest.approx(1.0, rel=1e-9)
        assert np.abs(jacobian @ null).max() <= 1e-9 * size
        left = left_null_vector(problem, x, values, name, null)
        assert np.abs(left @ jacobian).max() <= 1e-9 * size * np.linalg.norm(left)
        slope = problem.assembly.parameter_derivative(x, values, problem.system.parameters.index(name))
        assert left @ slope == pytest.approx(1.0)


def test_the_sensitivity_of_a_fold_is_the_difference_of_folds_located_again(traced):
    problem, name, branch = traced
    names = problem.system.parameters.names
    for fold in branch.folds[:4]:
        x, values = point(problem, fold)
        assert set(fold.sensitivity) == set(names) - {name}

        def located(shift, index, x=x, values=values, fold=fold):
            there = values.copy()
            there[index] += shift
            found = fold_by_newton(problem, x, there, name, Newton(tol=1e-12), fold.null.ravel())
            assert found.converged
            return found.value

        for other, slope in fold.sensitivity.items():
            index = names.index(other)
            h = 1e-4 * max(abs(values[index]), 1e-3)
            by_difference = (located(h, index) - located(-h, index)) / (2.0 * h)
            assert slope == pytest.approx(by_difference, rel=1e-5, abs=1e-8), other


def test_the_closed_form_gives_the_same_sensitivity_to_the_force():
    """With one harmonic, R(W^2, p, s) = 0: differences of the exact quintic's root."""

    def exact(force, z=0.025, g=0.1):
        k, c = 0.75 * g, 2.0 * force**2 / (3.0 * g)
        roots = np.roots([4 * z**2 * k, 4 * z**2, -2 * k * c, 4 * z**2 * c, 0.0, c**2])
        a = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0.0)].real
        return np.sort(np.sqrt(1.0 + k * a + c / a**2))

    branch = trace(HarmonicBalance(duffing(), 1), "omega", (0.5, 1.6), stability=None)
    check_branch(branch)
    slopes = (exact(0.18 + 1e-5) - exact(0.18 - 1e-5)) / 2e-5
    np.testing.assert_allclose(sorted(f.sensitivity["force"] for f in branch.folds), sorted(slopes), rtol=1e-7)


def test_any_multiple_of_the_left_null_vector_gives_the_same_sensitivity(traced):
    problem, name, branch = traced
    fold = branch.folds[0]
    x, values = point(problem, fold)
    left = left_null_vector(problem, x, values, name, fold.null.ravel())
    for factor in (1.0, -3.0, 1e-6):
        again = fold_sensitivity(problem, x, values, name, factor * left)
        assert again == pytest.approx(dict(fold.sensitivity), rel=1e-9)


def test_folds_of_a_wing_with_lag_states_are_found_both_ways():
    problem = HarmonicBalance(wing(), 3)
    at = {"pitch_amplitude": 0.3}
    branch = trace(problem, "omega", (0.5, 2.5), at=at, stability=None)
    check_branch(branch)
    assert len(branch.folds) == 2
    for fold in branch.folds:
        maximum = fold.value >= max(fold.bracket)
        x, values = point(problem, fold)
        found = fold_by_program(problem, x, values, "omega", Ipopt(), maximum=maximum)
        assert found.value == pytest.approx(fold.value, rel=1e-10)
        h = 1e-3
        index = problem.system.parameters.index("stiffness")
        values[index] += h
        above = fold_by_newton(problem, x, values, "omega", Newton(tol=1e-12), fold.null.ravel()).value
        values[index] -= 2 * h
        below = fold_by_newton(problem, x, values, "omega", Newton(tol=1e-12), fold.null.ravel()).value
        assert fold.sensitivity["stiffness"] == pytest.approx((above - below) / (2 * h), rel=1e-4)


def test_a_start_without_a_fold_near_says_so():
    problem = HarmonicBalance(duffing(cubic=0.0), 1)
    values = problem.values({"omega": 1.0})
    x = np.array([0.0, 1.0, 2.0])
    for found in (
        fold_by_newton(problem, x, values, "omega", Newton()),
        fold_by_program(problem, x, values, "omega", Ipopt(max_iterations=50), maximum=True),
    ):
        assert not found.converged
        assert found.reason


@pytest.mark.parametrize("place", ["damping", "force", "forcing"])
def test_a_parameter_at_the_edge_of_its_domain_leaves_the_others_their_derivatives(place):
    """That of sqrt(extra) at zero is infinite; those of the folds by the force are the Duffing oscillator's."""
    there = dict.fromkeys(["damping", "force", "forcing"], 0.0) | {place: 1.0}
    system = System(
        1.0,
        lambda p: 0.05 + there["damping"] * ca.sqrt(p.extra),
        1.0,
        nonlinear_force=lambda q, v, tau, p: 0.1 * q**3 + there["force"] * ca.sqrt(p.extra) * v,
        forcing=lambda tau, p: (p.force + there["forcing"] * ca.sqrt(p.extra)) * ca.cos(tau),
        parameters={"force": 0.18, "extra": 0.0},
    )
    folds = trace(HarmonicBalance(system, 5), "omega", (0.5, 1.6)).folds
    right = trace(HarmonicBalance(duffing(), 5), "omega", (0.5, 1.6)).folds
    assert [f.value for f in folds] == pytest.approx([f.value for f in right], rel=1e-9)
    given = [f.sensitivity["force"] for f in folds]
    assert given == pytest.approx([f.sensitivity["force"] for f in right], rel=1e-6)
    assert not any(np.isfinite(f.sensitivity["extra"]) for f in folds)
