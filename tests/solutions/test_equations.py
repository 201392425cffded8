"""Equations of a balance with free scalars: derivatives by differences, and points carried to other harmonics."""

import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.continuation.arclength import PseudoArclength, Stop
from hbnlp.continuation.point import start_point
from hbnlp.continuation.walk import Walk
from hbnlp.solutions.equations import along_folds, along_load, along_parameter
from hbnlp.solutions.solving import solve
from hbnlp.systems import duffing, tuned_absorber


def folds(problem, values, *names):
    return along_folds(problem, np.linspace(0.5, 1.5, problem.size), values, *names)


KINDS = {
    "a parameter": lambda problem, values: along_parameter(problem, values, "omega", span=(0.5, 2.0)),
    "the load": along_load,
    "folds in two parameters": lambda problem, values: folds(problem, values, "omega", "force"),
    "folds at a load": lambda problem, values: folds(problem, values, "omega"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_jacobian_is_that_of_differences(kind):
    problem = HarmonicBalance(tuned_absorber(), 3)
    curve = KINDS[kind](problem, problem.values({"omega": 1.2}))
    rng = np.random.default_rng(3)
    scalars = [1.3 if scalar.name == "omega" else 0.7 for scalar in curve.unknowns.free]
    y = curve.unknowns.joined(rng.normal(size=problem.size), scalars, rng.normal(size=curve.unknowns.n_added))
    assert y.size == curve.unknowns.size == curve.size + 1
    jacobian = np.zeros((curve.size, y.size))
    curve.jacobian(y, jacobian)
    h = 1e-6
    steps = [h * row for row in np.eye(y.size)]
    differences = np.array([(curve.residual(y + step) - curve.residual(y - step)) / (2.0 * h) for step in steps]).T
    np.testing.assert_allclose(jacobian, differences, atol=1e-6 * np.abs(jacobian).max())


def test_the_parts_of_a_point_are_found_again():
    problem = HarmonicBalance(duffing(), 2)
    curve = folds(problem, problem.values({"omega": 1.0}), "omega", "force")
    y = curve.unknowns.joined(np.arange(5.0), [1.1, 0.2], np.arange(5.0, 10.0))
    np.testing.assert_array_equal(curve.unknowns.coefficients(y), np.arange(5.0))
    np.testing.assert_array_equal(curve.unknowns.added(y), np.arange(5.0, 10.0))
    assert curve.values(y)[problem.system.parameters.index("force")] == 0.2
    assert curve.name == "force"


@pytest.mark.parametrize("kind", KINDS)
def test_a_point_carried_to_more_harmonics_and_back_is_the_same(kind):
    problem = HarmonicBalance(duffing(), 2)
    curve = KINDS[kind](problem, problem.values({"omega": 1.2}))
    finer = curve.on(problem.with_harmonics(5))
    y = np.random.default_rng(1).normal(size=curve.unknowns.size)
    there = finer.carried_from(curve, y)
    assert there.size == finer.unknowns.size
    np.testing.assert_array_equal(curve.carried_from(finer, there), y)
    np.testing.assert_allclose(np.linalg.norm(there), np.linalg.norm(y), rtol=1e-14)


def test_a_walk_goes_on_with_more_harmonics_where_it_is_told_to():
    """From 3 to 7 harmonics at omega = 0.9, both ends of every step on one curve."""
    problem = HarmonicBalance(duffing(damping_ratio=0.05, cubic=1.0, force=0.5), 3)
    start = solve(problem, at={"omega": 0.6})
    curve = along_parameter(problem, problem.values(start.parameters), "omega", span=(0.6, 2.5))

    def judge(curve, _, after):
        more = curve.problem.n_harmonics == 3 and after.value > 0.9
        return curve.on(problem.with_harmonics(7)) if more else None

    first = start_point(curve, curve.point(start.coefficients, 0.6), curve.unknowns.fixing_last())
    walk = Walk(curve, first, PseudoArclength(), limits=(0.6, 2.5), judge=judge)
    numbers, values = [], []
    for before, after in walk:
        assert before.y.size == after.y.size == walk.curve.unknowns.size
        numbers.append(walk.curve.problem.n_harmonics)
        values.append(after.value)
    assert walk.stop is Stop.LIMIT
    assert numbers == sorted(numbers)
    assert set(numbers) == {3, 7}
    whole = trace(HarmonicBalance(problem.system, 7), "omega", (0.6, 2.5), stability=None)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(values)))) + 1
    np.testing.assert_allclose([values[k] for k in turns], [fold.value for fold in whole.folds], atol=0.01)
