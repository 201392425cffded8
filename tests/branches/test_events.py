"""Events of the user on branches: places, slopes and curves of the one-harmonic Duffing oscillator, in closed form."""

import copy
import pickle
from concurrent.futures import ProcessPoolExecutor

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.testing import check_branch

ZETA, CUBIC, FORCE = 0.05, 1.0, 0.5


def amplitude_is_one(s):
    return s.amplitude_squared("x") - 1.0


def problem_of(**options):
    duffing = hbnlp.systems.duffing(damping_ratio=ZETA, cubic=CUBIC, force=FORCE)
    return hbnlp.HarmonicBalance(duffing, **(options or {"n_harmonics": 1}))


def frequencies(amplitude, *, damping_ratio=ZETA, cubic=CUBIC, force=FORCE):
    """Return both frequencies of a one-harmonic motion: (1 + 3/4 b A^2 - w^2)^2 + (2 z w)^2 = (F / A)^2."""
    stiffness = 1.0 + 0.75 * cubic * amplitude**2
    squares = np.roots([1.0, 4.0 * damping_ratio**2 - 2.0 * stiffness, stiffness**2 - (force / amplitude) ** 2])
    return np.sort(np.sqrt(squares.real))


def sent(record):
    return pickle.loads(pickle.dumps(record))  # noqa: S301


@pytest.fixture(scope="module")
def branch():
    return hbnlp.trace(problem_of(), "omega", (0.3, 3.0), events={"amplitude 1": amplitude_is_one})


def test_events_lie_where_the_closed_form_has_them(branch):
    check_branch(branch)
    events = branch.of_kind("UZ")
    assert [point.event.name for point in events] == ["amplitude 1"] * 2
    np.testing.assert_allclose([point.value for point in events], frequencies(1.0), rtol=1e-12)
    assert "event 'amplitude 1' at 1.12" in repr(events[0])


@pytest.mark.parametrize("name", ["damping_ratio", "cubic", "force"])
def test_sensitivities_are_those_of_the_closed_form(branch, name):
    step, value = 1e-5, {"damping_ratio": ZETA, "cubic": CUBIC, "force": FORCE}[name]
    slopes = (frequencies(1.0, **{name: value + step}) - frequencies(1.0, **{name: value - step})) / (2.0 * step)
    np.testing.assert_allclose([point.sensitivity[name] for point in branch.of_kind("event")], slopes, rtol=1e-8)


def test_an_event_that_is_passed_twice_in_a_step_is_found_twice(branch):
    top = abs(hbnlp.peaks(branch, "x")[0].solution.harmonics("x")[1])
    level = (1.0 - 1e-6) * top
    above = hbnlp.trace(
        problem_of(),
        "omega",
        (0.3, 3.0),
        stability=None,
        events={"nearly the top": lambda s: s.amplitude_squared("x") - level**2},
    )
    found = above.of_kind("event")
    assert len(found) == 2
    assert found[0].index == found[1].index  # or the test does not test it
    np.testing.assert_allclose(sorted(point.value for point in found), frequencies(level), rtol=1e-10)


def test_an_event_in_the_parameter_itself_moves_with_nothing_else():
    branch = hbnlp.trace(problem_of(), "omega", (0.3, 1.5), events={"1.2": lambda s: s.symbol("omega") - 1.2})
    (point,) = branch.of_kind("event")
    assert point.value == pytest.approx(1.2, abs=1e-13)
    np.testing.assert_allclose([*point.sensitivity.values()], 0.0, atol=1e-12)


def test_with_a_tolerance_an_event_has_the_harmonics_that_it_needs():
    exact = hbnlp.trace(problem_of(n_harmonics=25), "omega", (0.3, 3.0), events={"1": amplitude_is_one})
    branch = hbnlp.trace(problem_of(tolerance=1e-5), "omega", (0.3, 3.0), events={"1": amplitude_is_one})
    check_branch(branch)
    for point, known in zip(branch.of_kind("event"), exact.of_kind("event"), strict=True):
        assert point.converged
        assert abs(point.value - known.value) <= 1e-5 * known.value


def test_events_are_found_again_after_a_resume(branch):
    problem = problem_of()
    part = hbnlp.trace(
        problem, "omega", (0.3, 3.0), events={"1": amplitude_is_one}, method=hbnlp.PseudoArclength(max_points=12)
    )
    whole = hbnlp.trace(problem, "omega", (0.3, 3.0), events={"1": amplitude_is_one}, resume=part)
    values = [[point.value for point in each.of_kind("event")] for each in (whole, branch)]
    np.testing.assert_allclose(*values, rtol=1e-12)


def test_a_followed_event_is_the_curve_of_the_closed_form(branch):
    curve = hbnlp.follow(branch.of_kind("event")[0], "force", span=(0.05, 2.0))
    assert curve.complete
    assert curve.event == "amplitude 1"
    assert curve.events == ()
    force = np.hypot(1.0 + 0.75 * CUBIC - curve.first**2, 2.0 * ZETA * curve.first)
    np.testing.assert_allclose(curve.second, force, rtol=1e-9)
    lowest = np.argmin(curve.second)
    assert curve.first[lowest] == pytest.approx(np.sqrt(1.75 - 2.0 * ZETA**2), rel=0.02)
    assert "events 'amplitude 1'" in repr(curve)


def test_a_followed_event_meets_the_tolerance():
    problem = problem_of(tolerance=1e-5)
    event = hbnlp.trace(problem, "omega", (0.3, 1.3), events={"1": amplitude_is_one}).of_kind("event")[0]
    curve = hbnlp.follow(event, "force", span=(0.2, 1.0))
    assert curve.truncation_error.max() <= 1e-5
    amplitudes = [abs(curve.solution(i).harmonics("x")[1]) for i in range(len(curve))]
    np.testing.assert_allclose(amplitudes, 1.0, rtol=1e-10)


def test_a_file_holds_the_name_of_an_event_and_following_it_needs_the_function(branch, tmp_path):
    branch.save(tmp_path / "branch.npz")
    event = hbnlp.Branch.load(tmp_path / "branch.npz", problem=problem_of()).of_kind("event")[1]
    assert event.event.name == "amplitude 1"
    assert event.sensitivity == branch.of_kind("event")[1].sensitivity
    with pytest.raises(ValueError, match=r"give it: .* event=function in follow"):
        hbnlp.follow(event, "force")
    curve = hbnlp.follow(event, "force", event=amplitude_is_one, span=(0.4, 0.6))
    curve.save(tmp_path / "curve.npz")
    assert hbnlp.FoldBranch.load(tmp_path / "curve.npz").event == "amplitude 1"


def test_a_branch_with_events_can_be_sent_and_copied_whatever_their_functions_are(branch):
    assert sent(branch).of_kind("event")[0].event.function is amplitude_is_one
    other = hbnlp.trace(problem_of(), "omega", (0.3, 1.5), events={"1": lambda s: s.amplitude_squared("x") - 1.0})
    assert sent(other).of_kind("event")[0].event.function is None
    assert copy.deepcopy(other).of_kind("event")[0].event.function is other.of_kind("event")[0].event.function


def test_diagrams_look_for_events_too_and_the_same_by_other_processes():
    duffing = hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=2.0)
    problem = hbnlp.HarmonicBalance(duffing, n_harmonics=7)
    here = hbnlp.explore(problem, "omega", (0.7, 1.0), events={"1": amplitude_is_one})
    with ProcessPoolExecutor(1) as executor:
        there = hbnlp.explore(problem, "omega", (0.7, 1.0), events={"1": amplitude_is_one}, executor=executor)
        with pytest.raises(ValueError, match="with an executor of processes"):
            hbnlp.explore(problem, "omega", (0.7, 1.0), events={"1": lambda s: s.x[0]}, executor=executor)
    events = [
        [(*junction.branches, junction.point.value) for junction in each.special_points if junction.point.event]
        for each in (here, there)
    ]
    np.testing.assert_allclose(*events, rtol=1e-12)
    assert len(here) == 2
    assert all(each.at_low is None or each.at_low.event is None for each in here.stretches())


def test_events_are_marked_in_plots(branch):
    texts = [text.get_text() for text in branch.plot("x").get_legend().get_texts()]
    assert "event" in texts


@pytest.mark.parametrize(
    ("events", "error", "message"),
    [
        ([1.0], TypeError, "events"),
        ({"1": 1.0}, TypeError, r"events\['1'\] is 1.0; give a function"),
        ({1: amplitude_is_one}, TypeError, "a name of events"),
        ({"1": lambda s: 1.0}, ValueError, r"what events\['1'\] returns"),
        ({"1": lambda s: s.x}, ValueError, "one expression"),
        ({"1": lambda s: ca.MX.sym("a")}, ValueError, "no symbol of the problem"),
        ({"1": lambda s: s.amplitude_squared("y")}, ValueError, r"events\['1'\] raises KeyError"),
    ],
)
def test_what_is_no_event_is_said_before_anything_is_traced(events, error, message):
    with pytest.raises(error, match=message):
        hbnlp.trace(problem_of(), "omega", (0.3, 3.0), events=events)
    with pytest.raises(error, match=message):
        hbnlp.explore(problem_of(), "omega", (0.3, 3.0), events=events)


def test_only_an_event_takes_the_function_of_one(branch):
    with pytest.raises(ValueError, match="point a fold, which has no function"):
        hbnlp.follow(branch.folds[0], "force", event=amplitude_is_one)
