"""Threads and processes that share the work: what they give is what a loop gives, to the last bit."""

import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import casadi as ca
import jobs
import numpy as np
import pytest

import hbnlp

FORCES = (0.12, 0.16, 0.2, 0.24)
WAYS = [way for way in ("spawn", "fork") if way in multiprocessing.get_all_start_methods()]

# pytest's own worker has threads, at which Python shakes its head when it forks
pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")


def fresh():
    return hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 5)


def pool(way, workers=1):
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context(way))


def same(one, other):
    np.testing.assert_array_equal(one.coefficients, other.coefficients)
    np.testing.assert_array_equal(one.multipliers, other.multipliers)
    assert [p.value for p in one.special_points] == [p.value for p in other.special_points]


@pytest.mark.parametrize("way", WAYS)
def test_a_pool_of_processes_gives_what_a_loop_gives_and_builds_once(way):
    problem = fresh()
    loop = [jobs.traced(problem, force) for force in FORCES]
    with pool(way) as workers:
        for one, other in zip(loop, workers.map(jobs.traced, [problem] * 4, FORCES), strict=True):
            same(one, other)
        first, second = workers.map(jobs.built, [problem] * 2)
    assert first == second
    assert first[2]


@pytest.mark.parametrize("way", WAYS)
def test_an_error_in_a_worker_arrives(way):
    problem = fresh()
    with pool(way) as workers:
        with pytest.raises(hbnlp.ConvergenceError, match="stopped at t") as caught:
            workers.submit(jobs.diverging, problem.system).result(timeout=60)
        assert isinstance(caught.value.result, hbnlp.TimeResponse)
        with pytest.raises(hbnlp.TaskError, match="a callback of the user's") as failed:
            workers.submit(jobs.failing, problem).result(timeout=60)
        assert len(failed.value.result) == 3
        assert failed.value.__notes__ == ["caused by ZeroDivisionError: a callback of the user's"]


def test_an_error_does_not_hang_the_older_kind_of_pool():
    with multiprocessing.get_context("spawn").Pool(1) as workers:
        failed = workers.apply_async(jobs.diverging, [hbnlp.systems.duffing()])
        with pytest.raises(hbnlp.ConvergenceError, match="stopped at t"):
            failed.get(timeout=60)


@pytest.mark.skipif("fork" not in WAYS, reason="there is no fork here")
def test_a_fork_works_while_threads_compile_and_solve():
    problem = fresh()
    with ThreadPoolExecutor(2) as threads, pool("fork") as workers:
        under_way = [threads.submit(jobs.traced, fresh(), force) for force in FORCES]
        apart = workers.submit(jobs.traced, problem, 0.2).result(timeout=60)
        together = [each.result() for each in under_way]
    same(apart, together[2])


def verbs(problem):
    """Return what can be done with a problem, each as a function of a number, and what tells results apart."""
    system = problem.system
    branch = hbnlp.trace(problem, "omega", (0.5, 1.6), at={"force": 0.2}, stability=None)
    x = branch.coefficients.reshape(len(branch), -1)
    values = np.array([list(branch.solution(i).parameters.values()) for i in range(len(branch))])
    variables = hbnlp.design.Variables({"force": (0.1, 0.3)})
    response = hbnlp.design.response_at(problem, variables, branch.solution(0))
    program = hbnlp.design.Program(variables, [response], objective=response(problem.amplitude_squared("x")))

    def solution(i, **options):
        return hbnlp.solve(problem, at={"omega": 0.8 + 0.07 * i}, **options)

    return {
        "solve": lambda i: solution(i).coefficients,
        "ipopt": lambda i: solution(i, method=hbnlp.Ipopt()).coefficients,
        "trace": lambda i: jobs.traced(problem, FORCES[i]).multipliers,
        "floquet": lambda i: hbnlp.floquet(solution(i)).monodromy,
        "find_all": lambda i: hbnlp.find_all(problem, at={"omega": 1.0 + 0.05 * i})[-1].coefficients,
        "follow": lambda i: hbnlp.follow(branch.folds[0], "force", span=(0.15, 0.3 + 0.01 * i)).first,
        "newton sweep": lambda i: hbnlp.sweep(problem, "omega", np.linspace(0.6, 0.9 + 0.1 * i, 5)).amplitudes,
        "runge kutta": lambda i: hbnlp.sweep(system, "omega", [0.6 + 0.1 * i], method=hbnlp.RungeKutta4()).amplitudes,
        "cvodes": lambda i: hbnlp.integrate(system, at={"omega": 0.6 + 0.1 * i}, method=hbnlp.Adaptive()).q,
        "peaks": lambda i: hbnlp.peaks(branch, "x")[0].solution.coefficients + i,
        "at": lambda i: branch.at(0.9 + 0.05 * i)[0].coefficients,
        "outputs": lambda i: problem.output_harmonics(x[i:], values[i:]),
        "program": lambda i: program.solve({"force": 0.15 + 0.02 * i}).unknowns,
        "build": lambda i: (
            hbnlp.solve(hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 3 + i), at={"omega": 0.8}).coefficients
        ),
        "send": lambda i: hbnlp.solve(jobs.there(problem), at={"omega": 0.8 + 0.1 * i}).coefficients,
        "expression": lambda i: np.atleast_1d(solution(i)(ca.sumsqr(problem.x))),
    }


def test_threads_that_share_a_problem_give_what_a_loop_gives_with_every_verb():
    loop, shared = verbs(fresh()), verbs(fresh())
    tasks = [(name, i) for i in range(4) for name in loop]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)  # as many changes between threads as there can be
    try:
        with ThreadPoolExecutor(6) as threads:
            together = list(threads.map(lambda task: shared[task[0]](task[1]), tasks))
    finally:
        sys.setswitchinterval(interval)
    for (name, i), found in zip(tasks, together, strict=True):
        np.testing.assert_array_equal(found, loop[name](i), err_msg=f"{name} {i}")
