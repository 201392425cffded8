"""What the linear terms of a balance take from the system: its matrices, forcing and motion at parameter values."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from hbnlp.balance.pattern import Pattern
from hbnlp.balance.sampling import Sampling
from hbnlp.core.kept import built_once
from hbnlp.core.types import Array
from hbnlp.systems.lags import Lags
from hbnlp.systems.signals import excitation_signals
from hbnlp.systems.slopes import slope_along
from hbnlp.systems.system import System


class Laws(NamedTuple):
    """All that depends on the parameters alone, or its derivative by one of them."""

    mass: Array
    damping: Array
    stiffness: Array
    lag_output: Array
    input_stiffness: Array
    input_damping: Array
    input_mass: Array
    forcing: Array  # coefficients (n, L)
    motion: Array  # coefficients (n_u, L)


class CompiledLaws:
    """The laws of a system as compiled functions of its parameters, and the harmonics of forcing and motion."""

    def __init__(self, system: System, sampling: Sampling) -> None:
        self._system = system
        self._sampling = sampling
        self._signals = excitation_signals(system)
        self._expressions = [system.mass, system.damping, system.stiffness, system.lag_output]
        self._expressions += [system.input_stiffness, system.input_damping, system.input_mass]
        everything = [*self._expressions, system.forcing, system.motion]
        omega = system.parameters.index("omega")
        self.followed = np.arange(len(system.parameters.names)) != omega
        """Which parameters the laws are taken to depend on: all but omega, on which they seldom do."""
        self.followed[omega] = any(ca.depends_on(e, system.p[omega]) for e in everything)

    def at(self, values: Array) -> Laws:
        """Return the laws at parameter values."""
        own = self._sampling.n_harmonics_of_excitation
        matrices = [e.full() for e in self._system.matrices(values)]
        signals = [self._sampling.over_periods(each.coefficients(values, own)) for each in self._signals]
        return Laws._make([*matrices, *signals])

    def slope(self, values: Array, index: int) -> Laws:
        """Return their derivatives by one parameter."""
        own = self._sampling.n_harmonics_of_excitation
        unit = (np.arange(values.size) == index).astype(float)
        matrices = [e.full() for e in self._matrix_slopes(values, unit)]
        signals = [self._sampling.over_periods(each.slope(values, index, own)) for each in self._signals]
        return Laws._make([*matrices, *signals])

    @built_once
    def _matrix_slopes(self) -> ca.Function:
        p, direction = self._system.p, ca.SX.sym("direction", self._system.p.numel())

        def along(expression: ca.SX) -> ca.SX:
            return ca.reshape(slope_along(ca.vec(ca.densify(expression)), p, direction), *expression.shape)

        return ca.Function("matrices_along", [p, direction], [along(e) for e in self._expressions])


class LawsAt:
    """The laws at one point of the parameters that they depend on, and what follows from them alone.

    Nothing of it changes: what is kept is computed when first asked for.
    """

    def __init__(self, compiled: CompiledLaws, lags: Lags, values: Array) -> None:
        self._compiled, self._values = compiled, values.copy()
        self.key = values[compiled.followed].tobytes()
        self.laws = compiled.at(values)
        self.residues = lags.residues(self.laws.lag_output)
        self._has_lags = bool(lags.n_lags)
        self._slopes: dict[int, Laws] = {}

    def slope(self, index: int) -> Laws:
        """Return the derivatives of the laws by one parameter."""
        if index not in self._slopes:
            self._slopes[index] = self._compiled.slope(self._values, index)
        return self._slopes[index]

    @built_once
    def pattern(self) -> Pattern:
        """Where the linear terms are not zero."""
        law = self.laws
        every = np.full(law.mass.shape, self._has_lags)
        used = every | (law.stiffness != 0.0) | (law.damping != 0.0) | (law.mass != 0.0)
        return Pattern(used, (law.forcing.shape[1] - 1) // 2)
