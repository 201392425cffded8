"""Fold curves in two parameters: cusps, isola births and merges against closed forms and independent values."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from numpy_balance import absorber_balance
from scipy.optimize import brentq, fsolve, minimize_scalar

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.fold_curves import FoldBranch
from hbnlp.branches.folds import fold_by_newton
from hbnlp.branches.following import follow
from hbnlp.branches.tracing import trace
from hbnlp.continuation.newton import Newton
from hbnlp.core.errors import ConvergenceError, SaveError
from hbnlp.core.kinds import FoldEvent
from hbnlp.systems import duffing, tuned_absorber
from hbnlp.systems.system import System
from hbnlp.testing import check_branch

# (z, g F^2 and W at the onset of hysteresis), one harmonic, as `exact_onset` has them
CUSPS = [(0.05, 2.6609657849168e-3, 1.0903455353727), (0.025, 2.9218354053248e-4, 1.0442383311476)]


def check_fold_curve(problem, curve):
    """Every point is a solution, with a singular Jacobian there."""
    assert np.all(np.isfinite(curve.first))
    assert len(curve.first) == len(curve.second) == len(curve.coefficients) == len(curve)
    for k in range(0, len(curve), 3):
        at = {**curve.parameters, curve.names[0]: curve.first[k], curve.names[1]: curve.second[k]}
        x, values = curve.coefficients[k].ravel(), problem.values(at)
        terms = problem.assembly.term_size(x, values)
        assert np.abs(problem.residual(x, values).full()).max() <= 1e-7 * terms
        singular = np.linalg.svd(problem.assembly.jacobian(x, values), compute_uv=False)
        assert singular[-1] <= 1e-6 * singular[0]


def folded(problem, name="omega", span=(0.5, 3.0), at=None):
    branch = trace(problem, name, span, at=at, stability=None)
    check_branch(branch)
    return branch.folds


def exact_onset(z):
    """(g F^2, W) where both folds of one harmonic meet: the least force with a fold.

    With a = g A^2, s = 3/4 a and p = 2 g F^2 / (3 a^2) a fold has p^2 - 2 s p + 4 z^2 (1 + s + p) = 0, the smaller root
    p of which belongs to the least force, and W^2 = 1 + s + p.
    """

    def root(s):
        b = s - 2 * z**2
        return b - np.sqrt(max(b**2 - 4 * z**2 * (1 + s), 0.0))

    first = brentq(lambda s: (s - 2 * z**2) ** 2 - 4 * z**2 * (1 + s), 2 * z**2, 10.0)
    options = {"bounds": (first, 20 * first), "method": "bounded", "options": {"xatol": 1e-12}}
    s = minimize_scalar(lambda s: s**2 * root(s), **options).x
    return 1.5 * (s / 0.75) ** 2 * root(s), np.sqrt(1 + s + root(s))


@pytest.mark.parametrize(("z", "onset", "omega"), CUSPS)
def test_the_tabulated_onsets_are_the_closed_form(z, onset, omega):
    assert exact_onset(z) == pytest.approx((onset, omega), rel=1e-12)


@pytest.mark.parametrize(("z", "onset", "omega"), CUSPS)
def test_hysteresis_sets_in_at_the_cusp_of_the_closed_form(z, onset, omega):
    g = 0.1
    problem = HarmonicBalance(duffing(damping_ratio=z, cubic=g, force=3.0 * np.sqrt(onset / g)), 1)
    curve = follow(folded(problem)[0], "force")
    check_fold_curve(problem, curve)
    (cusp,) = curve.cusps
    assert g * cusp.second**2 == pytest.approx(onset, rel=1e-9)
    assert cusp.first == pytest.approx(omega, rel=1e-9)
    assert curve.second.min() >= cusp.second * (1 - 1e-9)
    assert curve.isola_births == curve.isola_merges == ()


def test_both_folds_lie_on_the_same_curve_which_may_be_followed_from_either():
    problem = HarmonicBalance(duffing(), 3)
    down, up = folded(problem)
    one, other = (follow(fold, "force") for fold in (down, up))
    for curve in (one, other):
        check_fold_curve(problem, curve)
    assert one.cusps[0].second == pytest.approx(other.cusps[0].second, rel=1e-10)
    distance = np.hypot(one.first - up.value, (one.second - 0.18) / 0.18)
    assert distance.min() < 0.1  # between neighbouring points


def test_points_of_the_curve_are_the_folds_of_branches_traced_there():
    problem = HarmonicBalance(duffing(), 5)
    curve = follow(folded(problem)[0], "force")
    for k in (5, len(curve) // 2, len(curve) - 5):
        folds = [fold.value for fold in folded(problem, at={"force": curve.second[k]}, span=(0.5, 6.0))]
        assert np.abs(np.array(folds) - curve.first[k]).min() < 1e-8


def test_the_slope_of_the_curve_is_the_sensitivity_of_the_fold():
    problem = HarmonicBalance(duffing(), 5)
    for fold in folded(problem):
        curve = follow(fold, "force", span=(0.17, 0.19))
        k = np.argmin(np.abs(curve.second - 0.18))
        slopes = np.gradient(curve.first, curve.second)
        assert curve.first[k] == pytest.approx(fold.value, rel=1e-9)
        assert slopes[k] == pytest.approx(fold.sensitivity["force"], rel=0.05)


def test_any_two_parameters_may_be_chosen():
    """With one harmonic only g F^2 matters: the cusp in (W, g) is that in (W, F)."""
    z, onset, omega = CUSPS[0]
    problem = HarmonicBalance(duffing(damping_ratio=z, cubic=0.5, force=0.2), 1)
    curve = follow(folded(problem)[0], "cubic")
    check_fold_curve(problem, curve)
    assert curve.names == ("omega", "cubic")
    assert curve.cusps[0].second * 0.2**2 == pytest.approx(onset, rel=1e-9)
    assert curve.cusps[0].first == pytest.approx(omega, rel=1e-9)
    assert curve.parameters["force"] == 0.2

    in_force = folded(problem, "force", (0.02, 0.5), at={"omega": 1.3})
    other = follow(in_force[0], "omega")
    check_fold_curve(problem, other)
    assert other.cusps[0].first ** 2 * 0.5 == pytest.approx(onset, rel=1e-9)
    assert other.cusps[0].second == pytest.approx(omega, rel=1e-9)


# -- isolas ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n_harmonics", "birth", "merge"),
    [(5, (0.122984738, 1.792821686), (0.180659229, 1.433949135)), (1, (0.125195958, None), (0.183958862, None))],
)
def test_the_absorbers_isola_is_born_and_merges_where_it_is_known_to(n_harmonics, birth, merge):
    problem = HarmonicBalance(tuned_absorber(force=0.15), n_harmonics)
    curves = [follow(f, "force", span=(0.05, 0.4)) for f in isola_folds(problem)]
    for curve in curves:
        check_fold_curve(problem, curve)
    for kind, (force, omega) in ((FoldEvent.ISOLA_BIRTH, birth), (FoldEvent.ISOLA_MERGE, merge)):
        events = [event for curve in curves for event in curve.of_kind(kind)]
        assert events, kind
        assert all(event.second == pytest.approx(force, abs=1e-8) for event in events)
        assert omega is None or all(event.first == pytest.approx(omega, abs=1e-8) for event in events)
        # the tabulated values are those of the balance in numpy, from a point close by
        balance = absorber_balance(n_harmonics)
        x, first, second = (part * (1 + 1e-5) for part in (events[0].coefficients.ravel(), events[0].first, force))
        touching = balance.touching(x, first, second)
        assert touching[0] == pytest.approx(force, abs=1e-8)
        assert omega is None or touching[1] == pytest.approx(omega, abs=1e-8)


def isola_folds(problem):
    start = [[0.0, -1.04, 1.44], [0.0, 0.64, -0.92]]
    branch = trace(problem, "omega", (0.5, 3.0), at={"omega": 1.9}, start=start, stability=None)
    check_branch(branch)
    assert branch.closed
    return branch.folds


def nonlinear_damper(force):
    """x'' + .1 x' - .15 x'^3 + .06 x'^5 + x + .5 x^3 = f cos w t."""
    return System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [-0.15 * v[0] ** 3 + 0.06 * v[0] ** 5 + 0.5 * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": force},
    )


def exact_amplitude_curve(amplitude, force):
    """(W^2 - 1 - 3/8 A^2)^2 A^2 + (W A (c1 + 3/4 c3 W^2 A^2 + 5/8 c5 W^4 A^4))^2 = f^2: the balance of one harmonic."""

    def left(omega):
        speed = (omega * amplitude) ** 2
        drag = 0.1 - 0.75 * 0.15 * speed + 0.625 * 0.06 * speed**2
        return ((1 + 0.375 * amplitude**2 - omega**2) * amplitude) ** 2 + (omega * amplitude * drag) ** 2 - force**2

    return left


# (f, W) of the isola's birth and merge, and A nearby: points where the left side is stationary in A and in W
BIRTH, MERGE = ((0.0189038507, 1.1772252482), 1.0), ((0.0386321683, 1.0605199625), 0.6)


@pytest.mark.parametrize(("event", "amplitude"), [BIRTH, MERGE])
def test_the_tabulated_birth_and_merge_are_stationary_points_of_the_closed_form(event, amplitude):
    step = 1e-30  # in the imaginary direction: exact derivatives of a polynomial

    def slopes(point):
        a, w = point
        by_amplitude = exact_amplitude_curve(a + 1j * step, 0.0)(w).imag / step
        return [by_amplitude, exact_amplitude_curve(a, 0.0)(w + 1j * step).imag / step]

    a, w = fsolve(slopes, [amplitude, event[1]], xtol=1e-13)
    assert (np.sqrt(exact_amplitude_curve(a, 0.0)(w)), w) == pytest.approx(event, rel=1e-8)


def test_a_nonlinear_damper_has_an_isola_between_birth_and_merge_of_the_closed_form():
    problem = HarmonicBalance(nonlinear_damper(0.03), 1)
    # on the isola at w = 1.13: the damping force almost vanishes where the amplitude is about one
    low, high = 0.8, 1.4
    amplitudes = [a for a in np.linspace(low, high, 400) if exact_amplitude_curve(a, 0.03)(1.15) < 0.0]
    assert amplitudes
    amplitude = amplitudes[0]
    detuning = (1 + 0.375 * amplitude**2 - 1.15**2) * amplitude
    sine = np.sqrt(max(0.03**2 - detuning**2, 0.0))
    start = np.array([[0.0, detuning * amplitude, sine * amplitude]]) / 0.03
    branch = trace(problem, "omega", (0.5, 2.0), at={"omega": 1.15}, start=start, stability=None)
    check_branch(branch)
    assert branch.closed
    curve = follow(branch.folds[0], "force", span=(0.005, 0.1))
    check_fold_curve(problem, curve)
    (birth,), (merge,) = curve.isola_births, curve.isola_merges
    assert (birth.second, birth.first) == pytest.approx(BIRTH[0], rel=1e-8)
    assert (merge.second, merge.first) == pytest.approx(MERGE[0], rel=1e-8)


# -- ends, files, errors -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def problem():
    return HarmonicBalance(duffing(), 1)


@pytest.fixture(scope="module")
def fold(problem):
    return folded(problem)[0]


def test_the_curve_ends_on_the_spans_it_is_given(problem, fold):
    curve = follow(fold, "force", span=(0.15, 0.3))
    check_fold_curve(problem, curve)
    assert {curve.second[0], curve.second[-1]} == {0.15, 0.3}
    assert curve.ends == ("end of the second span", "end of the second span")
    narrow = follow(fold, "force", limits=(1.2, 1.3))
    assert narrow.ends == ("end of the first span", "end of the first span")
    check_fold_curve(problem, narrow)
    np.testing.assert_allclose(sorted(narrow.first[[0, -1]]), [1.2, 1.3], rtol=1e-12)
    assert np.all((narrow.first[1:-1] > 1.2) & (narrow.first[1:-1] < 1.3))


def test_a_fold_curve_is_the_same_after_saving_and_loading(fold, tmp_path):
    curve = follow(fold, "force")
    assert curve.events
    curve.save(tmp_path / "curve.npz")
    loaded = FoldBranch.load(tmp_path / "curve.npz")
    for name in ("first", "second", "coefficients"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(curve, name))
    for one, other in zip(loaded.events, curve.events, strict=True):
        assert (one.kind, one.first, one.second) == (other.kind, other.first, other.second)
        np.testing.assert_array_equal(one.coefficients, other.coefficients)
    assert (loaded.names, loaded.ends, dict(loaded.parameters)) == (curve.names, curve.ends, dict(curve.parameters))
    assert repr(loaded) == repr(curve)
    assert len(repr(curve).splitlines()) <= 5
    assert repr(curve.events[0]) == f"cusp at ({curve.events[0].first:.8g}, {curve.events[0].second:.8g})"
    with pytest.raises(SaveError, match="could not write"):
        curve.save(tmp_path / "missing" / "curve.npz")


def test_a_problem_with_other_outputs_is_not_that_of_a_curve(fold, tmp_path):
    curve = follow(fold, "force", span=(0.17, 0.19))
    curve.save(tmp_path / "curve.npz")
    loaded = FoldBranch.load(tmp_path / "curve.npz", problem=fold.problem)
    assert loaded.output_names == curve.output_names == ("x",)
    assert repr(loaded.solution(0)) == repr(curve.solution(0))
    renamed = System(
        1.0,
        lambda p: 2.0 * p.damping_ratio,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"damping_ratio": 0.025, "cubic": 0.1, "force": 0.18},
        outputs={"y": lambda s: s.q[0]},
    )
    with pytest.raises(ValueError, match=r"the curve has outputs \('x',\), the system \('y',\)"):
        FoldBranch.load(tmp_path / "curve.npz", problem=HarmonicBalance(renamed, fold.problem.n_harmonics))


def test_a_curve_without_events_survives_the_file_as_well(fold, tmp_path):
    curve = follow(fold, "force", span=(0.15, 0.3))
    assert curve.events == ()
    curve.save(tmp_path / "curve.npz")
    assert FoldBranch.load(tmp_path / "curve.npz").events == ()


def test_bad_arguments_are_refused_by_name(fold):
    with pytest.raises(ValueError, match="name is 'omega', the fold's own parameter; give another one"):
        follow(fold, "omega")
    with pytest.raises(KeyError, match="unknown parameter 'forc'; did you mean 'force'"):
        follow(fold, "forc")
    with pytest.raises(ValueError, match=r"span is \(0.2, 0.3\); give values on both sides of the fold"):
        follow(fold, "force", span=(0.2, 0.3))


def of_problem(fold, problem):
    """The fold as if it were of another problem."""
    return dataclasses.replace(fold, solution=dataclasses.replace(fold.solution, problem=problem))


def test_a_fold_of_another_system_does_not_converge(fold):
    """A linear oscillator with parameters of the same names has no folds."""
    linear = System(
        1.0,
        0.05,
        1.0,
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"damping_ratio": 0.025, "cubic": 0.1, "force": 0.18},
    )
    with pytest.raises(ConvergenceError, match=r"the fold at omega = 1\.26\S+ does not converge in this problem: "):
        follow(of_problem(fold, HarmonicBalance(linear, 1)), "force")


def test_arguments_of_another_kind_are_named(fold):
    for given, options, message in (
        ((fold, fold), {}, r"point is \(fold at .*; give one fold, such as branch.folds\[0\]"),
        (fold, {"method": "x"}, r"method is 'x'; give PseudoArclength"),
        (fold, {"callbacks": print}, r"callbacks is .*; give a list of callables"),
    ):
        with pytest.raises(TypeError, match=message):
            follow(given, "force", **options)
    with pytest.raises(ValueError, match=r"span is \(0.1, 0.2, 0.3\); give two different finite values of force"):
        follow(fold, "force", span=(0.1, 0.2, 0.3))


def test_what_is_no_fold_is_refused():
    absorber = HarmonicBalance(tuned_absorber(force=0.15), 5)
    branch = trace(absorber, "omega", (1.0, 1.3))
    others = [point for point in branch.special_points if point not in branch.folds]
    assert others
    with pytest.raises(ValueError, match="point is a Neimark-Sacker; a fold or an event is needed"):
        follow(others[0], "force")


def test_a_fold_may_serve_a_problem_with_more_harmonics(fold):
    finer = HarmonicBalance(duffing(), 7)
    curve = follow(of_problem(fold, finer), "force", span=(0.17, 0.19))
    check_fold_curve(finer, curve)
    k = np.argmin(np.abs(curve.second - 0.18))
    # the converged fold of test_duffing_folds.py
    assert curve.first[k] == pytest.approx(1.2696019555, abs=1e-9)
    values = finer.values({"omega": curve.first[k]})
    again = fold_by_newton(finer, curve.coefficients[k].ravel(), values, "omega", Newton())
    assert again.value == pytest.approx(1.2696019555, rel=1e-10)


def test_an_interrupted_curve_keeps_its_folds_and_says_so(fold, caplog):
    spans = {"limits": (0.5, 3.0), "span": (0.05, 0.5)}
    seen = []

    def end(progress):
        seen.append(progress)
        if progress.counts["folds"] == 12 and not progress.done:
            raise KeyboardInterrupt

    whole = follow(fold, "force", **spans)
    part = follow(fold, "force", callbacks=[end], **spans)
    assert len(part) == 12
    assert part.ends == ("interrupted", "interrupted")
    assert "interrupted after 12 folds" in caplog.text
    assert seen[-1].done
    for first, second in zip(part.first, part.second, strict=True):
        assert np.hypot(whole.first - first, whole.second - second).min() == 0.0
