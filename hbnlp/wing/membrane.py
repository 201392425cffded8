"""Linear, quasi-linear and nonlinear membranes with pinned ends, in sine modes.

The displacement is ``w(x, t) = sum_k W_k(t) sin(k pi x)`` and the equation
``2 mu w_tt - c_T w_xx (1 + w_x^2)^(-3/2) = dCp`` [1]_, taken with the test functions ``2 sin(k pi x)``. As
``w_xx (1 + w_x^2)^(-3/2)`` is the derivative of ``w_x (1 + w_x^2)^(-1/2)``, one integration by parts leaves, for every
model::

    2 mu W_k'' + 2 c_T d(delta)/dW_k = dCp_k,      c_T = 2 Eh (delta0 + delta)

with the elongation ``delta = int sqrt(1 + w_x^2) dx - 1`` (nonlinear) or ``pi^2/4 sum m^2 W_m^2`` (quasi-linear); the
linear membrane keeps ``c_T0 = 2 Eh delta0``. A model is a strain (`hbnlp.wing.strain`) with a law of tension
(`hbnlp.wing.tension`).

References
----------
.. [1] G. Nardini, S. J. Illingworth, R. D. Sandberg, "Linear and nonlinear lift frequency response of a pitching
   membrane wing at low Reynolds numbers".
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Self, final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import real_number, whole_number
from hbnlp.core.kept import built_once
from hbnlp.core.sending import FieldsAlone
from hbnlp.core.types import Array
from hbnlp.wing.strain import ExactArc, SmallSlopes, Strain
from hbnlp.wing.tension import ConstantTension, ElasticTension, MembraneProperties, TensionLaw

LETTERS = {"mu": "mass_ratio", "Eh": "stiffness", "delta0": "prestrain", "N": "n_modes"}
"""Letters of the equations, and the arguments that they stand for."""


@dataclass(frozen=True, kw_only=True)
class Membrane(FieldsAlone, ABC):
    """A membrane with pinned ends in sine modes; everything nondimensional (chord, stream velocity, density).

    Its laws take ``W``, the modal amplitudes: CasADi expressions (N, 1), or an array (N,) or (N, n_times); and ``p``,
    anything with the attributes ``mass_ratio``, ``stiffness`` and ``prestrain`` (numbers or symbols), by default the
    membrane itself.

    Parameters
    ----------
    mass_ratio : float
        mu = rho_s h / (rho c), not negative.
    stiffness : float
        Eh = E_s h / (rho U^2 c), positive.
    prestrain : float
        delta0, not negative; the tension at rest is c_T0 = 2 Eh delta0.
    n_modes : int
        Number N of sine modes.

    Raises
    ------
    ValueError, TypeError
        If a value is not of that kind.
    """

    mass_ratio: float = 0.5
    stiffness: float = 250.0
    prestrain: float = 0.002
    n_modes: int = 10

    _law: ClassVar[TensionLaw]

    @property
    @abstractmethod
    def _strain(self) -> Strain:
        """The elongation as a function of the shape."""

    def __new__(cls, **given: Any) -> Self:
        """Name the words of the letters in the equations, which are no arguments."""
        for letter in LETTERS.keys() & given.keys():
            raise TypeError(f"{cls.__name__}() has no argument {letter!r}; it is called {LETTERS[letter]!r}")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        checked = {
            "mass_ratio": real_number("mass_ratio", self.mass_ratio, least=0.0),
            "stiffness": real_number("stiffness", self.stiffness, above=0.0),
            "prestrain": real_number("prestrain", self.prestrain, least=0.0),
            "n_modes": whole_number("n_modes", self.n_modes, least=1, most=1000),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @built_once
    def wave_numbers(self) -> Array:
        """Wave numbers k pi of the modes, k = 1..N, (N,)."""
        return np.pi * np.arange(1.0, self.n_modes + 1)

    # -- kinematics -------------------------------------------------------------------------------------------------

    def shape(self, x: ArrayLike) -> Array:
        """Return the modes sin(k pi x) at ``x`` (0 leading, 1 trailing edge), (len(x), N)."""
        return np.asarray(np.sin(np.multiply.outer(np.asarray(x, dtype=float), self.wave_numbers)))

    def displacement(self, W: ArrayLike, x: ArrayLike) -> Array:
        """Return w at ``x``, (len(x), ...), of amplitudes (N, ...)."""
        return np.asarray(self.shape(x) @ np.asarray(W, dtype=float))

    def camber(self, W: ArrayLike) -> Array:
        """Return the largest ``|w|`` along the chord, (...), of amplitudes (N, ...), to some 1e-8 of it."""
        amplitudes = np.asarray(W, dtype=float)
        columns = amplitudes.reshape(self.n_modes, -1)
        n_intervals = 16 * self.n_modes
        k = self.wave_numbers
        heights = np.abs(self.displacement(columns, np.linspace(0.0, 1.0, n_intervals + 1)))
        highest = heights.max(axis=0)
        # by Bernstein's inequality a node beside the highest point is at most (pi / 32)^2 / 2, half a percent, below it
        node, column = np.nonzero(heights >= 0.99 * highest)
        x, shapes = node / n_intervals, columns.T[column]
        for _ in range(3):
            phase = np.multiply.outer(x, k)
            slope = np.sum(k * np.cos(phase) * shapes, axis=1)
            curvature = -np.sum(k**2 * np.sin(phase) * shapes, axis=1)
            step = np.divide(-slope, curvature, out=np.zeros_like(x), where=curvature != 0.0)
            x = np.clip(x + np.clip(step, -1.0 / n_intervals, 1.0 / n_intervals), 0.0, 1.0)
        np.maximum.at(highest, column, np.abs(np.sum(self.shape(x) * shapes, axis=1)))
        return np.asarray(highest.reshape(amplitudes.shape[1:]))

    def elongation(self, W: Any) -> Any:
        """Return delta, the strain by which the displaced membrane is longer than the chord."""
        return self._strain.elongation(W)

    # -- laws -------------------------------------------------------------------------------------------------------

    def tension(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return c_T of the membrane's law at the elongation of this shape."""
        return self._law.tension(self.elongation(W), self if p is None else p)

    def restoring_force(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return 2 c_T d(delta)/dW_k, the loads dCp_k that hold the membrane in this shape, of the shape of W."""
        return 2.0 * self.tension(W, p) * self._strain.gradient(W)

    def tangent_stiffness(self, W: ArrayLike, p: MembraneProperties | None = None) -> Array:
        """Return the restoring force's derivative at the shape ``W``, (N, N), of an array (N,) only."""
        p = self if p is None else p
        amplitudes = np.asarray(W, dtype=float)
        gradient = self._strain.gradient(amplitudes)
        stretching = self._law.rate(p) * np.outer(gradient, gradient)
        return np.asarray(2.0 * (stretching + self.tension(amplitudes, p) * self._strain.curvature(amplitudes)))

    def energy(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return the potential of the restoring force, 2 Eh delta0^2 at rest, beside mu sum W_k'^2 of the motion."""
        return self._law.energy(self.elongation(W), self if p is None else p)

    def mass_matrix(self, p: MembraneProperties | None = None) -> Any:
        """Return 2 mu I, (N, N)."""
        p = self if p is None else p
        return 2.0 * p.mass_ratio * ca.DM.eye(self.n_modes)

    def stiffness_matrix(self, p: MembraneProperties | None = None) -> Any:
        """Return k^2 pi^2 c_T0 on the diagonal, (N, N), the restoring force's derivative at W = 0."""
        return self._law.at_rest(self if p is None else p) * ca.diag(ca.DM(self.wave_numbers**2))

    def nonlinear_force(self, W: Any, p: MembraneProperties | None = None) -> Any:
        """Return the restoring force less that of `stiffness_matrix`, of the shape of W.

        It is what strain adds to the tension and what large slopes add to the shape. The linear membrane has neither:
        it returns zeros, exact also as expressions.
        """
        p = self if p is None else p
        delta = self.elongation(W)
        by_tension = self._law.rise(delta, p) * self._strain.linear_gradient(W)
        return 2.0 * (by_tension + self._law.tension(delta, p) * self._strain.gradient_of_slopes(W))


@final
@dataclass(frozen=True, kw_only=True)
class LinearMembrane(Membrane):
    """The membrane of constant tension: ``2 mu W_k'' + k^2 pi^2 c_T0 W_k = dCp_k``.

    Its elongation is the quasi-linear one, of which its tension takes no notice.

    Parameters
    ----------
    mass_ratio, stiffness, prestrain : float
        mu = rho_s h / (rho c), Eh = E_s h / (rho U^2 c) and delta0; the tension at rest is c_T0 = 2 Eh delta0.
    n_modes : int
        Number N of sine modes.
    """

    _law: ClassVar[TensionLaw] = ConstantTension()

    @built_once
    def _strain(self) -> Strain:
        return SmallSlopes(self.wave_numbers)


@final
@dataclass(frozen=True, kw_only=True)
class QuasiLinearMembrane(Membrane):
    """The membrane whose tension grows with the square of small slopes: ``2 mu W_k'' + k^2 pi^2 c_T W_k = dCp_k``.

    Its force is a cubic polynomial. It differs from the nonlinear membrane's at a relative order of slope^2.

    Parameters
    ----------
    mass_ratio, stiffness, prestrain : float
        mu = rho_s h / (rho c), Eh = E_s h / (rho U^2 c) and delta0; the tension at rest is c_T0 = 2 Eh delta0.
    n_modes : int
        Number N of sine modes.
    """

    _law: ClassVar[TensionLaw] = ElasticTension()

    @built_once
    def _strain(self) -> Strain:
        return SmallSlopes(self.wave_numbers)


@final
@dataclass(frozen=True, kw_only=True)
class NonlinearMembrane(Membrane):
    """The membrane of exact arc length and curvature: ``2 mu w_tt - c_T w_xx (1 + w_x^2)^(-3/2) = dCp``.

    The integrals along the chord are midpoint sums. The integrands are even about both ends, so that the sums converge
    exponentially in the number of nodes, the faster the smaller the slopes. The default, ``4 N + 8`` and at least 32,
    leaves an error of 1e-12 of the force where amplitudes fall as k^-3 (those of a smooth load) up to slopes of 1, and
    of 1e-7 where they fall as k^-2.

    Ten modes against the exact circular arc of a uniform pressure: the tension is off by 4e-5 of it at a camber of 3 %,
    by 3e-4 at 17 %; both errors fall as N^-3, as the arc's curvature does not vanish at the ends and that of a sine
    series does.

    Parameters
    ----------
    mass_ratio, stiffness, prestrain : float
        mu = rho_s h / (rho c), Eh = E_s h / (rho U^2 c) and delta0; the tension at rest is c_T0 = 2 Eh delta0.
    n_modes : int
        Number N of sine modes.
    n_nodes : int or None
        Number of nodes, more than ``n_modes``; None is the default above.
    """

    n_nodes: int | None = None

    _law: ClassVar[TensionLaw] = ElasticTension()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.n_nodes is not None:
            advice = f", more than the {self.n_modes} modes, or None for the default"
            n_nodes = whole_number("n_nodes", self.n_nodes, least=self.n_modes + 1, most=100_000, advice=advice)
            object.__setattr__(self, "n_nodes", n_nodes)

    @built_once
    def _strain(self) -> Strain:
        return ExactArc(self.wave_numbers, max(32, 4 * self.n_modes + 8) if self.n_nodes is None else self.n_nodes)
