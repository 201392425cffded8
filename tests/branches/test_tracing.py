"""A trace on its span: where it begins and ends, from which start, to which side, driven by hand."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.extrema import peaks
from hbnlp.branches.tracer import Tracer
from hbnlp.branches.tracing import trace
from hbnlp.core.kinds import End
from hbnlp.solutions.solving import solve
from hbnlp.stability.result import Floquet
from hbnlp.systems import duffing
from hbnlp.systems.system import System
from hbnlp.testing import check_branch


def test_a_trace_begins_and_ends_exactly_on_its_span(branch):
    check_branch(branch)
    assert (branch.parameter[0], branch.parameter[-1]) == (0.5, 1.6)
    assert branch.end is End.SPAN_END
    assert branch.message == "reached the end of the span"


def test_the_way_back_meets_the_same_folds_in_reverse(problem, branch):
    back = trace(problem, "omega", (1.6, 0.5))
    check_branch(back)
    assert (back.parameter[0], back.parameter[-1]) == (1.6, 0.5)
    np.testing.assert_allclose([f.value for f in back.folds], [f.value for f in branch.folds][::-1], rtol=1e-11)


def test_a_span_that_ends_between_the_folds_ends_on_the_first_leg(problem, branch):
    short = trace(problem, "omega", (0.5, 1.2), stability=None)
    check_branch(short)
    assert short.end is End.SPAN_END
    assert short.folds == ()
    upper = branch.parameter[: branch.folds[0].index]
    amplitude = np.interp(1.2, upper, np.abs(branch.harmonics("x")[: upper.size, 1]))
    assert abs(short.harmonics("x")[-1, 1]) == pytest.approx(amplitude, abs=2e-3)


def test_a_branch_that_turns_back_ends_where_it_came_from():
    """The lower leg at W = 1.2 ends at the fold in the force at .4179, which is within the span; .145 is not."""
    problem = HarmonicBalance(duffing(), 3)
    lower = solve(problem, at={"omega": 1.2, "force": 0.3})
    branch = trace(problem, "force", (0.2, 0.43), at={"omega": 1.2}, start=lower)
    check_branch(branch)
    assert branch.end is End.SPAN_START
    assert branch.parameter[-1] == 0.2
    assert len(branch.folds) == 1


def test_both_directions_from_an_interior_start_cover_the_branch(problem, branch):
    start = solve(problem, at={"omega": 1.2}, start=[[0.0, -2.2, 0.5]])
    ahead, back = (trace(problem, "omega", (0.5, 1.6), start=start, direction=d) for d in (1, -1))
    for half in (ahead, back):
        check_branch(half)
        np.testing.assert_allclose(half.coefficients[0], start.coefficients, atol=1e-10)
    assert {ahead.end, back.end} == {End.SPAN_END, End.SPAN_START}
    assert {ahead.parameter[-1], back.parameter[-1]} == {0.5, 1.6}
    folds = [f.value for half in (ahead, back) for f in half.folds]
    np.testing.assert_allclose(sorted(folds), sorted(f.value for f in branch.folds), rtol=1e-11)


def test_a_value_of_the_parameter_in_at_is_where_the_trace_begins(problem, branch):
    inside = trace(problem, "omega", (0.5, 1.6), at={"omega": 1.0}, stability=None)
    check_branch(inside)
    assert inside.parameter[0] == 1.0
    np.testing.assert_allclose([f.value for f in inside.folds], [f.value for f in branch.folds], rtol=1e-11)


@pytest.mark.parametrize("way", [{"resume": True}, {"start": -1}, {"direction": -1}], ids=str)
def test_no_trace_leaves_its_span(problem, branch, way):
    """At an end of the span, heading out: there is nothing left to do."""
    if "resume" in way:
        resumed = trace(problem, "omega", branch.span, resume=branch)
        assert resumed.end is End.SPAN_END
        np.testing.assert_array_equal(resumed.parameter, branch.parameter)
        return
    options = {"start": branch.solution(-1)} if "start" in way else way
    with pytest.raises(ValueError, match=r"an end of the span .* and the way first taken leads out of it"):
        trace(problem, "omega", branch.span, **options)


def test_a_branch_can_begin_at_a_fold(problem, branch):
    for fold in branch.folds:
        part = trace(problem, "omega", branch.span, start=fold.solution, stability=None)
        check_branch(part)
        assert part.parameter[0] == fold.value
        assert part.end in {End.SPAN_END, End.SPAN_START}


def test_the_user_may_drive_the_trace_and_stop_at_will(problem, branch):
    tracer = Tracer(problem, "omega", (0.5, 1.6), stability=Floquet())
    for point in tracer:
        if point.special_points:
            break
    assert tracer.end is None
    partial = tracer.branch()
    check_branch(partial)
    assert partial.end is End.STOPPED
    assert len(partial) == tracer.n_points == branch.folds[0].index + 2
    assert tracer.n_folds == 1
    for _ in tracer:
        pass
    assert tracer.end is End.SPAN_END
    whole = tracer.branch()
    np.testing.assert_array_equal(whole.coefficients, branch.coefficients)


def test_samples_are_doubled_on_the_way_and_the_branch_goes_on_where_it_was():
    """The larger a pendulum's swing, the more harmonics has the sine of it."""
    system = System(
        1.0,
        0.05,
        0.3,
        nonlinear_force=lambda q, v, tau, p: [ca.sin(q[0])],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": 0.1},
    )
    branch = trace(HarmonicBalance(system, 2), "force", (0.0, 5.0), at={"omega": 0.4}, stability=None)
    check_branch(branch)
    assert branch.end is End.SPAN_END
    assert branch.n_samples[0] < branch.n_samples[-1] <= 200
    assert np.all(np.diff(branch.n_samples) >= 0)


@pytest.mark.parametrize("stability", [Floquet(), None])
def test_a_branch_of_a_force_that_is_singular_at_rest_is_traced_from_a_start(stability):
    """A magnet, x'' + .1 x' + x - 1 / x^2 = .05 cos tau about x = 1: omega^2 = 1 + 2 / x^3 = 3 at resonance."""
    system = System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [-1.0 / q[0] ** 2],
        forcing=lambda tau, p: [0.05 * ca.cos(tau)],
    )
    problem = HarmonicBalance(system, 7)
    start = solve(problem, at={"omega": 1.0}, start=[[1.0, 0.0, 0.0]])
    branch = trace(start, "omega", (1.0, 2.5), stability=stability)
    check_branch(branch)
    assert branch.end is End.SPAN_END
    (peak,) = peaks(branch, "x")
    assert peak.value == pytest.approx(np.sqrt(3.0), rel=0.01)
