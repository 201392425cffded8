"""A trace goes on from a branch as if it had never stopped, and from no branch of something else."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.tracer import Tracer
from hbnlp.branches.tracing import trace
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.core.kinds import End
from hbnlp.stability.result import Floquet
from hbnlp.systems import duffing, tuned_absorber
from hbnlp.systems.system import System
from hbnlp.testing import check_branch


@pytest.mark.parametrize("count", [1, 2, 15, 30, 45])
def test_a_trace_resumed_from_a_file_is_that_without_interruption(problem, branch, tmp_path, count):
    """Wherever it stopped: the same folds in the same order, the same stability between them, and the same end."""
    short = trace(problem, "omega", (0.5, 1.6), method=PseudoArclength(max_points=max(count, 2)))
    if count == 1:
        tracer = Tracer(problem, "omega", (0.5, 1.6), stability=Floquet())
        next(iter(tracer))
        short = tracer.branch()
    assert len(short) == count
    short.save(tmp_path / "part.npz")
    resumed = trace(HarmonicBalance(duffing(), 5), "omega", (0.5, 1.6), resume=Branch.load(tmp_path / "part.npz"))
    check_branch(resumed)
    assert resumed.end is End.SPAN_END
    np.testing.assert_array_equal(resumed.coefficients[:count], short.coefficients)
    np.testing.assert_allclose([f.value for f in resumed.folds], [f.value for f in branch.folds], rtol=1e-11)
    assert (resumed.parameter[0], resumed.parameter[-1]) == (0.5, 1.6)
    np.testing.assert_array_equal(np.flatnonzero(np.diff(resumed.stable)), [f.index for f in resumed.folds])


def test_max_points_ends_a_trace_that_can_be_resumed(problem, branch):
    options = PseudoArclength(max_points=20)
    first = trace(problem, "omega", (0.5, 1.6), method=options)
    assert first.end is End.MAX_POINTS
    assert len(first) == 20
    assert "resume it" in first.message
    check_branch(first)
    rest = trace(problem, "omega", (0.5, 1.6), resume=first)
    check_branch(rest)
    assert rest.end is End.SPAN_END
    np.testing.assert_allclose([f.value for f in rest.folds], [f.value for f in branch.folds], rtol=1e-11)


def test_a_finished_branch_can_be_resumed_into_a_longer_span(problem, branch):
    longer = trace(problem, "omega", (0.5, 2.0), resume=branch)
    check_branch(longer)
    assert longer.end is End.SPAN_END
    assert longer.parameter[-1] == 2.0
    np.testing.assert_array_equal(longer.coefficients[: len(branch)], branch.coefficients)


def test_resuming_keeps_the_parameters_of_the_branch():
    problem = HarmonicBalance(duffing(), 3)
    first = trace(
        problem, "omega", (0.5, 1.6), at={"force": 0.3}, method=PseudoArclength(max_points=10), stability=None
    )
    resumed = trace(problem, "omega", (0.5, 1.6), resume=first, stability=None)
    check_branch(resumed)
    assert resumed.parameters["force"] == 0.3


def test_a_branch_whose_force_took_more_samples_is_resumed(tmp_path):
    """Friction by tanh doubles its samples on the way: the problem that resumes begins with the few it had at first."""
    friction = System(
        1.0,
        0.05,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [0.1 * ca.tanh(20.0 * v[0]) + q[0] ** 3],
        forcing=lambda tau, p: [0.5 * ca.cos(tau)],
    )
    options = {"method": PseudoArclength(max_points=15), "stability": None}
    short = trace(HarmonicBalance(friction, 5), "omega", (0.3, 2.0), **options)
    assert short.n_samples[-1] > HarmonicBalance(friction, 5).n_samples
    short.save(tmp_path / "part.npz")
    problem = HarmonicBalance(friction, 5)
    loaded = Branch.load(tmp_path / "part.npz", problem=problem)
    assert trace(problem, "omega", (0.3, 2.0), resume=loaded, stability=None).end is End.SPAN_END


def test_a_branch_of_one_point_is_resumed_the_way_that_is_asked_for(problem):
    tracer = Tracer(problem, "omega", (0.9, 1.1), at={"omega": 1.0}, stability=None)
    next(iter(tracer))
    back = trace(problem, "omega", (0.9, 1.1), resume=tracer.branch(), direction=-1, stability=None)
    assert back.end is End.SPAN_START
    assert np.all(np.diff(back.parameter) < 0.0)


REFUSED = {
    "another parameter": (lambda: (duffing(), 5, {}, "force", (0.0, 1.0)), "was traced in 'omega', not in 'force'"),
    "other harmonics": (lambda: (duffing(), 7, {}, "omega", (0.5, 1.6)), r"coefficients of shape \(1, 11\)"),
    "another size": (lambda: (tuned_absorber(), 5, {}, "omega", (0.5, 1.6)), r"coefficients of shape \(1, 11\)"),
    "other values": (
        lambda: (duffing(), 5, {"force": 0.2}, "omega", (0.5, 1.6)),
        "parameter 'force' is 0.2 here but 0.18",
    ),
    "other names": (
        lambda: (System(1.0, 0.1, 1.0, parameters={"a": 1.0}), 5, {}, "omega", (0.5, 1.6)),
        r"parameters .*'cubic'.*, the system \('a', 'omega'\)",
    ),
    "a span it is not in": (lambda: (duffing(), 5, {}, "omega", (2.0, 3.0)), "outside the span"),
}


@pytest.mark.parametrize(("make", "message"), REFUSED.values(), ids=REFUSED)
def test_a_branch_of_something_else_is_not_resumed(branch, make, message):
    system, n_harmonics, at, name, span = make()
    with pytest.raises(ValueError, match=message):
        trace(HarmonicBalance(system, n_harmonics), name, span, at=at, resume=branch)


def test_a_branch_of_other_periods_is_not_resumed(branch):
    with pytest.raises(ValueError, match="period"):
        trace(HarmonicBalance(duffing(), 5, periods=2), "omega", (0.5, 1.6), resume=branch)


def test_a_branch_of_another_system_with_the_same_names_is_not_resumed(problem):
    first = trace(problem, "omega", (0.5, 1.6), stability=None, method=PseudoArclength(max_points=10))
    system = System(
        1.1,
        lambda p: 2.0 * p.damping_ratio,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"damping_ratio": 0.025, "cubic": 0.1, "force": 0.18},
    )
    with pytest.raises(ValueError, match=r"the last point of the branch has the residual .* in this system"):
        trace(HarmonicBalance(system, 5), "omega", (0.5, 1.6), stability=None, resume=first)


def test_stability_is_not_lost_where_a_branch_is_resumed(problem, branch):
    without = trace(problem, "omega", (0.5, 1.0), stability=None)
    with pytest.raises(ValueError, match="traced without multipliers: resume it with stability=None"):
        trace(problem, "omega", branch.span, resume=without)
    with pytest.raises(ValueError, match="traced with multipliers: resume it with stability=Floquet"):
        trace(problem, "omega", branch.span, resume=branch, stability=None)
    assert Tracer(problem, "omega", branch.span, resume=branch).branch().stable is not None


@pytest.mark.parametrize("count", [20, 21, 49])
def test_a_point_found_anew_with_more_samples_replaces_the_old_one(count):
    """Friction next to a fold: its bracket ends at the points of the branch, those of the resumed part included."""
    friction = System(
        1.0,
        0.03,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [
            0.09589195577097952 * ca.tanh(22.913756864508986 * v[0]) + 1.9108346533866836 * q[0] ** 3
        ],
        forcing=lambda tau, p: [0.28649576763178025 * ca.cos(tau)],
    )
    problem = HarmonicBalance(friction, 5)
    short = trace(problem, "omega", (0.3, 3.0), stability=None, method=PseudoArclength(max_points=count))
    branch = trace(HarmonicBalance(friction, 5), "omega", (0.3, 3.0), stability=None, resume=short)
    check_branch(branch)
    assert [fold.value for fold in branch.folds] == pytest.approx([2.63302910673, 1.35652969544], rel=1e-8)
