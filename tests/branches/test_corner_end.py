"""A branch that comes to a corner of the force ends there, and says where it is."""

import casadi as ca
import pytest

import hbnlp
from hbnlp.core.kinds import End
from hbnlp.testing import check_branch


def system(force):
    return hbnlp.System(
        [[1.0]],
        [[0.1]],
        [[1.0]],
        nonlinear_force=force,
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": 0.3, "gap": 1.0, "width": 0.02},
    )


@pytest.fixture(scope="module")
def stopped():
    problem = hbnlp.HarmonicBalance(system(lambda q, v, tau, p: [2.0 * ca.fmax(q[0] - p.gap, 0.0)]), 5)
    return hbnlp.trace(problem, "omega", (0.4, 2.0), stability=None)


def test_a_branch_ends_where_a_gap_is_closed(stopped):
    check_branch(stopped)
    assert stopped.end is End.CORNER
    assert not stopped.complete
    assert "where d = (q[0]-gap) is zero: round it over a width in units of d" in stopped.message
    # until then it is the linear response
    amplitude = 0.3 / abs(1.0 - stopped.parameter**2 + 0.1j * stopped.parameter)
    assert abs(stopped.harmonics("x")[:, 1]) == pytest.approx(amplitude, rel=1e-9)
    assert 0.97 < amplitude[-1] < 1.0


def test_such_a_branch_is_kept_in_a_file_and_ends_there_again(stopped, tmp_path):
    stopped.save(tmp_path / "gap.npz")
    loaded = hbnlp.Branch.load(tmp_path / "gap.npz", problem=stopped.problem)
    assert (loaded.end, loaded.message) == (End.CORNER, stopped.message)
    again = hbnlp.trace(stopped.problem, "omega", (0.4, 2.0), stability=None, resume=loaded)
    assert again.end is End.CORNER
    assert again.parameter[-1] == pytest.approx(stopped.parameter[-1], abs=0.01)


def test_with_the_width_that_is_named_the_branch_goes_on(stopped):
    assert "0.02 or more here" in stopped.message
    rounded = system(lambda q, v, tau, p: [q[0] - p.gap + ca.sqrt((q[0] - p.gap) ** 2 + p.width**2)])
    branch = hbnlp.trace(hbnlp.HarmonicBalance(rounded, 5), "omega", (0.4, 2.0), stability=None)
    check_branch(branch)
    assert branch.end is End.SPAN_END
    assert branch.n_samples.max() > 1000


@pytest.mark.parametrize("n_samples", [None, 256])
def test_a_step_at_which_no_step_is_accepted_is_the_reason(n_samples, caplog):
    stiff = system(lambda q, v, tau, p: [0.3 * ca.if_else(q[0] > p.gap, 1.0, 0.0)])
    branch = hbnlp.trace(hbnlp.HarmonicBalance(stiff, 5, n_samples=n_samples), "omega", (0.4, 2.0))
    check_branch(branch)
    assert branch.end is End.CORNER
    assert "; perhaps because nonlinear_force[0] has a step of 0.3 on this motion" in branch.message
    assert "the trace ended at omega" in caplog.text


@pytest.mark.parametrize("n_harmonics", [5, 9])
def test_a_rounding_that_is_too_steep_for_the_samples_is_the_reason(n_harmonics):
    steep = system(lambda q, v, tau, p: [0.1 * ca.tanh((q[0] - p.gap) / 1e-6)])
    branch = hbnlp.trace(hbnlp.HarmonicBalance(steep, n_harmonics), "omega", (0.4, 2.0))
    check_branch(branch)
    assert branch.end is End.CORNER
    assert "samples a period would be needed" in branch.message
