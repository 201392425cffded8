"""Branches of odd motions traced in odd harmonics alone: the same branches, and no breaking of the symmetry missed."""

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.balance.odd import even_positions
from hbnlp.branches import starting
from hbnlp.continuation.curve import Bordered, InParts
from hbnlp.core.kinds import Kind
from hbnlp.solutions.equations import Equations, along_parameter
from hbnlp.solutions.odd import is_odd_throughout
from hbnlp.solutions.odd_equations import OddEquations
from hbnlp.systems import chain, duffing


@pytest.fixture
def whole_and_parts(monkeypatch):
    """Make a branch as it is traced in all harmonics, and as in odd ones alone where it has only these."""

    def make(*arguments, **options):
        branches = []
        for large in (10**9, 0):
            monkeypatch.setattr(starting, "LARGE", large)
            branches.append(hbnlp.trace(*arguments, **options))
        return branches

    return make


def biased(bias):
    """x'' + .1 x' + x + x^3 = .5 cos w t + bias: odd without the bias."""
    return hbnlp.System(
        [[1.0]],
        [[0.1]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau) + p.bias],
        parameters={"force": 0.5, "bias": bias},
    )


def told(branch):
    return [point.kind for point in branch.special_points], [point.value for point in branch.special_points]


def even_part(branch):
    return np.abs(branch.coefficients[..., even_positions(branch.coefficients.shape[-1] // 2)]).max()


@pytest.mark.parametrize("stability", [None, hbnlp.Floquet()], ids=["without", "with multipliers"])
@pytest.mark.parametrize(
    ("system", "number", "span"),
    [
        (duffing(), {"n_harmonics": 7}, (0.5, 1.6)),
        (chain(3), {"n_harmonics": 5}, (2.5, 0.4)),
        (chain(3), {"tolerance": 1e-4}, (2.5, 0.6)),
    ],
    ids=["duffing", "chain", "chain to a tolerance"],
)
def test_special_points_are_those_of_all_harmonics(whole_and_parts, system, number, span, stability):
    whole, parts = whole_and_parts(hbnlp.HarmonicBalance(system, **number), "omega", span, stability=stability)
    kinds, values = told(whole)
    assert kinds
    assert told(parts)[0] == kinds
    assert told(parts)[1] == pytest.approx(values, rel=1e-8)
    assert [point.breaks for point in parts.special_points] == [point.breaks for point in whole.special_points]
    assert parts.end is whole.end
    assert even_part(parts) == 0.0


def test_the_null_vector_of_a_breaking_is_that_of_the_jacobian_and_even(whole_and_parts):
    problem = hbnlp.HarmonicBalance(chain(3), 5)
    _, branch = whole_and_parts(problem, "omega", (2.5, 0.4), stability=None)
    assert branch.branch_points
    for point in branch.branch_points:
        x, values = point.solution.coefficients.ravel(), problem.values(point.solution.parameters)
        jacobian, null = problem.assembly.jacobian(x, values), point.null.ravel()
        assert np.linalg.norm(jacobian @ null) < 1e-7 * np.linalg.norm(jacobian, 2) * np.linalg.norm(null)
        odd = np.delete(point.null, even_positions(5), axis=1)
        assert np.all(odd == 0.0)


def test_a_branch_that_lost_the_symmetry_has_all_harmonics(whole_and_parts):
    problem = hbnlp.HarmonicBalance(chain(3), 5)
    _, branch = whole_and_parts(problem, "omega", (2.5, 0.4), stability=None)
    start = hbnlp.switch_branch(branch.branch_points[0])[0]
    whole, parts = whole_and_parts(start, "omega", (2.5, 0.4), stability=None)
    assert even_part(parts) > 1e-3
    assert told(parts) == told(whole)


def test_a_parameter_that_breaks_the_symmetry_from_zero_on_is_seen(whole_and_parts):
    problem = hbnlp.HarmonicBalance(biased(0.0), 7)
    values, x = problem.values({"omega": 1.3}), hbnlp.solve(problem, at={"omega": 1.3}).coefficients.ravel()
    assert is_odd_throughout(problem, x, values, "omega", (0.3, 3.0))
    assert is_odd_throughout(problem, x, values, "force", (0.5, 1.0))
    assert not is_odd_throughout(problem, x, values, "bias", (0.0, 0.5))
    whole, parts = whole_and_parts(problem, "bias", (0.0, 0.5), at={"omega": 1.3}, stability=None)
    assert even_part(parts) > 0.01
    assert np.array_equal(whole.coefficients, parts.coefficients)


def test_equations_without_the_symmetry_and_motions_without_it_have_all_harmonics():
    problem = hbnlp.HarmonicBalance(biased(0.2), 5)
    x = np.zeros(problem.size)
    assert not is_odd_throughout(problem, x, problem.values({"omega": 1.3}), "omega", (0.3, 3.0))
    problem = hbnlp.HarmonicBalance(biased(0.0), 5)
    x[0], x[1] = 1e-3, 1.0
    assert not is_odd_throughout(problem, x, problem.values({"omega": 1.3}), "omega", (0.3, 3.0))
    doubled = hbnlp.HarmonicBalance(biased(0.0), 10, periods=2)
    none = np.zeros(doubled.size)
    assert not is_odd_throughout(doubled, none, doubled.values({"omega": 1.3}), "omega", (0.3, 3.0))


def test_factors_in_parts_are_those_of_the_whole():
    problem = hbnlp.HarmonicBalance(chain(3), 6)
    values, rng = problem.values({"omega": 1.1}), np.random.default_rng(2)
    whole, odd = (along_parameter(problem, values, "omega", kind=each) for each in (Equations, OddEquations))
    y = odd.point(rng.standard_normal(problem.shape), 1.1)
    row = np.zeros(y.size)
    row[odd.parts.along] = rng.standard_normal(odd.parts.along.size)
    one, other = (Bordered.at(curve, y, row) for curve in (whole, odd))
    assert isinstance(other, InParts)
    right = rng.standard_normal(y.size)
    assert other.solve(right) == pytest.approx(one.solve(right), rel=1e-8)
    assert other.solve_transposed(right) == pytest.approx(one.solve_transposed(right), rel=1e-8)
    assert other.product(right) == pytest.approx(one.product(right), rel=1e-8)
    # the order of rows and columns is changed alike, which leaves the determinant
    assert other.determinant() == pytest.approx(one.determinant())


def test_a_branch_of_odd_motions_is_resumed_as_such(whole_and_parts):
    problem = hbnlp.HarmonicBalance(chain(3), 5)
    short = hbnlp.PseudoArclength(max_points=40)
    _, begun = whole_and_parts(problem, "omega", (2.5, 0.4), stability=None, method=short)
    resumed = hbnlp.trace(problem, "omega", (2.5, 0.4), stability=None, resume=begun)
    _, at_once = whole_and_parts(problem, "omega", (2.5, 0.4), stability=None)
    assert even_part(resumed) == 0.0
    assert [point.kind for point in resumed.special_points if point.kind is Kind.BRANCH_POINT] == [
        point.kind for point in at_once.special_points if point.kind is Kind.BRANCH_POINT
    ]
