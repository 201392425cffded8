"""What workers of a pool are given to do: a spawned process imports it from here, as it would a user's module."""

import os
import pickle
import signal
import time
import warnings

import numpy as np

import hbnlp


def there(thing):
    """Return what arrives in another process."""
    return pickle.loads(pickle.dumps(thing))  # noqa: S301 (our own)


def traced(problem, force):
    return hbnlp.trace(problem, "omega", (0.5, 1.6), at={"force": force})


def built(problem):
    """Return where a problem is that arrived before, and whether it is compiled."""
    return id(problem), id(problem.system), "assembly" in vars(problem)


def diverging(subject):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        hbnlp.integrate(subject, at={"omega": 1.0, "damping_ratio": -5.0})


def failing(problem):
    def fail(progress):
        if progress.counts["points"] == 3:
            raise ZeroDivisionError("a callback of the user's")

    hbnlp.trace(problem, "omega", (0.5, 1.6), callbacks=[fail])


def own(at):
    """Make a system of the values, and fail where the force is large."""
    if at["force"] > 0.25:
        raise ValueError("the force is too large")
    system = hbnlp.systems.duffing(damping_ratio=at["damping_ratio"])
    return hbnlp.solve(hbnlp.HarmonicBalance(system, 3), at={"omega": 0.5, "force": at["force"]})


def slow_first(at):
    """Return a number, the later ones first."""
    time.sleep(0.2 / (1 + at["number"]))
    return 10 * at["number"]


def ending(at):
    """End the process at one point, as the system does that has no memory left."""
    if at["number"] == 3:
        os._exit(1)
    return at["number"]


def interrupted(problem, at):
    """Trace, and be interrupted on the way at one point: what the trace returns then is not whole."""

    def interrupt(progress):
        if at["force"] == 0.2 and progress.counts["points"] == 5:
            signal.raise_signal(signal.SIGINT)

    return hbnlp.trace(problem, "omega", (0.5, 1.6), at=at, stability=None, callbacks=[interrupt])


def unsendable(at):
    """Return what no process can be sent."""
    return (lambda: at) if at["number"] == 1 else np.arange(at["number"])


def leaving(at):
    """End the program, as a script does that was given wrong arguments."""
    raise SystemExit(at["number"])


def twice(number):
    return 2 * number
