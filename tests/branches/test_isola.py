"""A detached branch of the host with its absorber: found, closed, cut off by the span, resumed."""

import numpy as np
import pytest
from numpy_balance import absorber_balance

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.tracing import trace
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.core.kinds import End
from hbnlp.solutions.search import find_all
from hbnlp.solutions.solving import solve
from hbnlp.systems import tuned_absorber
from hbnlp.testing import check_branch

# folds with 5 harmonics at the force .15, by tests/numpy_balance.py, as tested below
MAIN_FOLDS = [1.1112622160, 1.1001859507, 1.3004881667, 1.2472807483]
ISOLA_FOLDS = [1.5658235396, 2.3185469325]


@pytest.fixture(scope="module", params=[1, -1])
def isola(request, absorber, isola_start):
    return trace(absorber, "omega", (0.5, 3.0), start=isola_start, direction=request.param)


def assert_folds_of_numpy(branch, values):
    balance = absorber_balance(5)
    starts = [(fold.solution.coefficients.ravel() * (1 + 1e-4), fold.value * (1 + 1e-6)) for fold in branch.folds]
    found = [balance.fold(x, omega, 0.15)[0] for x, omega in starts]
    np.testing.assert_allclose(sorted(found), sorted(values), rtol=1e-10)


def test_the_main_branch_of_the_absorber_has_its_four_folds(absorber):
    branch = trace(absorber, "omega", (0.5, 3.0))
    check_branch(branch)
    np.testing.assert_allclose([fold.value for fold in branch.folds], MAIN_FOLDS, rtol=1e-10)
    assert_folds_of_numpy(branch, MAIN_FOLDS)


def test_an_isola_is_recognised_when_it_closes(isola):
    check_branch(isola)
    assert isola.closed
    assert isola.end is End.CLOSED
    np.testing.assert_allclose(isola.coefficients[-1], isola.coefficients[0], atol=1e-8)
    np.testing.assert_allclose(sorted(f.value for f in isola.folds), ISOLA_FOLDS, rtol=1e-10)
    assert_folds_of_numpy(isola, ISOLA_FOLDS)
    assert isola.parameter.min() == pytest.approx(ISOLA_FOLDS[0], rel=1e-3)


def test_an_isola_is_the_same_loop_the_other_way_round(isola, absorber):
    start = solve(absorber, at={"omega": 1.9}, start=[[0.0, 0.95, 1.54], [0.0, -0.6, -1.0]])
    other = trace(absorber, "omega", (0.5, 3.0), start=start, stability=None)
    check_branch(other)
    assert other.closed
    length = [branch.arclength[-1] for branch in (isola, other)]
    assert length[1] == pytest.approx(length[0], rel=1e-2)


def test_an_isola_that_leaves_the_span_ends_on_its_limit(absorber, isola_start):
    branch = trace(absorber, "omega", (0.5, 2.0), start=isola_start, stability=None)
    check_branch(branch)
    assert branch.end is End.SPAN_END
    assert branch.parameter[-1] == 2.0


@pytest.mark.parametrize("count", [3, 25])
def test_a_resumed_isola_still_closes_where_it_began(absorber, isola_start, tmp_path, count):
    first = trace(
        absorber, "omega", (0.5, 3.0), start=isola_start, stability=None, method=PseudoArclength(max_points=count)
    )
    first.save(tmp_path / "part.npz")
    resumed = trace(absorber, "omega", (0.5, 3.0), stability=None, resume=Branch.load(tmp_path / "part.npz"))
    check_branch(resumed)
    assert resumed.end is End.CLOSED
    np.testing.assert_allclose(sorted(f.value for f in resumed.folds), ISOLA_FOLDS, rtol=1e-10)


def test_a_closed_branch_is_not_gone_round_again():
    problem = HarmonicBalance(tuned_absorber(force=0.15), 5)
    isola = trace(problem, "omega", (0.8, 2.6), start=find_all(problem, at={"omega": 1.9})[-1], stability=None)
    again = trace(problem, "omega", (0.8, 2.6), resume=isola, stability=None)
    assert again.end is End.CLOSED
    assert len(again) == len(isola)
