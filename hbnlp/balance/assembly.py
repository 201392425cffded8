"""Fast numbers for the harmonic-balance residual: the equations of `balance`, assembled harmonic by harmonic in numpy.

Automatic differentiation through the whole alternating frequency/time residual wastes most of its time. Here CasADi
differentiates the force at one sample, exactly; the compiled derivative is mapped over the samples, and constant
matrices project it onto the harmonics. The linear part comes from `linear_balance`.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from hbnlp.balance.linear_terms import LinearBalance
from hbnlp.core.types import Array
from hbnlp.fourier import FourierBasis, n_coefficients
from hbnlp.systems.system import System

LARGEST_EXPANSION = 50_000
"""Instructions up to which all samples are written out as one function: calls cost more than arithmetic there."""


class MappedFunction:
    """A CasADi function evaluated at many samples at once, on numpy memory and without copies.

    Fill the ``inputs``, arrays (n_samples, size), and call: the result is a list of arrays (n_samples, size),
    overwritten by the next call.
    """

    def __init__(self, function: ca.Function, inputs: list[Array]) -> None:
        n_samples = inputs[0].shape[0]
        self._mapped = function.map(n_samples)
        if function.n_instructions() * n_samples <= LARGEST_EXPANSION:
            self._mapped = self._mapped.expand()
        self._inputs = inputs
        self._outputs = [np.zeros((n_samples, function.nnz_out(i))) for i in range(function.n_out())]
        self._buffer, self._run = self._mapped.buffer()
        for i, array in enumerate(self._inputs):
            self._buffer.set_arg(i, _memory(array))
        for i, array in enumerate(self._outputs):
            self._buffer.set_res(i, _memory(array))

    def __call__(self) -> list[Array]:
        """Return the results for the present inputs."""
        self._run()
        return self._outputs


class SampledForce:
    """The force and its exact derivatives at all samples, as ``g(q, r) = f(q, omega r / periods)`` with r = dq/dtheta.

    With r for the velocity, all dependence on omega is a dependence on the parameters.
    """

    def __init__(self, system: System, basis: FourierBasis, periods: int) -> None:
        self._basis = basis
        q, p, tau = system.q, system.p, system.tau
        r, dq, dr = (ca.SX.sym(name, system.n_dof) for name in ("r", "dq", "dr"))
        dp = ca.SX.sym("dp", p.numel())
        g = ca.substitute(system.force, system.v, p[system.parameters.index("omega")] / periods * r)
        by_q, by_r = ca.jacobian(g, q), ca.jacobian(g, r)
        self.places_q, self.places_r = (
            tuple(np.array(k, dtype=int) for k in e.sparsity().get_triplet()) for e in (by_q, by_r)
        )
        self.depends_on = np.array([ca.depends_on(g, p[i]) for i in range(p.numel())], dtype=bool)
        entries = [_entries(by_q), _entries(by_r)]
        point, direction = ca.vertcat(q, r, p), ca.vertcat(dq, dr, dp)
        self._functions = {
            "value": ([q, r, tau, p], [g]),
            "jacobian": ([q, r, tau, p], [g, *entries]),
            "along": ([q, r, tau, p, dq, dr, dp], [ca.jtimes(g, point, direction)]),
            "jacobian_along": ([q, r, tau, p, dq, dr, dp], [ca.jtimes(e, point, direction) for e in entries]),
        }
        n = basis.n_samples
        self._phases = np.vstack([basis.sampling, basis.derivative_sampling])
        self._state, self._direction = np.zeros((2 * n, system.n_dof)), np.zeros((2 * n, system.n_dof))
        self._p, self._dp = np.zeros((n, p.numel())), np.zeros((n, p.numel()))
        tau_samples = (periods * basis.theta)[:, None].copy()
        self._inputs = [self._state[:n], self._state[n:], tau_samples, self._p]
        self._inputs += [self._direction[:n], self._direction[n:], self._dp]
        self._compiled: dict[str, MappedFunction] = {}

    def __call__(self, name: str, coefficients: Array, values: Array) -> list[Array]:
        """Return what the named function gives at all samples: arrays (n_samples, size), overwritten by its next call.

        Names: "value" (force), "jacobian" (force, nonzeros by q, nonzeros by r), and "along", "jacobian_along"
        (derivatives of force and of those nonzeros along the direction that was set).
        """
        np.matmul(self._phases, coefficients.T, out=self._state)
        self._p[:] = values
        if name not in self._compiled:
            arguments, results = self._functions[name]
            function = ca.Function(name, arguments, [ca.densify(e) for e in results])
            self._compiled[name] = MappedFunction(function, self._inputs[: len(arguments)])
        return self._compiled[name]()

    def set_direction(self, coefficients: Array | None, index: int | None) -> None:
        """Set the direction of the derivatives: coefficients (n, L) or none, and the parameter or none."""
        if coefficients is None:
            self._direction[:] = 0.0
        else:
            np.matmul(self._phases, coefficients.T, out=self._direction)
        self._dp[:] = 0.0
        if index is not None:
            self._dp[:, index] = 1.0


class Assembly:
    """Residual, Jacobian and their derivatives as numpy arrays, for one system, harmonic count and sample count.

    Vectors of unknowns ``x`` have ``n L`` entries, L = 2H + 1, ordered as the array of coefficients (n, L); ``values``
    are the parameters in the system's order. Arrays returned belong to the caller.
    """

    def __init__(self, system: System, basis: FourierBasis, periods: int) -> None:
        self.linear = LinearBalance(system, basis.n_harmonics, periods)
        self.force = SampledForce(system, basis, periods) if system.is_nonlinear else None
        self._projection = basis.projection
        self._basis = basis
        self._shape = (system.n_dof, n_coefficients(basis.n_harmonics))
        self.size = self._shape[0] * self._shape[1]

    def residual(self, x: Array, values: Array, load: float = 1.0) -> Array:
        """Return R (n L,); ``load`` scales the excitation (homotopy from rest)."""
        coefficients = x.reshape(self._shape)
        result = self.linear.residual(coefficients, values, load)
        if self.force:
            result += (self._projection @ self.force("value", coefficients, values)[0]).T
        return result.reshape(-1)

    def jacobian(self, x: Array, values: Array, out: Array | None = None) -> Array:
        """Return dR/dx, (n L, n L), or add it to ``out``."""
        out = np.zeros((self.size, self.size)) if out is None else out
        self.linear.add_jacobian(out, values)
        if self.force:
            _, by_q, by_r = self.force("jacobian", x.reshape(self._shape), values)
            self._add_force(out, by_q, by_r)
        return out

    def parameter_derivative(self, x: Array, values: Array, index: int, load: float = 1.0) -> Array:
        """Return dR/dp_index, (n L,)."""
        coefficients = x.reshape(self._shape)
        result = self.linear.residual_slope(coefficients, values, index, load)
        if self.force and self.force.depends_on[index]:
            self.force.set_direction(None, index)
            result += (self._projection @ self.force("along", coefficients, values)[0]).T
        return result.reshape(-1)

    def load_derivative(self, values: Array) -> Array:
        """Return dR/dload, (n L,)."""
        return -self.linear.excitation(values).ravel()

    def jacobian_along(self, x: Array, values: Array, dx: Array | None, index: int | None = None) -> Array:
        """Return the derivative of dR/dx along ``dx`` plus that by parameter ``index``, (n L, n L)."""
        out = np.zeros((self.size, self.size))
        if index is not None:
            self.linear.add_jacobian_slope(out, values, index)
        if self.force:
            self.force.set_direction(None if dx is None else dx.reshape(self._shape), index)
            by_q, by_r = self.force("jacobian_along", x.reshape(self._shape), values)
            self._add_force(out, by_q, by_r)
        return out

    def term_size(self, x: Array, values: Array) -> float:
        """Return the size of the terms that R balances: the largest entry of its linear terms and excitation."""
        return self.linear.term_size(x.reshape(self._shape), values)

    @cached_property
    def _products(self) -> tuple[Array, Array]:
        """Constant maps (n_samples, L * L) from samples of a derivative to its block of the Jacobian."""
        projection = self._basis.projection.T[:, :, None]
        size = self._shape[1] ** 2
        return (
            (projection * self._basis.sampling[:, None, :]).reshape(-1, size),
            (projection * self._basis.derivative_sampling[:, None, :]).reshape(-1, size),
        )

    def _add_force(self, out: Array, by_q: Array, by_r: Array) -> None:
        force, size = self.force, self._shape[1]
        assert force is not None
        matrix = out.view()
        matrix.shape = (*self._shape, *self._shape)  # unlike reshape, this never copies
        for samples, products, (rows, columns) in (
            (by_q, self._products[0], force.places_q),
            (by_r, self._products[1], force.places_r),
        ):
            if rows.size == self._shape[0] ** 2:
                # entries come column by column: (column, row, L, L) to (row, L, column, L)
                blocks = (samples.T @ products).reshape(self._shape[0], self._shape[0], size, size)
                matrix += blocks.transpose(1, 2, 0, 3)
            elif rows.size:
                matrix[rows, :, columns, :] += (samples.T @ products).reshape(-1, size, size)


def _entries(matrix: ca.SX) -> ca.SX:
    return ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)


def _memory(array: Array) -> Any:
    """Return the memory of an array as CasADi's buffers want it."""
    return memoryview(array.reshape(-1))  # type: ignore[arg-type]
