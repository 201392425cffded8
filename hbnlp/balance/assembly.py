"""Fast numbers for the harmonic-balance residual: the equations of `problem`, assembled harmonic by harmonic in numpy.

Automatic differentiation through the whole alternating frequency/time residual wastes most of its time. Here CasADi
differentiates the force at one sample, exactly; the compiled derivative is mapped over the samples, and what it does
to the harmonics comes from `multiplication`. The linear part comes from `linear_terms`.
"""

from __future__ import annotations

import numpy as np

from hbnlp.balance.linear_terms import LinearBalance
from hbnlp.balance.multiplication import Multiplication
from hbnlp.balance.sampled_force import SampledForce
from hbnlp.balance.sampling import Sampling
from hbnlp.core.types import Array
from hbnlp.fourier import FourierBasis, n_coefficients
from hbnlp.systems.system import System


class Terms:
    """Residual and its derivatives by parameters as numpy arrays, the force seen at the samples of a basis.

    Vectors of unknowns ``x`` have ``n L`` entries, L = 2H + 1, ordered as the array of coefficients (n, L); ``values``
    are the parameters in the system's order. Arrays returned belong to the caller.
    """

    def __init__(self, system: System, sampling: Sampling, basis: FourierBasis, linear: LinearBalance) -> None:
        self.linear = linear
        self.force = SampledForce(system, basis, sampling.periods) if system.is_nonlinear else None
        self._basis = basis
        self._places = system.compiled_force.places_q, system.compiled_force.places_v
        self._shape = (system.n_dof, n_coefficients(sampling.n_harmonics))
        self.size = self._shape[0] * self._shape[1]

    def residual(self, x: Array, values: Array, load: float = 1.0) -> Array:
        """Return R (n L,); ``load`` scales the excitation (homotopy from rest)."""
        coefficients = x.reshape(self._shape)
        result = self.linear.residual(coefficients, values, load)
        if self.force:
            result += self._basis.projected(self.force.value(coefficients, values).T)
        return result.reshape(-1)

    def parameter_derivative(self, x: Array, values: Array, index: int, load: float = 1.0) -> Array:
        """Return dR/dp_index, (n L,)."""
        coefficients = x.reshape(self._shape)
        result = self.linear.residual_slope(coefficients, values, index, load)
        if self.force and self.force.depends_on(index):
            result += self._basis.projected(self.force.along(coefficients, values, index).T)
        return result.reshape(-1)

    def load_derivative(self, values: Array) -> Array:
        """Return dR/dload, (n L,)."""
        return -self.linear.excitation(values).ravel()

    def mean_derivatives(self, x: Array, values: Array) -> tuple[Array, Array]:
        """Return the means over the period of the force's derivatives by displacements and their slopes, (n, n)."""
        n = self._shape[0]
        means = np.zeros((2, n, n))
        if self.force:
            derivatives = self.force.derivatives(x.reshape(self._shape), values)
            for mean, places, samples in zip(means, self._places, derivatives, strict=True):
                mean[places] = samples.mean(axis=0)
        return means[0], means[1]

    def term_size(self, x: Array, values: Array) -> float:
        """Return the size of the terms that R balances: the largest entry of its linear terms and excitation."""
        return self.linear.term_size(x.reshape(self._shape), values)


class Assembly(Terms):
    """Residual, Jacobian and their derivatives, for one system, harmonic count and sample count."""

    def __init__(self, system: System, sampling: Sampling) -> None:
        super().__init__(system, sampling, sampling.force, LinearBalance(system, sampling))
        self._by_q = Multiplication(self._basis, self._places[0])
        self._by_r = Multiplication(self._basis, self._places[1], derivative=True)

    def jacobian(self, x: Array, values: Array, out: Array | None = None) -> Array:
        """Return dR/dx, (n L, n L), or add it to ``out``."""
        out = np.zeros((self.size, self.size)) if out is None else out
        self.linear.add_jacobian(out, values)
        if self.force:
            self._add_force(out, *self.force.derivatives(x.reshape(self._shape), values))
        return out

    def jacobian_along(self, x: Array, values: Array, dx: Array | None, index: int | None = None) -> Array:
        """Return the derivative of dR/dx along ``dx`` plus that by parameter ``index``, (n L, n L)."""
        out = np.zeros((self.size, self.size))
        if index is not None:
            self.linear.add_jacobian_slope(out, values, index)
        if self.force:
            direction = None if dx is None else dx.reshape(self._shape)
            self._add_force(out, *self.force.derivatives_along(x.reshape(self._shape), values, direction, index))
        return out

    def _add_force(self, out: Array, by_q: Array, by_r: Array) -> None:
        matrix = out.view()
        matrix.shape = (*self._shape, *self._shape)  # unlike reshape, this never copies
        self._by_q.add(matrix, by_q)
        self._by_r.add(matrix, by_r)
