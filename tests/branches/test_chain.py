"""The ten-mass chain: sixteen folds, sixty-four branch points, legs that come close to each other."""

import numpy as np
import pytest
from numpy_balance import CubicBalance

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.core.kinds import End
from hbnlp.solutions.solving import solve
from hbnlp.systems import chain
from hbnlp.testing import check_branch

# with 7 harmonics, by tests/numpy_balance.py, as tested below
CHAIN_FOLDS = [
    *(1.037698837, 1.080013925, 0.786500496, 1.076544718, 0.535510968, 1.295849021, 0.966704292, 1.264666301),
    *(0.907068227, 1.291487578, 0.940645927, 1.256394770, 1.068749937, 1.270584141, 0.333995527, 1.965667751),
]

# Where symmetry breaks: odd harmonics x, even null vector v of R(x, w) = 0, R_x v = 0, v.v = 1, solved by Newton's
# method to 1e-12 from every sign change of the determinant that a trace in steps of at most 0.02 sees
CHAIN_BRANCH_POINTS = [
    *(1.1882881437, 1.2190032844, 1.2282369444, 1.2514365808, 1.2514767041, 1.2318400264, 1.2190375984, 1.1895701001),
    *(1.1634203477, 1.1927438329, 1.2330664821, 1.2330960313, 1.1860720605, 1.1622094136, 1.2427567829, 1.2428158102),
    *(1.1153523292, 1.1081341306, 1.1418505113, 1.1578709124, 1.2523613605, 1.2523920465, 1.1597033215, 1.1427017861),
    *(1.1540913752, 1.1830649405, 1.2584668686, 1.2585504626, 1.1849981989, 1.1558220099, 0.4224434917, 0.4314588160),
    *(0.6027812048, 0.6279600310, 0.7654084386, 0.7990030670, 0.9115792506, 0.9524945722, 1.0403148791, 1.0887604971),
    *(1.1482333856, 1.2033833708, 1.2311407839, 1.2812783680, 1.2940563336, 1.3490781875, 1.3495836144, 1.2954663010),
    *(1.2817141065, 1.2319340473, 1.2061868916, 1.1496074561, 1.0929497922, 1.0424160233, 0.9583848399, 0.9147204373),
    *(0.8074861441, 0.7703686117, 0.6419125208, 0.6114309662, 0.4626786464, 0.4408079285, 0.2885521543, 0.2686431694),
]

STEPS = {"default": {}, "short": {"max_step": 0.05}, "long": {"step": 0.1, "max_step": 0.5, "angle": 14.0}}


@pytest.fixture(scope="module")
def chain_problem():
    return HarmonicBalance(chain(10), 7)


@pytest.fixture(scope="module", params=STEPS.values(), ids=STEPS.keys())
def chain_branch(request, chain_problem):
    return trace(chain_problem, "omega", (2.5, 0.2), stability=None, method=PseudoArclength(**request.param))


def test_the_chain_has_its_sixteen_folds_in_order(chain_branch):
    check_branch(chain_branch)
    assert chain_branch.end is End.SPAN_END
    assert all(fold.refined for fold in chain_branch.folds)
    np.testing.assert_allclose([fold.value for fold in chain_branch.folds], CHAIN_FOLDS, rtol=1e-9)


def test_all_its_branch_points_break_the_half_period_sign_change(chain_branch):
    assert {point.breaks.name for point in chain_branch.branch_points} == {"half-period sign change"}


def test_the_tabulated_folds_are_those_of_a_balance_in_numpy(chain_branch):
    """From the folds that were traced, at a distance of some 1e-5."""
    springs = 2 * np.eye(10) - np.eye(10, k=1) - np.eye(10, k=-1)
    springs[-1, -1] = 1.0
    cubic, load = np.full(10, 0.5), 0.1 * np.eye(10)[-1]
    balance = CubicBalance(np.eye(10), 0.02 * springs, springs, np.eye(10), cubic, load, 7)
    starts = [(fold.solution.coefficients.ravel() * (1 + 1e-5), fold.value) for fold in chain_branch.folds]
    found = [balance.fold(x, omega, 1.0)[0] for x, omega in starts]
    np.testing.assert_allclose(found, CHAIN_FOLDS, rtol=1e-9)


def test_all_but_a_few_pairs_of_the_chains_branch_points_are_found(chain_branch):
    """Two branch points within one step leave the determinant's sign as it was; its dip gives most away."""
    found = np.array([point.value for point in chain_branch.branch_points])
    missed = [value for value in CHAIN_BRANCH_POINTS if np.abs(found - value).min() > 1e-5]
    assert len(missed) <= 4
    assert len(found) % 2 == len(CHAIN_BRANCH_POINTS) % 2


def test_every_branch_point_that_is_said_to_be_refined_is_where_symmetry_breaks(chain_branch):
    refined = np.array([point.value for point in chain_branch.branch_points if point.refined])
    distance = np.abs(np.subtract.outer(refined, CHAIN_BRANCH_POINTS)).min(axis=1)
    assert distance.max() < 1e-7


@pytest.mark.parametrize("step", [0.001, 0.0014, 0.0018, 0.0024, 0.0034, 0.0042, 0.005])
def test_short_steps_pass_through_branch_points(chain_problem, step):
    """At a branch point the corrector has nothing to hold on to: a step must leap over it, not creep up to it."""
    start = solve(chain_problem, at={"omega": 1.3})
    options = PseudoArclength(step=step, max_step=step, max_points=150)
    branch = trace(chain_problem, "omega", (1.3, 1.1), start=start, stability=None, method=options)
    check_branch(branch)
    assert branch.end in (End.MAX_POINTS, End.SPAN_END)
