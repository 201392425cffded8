"""Period doublings, Neimark-Sacker and branch points: located, checked by direct integration, and followed."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from independent import FirstOrder, multipliers, state
from scipy.optimize import brentq

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.detection import crossings
from hbnlp.branches.switching import switch_branch
from hbnlp.branches.tracing import trace
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.core.kinds import End, Kind
from hbnlp.solutions.identity import relation
from hbnlp.solutions.solving import solve
from hbnlp.stability.result import Floquet
from hbnlp.systems import chain, duffing, tuned_absorber
from hbnlp.systems.symmetry import Symmetry
from hbnlp.systems.system import System
from hbnlp.testing import check_branch

EVEN = slice(0, None, 2)  # of complex amplitudes 0, 1, 2, ...


def mathieu_duffing():
    """x'' + .1 x' + (1 + .5 cos w t) x + .5 x^3 = .1 cos w t: its response doubles its period about w = 2."""
    return System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [p.modulation * ca.cos(tau) * q[0] + p.cubic * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"modulation": 0.5, "cubic": 0.5, "force": 0.1},
    )


# -- period doubling ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def doubling():
    problem = HarmonicBalance(mathieu_duffing(), 8)
    branch = trace(problem, "omega", (1.2, 3.0))
    check_branch(branch)
    return problem, branch, branch.of_kind(Kind.PERIOD_DOUBLING)


def test_the_response_is_unstable_between_two_period_doublings(doubling):
    _, branch, (first, second) = doubling
    assert all(point.refined for point in (first, second))
    between = (branch.parameter > first.value) & (branch.parameter < second.value)
    np.testing.assert_array_equal(branch.stable, ~between)
    assert len(branch.special_points) == 2


def test_period_doublings_are_where_shooting_finds_the_multiplier_minus_one(doubling):
    _, branch, points = doubling
    system = branch.problem.system
    for point in points:
        near = state(point.solution)

        def beyond(omega, near=near):
            _, matrix = FirstOrder(system, {"omega": omega}).periodic(near)
            return np.linalg.det(matrix + np.eye(2))

        exact = brentq(beyond, point.value - 1e-3, point.value + 1e-3, xtol=1e-12)
        assert point.value == pytest.approx(exact, abs=1e-9)
        assert point.multiplier == pytest.approx(-1.0, abs=1e-8)


def test_an_independent_monodromy_matrix_has_the_multiplier_minus_one_there(doubling):
    _, branch, points = doubling
    for point in points:
        first_order = FirstOrder(branch.problem.system, point.solution.parameters)
        _, matrix = first_order.monodromy(state(point.solution), 2 * np.pi / point.value)
        assert np.abs(multipliers(matrix) + 1.0).min() < 1e-8


def test_the_doubled_solution_repeats_after_two_periods_and_not_after_one(doubling):
    _problem, branch, points = doubling
    for point in points:
        starts = switch_branch(point)
        assert len(starts) == 2
        for start in starts:
            assert start.periods == start.problem.periods == 2
            values = start.problem.values(start.parameters)
            assert np.abs(start.problem.residual(start.coefficients.ravel(), values).full()).max() < 1e-9
            odd = np.abs(start.harmonics("x")[1::2]).max()
            assert odd > 1e-3 * np.abs(start.harmonics("x")).max()
            first_order = FirstOrder(branch.problem.system, start.parameters)
            period = 2 * np.pi / start.omega
            begin = state(start)
            once, twice = first_order.run(begin, period), first_order.run(begin, 2 * period)
            np.testing.assert_allclose(twice, begin, atol=1e-8)
            assert np.abs(once - begin).max() > 1e-4


def test_the_two_starts_are_one_solution_a_period_apart(doubling):
    _problem, _, points = doubling
    one, other = switch_branch(points[0])
    period = 2 * np.pi / one.omega
    t = np.linspace(0.0, 2 * period, 20)
    assert other.omega == pytest.approx(one.omega, abs=1e-9)
    np.testing.assert_allclose(other.displacement(t), one.displacement(t + period), atol=1e-6)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("which", [0, 1])
def test_the_doubled_branch_leaves_the_period_doubling_as_a_square_root(doubling, which, side):
    _problem, _, points = doubling
    point = points[which]
    start = switch_branch(point)[side]
    options = PseudoArclength(max_points=25)
    branch = trace(start, "omega", (1.2, 3.0), method=options)
    check_branch(branch)
    assert branch.periods == 2
    assert branch.special_points == ()
    subharmonic = np.abs(branch.harmonics("x")[:, 1])
    assert np.all(np.diff(subharmonic) > 0.0)
    beyond = np.abs(branch.parameter - point.value)
    early = (beyond > 1e-5) & (beyond < 1e-2)
    order = np.polyfit(np.log(beyond[early]), np.log(subharmonic[early]), 1)[0]
    assert order == pytest.approx(0.5, abs=0.05)
    # the response jumps softly to the stable side of the first, and not at all to the second
    assert branch.stable[-1] == (which == 0)


def test_the_stable_doubled_response_is_where_time_integration_goes(doubling):
    _problem, branch, points = doubling
    start = switch_branch(points[0])[0]
    doubled = trace(start, "omega", (1.2, 2.0), stability=None)
    check_branch(doubled)
    assert doubled.end is End.SPAN_END
    solution = doubled.solution(len(doubled) - 1)
    first_order = FirstOrder(branch.problem.system, solution.parameters)
    settled = first_order.run(np.array([0.3, 0.0]), 2 * np.pi / 2.0 * 200)
    one, other = (solution.displacement([t])[0, 0] for t in (0.0, np.pi))
    assert min(abs(settled[0] - one), abs(settled[0] - other)) < 1e-5


def test_the_doubled_balance_has_the_bifurcation_as_a_branch_point(doubling):
    """The same branch over two periods: -1 squared is +1, and the Jacobian is singular there."""
    _, branch, points = doubling
    problem = HarmonicBalance(branch.problem.system, 16, periods=2)
    twice = trace(problem, "omega", (1.2, 3.0))
    check_branch(twice)
    found = [point.value for point in twice.branch_points]
    np.testing.assert_allclose(found, [point.value for point in points], rtol=1e-6)
    assert [p.multiplier.real for p in twice.branch_points] == pytest.approx([1.0, 1.0], abs=1e-4)


# -- Neimark-Sacker ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def absorber():
    problem = HarmonicBalance(tuned_absorber(force=0.15), 9)
    branch = trace(problem, "omega", (0.9, 1.4))
    check_branch(branch)
    return problem, branch


def test_a_pair_crosses_the_unit_circle_at_the_neimark_sacker_point(absorber):
    problem, branch = absorber
    (point,) = branch.of_kind(Kind.NEIMARK_SACKER)
    assert point.refined
    assert abs(point.multiplier) == pytest.approx(1.0, abs=1e-8)
    assert abs(point.multiplier.imag) > 0.1
    first_order = FirstOrder(problem.system, point.solution.parameters)
    _, matrix = first_order.monodromy(state(point.solution), 2 * np.pi / point.value)
    found = multipliers(matrix)
    critical = found[np.argmin(np.abs(found - point.multiplier))]
    assert critical == pytest.approx(point.multiplier, abs=1e-6)
    moduli = [np.sort(np.abs(branch.multipliers[k])) for k in (point.index, point.index + 1)]
    assert sum((m > 1.0).sum() for m in moduli) == 2


def test_the_neimark_sacker_point_is_where_shooting_finds_it(absorber):
    problem, branch = absorber
    (point,) = branch.of_kind(Kind.NEIMARK_SACKER)
    near = state(point.solution)

    def beyond(omega):
        _, matrix = FirstOrder(problem.system, {"omega": omega}).periodic(near)
        return np.abs(multipliers(matrix))[0] - 1.0

    exact = brentq(beyond, point.value - 2e-4, point.value + 2e-4, xtol=1e-11)
    fine = HarmonicBalance(problem.system, 15)
    start = solve(fine, at={"omega": point.value - 0.002}, start=point.solution)
    short = trace(fine, "omega", (point.value - 0.002, point.value + 0.002), start=start)
    check_branch(short)
    (better,) = short.of_kind(Kind.NEIMARK_SACKER)
    assert better.value == pytest.approx(exact, abs=1e-7)


def test_no_branch_of_periodic_solutions_crosses_there(absorber):
    _problem, branch = absorber
    (point,) = branch.of_kind(Kind.NEIMARK_SACKER)
    with pytest.raises(ValueError, match="no branch crosses at a Neimark-Sacker; a branch point or a period doubling"):
        switch_branch(point)
    with pytest.raises(ValueError, match="no branch crosses at a fold"):
        switch_branch(branch.folds[0])


# -- folds -------------------------------------------------------------------------------------------------------------


def test_the_multiplier_at_a_truncated_fold_comes_nearer_to_one_with_every_harmonic():
    distances = []
    for n_harmonics in (1, 3, 5, 7, 9):
        problem = HarmonicBalance(duffing(damping_ratio=0.05, cubic=1.0, force=0.5), n_harmonics)
        branch = trace(problem, "omega", (1.2, 3.0), stability=Floquet(tol=1e-10))
        check_branch(branch, modulus_tol=1e-10)
        distances.append([abs(fold.multiplier - 1.0) for fold in branch.folds])
    distances = np.array(distances)
    assert np.all(distances[1:] < np.maximum(0.3 * distances[:-1], 1e-8))
    assert distances[0].max() > 1e-3
    assert distances[-1].max() < 1e-6


def test_exactly_one_multiplier_crosses_at_every_fold(absorber):
    _, branch = absorber
    for fold in branch.folds:
        before, after = (np.sum(np.abs(branch.multipliers[k]) > 1.0) for k in (fold.index, fold.index + 1))
        others = [p for p in branch.special_points if p.index == fold.index and p is not fold]
        if not others:
            assert abs(before - after) == 1


# -- branch points -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def broken():
    """A chain of three with a branch along which its symmetry x(t + T/2) = -x(t) is lost, and found again."""
    problem = HarmonicBalance(chain(3), 5)
    branch = trace(problem, "omega", (2.5, 0.4), stability=Floquet(tol=1e-5))
    check_branch(branch, modulus_tol=1e-5)
    assert len(branch.branch_points) >= 2
    return problem, branch


def test_at_a_branch_point_the_null_vector_breaks_the_symmetry_of_the_solution(broken):
    problem, branch = broken
    for point in branch.branch_points:
        assert point.refined
        assert np.abs(point.solution.coefficients[:, 0::4]).max() < 1e-9  # the mean
        x, values = point.solution.coefficients.ravel(), problem.values(point.solution.parameters)
        jacobian = problem.assembly.jacobian(x, values)
        null = point.null.ravel() / np.linalg.norm(point.null)
        assert np.linalg.norm(jacobian @ null) < 1e-5 * np.linalg.norm(jacobian, 2)
        harmonic = (np.arange(problem.shape[1]) + 1) // 2
        assert np.abs(point.null[:, harmonic % 2 == 1]).max() < 1e-6 * np.abs(point.null).max()
        assert point.multiplier == pytest.approx(1.0, abs=1e-3)


def test_the_other_branch_is_another_one_and_its_two_sides_are_mirror_images(broken):
    problem, branch = broken
    for point in branch.branch_points:
        starts = switch_branch(point)
        assert len(starts) == 2
        means = []
        for start in starts:
            values = problem.values(start.parameters)
            residual = np.abs(problem.residual(start.coefficients.ravel(), values).full()).max()
            assert residual < 1e-9
            even = np.abs(start.harmonics("x3")[EVEN]).max()
            assert even > 1e-4
            means.append(start.harmonics("x3")[0].real)
            same = solve(problem, at=start.parameters, start=point.solution)
            if np.abs(same.harmonics("x3")[EVEN]).max() < 1e-9:
                assert np.linalg.norm(same.coefficients - start.coefficients) > 1e-3
        assert means[0] * means[1] < 0.0
        assert means[0] == pytest.approx(-means[1], rel=0.05)


@pytest.mark.parametrize("side", [0, 1])
def test_the_other_branch_leads_from_one_branch_point_to_the_other(broken, side):
    _problem, branch = broken
    first, second = branch.branch_points[:2]
    start = switch_branch(first)[side]
    options = PseudoArclength(max_points=400)
    other = trace(start, "omega", (0.9, 1.5), stability=None, method=options)
    check_branch(other)
    even = np.abs(other.harmonics("x3")[:, EVEN]).max(axis=1)
    assert np.all(even[:5] > 1e-4)
    assert even.max() > 5 * even[0]
    # it meets the symmetric branch again at the second point
    distance = np.linalg.norm(other.coefficients - second.solution.coefficients, axis=(1, 2))
    assert distance.min() < 0.1 * np.linalg.norm(second.solution.coefficients)


def test_a_step_that_is_no_step_is_refused(broken):
    _problem, branch = broken
    for step in (0.0, -0.1, 1.0):
        with pytest.raises(ValueError, match=f"step is {step}; give a finite number greater than 0 and less than 1"):
            switch_branch(branch.branch_points[0], step=step)


def test_a_pitchfork_in_a_static_parameter_is_switched_exactly():
    """x^3 = mu x beside a small load: at mu = 0 the rest of a cubic spring loses its stability to +-sqrt(mu)."""
    system = System(
        1.0,
        0.3,
        lambda p: -p.mu,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        parameters={"mu": -0.5, "omega": 1.0},
    )
    problem = HarmonicBalance(system, 1)
    branch = trace(problem, "mu", (-0.5, 0.7), start=np.zeros((1, 3)))
    check_branch(branch)
    (point,) = branch.branch_points
    assert point.value == pytest.approx(0.0, abs=1e-8)
    assert branch.stable[0]
    assert not branch.stable[-1]


# -- which symmetry breaks ---------------------------------------------------------------------------------------------

SWAP = Symmetry([[0, 1], [1, 0]], name="swap")


def test_a_duffing_oscillator_under_a_large_load_loses_its_half_period_sign_change():
    problem = HarmonicBalance(duffing(damping_ratio=0.05, cubic=1.0, force=2.0), 9)
    branch = trace(problem, "omega", (0.6, 1.2))
    check_branch(branch)
    assert len(branch.branch_points) == 2
    for point in branch.branch_points:
        assert point.breaks.name == "half-period sign change"
        assert "breaks 'half-period sign change', between" in repr(point)
        assert point.solution.is_odd
        one, other = switch_branch(point)
        assert not one.is_odd
        assert relation(one, other, tol=1e-3) in (None, point.breaks)  # None: they lie at different frequencies
    assert all(fold.breaks is None for fold in branch.folds)


def test_all_branch_points_of_the_chain_break_it(broken):
    _, branch = broken
    assert {point.breaks.name for point in branch.branch_points} == {"half-period sign change"}


def test_equal_oscillators_in_phase_lose_what_swaps_them():
    system = System(
        np.eye(2),
        0.08 * np.eye(2),
        [[1.05, -0.05], [-0.05, 1.05]],
        nonlinear_force=lambda q, v, tau, p: q**3,
        forcing=lambda tau, p: [0.1 * ca.cos(tau)] * 2,
        symmetries=[SWAP],
    )
    problem = HarmonicBalance(system, 3)
    branch = trace(problem, "omega", (0.8, 2.5), stability=None)
    check_branch(branch)
    assert len(branch.branch_points) == 2
    for point in branch.branch_points:
        assert point.breaks == SWAP
        assert len(point.solution.symmetries) == 3
        one, other = switch_branch(point)
        assert [each.name for each in one.symmetries] == ["half-period sign change"]
        assert relation(one, other) == SWAP
        image = one.image(SWAP)
        np.testing.assert_allclose(image.origin.coefficients, one.origin.coefficients, atol=1e-9)
        short = PseudoArclength(max_points=10)
        there, mirrored = (trace(s, "omega", (0.8, 2.5), stability=None, method=short) for s in (other, image))
        np.testing.assert_allclose(mirrored.parameter, there.parameter, rtol=1e-8)
        np.testing.assert_allclose(mirrored.coefficients, there.coefficients, atol=1e-7)


def test_a_plain_crossing_breaks_nothing():
    """x^2 = mu x: at mu = 0 the rest and x = mu cross, the transcritical bifurcation."""
    system = System(
        1.0,
        0.3,
        lambda p: -p.mu,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 2],
        parameters={"mu": -0.5, "omega": 1.0},
    )
    branch = trace(HarmonicBalance(system, 1), "mu", (-0.5, 0.7), start=np.zeros((1, 3)))
    check_branch(branch)
    (point,) = branch.branch_points
    assert point.breaks is None
    assert "breaks" not in repr(point)


def test_rest_under_a_pump_loses_the_sign_change_and_half_a_period_but_not_both():
    system = System(1.0, 0.005, 1.0, nonlinear_force=lambda q, v, tau, p: [-0.3 * ca.cos(2 * tau) * q[0] + q[0] ** 3])
    problem = HarmonicBalance(system, 5)
    branch = trace(problem, "omega", (0.7, 1.3), start=np.zeros((1, 11)), stability=None)
    assert [point.breaks.name for point in branch.branch_points] == ["sign change", "sign change"]
    (start, _) = switch_branch(branch.branch_points[0])
    assert [each.name for each in start.symmetries] == ["half-period sign change"]


def test_over_two_periods_a_period_doubling_breaks_the_shift_by_one(doubling):
    _, branch, points = doubling
    twice = trace(HarmonicBalance(branch.problem.system, 16, periods=2), "omega", (1.2, 3.0), stability=None)
    assert len(twice.branch_points) == len(points)
    assert {point.breaks.name for point in twice.branch_points} == {"shift by 1 forcing period"}


# -- what multipliers imply --------------------------------------------------------------------------------------------

PAIR_IN, PAIR_OUT = [0.7 + 0.6j, 0.7 - 0.6j], [0.9 + 0.6j, 0.9 - 0.6j]
STEPS = {
    "nothing": ([0.5, 0.4], [0.6, 0.3], ()),
    "a fold": ([0.9, 0.5], [1.1, 0.5], ()),
    "a period doubling": ([-0.9, 0.5], [-1.1, 0.5], (Kind.PERIOD_DOUBLING,)),
    "a period doubling back": ([-1.1, 0.5], [-0.9, 0.5], (Kind.PERIOD_DOUBLING,)),
    "a period doubling of what is unstable": ([1.5, -0.9], [1.5, -1.1], (Kind.PERIOD_DOUBLING,)),
    "a pair goes out": (PAIR_IN, PAIR_OUT, (Kind.NEIMARK_SACKER,)),
    "a pair comes in": (PAIR_OUT, PAIR_IN, (Kind.NEIMARK_SACKER,)),
    "a pair goes out beside an unstable one": ([1.3, *PAIR_IN], [1.4, *PAIR_OUT], (Kind.NEIMARK_SACKER,)),
    "an unstable pair becomes real": (PAIR_OUT, [1.2, 1.1], ()),
    "an unstable pair becomes real beyond -1": ([-0.9 + 0.6j, -0.9 - 0.6j], [-1.2, -1.1], ()),
    "a pair becomes real and one of it comes in": (
        [1.07 + 0.31j, 1.07 - 0.31j, 0.45 + 0.2j, 0.45 - 0.2j],
        [1.2, 0.95, 0.47 + 0.21j, 0.47 - 0.21j],
        (),
    ),
    "a pair goes out while one comes in through -1": (
        [-1.1, *PAIR_IN],
        [-0.9, *PAIR_OUT],
        (Kind.PERIOD_DOUBLING, Kind.NEIMARK_SACKER),
    ),
    "a pair comes in, becomes real, and one goes out": (
        [-0.98 + 0.23j, -0.98 - 0.23j],
        [-1.08, -0.81],
        (Kind.PERIOD_DOUBLING, Kind.NEIMARK_SACKER),
    ),
    "a pair goes out while one comes in through +1": ([1.1, *PAIR_IN], [0.9, *PAIR_OUT], (Kind.NEIMARK_SACKER,)),
    "a pair and one through +1 go out": ([0.9, *PAIR_IN], [1.1, *PAIR_OUT], (Kind.NEIMARK_SACKER,)),
}


@pytest.mark.parametrize(("before", "after", "kinds"), STEPS.values(), ids=STEPS)
def test_multipliers_of_neighbours_imply_what_lies_between(before, after, kinds):
    shared = {"converged": True, "options": Floquet()}
    a, b = (SimpleNamespace(multipliers=np.array(m, dtype=complex), **shared) for m in (before, after))
    assert crossings(a, b) == kinds


def test_multipliers_that_are_not_converged_imply_nothing():
    a = SimpleNamespace(converged=True, multipliers=np.array([-0.9, 0.5], dtype=complex))
    b = SimpleNamespace(converged=False, multipliers=np.array([-1.1, 0.5], dtype=complex))
    assert crossings(a, b) == crossings(b, a) == ()
