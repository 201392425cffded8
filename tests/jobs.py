"""What workers of a pool are given to do: a spawned process imports it from here, as it would a user's module."""

import pickle
import warnings

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
