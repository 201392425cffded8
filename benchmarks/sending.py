"""What it costs to send a problem to another process, and what two workers gain.

Prints the bytes of a pickled problem, the time to pickle it and to unpickle it where it was not known and where it was,
and the time to the first residual with its Jacobian, which compiles; then the time of four traces by two threads with
one lock around everything, by two threads without, and by two processes. Run it from the root of the repository::

    python benchmarks/sending.py
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import logging
import multiprocessing
import pickle
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial

import numpy as np

import hbnlp

REPEATS = 5


def wing(membrane: hbnlp.wing.membrane.Membrane) -> hbnlp.System:
    """Return a wing of ten modes on the shipped aerodynamics."""
    rom = hbnlp.aero.flat_plate_re100()
    return hbnlp.membrane_wing(membrane, rom, parameters={"pitch_amplitude": np.radians(2.5)})


def systems() -> dict[str, hbnlp.System]:
    """Return what is sent."""
    return {
        "Duffing oscillator": hbnlp.systems.duffing(),
        "chain of ten masses": hbnlp.systems.chain(10),
        "wing, quasi-linear membrane": wing(hbnlp.QuasiLinearMembrane(prestrain=0.008)),
        "wing, nonlinear membrane": wing(hbnlp.NonlinearMembrane(prestrain=0.008)),
    }


def milliseconds(run: Callable[[], object]) -> tuple[float, object]:
    """Return the time of one call, and its result."""
    begin = time.perf_counter()
    result = run()
    return 1e3 * (time.perf_counter() - begin), result


def received(content: bytes) -> tuple[float, float, float]:
    """Return, in a process that knows nothing yet, the times to unpickle, again, and to the first evaluation."""
    first, problem = milliseconds(lambda: pickle.loads(content))  # noqa: S301 (our own)
    again, _ = milliseconds(lambda: pickle.loads(content))  # noqa: S301 (our own)
    values = problem.values({"omega": 1.0})

    def evaluate() -> None:
        x = np.full(problem.size, 1e-3)
        problem.assembly.residual(x, values)
        problem.assembly.jacobian(x, values)

    return first, again, milliseconds(evaluate)[0]


def row(name: str, *cells: str) -> None:
    print(f"{name:30s}" + "".join(f"{cell:>18s}" for cell in cells), flush=True)


def table_of_sending() -> None:
    """Print what a problem costs to send; each time is the median over new processes."""
    row("problem, H = 5", "bytes", "pickle ms", "unpickle ms", "again ms", "first value ms")
    for name, system in systems().items():
        pickling, content = milliseconds(partial(pickle.dumps, hbnlp.HarmonicBalance(system, 5)))
        times = []
        for _ in range(REPEATS):
            with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
                pool.submit(pickle.loads, pickle.dumps(hbnlp.systems.duffing(force=0.3))).result()  # imports
                times.append(pool.submit(received, content).result())
        row(name, f"{len(content)}", f"{pickling:.2f}", *(f"{each:.2f}" for each in np.median(times, axis=0)))


SHIFTS = (0.0, 0.001, 0.002, 0.003)
TRACES = {
    "chain of ten masses, H = 5": (10, 5),
    "chain of 25 masses, H = 7": (25, 7),
}


def traced(problem: hbnlp.HarmonicBalance, shift: float) -> int:
    """Return the points of a short trace with stability."""
    logging.disable()  # that it ends early is meant
    start = hbnlp.PseudoArclength(max_points=40)
    return len(hbnlp.trace(problem, "omega", (0.25 + shift, 0.5), method=start))


def table_of_workers() -> None:
    """Print the time of four traces by two workers that share a problem, the best of runs that alternate."""
    print()
    row("four traces with stability", "one lock s", "two threads s", "two processes s")
    lock = threading.Lock()

    def locked(problem: hbnlp.HarmonicBalance, shift: float) -> int:
        with lock:
            return traced(problem, shift)

    spawn = multiprocessing.get_context("spawn")
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(2, mp_context=spawn) as processes:
        ways = [(threads, locked), (threads, traced), (processes, traced)]
        for name, (masses, n_harmonics) in TRACES.items():
            shared = [hbnlp.HarmonicBalance(hbnlp.systems.chain(masses), n_harmonics)] * len(SHIFTS)
            times: list[list[float]] = [[], [], []]
            for _ in range(4):  # the first one compiles
                for taken, (pool, trace) in zip(times, ways, strict=True):
                    taken.append(
                        milliseconds(
                            lambda pool=pool, trace=trace, shared=shared: list(pool.map(trace, shared, SHIFTS))
                        )[0]
                        / 1e3
                    )
            row(name, *(f"{min(taken[1:]):.2f}" for taken in times))


if __name__ == "__main__":
    table_of_sending()
    table_of_workers()
