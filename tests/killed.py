"""Long work in a process of its own, which is killed: ``python killed.py verb folder`` says each point that it has.

Each verb saves after every point. What is said was computed, and is in the file but for the last of it at most.
"""

import functools
import itertools
import sys
from pathlib import Path

import numpy as np

import hbnlp
from hbnlp import dns
from hbnlp.systems import duffing

FREQUENCIES = np.linspace(0.9, 1.2, 600)
FORCES = {"force": np.linspace(0.02, 0.2, 100)}


def problem():
    return hbnlp.HarmonicBalance(duffing(), 5)


def flow():
    return dns.Simulation(dns.Grid.around_plate(cells=16, levels=1), dns.Membrane(hbnlp.NonlinearMembrane(n_modes=3)))


def say(number):
    sys.stdout.write(f"{number}\n")
    sys.stdout.flush()


def trace(folder):
    """Trace in small steps, far longer than it takes until the kill."""
    small = hbnlp.PseudoArclength(step=1e-3, max_step=1e-3, max_points=10**5)
    callbacks = [lambda progress: say(progress.counts["points"]), hbnlp.Autosave(folder / "file.npz", seconds=1e-9)]
    return hbnlp.trace(problem(), "omega", (0.5, 1.6), method=small, callbacks=callbacks)


def sweep(folder):
    callbacks = [
        lambda progress: say(len(progress.result())),
        hbnlp.Autosave(folder / "file.npz", seconds=1e-9),
    ]
    return hbnlp.sweep(problem(), "omega", FREQUENCIES, callbacks=callbacks)


def search(folder):
    """Make random starts, far more than it takes until the kill."""
    callbacks = [
        lambda progress: say(int(progress.value)),
        hbnlp.Autosave(folder / "file.npz", seconds=1e-9),
    ]
    return hbnlp.find_all(problem(), at={"omega": 1.2}, method=hbnlp.Search(n_starts=10**6), callbacks=callbacks)


def study(folder):
    """Trace at more points than it takes until the kill, each into a file of the folder."""

    def told(progress):
        if not progress.done:
            say(progress.counts["done"])

    return hbnlp.study(task(), over=FORCES, folder=folder, callbacks=[told])


def task():
    few = hbnlp.PseudoArclength(max_points=15)
    return functools.partial(hbnlp.trace, problem(), "omega", (0.5, 1.6), stability=None, method=few)


def settle(folder):
    """Integrate until it repeats itself to nothing, which it never does."""
    callbacks = [
        lambda progress: say(progress.counts["periods"]),
        hbnlp.Autosave(folder / "file.npz", seconds=1e-9),
    ]
    hbnlp.integrate(
        duffing(), at={"omega": 0.7}, periodic_tol=1e-300, max_periods=10**6, throw=False, callbacks=callbacks
    )


def run(folder):
    simulation = flow()
    checkpoint = dns.Checkpoint(folder / "file.npz", every=1)
    for _ in itertools.count():
        simulation.step()
        say(simulation.steps)
        checkpoint(simulation)


if __name__ == "__main__":
    {"trace": trace, "sweep": sweep, "search": search, "settle": settle, "run": run, "study": study}[sys.argv[1]](
        Path(sys.argv[2])
    )
