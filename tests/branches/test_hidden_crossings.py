"""Special points that hide: two within one step, at rest, at pitchfork and common folds; and those that are none."""

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.testing import check_branch


def pumped(width, pumping, *, centre=1.0, twice=False):
    """An oscillator pumped near twice its frequency: rest is unstable over a relative width of omega, in closed form.

    With one harmonic (1 - w^2)^2 + g^2 w^2 = lam^2 / 4; narrow tongues have this width whatever the harmonics.
    """
    lam = 2.0 * width * pumping
    damping = np.sqrt((lam / 2.0) ** 2 - width**2)
    return hbnlp.System(
        [[1.0]],
        [[damping * centre]],
        [[centre**2]],
        nonlinear_force=lambda q, v, tau, p: [-lam * centre**2 * ca.cos((2 if twice else 1) * tau) * q[0] + q[0] ** 3],
    )


@pytest.mark.parametrize("seed", range(12))
def test_tongues_down_to_a_relative_width_of_1e_4_are_found_wherever_they_are(seed):
    rng = np.random.default_rng(seed)
    width, centre, twice = 10.0 ** rng.uniform(-4.0, -2.0), rng.uniform(0.8, 1.3), bool(rng.integers(2))
    system = pumped(width, rng.uniform(1.2, 3.0), centre=centre, twice=twice)
    low, high = np.array([0.85, 1.15]) * centre * (1 if twice else 2)
    span = (low, high) if rng.random() < 0.5 else (high, low)
    branch = hbnlp.trace(hbnlp.HarmonicBalance(system, int(rng.choice([1, 3, 5]))), "omega", span)
    assert [point.kind.code for point in branch.special_points] == (["BP", "BP"] if twice else ["PD", "PD"])
    assert np.ptp([point.value for point in branch.special_points]) / np.mean(span) == pytest.approx(width, rel=0.05)
    assert not branch.stable.all()


def test_a_tongue_ends_where_integration_says():
    """x'' + g x' + (1 - lam cos 2 w t) x + x^3, g = .005, lam = .011: by shooting (DOP853, 1e-11)."""
    system = hbnlp.System(
        [[1.0]],
        [[0.005]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [-0.011 * ca.cos(2 * tau) * q[0] + q[0] ** 3],
    )
    branch = hbnlp.trace(hbnlp.HarmonicBalance(system, 3), "omega", (0.95, 1.05))
    np.testing.assert_allclose([p.value for p in branch.branch_points], [0.998849340645, 1.001140628228], atol=1e-9)


@pytest.fixture(scope="module")
def twins():
    """Two identical coupled Duffing oscillators, whose in-phase motion has twelve branch points over this span."""
    system = hbnlp.System(
        np.eye(2),
        0.010785895345430643 * np.eye(2),
        [[1.3, -0.3], [-0.3, 1.3]],
        nonlinear_force=lambda q, v, tau, p: [0.886499750937639 * q[i] ** 3 for i in range(2)],
        forcing=lambda tau, p: [p.force * ca.cos(tau)] * 2,
        parameters={"force": 1.6116169316138198},
    )
    return hbnlp.HarmonicBalance(system, 5), (0.3287738405815925, 2.042799540138992)


@pytest.mark.parametrize("angle", [6.0, 8.5, 10.0, 11.6, 13.4])
def test_the_same_branch_points_are_found_both_ways(twins, angle):
    """However long the steps are; by the determinant alone each trace up misses a pair or two of them."""
    problem, (low, high) = twins
    options = {"stability": None, "method": hbnlp.PseudoArclength(angle=angle)}
    up = hbnlp.trace(problem, "omega", (low, high), **options)
    down = hbnlp.trace(problem, "omega", (high, low), start=up.solution(len(up) - 1), **options)
    values = [sorted(point.value for point in branch.branch_points) for branch in (up, down)]
    assert len(values[0]) == 12
    np.testing.assert_allclose(values[0], values[1], rtol=1e-8)


def parametron():
    return hbnlp.System(
        [[1.0]],
        [[0.01]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [-0.05 * ca.cos(2 * tau) * q[0] + q[0] ** 3 + 0.3 * q[0] ** 2 * v[0]],
    )


@pytest.mark.parametrize("n_harmonics", [1, 3])
def test_branches_begin_at_rest_on_both_sides_and_return_there(n_harmonics):
    """With one harmonic the tongue's edges are (1 - w^2)^2 + 1e-4 w^2 = .025^2; a fold and its mirror image follow."""
    problem = hbnlp.HarmonicBalance(parametron(), n_harmonics)
    rest = hbnlp.trace(problem, "omega", (0.9, 1.1))
    edges = np.sort(np.sqrt(np.roots([1.0, -2.0 + 1e-4, 1.0 - 0.025**2])))
    np.testing.assert_allclose([p.value for p in rest.branch_points], edges, atol=1e-9 if n_harmonics == 1 else 1e-4)
    for point in rest.branch_points:
        one, other = hbnlp.switch_branch(point)
        assert 1e-4 < np.abs(one.coefficients).max() < 0.1
        np.testing.assert_allclose(one.coefficients, -other.coefficients, rtol=1e-6)
    branch = hbnlp.trace(hbnlp.switch_branch(rest.branch_points[1])[0], "omega", (0.9, 1.1))
    check_branch(branch)
    assert len(branch) < 250
    assert branch.closed
    assert [point.kind.code for point in branch.special_points].count("LP") == 2
    assert len(branch.branch_points) in (1, 2)  # it begins and closes at one of them
    np.testing.assert_allclose(*[fold.value for fold in branch.folds], rtol=1e-9)


def test_a_doubling_of_rest_is_switched_at_as_well():
    system = pumped(0.01, 2.0)
    rest = hbnlp.trace(hbnlp.HarmonicBalance(system, 3), "omega", (1.9, 2.1))
    for point in rest.of_kind("PD"):
        starts = hbnlp.switch_branch(point)
        assert len(starts) == 2
        doubled = hbnlp.trace(starts[0], "omega", (1.9, 2.2), stability=None)
        assert doubled.periods == 2
        assert len(doubled) < 250


def test_without_damping_there_are_no_neimark_sackers():
    """The product of the two multipliers is one (Liouville): a pair stays on the unit circle."""
    system = hbnlp.System(
        [[1.0]],
        [[0.0]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [-(q[0] ** 3) / 6.0],
        forcing=lambda tau, p: [0.3 * ca.cos(tau)],
    )
    branch = hbnlp.trace(hbnlp.HarmonicBalance(system, 9), "omega", (1.3, 1.1))
    np.testing.assert_allclose(np.abs(branch.multipliers), 1.0, atol=1e-12)
    assert branch.special_points == ()


def test_a_tangent_beside_rest_does_not_make_a_fold():
    """Beside a pitchfork at rest a corrector misses by 4e-9: with its factors the tangent had the wrong sign there."""
    problem = hbnlp.HarmonicBalance(parametron(), 3)
    largest = max(hbnlp.find_all(problem, at={"omega": 1.0}), key=lambda s: np.abs(s.coefficients).max())
    branch = hbnlp.trace(problem, "omega", (0.9, 1.1), start=largest)
    assert branch.closed
    assert len(branch.branch_points) == 2
    np.testing.assert_allclose([fold.value for fold in branch.folds], [1.065897786783] * 2, rtol=1e-10)
    assert all(fold.refined for fold in branch.folds)


def test_a_broken_branch_has_pitchforks_and_no_folds_there():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=2.0), 9)
    symmetric = hbnlp.trace(problem, "omega", (0.6, 1.2))
    out = hbnlp.trace(hbnlp.switch_branch(symmetric.branch_points[0])[0], "omega", (0.6, 1.2))
    start = out.solution(len(out) // 2)
    broken = hbnlp.trace(problem, "omega", (0.6, 1.2), start=start)
    check_branch(broken)
    assert broken.folds == ()
    np.testing.assert_allclose(
        sorted(p.value for p in broken.branch_points), [p.value for p in symmetric.branch_points], atol=1e-8
    )


@pytest.mark.parametrize("coupling", [0.0, 0.05])
@pytest.mark.parametrize("count", [2, 3, 4])
def test_identical_parts_fold_where_one_of_them_does(count, coupling):
    """All move alike: the folds of the single oscillator, 1.115700 and 1.269602 with many harmonics."""
    stiffness = np.eye(count) + coupling * (2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1))
    stiffness[0, 0] -= coupling
    stiffness[-1, -1] -= coupling
    system = hbnlp.System(
        np.eye(count),
        0.05 * np.eye(count),
        stiffness,
        nonlinear_force=lambda q, v, tau, p: [0.1 * q[i] ** 3 for i in range(count)],
        forcing=lambda tau, p: [0.18 * ca.cos(tau)] * count,
    )
    branch = hbnlp.trace(hbnlp.HarmonicBalance(system, 5), "omega", (0.5, 1.6), stability=None)
    assert branch.complete
    assert all(fold.refined for fold in branch.folds)
    np.testing.assert_allclose([fold.value for fold in branch.folds], [1.269601955, 1.115700252], atol=2e-7)
    if coupling == 0.0:
        assert branch.branch_points == ()


def test_solutions_beside_a_pitchfork_at_which_a_branch_turns():
    """Between the pitchfork and the next points the branch and its mirror image pass each value."""
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=2.0), 9)
    symmetric = hbnlp.trace(problem, "omega", (0.6, 1.2))
    for point in symmetric.branch_points:
        one, other = hbnlp.switch_branch(point)
        branch = hbnlp.trace(one, "omega", (0.6, 1.2))
        for start in (one, other):
            sizes = [np.linalg.norm(s.coefficients - start.coefficients) for s in branch.at(start.omega)]
            assert min(sizes) < 1e-8 * np.linalg.norm(start.coefficients)
