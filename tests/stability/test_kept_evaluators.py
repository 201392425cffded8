"""`floquet` compiles once for all solutions of a problem, and threads may share what it compiled."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.solutions.solving import solve
from hbnlp.stability import multipliers
from hbnlp.stability.multipliers import FloquetEvaluator, floquet
from hbnlp.stability.result import Floquet
from hbnlp.systems import chain, duffing


@pytest.fixture
def made(monkeypatch):
    """The arguments with which evaluators are made."""
    calls = []

    class Counted(FloquetEvaluator):
        def __init__(self, *args):
            calls.append(args[1:])
            super().__init__(*args)

    monkeypatch.setattr(multipliers, "FloquetEvaluator", Counted)
    return calls


def test_one_evaluator_serves_all_solutions_of_a_problem(made):
    problem = HarmonicBalance(duffing(), 5)
    solutions = [solve(problem, at={"omega": omega}) for omega in (0.8, 1.0, 1.3)]
    found = [floquet(solution) for solution in solutions]
    assert made == [(1, 5, Floquet())]
    for solution, result in zip(solutions, found, strict=True):
        fresh = FloquetEvaluator(problem.system, 1, 5)(
            solution.coefficients, problem.system.parameters.ordered(solution.parameters)
        )
        np.testing.assert_array_equal(result.multipliers, fresh.multipliers)
    floquet(solutions[0], method=Floquet(tol=1e-8))
    floquet(solve(problem.with_harmonics(3), at={"omega": 0.8}))
    floquet(solutions[1])
    assert made == [(1, 5, Floquet()), (1, 5, Floquet(tol=1e-8)), (1, 3, Floquet())]


def test_evaluators_of_ever_other_options_do_not_pile_up(made):
    problem = HarmonicBalance(duffing(), 1)
    solution = solve(problem, at={"omega": 0.8})
    for k in range(30):
        floquet(solution, method=Floquet(tol=1e-6 + 1e-9 * k))
    assert len(made) == 30
    assert len(problem.kept) <= 4


def test_threads_that_share_a_system_get_the_same_multipliers():
    problem = HarmonicBalance(chain(3), 5)
    solutions = [solve(problem, at={"omega": omega}) for omega in np.linspace(0.3, 2.2, 12)]
    expected = [floquet(solution).multipliers for solution in solutions]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # threads take turns as often as they can
    try:
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(floquet, solutions * 5))
    finally:
        sys.setswitchinterval(interval)
    for result, multipliers_alone in zip(found, expected * 5, strict=True):
        np.testing.assert_array_equal(result.multipliers, multipliers_alone)
