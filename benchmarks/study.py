"""What a study costs beside its tasks, and what a second worker gains.

For a pool of spawned processes, and for a cluster of Dask on this machine if that is installed: the bytes that are sent
with the task and with a point, the time that a task costs which does nothing once the workers have a wing of ten modes,
by the clock and in CPU of the process that makes the study, and the time of tasks of a second by one worker and by two.
The ratio is printed for tasks that compute for a second of CPU, which takes longer where the machine has other work,
and for tasks that wait for a second, which does not. Run it from the root of the repository, on two free cores::

    python benchmarks/study.py
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import importlib.util
import multiprocessing
import pickle
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial

import numpy as np

import hbnlp
from hbnlp.core.sent_once import Call, packed
from hbnlp.studies.outcomes import attempted

POINTS = 200
SECONDS = 8


def idle(problem: hbnlp.HarmonicBalance, at: Mapping[str, float]) -> float:
    """Return a number at once; the problem is there for being sent."""
    return problem.size + at["number"]


def computing(at: Mapping[str, float]) -> float:
    """Compute for a second of CPU."""
    end = time.process_time() + 1.0
    while time.process_time() < end:
        np.linalg.eigvals(np.eye(20))
    return at["number"]


def waiting(at: Mapping[str, float]) -> float:
    """Wait for a second."""
    time.sleep(1.0)
    return at["number"]


@contextmanager
def processes(workers: int) -> Iterator[Executor]:
    """Give a pool of spawned processes."""
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


@contextmanager
def dask(workers: int) -> Iterator[Executor]:
    """Give a cluster of Dask on this machine."""
    from distributed import Client, LocalCluster  # noqa: PLC0415 (the extra `parallel`)

    with ExitStack() as stack:
        cluster = stack.enter_context(LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None))
        yield stack.enter_context(Client(cluster)).get_executor()


def seconds(task: Callable[..., object], points: int, executor: Executor | None) -> float:
    """Return the time of a study; all of its points must be there, in their order."""
    begin = time.perf_counter()
    study = hbnlp.study(task, over={"number": list(range(points))}, executor=executor)
    passed = time.perf_counter() - begin
    assert not study.errors
    assert sorted(study.results) == list(study.results)
    return passed


def table_of_sizes(problem: hbnlp.HarmonicBalance) -> None:
    """Print what is sent."""
    token, content = packed(partial(attempted, partial(idle, problem)))
    call = Call(token, None, {"number": 1.0}, 32 * "a")
    solution = hbnlp.solve(problem, at={"omega": 3.0})
    print(f"the task, once to a worker     {len(content):8d} bytes")
    print(f"a point                        {len(pickle.dumps(call)):8d} bytes")
    print(f"a number, back                 {len(pickle.dumps(1.0)):8d} bytes")
    print(f"a solution with its problem    {len(pickle.dumps(solution)):8d} bytes", flush=True)


def row(name: str, ways: Callable[[int], object], problem: hbnlp.HarmonicBalance) -> None:
    """Print what one kind of executor costs."""
    idle_task, times = partial(idle, problem), {}
    for workers in (1, 2):
        with ways(workers) as executor:  # type: ignore[attr-defined]
            seconds(idle_task, POINTS, executor)  # workers start, and are sent the task
            begin = time.process_time()
            cost = seconds(idle_task, POINTS, executor) / POINTS
            here = (time.process_time() - begin) / POINTS
            print(f"{name}, {workers} workers: a task costs {1e3 * cost:.2f} ms, {1e3 * here:.2f} ms of CPU here")
            for task in (computing, waiting):
                seconds(task, workers, executor)
                times[task, workers] = seconds(task, SECONDS, executor)
    for task in (computing, waiting):
        one, two = times[task, 1], times[task, 2]
        print(
            f"{name}, {SECONDS} tasks {task.__name__} for a second: {one:.2f} s by one worker, {two:.2f} s by two, "
            f"ratio {one / two:.2f}",
            flush=True,
        )


if __name__ == "__main__":
    wing = hbnlp.membrane_wing(
        hbnlp.QuasiLinearMembrane(prestrain=0.008),
        hbnlp.aero.flat_plate_re100(),
        parameters={"pitch_amplitude": np.radians(2.5)},
    )
    sent = hbnlp.HarmonicBalance(wing, 5)
    table_of_sizes(sent)
    print(f"{SECONDS} tasks computing for a second by a loop: {seconds(computing, SECONDS, None):.2f} s", flush=True)
    row("processes", processes, sent)
    if importlib.util.find_spec("distributed") is not None:
        row("Dask", dask, sent)
