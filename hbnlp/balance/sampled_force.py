"""The force at the samples of a balance: alternating frequency/time on compiled functions and numpy memory.

At coefficients X (n, L) the force sees, at each sample, ``q = X s`` and ``v = omega / periods X s'``: s are the basis
functions there, s' their derivatives by phase. The coefficients give ``r = X s'``, hence ``f_r = omega / periods f_v``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import casadi as ca
import numpy as np

from hbnlp.core.kept import Kept, built_once
from hbnlp.core.native import PerThread, bound
from hbnlp.core.types import Array
from hbnlp.fourier import FourierBasis, differentiated
from hbnlp.systems.system import System

LARGEST_EXPANSION = 50_000
"""Instructions up to which all samples are written out as one function: calls cost more than arithmetic there."""

_Name = Literal["value", "derivatives", "along", "derivatives_along"]


class SampledForce:
    """The force f and its exact derivatives at all samples, in arrays (n_samples, size).

    Derivatives are the entries of f_q and f_r that may differ from zero. An array that is returned may be overwritten
    by the next call in the same thread.
    """

    def __init__(self, system: System, basis: FourierBasis, periods: int) -> None:
        self._force = system.compiled_force
        self._omega, self._periods = system.parameters.index("omega"), periods
        self._n_q, self._viscous = self._force.places_q[0].size, self._force.places_v[0].size > 0
        self._basis = basis
        mapped = _Mapped(system, basis.n_samples)
        self._memory = PerThread(lambda: _Memory(system, periods * basis.theta, mapped))

    def value(self, coefficients: Array, values: Array) -> Array:
        """Return the force."""
        return self._at(coefficients, values).evaluated("value")

    def derivatives(self, coefficients: Array, values: Array) -> tuple[Array, Array]:
        """Return f_q and f_r."""
        return self._parted(self._at(coefficients, values).evaluated("derivatives"), values)

    def along(self, coefficients: Array, values: Array, index: int) -> Array:
        """Return the derivative of the force by parameter ``index``."""
        return self._toward(coefficients, values, None, index).evaluated("along")

    def derivatives_along(
        self, coefficients: Array, values: Array, direction: Array | None, index: int | None
    ) -> tuple[Array, Array]:
        """Return the slopes of f_q and f_r along coefficients (n, L), if given, plus those by a parameter."""
        memory = self._toward(coefficients, values, direction, index)
        by_q, by_r = self._parted(memory.evaluated("derivatives_along"), values)
        if self._viscous and index == self._omega:
            by_r += memory.evaluated("derivatives")[:, self._n_q :] / self._periods
        return by_q, by_r

    def depends_on(self, index: int) -> bool:
        """Return whether the force depends on a parameter; on omega it may through the velocities alone."""
        return bool(self._force.depends_on[index]) or (self._viscous and index == self._omega)

    def _parted(self, entries: Array, values: Array) -> tuple[Array, Array]:
        if not self._viscous:
            return entries, entries[:, :0]
        return entries[:, : self._n_q], self._rate(values) * entries[:, self._n_q :]

    def _rate(self, values: Array) -> float:
        return float(values[self._omega]) / self._periods

    def _at(self, coefficients: Array, values: Array) -> _Memory:
        memory = self._memory()
        self._sample(coefficients, memory.state)
        if self._viscous:
            np.multiply(memory.r, self._rate(values), out=memory.v)
        memory.p[:] = values
        return memory

    def _sample(self, coefficients: Array, out: Array) -> None:
        """Write the samples of signals and, where the force has to do with it, of their derivatives by phase."""
        if self._basis.is_small:
            np.matmul(self._matrix, coefficients.T, out=out[: len(self._matrix)])
            return
        count = self._basis.n_samples
        out[:count] = self._basis.sampled(coefficients).T
        if self._viscous:
            out[count:] = self._basis.sampled(differentiated(coefficients)).T

    @built_once
    def _matrix(self) -> Array:
        basis = self._basis
        return np.vstack([basis.sampling, basis.derivative_sampling]) if self._viscous else basis.sampling

    def _toward(self, coefficients: Array, values: Array, direction: Array | None, index: int | None) -> _Memory:
        memory = self._at(coefficients, values)
        if direction is None:
            memory.direction[:] = 0.0
        else:
            self._sample(direction, memory.direction)
        memory.dp[:] = 0.0
        if index is not None:
            memory.dp[:, index] = 1.0
        if self._viscous:
            np.multiply(memory.dr, self._rate(values), out=memory.dv)
            if index == self._omega:
                memory.dv += memory.r / self._periods
        return memory


class _Mapped:
    """The force and its derivatives at all samples, compiled once for all threads."""

    def __init__(self, system: System, count: int) -> None:
        self._force, self._count = system.compiled_force, count
        self._kept: Kept[ca.Function] = Kept(4)

    def __call__(self, name: _Name) -> ca.Function:
        """Return one of them."""
        return self._kept.get(name, lambda: self._compiled(getattr(self._force, name)))

    def _compiled(self, function: ca.Function) -> ca.Function:
        mapped = function.map(self._count)
        return mapped.expand() if function.n_instructions() * self._count <= LARGEST_EXPANSION else mapped


class _Memory:
    """The arrays of one thread: where the force is evaluated, and what it gives.

    Of ``state`` and ``direction`` the first half are displacements, the second their derivatives by phase.
    """

    def __init__(self, system: System, tau: Array, mapped: _Mapped) -> None:
        count, n, n_p = tau.size, system.n_dof, len(system.parameters.names)
        self.state, self.direction = np.zeros((2 * count, n)), np.zeros((2 * count, n))
        self.r, self.dr = self.state[count:], self.direction[count:]
        self.v, self.dv = np.zeros((count, n)), np.zeros((count, n))
        self.p, self.dp = np.zeros((count, n_p)), np.zeros((count, n_p))
        self._arguments = [self.state[:count], self.v, tau[:, None].copy(), self.p]
        self._arguments += [self.direction[:count], self.dv, self.dp]
        self._mapped = mapped
        self._evaluations: dict[_Name, tuple[Callable[[], None], Array]] = {}

    def evaluated(self, name: _Name) -> Array:
        """Return a function's result (n_samples, size) at all samples, overwritten by its next evaluation."""
        if name not in self._evaluations:
            function = self._mapped(name)
            result = np.zeros((len(self.p), function.nnz_out(0) // len(self.p)))
            evaluate = bound(function, self._arguments[: function.n_in()], [result])
            self._evaluations[name] = evaluate, result
        evaluate, result = self._evaluations[name]
        evaluate()
        return result
