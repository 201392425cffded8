"""Folds of the Duffing oscillator: closed form, independent values, any units; a linear response has none."""

import casadi as ca
import numpy as np
import pytest
from numpy_balance import CubicBalance

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.core.kinds import End
from hbnlp.systems import duffing
from hbnlp.systems.system import System
from hbnlp.testing import check_branch

# x'' + 2 z x' + x + g x^3 = F cos(W t): (z, g, F), and W of the fold that jumps up and of the one that jumps down, with
# 3 harmonics and converged in their number; by tests/numpy_balance.py, as tested below. The first set is example 1 of
# NLvib (Krack and Gross 2019, doi:10.1007/978-3-030-14023-6).
DUFFING = [
    ((0.025, 0.1, 0.18), (1.115700246882, 1.269600032145), (1.115700251771, 1.2696019555)),
    ((0.05, 1.0, 0.5), (1.438669909563, 2.211937689810), (1.438670145514, 2.211935317020)),
]


def exact_folds(z, g, force):
    """(W, A) of both folds with one harmonic, by falling amplitude.

    p^2 - 2 s p + 4 z^2 (1 + s + p) = 0 and W^2 = 1 + s + p; with a = A^2, s = 3/4 g a and p = c / a^2, where
    c = 2 F^2 / (3 g), the first times a^4 is a quintic in a.
    """
    k, c = 0.75 * g, 2.0 * force**2 / (3.0 * g)
    roots = np.roots([4 * z**2 * k, 4 * z**2, -2 * k * c, 4 * z**2 * c, 0.0, c**2])
    a = np.sort(roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0.0)].real)[::-1]
    return [(np.sqrt(1.0 + k * x + c / x**2), np.sqrt(x)) for x in a]


@pytest.mark.parametrize("case", [case[0] for case in DUFFING])
def test_duffing_folds_with_one_harmonic_are_the_closed_form(case):
    z, g, force = case
    branch = trace(HarmonicBalance(duffing(damping_ratio=z, cubic=g, force=force), 1), "omega", (0.5, 3.0))
    check_branch(branch)
    assert branch.end is End.SPAN_END
    assert all(fold.refined for fold in branch.folds)
    found = [(fold.value, abs(fold.solution.harmonics("x")[1])) for fold in branch.folds]
    np.testing.assert_allclose(found, exact_folds(z, g, force), rtol=1e-10)


@pytest.mark.parametrize(("case", "three", "converged"), DUFFING)
def test_the_tabulated_folds_are_those_of_a_balance_in_numpy(case, three, converged):
    z, g, force = case
    for n_harmonics, (up, down), tol in ((3, three, 1e-11), (11, converged, 1e-10), (15, converged, 1e-10)):
        balance = CubicBalance(1.0, 2 * z, 1.0, 1.0, g, 1.0, n_harmonics)
        for exact, (omega, amplitude) in zip((down, up), exact_folds(z, g, force), strict=True):
            answer = force / (1.0 - omega**2 + 0.75 * g * amplitude**2 + 2j * z * omega)
            start = np.zeros(2 * n_harmonics + 1)
            start[1:3] = answer.real, -answer.imag
            assert balance.fold(start, omega, force)[0] == pytest.approx(exact, rel=tol)


@pytest.mark.parametrize(("case", "three", "converged"), DUFFING)
def test_duffing_folds_are_those_of_independent_codes(case, three, converged):
    z, g, force = case
    for n_harmonics, (up, down), tol in ((3, three, 1e-11), (11, converged, 1e-10)):
        problem = HarmonicBalance(duffing(damping_ratio=z, cubic=g, force=force), n_harmonics)
        branch = trace(problem, "omega", (0.5, 3.0))
        check_branch(branch)
        np.testing.assert_allclose([fold.value for fold in branch.folds], [down, up], rtol=tol)


def test_duffing_is_unstable_between_its_folds_alone_and_liouville_holds():
    branch = trace(HarmonicBalance(duffing(), 7), "omega", (0.5, 1.6))
    check_branch(branch)
    down, up = branch.folds
    between = np.arange(len(branch))
    np.testing.assert_array_equal(branch.stable, (between <= down.index) | (between > up.index))
    exact = np.exp(-2 * 0.025 * 2 * np.pi / branch.parameter)
    np.testing.assert_allclose(np.prod(branch.multipliers, axis=1), exact, rtol=1e-6)
    for fold in branch.folds:
        assert fold.multiplier == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(("length", "time"), [(1e-6, 1.0), (1e6, 1.0), (1.0, 1e-3), (1.0, 1e3), (1e-9, 1e-6)])
def test_other_units_need_no_tuning(length, time):
    system = System(
        1.0,
        0.05 / time,
        1.0 / time**2,
        nonlinear_force=lambda q, v, tau, p: [0.1 / (length * time) ** 2 * q[0] ** 3],
        forcing=lambda tau, p: [0.18 * length / time**2 * ca.cos(tau)],
    )
    branch = trace(HarmonicBalance(system, 3), "omega", (0.5 / time, 1.6 / time))
    check_branch(branch)
    up, down = DUFFING[0][1]
    np.testing.assert_allclose([fold.value * time for fold in branch.folds], [down, up], rtol=1e-10)


def test_a_linear_response_is_traced_without_special_points():
    system = System(1.0, 0.05, 1.0, forcing=lambda tau, p: [ca.cos(tau)])
    branch = trace(HarmonicBalance(system, 2), "omega", (0.2, 5.0))
    check_branch(branch)
    w = branch.parameter
    np.testing.assert_allclose(branch.harmonics("x")[:, 1], 1.0 / (1.0 - w**2 + 0.05j * w), rtol=1e-9)
    assert branch.special_points == ()
    assert branch.stable.all()
