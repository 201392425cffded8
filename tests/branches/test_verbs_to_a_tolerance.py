"""Following, switching and peaks to a tolerance: as many harmonics as a fold, a new branch or a peak asks for."""

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.branches.folds import fold_by_newton
from hbnlp.systems import duffing, tuned_absorber
from hbnlp.testing import check_branch

MANY = 15
SPAN = (0.5, 1.6)
ISOLA = [[0.0, -1.04, 1.44], [0.0, 0.64, -0.92]]


@pytest.fixture(scope="module")
def tolerant():
    return hbnlp.HarmonicBalance(duffing(), tolerance=1e-6)


@pytest.fixture(scope="module")
def branch(tolerant):
    return hbnlp.trace(tolerant, "omega", SPAN)


@pytest.fixture(scope="module")
def curve(branch):
    return hbnlp.follow(branch.folds[0], "force", span=(0.05, 1.0))


def isola(**options):
    problem = hbnlp.HarmonicBalance(tuned_absorber(force=0.15), **options)
    start = hbnlp.solve(problem, at={"omega": 1.9}, start=ISOLA)
    return hbnlp.trace(problem, "omega", (0.5, 3.0), start=start, stability=None)


# -- follow ------------------------------------------------------------------------------------------------------------


def test_every_fold_is_where_many_harmonics_have_it(curve):
    exact = hbnlp.HarmonicBalance(duffing(), MANY)
    assert curve.complete
    assert curve.truncation_error.max() <= 1e-6
    for k in range(0, len(curve), 6):
        motion = curve.solution(k)
        x, values = exact.vector(motion.coefficients), exact.values(motion.parameters)
        fold = fold_by_newton(exact, x, values, "omega", hbnlp.Newton())
        assert abs(fold.value - curve.first[k]) <= 1e-6 * fold.value
        error = np.linalg.norm(fold.x - x) / np.linalg.norm(fold.x)
        assert error == pytest.approx(curve.truncation_error[k], rel=0.2, abs=1e-10)


def test_numbers_of_harmonics_rise_along_a_fold_curve_and_fall_without_flapping(curve):
    assert len({*curve.n_harmonics}) >= 2
    assert np.count_nonzero(np.diff(curve.n_harmonics)) <= 8
    for k in range(0, len(curve), 9):
        own = int(curve.n_harmonics[k])
        assert curve.solution(k).problem.n_harmonics == own
        assert not np.any(curve.coefficients[k, :, 2 * own + 1 :])


def test_folds_have_an_error_where_isolas_are_born_and_merge_and_events_are_those_of_many_harmonics():
    """The fold's own parameter moves without bound there as the residual changes; the other one does not."""
    events = []
    for options in ({"tolerance": 1e-6}, {"n_harmonics": MANY}):
        curve = hbnlp.follow(isola(**options).folds[0], "force", span=(0.05, 0.3))
        events.append(curve.events)
        if curve.truncation_error is not None:
            assert curve.truncation_error.max() <= 1e-6
            assert curve.n_harmonics.max() < MANY
    assert [e.kind.value for e in events[0]] == ["cusp", "isola merge", "isola birth"]
    for one, other in zip(*events, strict=True):
        assert one.kind is other.kind
        np.testing.assert_allclose([one.first, one.second], [other.first, other.second], rtol=2e-6)


def test_a_cap_that_is_met_is_said_by_the_ends_of_a_fold_curve():
    curve = hbnlp.follow(isola(tolerance=1e-6, most_harmonics=3).folds[0], "force", span=(0.12, 0.16))
    assert curve.complete
    assert any("not within the tolerance 1e-06 with most_harmonics = 3" in end for end in curve.ends)
    assert curve.n_harmonics.max() == 3


def test_a_file_holds_the_numbers_of_folds_and_events(tmp_path, branch, tolerant):
    curve = hbnlp.follow(branch.folds[0], "force", span=(0.05, 0.3))
    curve.save(tmp_path / "curve.npz")
    loaded = hbnlp.FoldBranch.load(tmp_path / "curve.npz", problem=tolerant)
    for name in ("first", "second", "coefficients", "n_harmonics", "truncation_error"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(curve, name))
    assert loaded.ends == curve.ends
    assert [e.n_harmonics for e in loaded.events] == [e.n_harmonics for e in curve.events]
    np.testing.assert_array_equal(loaded.events[0].coefficients, curve.events[0].coefficients)
    if len({*curve.n_harmonics}) > 1:
        with pytest.raises(ValueError, match=r"the curve has . to . harmonics, the problem n_harmonics = 7 for all"):
            hbnlp.FoldBranch.load(tmp_path / "curve.npz", problem=hbnlp.HarmonicBalance(duffing(), 7))


def test_of_a_fixed_number_all_folds_have_it():
    branch = hbnlp.trace(hbnlp.HarmonicBalance(duffing(), 3), "omega", SPAN, stability=None)
    curve = hbnlp.follow(branch.folds[0], "force", span=(0.15, 0.2))
    assert {*curve.n_harmonics} == {3}
    assert curve.truncation_error is None


# -- switching ---------------------------------------------------------------------------------------------------------


def double_well():
    """x'' + .25 x' - x + x^3 = f cos t."""
    return hbnlp.System(
        1.0,
        0.25,
        -1.0,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"omega": 1.0, "force": 0.1},
    )


def first_crossing(subject, span):
    tracer = hbnlp.Tracer(subject, "force", span)
    for traced in tracer:
        for point in traced.special_points:
            if point.kind.code in ("PD", "BP"):
                check_branch(tracer.branch())
                return point
    raise AssertionError(f"nothing crosses: {tracer.branch()}")


def cascade(subject, span, depth):
    points = [first_crossing(subject, span)]
    while len(points) < depth:
        points.append(first_crossing(hbnlp.switch_branch(points[-1])[0], span))
    return points


@pytest.mark.parametrize("tolerance", [1e-2, 1e-6])
def test_a_cascade_of_doublings_is_that_of_many_harmonics(tolerance):
    systems = {"tolerance": tolerance}, {"n_harmonics": 16}
    found = []
    for options in systems:
        problem = hbnlp.HarmonicBalance(double_well(), **options)
        start = hbnlp.solve(problem, at={"force": 0.1}, start=[[1.0, 0.0, 0.0]])
        with pytest.warns(hbnlp.LinearInstabilityWarning):
            found.append(cascade(start, (0.1, 0.6), 3))
    tolerant, exact = found
    assert [p.solution.periods for p in tolerant] == [1, 2, 4]
    assert all(p.converged for p in tolerant)
    np.testing.assert_allclose([p.value for p in tolerant], [p.value for p in exact], rtol=tolerance)
    # of the forcing's frequency they have no more from one doubling to the next
    assert max(p.n_harmonics / p.solution.periods for p in tolerant) <= 15


def test_starts_on_a_branch_of_broken_symmetry_have_the_harmonics_of_their_branch_point():
    problem = hbnlp.HarmonicBalance(double_well(), tolerance=1e-4)
    with pytest.warns(hbnlp.LinearInstabilityWarning):
        point = first_crossing(problem, (3.0, 0.3))
    assert point.breaks.name == "half-period sign change"
    starts = hbnlp.switch_branch(point)
    assert [s.n_harmonics for s in starts] == [point.n_harmonics] * 2
    with pytest.warns(hbnlp.LinearInstabilityWarning):
        doubling = first_crossing(starts[0], (3.0, 0.3))
    assert doubling.value == pytest.approx(2.654326, abs=1e-4)  # of 23 harmonics


# -- peaks, files, other processes -------------------------------------------------------------------------------------


@pytest.mark.parametrize("harmonic", [1, 3])
def test_a_peak_has_the_harmonics_that_it_asks_for(harmonic):
    tolerance = 1e-6
    loose = hbnlp.trace(hbnlp.HarmonicBalance(duffing(), tolerance=1e-2), "omega", SPAN, stability=None)
    exact = hbnlp.trace(hbnlp.HarmonicBalance(duffing(), MANY), "omega", SPAN, stability=None)
    tight = hbnlp.HarmonicBalance(duffing(), tolerance=tolerance)
    (peak,), (known,) = (
        hbnlp.peaks(loose, "x", harmonic=harmonic, problem=tight),
        hbnlp.peaks(exact, "x", harmonic=harmonic),
    )
    assert peak.value == pytest.approx(known.value, rel=tolerance)
    assert peak.n_harmonics > loose.n_harmonics.max()
    assert peak.truncation_error <= tolerance
    assert peak.converged is True
    assert known.converged is None


def test_a_harmonic_that_a_point_lacks_makes_no_peak(branch):
    """Where the number changes, the highest harmonics begin and end: no maxima."""
    lacking = branch.n_harmonics < 7
    assert lacking.any()
    assert not lacking.all()
    for peak in hbnlp.peaks(branch, "x", harmonic=3):
        assert np.all(branch.n_harmonics[peak.index - 1 : peak.index + 2] >= 3)
        assert peak.value == pytest.approx(1.26787845, abs=1e-6)


def test_a_branch_of_several_numbers_needs_a_problem_with_a_tolerance(branch, tmp_path):
    branch.save(tmp_path / "branch.npz")
    for give in (
        lambda problem: hbnlp.Branch.load(tmp_path / "branch.npz", problem=problem),
        lambda problem: hbnlp.trace(problem, "omega", SPAN, resume=branch),
    ):
        with pytest.raises(
            ValueError, match=r"the branch has . to 7 harmonics, the problem n_harmonics = 7 .*tolerance="
        ):
            give(hbnlp.HarmonicBalance(duffing(), 7))
    with pytest.raises(ValueError, match="the branch has parameters"):
        hbnlp.Branch.load(tmp_path / "branch.npz", problem=hbnlp.HarmonicBalance(double_well(), tolerance=1e-6))


def test_a_branch_of_one_number_is_gone_on_with_to_a_tolerance(tolerant):
    def stop(progress):
        if progress.counts["points"] == 20 and not progress.done:
            raise hbnlp.StopTracing

    fixed = hbnlp.trace(hbnlp.HarmonicBalance(duffing(), 9), "omega", SPAN, stability=None, callbacks=[stop])
    whole = hbnlp.trace(tolerant, "omega", SPAN, stability=None, resume=fixed)
    check_branch(whole)
    assert whole.n_harmonics[:19].tolist() == [9] * 19
    assert whole.n_harmonics[-1] < 9
    assert whole.truncation_error is None  # of the points before nothing is known
