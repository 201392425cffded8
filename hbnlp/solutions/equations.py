"""The curves that are traced: solutions against a parameter, and against the size of the load."""

from __future__ import annotations

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.types import Array


class ParameterCurve:
    """Solutions ``y = (x, lambda)`` of a balance against one parameter, the others fixed.

    Parameters
    ----------
    problem : HarmonicBalance
    values : array
        All parameters in order; the entry of the continuation parameter is ignored.
    name : str
        The continuation parameter.
    floor : float
        Changes of lambda are measured relative to itself, or to this where it is smaller.
    """

    def __init__(self, problem: HarmonicBalance, values: Array, name: str, floor: float) -> None:
        self.problem = problem
        self.size = problem.size
        self.name = name
        self.index = problem.system.parameters.index(name)
        self.floor = floor
        self.solution_floor = float(np.finfo(float).tiny)
        self._values = values.copy()

    def values(self, y: Array) -> Array:
        """Return all parameters at a point."""
        values = self._values.copy()
        values[self.index] = y[-1]
        return values

    def residual(self, y: Array) -> Array:
        """Return R(y), (size,)."""
        return self.problem.assembly.residual(y[:-1], self.values(y))

    def jacobian(self, y: Array, out: Array) -> None:
        """Write dR/dy into an array (size, size + 1) of zeros."""
        assembly, values = self.problem.assembly, self.values(y)
        assembly.jacobian(y[:-1], values, out[:, :-1])
        out[:, -1] = assembly.parameter_derivative(y[:-1], values, self.index)

    def scale(self, y: Array) -> Array:
        """Return the sizes (size + 1,) by which changes of y are measured."""
        scale = np.full(y.size, max(float(np.linalg.norm(y[:-1])), self.solution_floor))
        scale[-1] = max(abs(y[-1]), self.floor)
        return scale

    def term_size(self, y: Array) -> float:
        """Return the size of the terms whose sum is R."""
        return self.problem.assembly.term_size(y[:-1], self.values(y))


class LoadCurve:
    """Solutions ``y = (x, load)`` at fixed parameters, the excitation times ``load``: the way from rest to 1."""

    def __init__(self, problem: HarmonicBalance, values: Array) -> None:
        self.problem = problem
        self.size = problem.size
        self.solution_floor = float(np.finfo(float).tiny)
        self._values = values

    def residual(self, y: Array) -> Array:
        """Return R(y), (size,)."""
        return self.problem.assembly.residual(y[:-1], self._values, load=y[-1])

    def jacobian(self, y: Array, out: Array) -> None:
        """Write dR/dy into an array (size, size + 1) of zeros."""
        assembly = self.problem.assembly
        assembly.jacobian(y[:-1], self._values, out[:, :-1])
        out[:, -1] = assembly.load_derivative(self._values)

    def scale(self, y: Array) -> Array:
        """Return the sizes (size + 1,) by which changes of y are measured."""
        scale = np.full(y.size, max(float(np.linalg.norm(y[:-1])), self.solution_floor))
        scale[-1] = max(abs(y[-1]), 0.1)
        return scale

    def term_size(self, y: Array) -> float:
        """Return the size of the terms whose sum is R."""
        return self.problem.assembly.term_size(y[:-1], self._values)
