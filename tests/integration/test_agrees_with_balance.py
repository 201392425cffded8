"""What is traced is what happens: direct integration stays on stable branches and leaves unstable ones."""

from types import SimpleNamespace

import numpy as np
import pytest
from independent import FirstOrder

from hbnlp.aero import thin_airfoil
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.fourier import FourierBasis, to_complex
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.settling import integrate, state_of
from hbnlp.solutions.solving import solve
from hbnlp.systems import duffing, tuned_absorber
from hbnlp.testing import check_branch
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.membrane import NonlinearMembrane, QuasiLinearMembrane


def traced(system, n_harmonics, span, at, points):
    problem = HarmonicBalance(system, n_harmonics)
    branch = trace(problem, "omega", span, at=at)
    check_branch(branch)
    return SimpleNamespace(branch=branch, system=system, points=points)


CASES = {
    "Duffing": lambda: traced(duffing(), 11, (0.5, 1.6), {}, 3),
    "absorber": lambda: traced(tuned_absorber(force=0.15), 11, (0.6, 2.5), {}, 3),
    "wing": lambda: traced(
        membrane_wing(QuasiLinearMembrane(prestrain=0.008, n_modes=2), thin_airfoil(2)),
        31,
        (5.0, 12.0),
        {"pitch_amplitude": 0.1, "pitch_mean": 0.02},
        2,
    ),
}


@pytest.fixture(scope="module", params=CASES.values(), ids=CASES.keys())
def case(request):
    return request.param()


def chosen(case, *, stable):
    """Points along the branch, those whose motion decays or grows fast enough to be seen."""
    modulus = np.abs(case.branch.multipliers[:, 0])
    period = 2 * np.pi / case.branch.parameter
    rate = np.log(modulus) / period
    fit = np.flatnonzero(rate < -0.01 if stable else rate > 0.05)
    return [int(k) for k in fit[np.linspace(0, fit.size - 1, case.points).astype(int)]]


def start(case, k):
    """The state on the branch and the equations at its parameters."""
    solution = case.branch.solution(k)
    values = case.system.parameters.values(solution.parameters)
    return solution, state_of(case.system, solution.coefficients, values), FirstOrder(case.system, solution.parameters)


def first_harmonics(first_order, state, n_dof):
    """Those of the displacements over one period from a state, (n_dof,)."""
    basis, period = FourierBasis(8, 128), 2 * np.pi / first_order.omega
    samples = first_order.run(state, period, basis.theta / first_order.omega)[:n_dof]
    return to_complex(samples @ basis.projection.T)[:, 1]


def test_the_multipliers_at_the_folds_show_that_there_are_harmonics_enough(case):
    assert len(case.branch.folds) >= 2
    for fold in case.branch.folds:
        assert fold.multiplier == pytest.approx(1.0, abs=1e-3)


def test_every_point_returns_to_itself_after_a_period(case):
    """Stable or not: with enough harmonics the state on the branch is that of a periodic motion."""
    for k in np.linspace(0, len(case.branch) - 1, 8).astype(int):
        _, state, first_order = start(case, k)
        end = first_order.run(state, 2 * np.pi / first_order.omega)
        np.testing.assert_allclose(end, state, atol=2e-5 * np.abs(state).max())


def test_independent_integration_comes_back_to_stable_points(case):
    n = case.system.n_dof
    for k in chosen(case, stable=True):
        solution, state, first_order = start(case, k)
        modulus = abs(case.branch.multipliers[k, 0])
        # so many periods that the disturbance falls to a thousandth
        periods = int(np.ceil(np.log(1e-3) / np.log(max(modulus, 1e-3)))) + 1
        disturbed = state * 1.002 + 1e-4 * np.abs(state).max()
        settled = first_order.run(disturbed, periods * 2 * np.pi / first_order.omega, rtol=1e-8, atol=1e-10)
        found = first_harmonics(first_order, settled, n)
        exact = to_complex(solution.coefficients)[:, 1]
        np.testing.assert_allclose(found, exact, atol=2e-5 * np.abs(exact).max())


def test_the_packages_own_integration_has_all_outputs_of_stable_points(case):
    for k in chosen(case, stable=True):
        solution, _, _ = start(case, k)
        response = integrate(case.system, at=solution.parameters, start=solution, method=Adaptive())
        for output in solution.output_names:
            exact = solution.harmonics(output)
            found = response.harmonics(output, 3)
            size = max(np.abs(exact).max(), 1e-3)
            np.testing.assert_allclose(found, exact[:4], atol=1e-4 * size, err_msg=output)


def test_integration_leaves_unstable_points_for_a_stable_one(case):
    n = case.system.n_dof
    for k in chosen(case, stable=False)[-1:]:
        solution, state, first_order = start(case, k)
        exact = to_complex(solution.coefficients)[:, 1]
        modulus = abs(case.branch.multipliers[k, 0])
        # so many periods that a disturbance of 1e-3 would have grown ten times the motion itself
        periods = int(np.ceil(np.log(1e4) / np.log(modulus))) + 5
        gone = first_order.run(state * 1.001, periods * 2 * np.pi / first_order.omega, rtol=1e-8, atol=1e-10)
        found = first_harmonics(first_order, gone, n)
        assert np.abs(found - exact).max() > 0.02 * np.abs(exact).max()


def test_between_its_folds_duffing_goes_to_one_of_two_stable_motions():
    case = CASES["Duffing"]()
    k = int(np.argmax(np.abs(case.branch.multipliers[:, 0])))
    omega = case.branch.parameter[k]
    solution, state, first_order = start(case, k)
    stable = case.branch.stable
    motions = []
    for part in (slice(0, case.branch.folds[0].index), slice(case.branch.folds[1].index + 1, None)):
        x, size = case.branch.parameter[part], np.abs(case.branch.harmonics("x")[part, 1])
        order = np.argsort(x)
        motions.append(np.interp(omega, x[order], size[order]))
        assert stable[part].all()
    reached = set()
    for factor in (0.95, 1.05):
        settled = first_order.run(factor * state, 120 * 2 * np.pi / omega, rtol=1e-8, atol=1e-10)
        size = abs(first_harmonics(first_order, settled, 1)[0])
        assert abs(size - abs(solution.harmonics("x")[1])) > 0.1
        nearest = int(np.argmin(np.abs(np.array(motions) - size)))
        assert size == pytest.approx(motions[nearest], rel=0.02)
        reached.add(nearest)
    assert reached == {0, 1}


@pytest.mark.parametrize("membrane", [QuasiLinearMembrane, NonlinearMembrane])
def test_the_balance_of_a_wing_converges_to_its_integration_with_every_harmonic(membrane):
    """Lag states, mean incidence and even harmonics included; the error falls faster than any power of H."""
    wing = membrane_wing(membrane(prestrain=0.008, n_modes=2), thin_airfoil(2))
    at = {"omega": 2.2, "pitch_amplitude": 0.1, "pitch_mean": 0.03}
    first_order = FirstOrder(wing, at)
    settled = first_order.run(np.zeros(wing.n_state), 50 * 2 * np.pi / 2.2, rtol=1e-7, atol=1e-10)
    exact = first_harmonics(first_order, settled, 2)
    errors = []
    for n_harmonics in (3, 7, 11):
        solution = solve(HarmonicBalance(wing, n_harmonics), at=at)
        found = to_complex(solution.coefficients)[:, 1]
        errors.append(np.abs(found - exact).max() / np.abs(exact).max())
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 0.1 * errors[1]
    assert errors[2] < 2e-5
