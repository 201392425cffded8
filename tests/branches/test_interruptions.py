"""What stops a trace: Ctrl-C, callbacks, errors, forces at the end of their domain; all points are kept."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.core.callbacks import StopTracing
from hbnlp.core.errors import ConvergenceError, LinearInstabilityWarning, TaskError
from hbnlp.core.kinds import End
from hbnlp.systems import duffing
from hbnlp.systems.system import System
from hbnlp.testing import check_branch


def test_ctrl_c_keeps_all_points_and_the_trace_can_be_resumed(problem, branch, caplog, raising_at):
    stopped = trace(problem, "omega", (0.5, 1.6), callbacks=[raising_at(30, KeyboardInterrupt())])
    assert stopped.end is End.INTERRUPTED
    assert len(stopped) == 30
    assert "interrupted after 30 points" in caplog.text
    check_branch(stopped)
    np.testing.assert_array_equal(stopped.coefficients, branch.coefficients[:30])
    resumed = trace(problem, "omega", (0.5, 1.6), resume=stopped)
    check_branch(resumed)
    assert resumed.end is End.SPAN_END
    assert len(resumed.folds) == 2


def test_ctrl_c_within_a_step_keeps_all_points(monkeypatch):
    problem = HarmonicBalance(duffing(), 5)
    residual, calls = problem.assembly.residual, []

    def interrupted(*arguments, **options):
        calls.append(1)
        if len(calls) == 100:
            raise KeyboardInterrupt
        return residual(*arguments, **options)

    monkeypatch.setattr(problem.assembly, "residual", interrupted)
    stopped = trace(problem, "omega", (0.5, 1.6))
    assert stopped.end is End.INTERRUPTED
    assert len(stopped) > 5
    check_branch(stopped)


def test_a_callback_may_stop_the_trace(problem, raising_at):
    stopped = trace(problem, "omega", (0.5, 1.6), callbacks=[raising_at(7, StopTracing())])
    assert stopped.end is End.STOPPED
    assert len(stopped) == 7
    check_branch(stopped)


@pytest.mark.parametrize("error", [RuntimeError("from a callback"), MemoryError(), ZeroDivisionError("oops")], ids=repr)
def test_an_error_on_the_way_carries_the_branch_so_far(problem, error, raising_at):
    with pytest.raises(TaskError, match="tracing omega failed; the attribute 'result'") as caught:
        trace(problem, "omega", (0.5, 1.6), callbacks=[raising_at(12, error)])
    branch = caught.value.result
    assert caught.value.__cause__ is error
    assert branch.end is End.ERROR
    assert type(error).__name__ in branch.message
    assert len(branch) == 12
    check_branch(branch)


def test_a_force_that_is_no_longer_smooth_ends_the_branch_where_it_is_so():
    """The force loses its derivative where x reaches 1: no number of samples is enough there."""
    system = System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [-0.1 * q[0] * ca.sqrt(1.0 - q[0] ** 2)],
        forcing=lambda tau, p: [0.3 * ca.cos(tau)],
    )
    branch = trace(HarmonicBalance(system, 3), "omega", (0.3, 1.6))
    assert branch.end is End.CORNER
    assert "a derivative of nonlinear_force is not finite" in branch.message
    assert len(branch) > 5
    check_branch(branch)
    assert np.abs(branch.harmonics("x")[:, 1]).max() > 0.8


def test_a_force_that_ceases_to_be_finite_ends_the_branch_where_it_does(caplog):
    """log(1 - x^2) pushes outward with all its derivatives: the branch comes as near as it can and says so."""
    system = System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [0.05 * q[0] * ca.log(1.0 - q[0] ** 2)],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": 0.1},
    )
    problem = HarmonicBalance(system, 3)
    branch = trace(problem, "force", (0.01, 2.0), at={"omega": 0.5}, stability=None)
    check_branch(branch)
    assert branch.end is End.CORNER
    assert 0.3 < branch.parameter[-1] < 2.0
    assert "the trace ended at force" in caplog.text


def test_a_start_that_does_not_converge_is_an_error_before_the_first_point():
    system = System(1.0, 0.0, 1.0, forcing=lambda tau, p: [ca.cos(tau)])
    with pytest.raises(ConvergenceError, match=r"no solution at omega=1"):
        trace(HarmonicBalance(system, 1), "omega", (1.0, 2.0))


def test_an_unstable_linear_part_is_a_warning_and_tracing_goes_on():
    system = System(
        1.0,
        0.1,
        -1.0,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        forcing=lambda tau, p: [0.3 * ca.cos(tau)],
    )
    with pytest.warns(LinearInstabilityWarning, match="linearly unstable about rest: eigenvalue"):
        branch = trace(HarmonicBalance(system, 3), "omega", (0.3, 1.6))
    check_branch(branch)
    assert branch.end is End.SPAN_END
