"""Laws of a membrane's tension: what it makes of its strain ``delta``.

A law is its energy ``V(delta)``; the tension is half of its derivative, ``c_T = V'(delta) / 2``, so that the load which
holds a shape, ``2 c_T d(delta)/dW_k``, is the gradient of the energy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Protocol, final


class MembraneProperties(Protocol):
    """What a membrane's laws need: numbers, or symbols of the same names."""

    @property
    def mass_ratio(self) -> Any:
        """The symbol or value of mu."""

    @property
    def stiffness(self) -> Any:
        """The symbol or value of Eh."""

    @property
    def prestrain(self) -> Any:
        """The symbol or value of delta0."""


class TensionLaw(ABC):
    """Tension by strain, from ``c_T0 = 2 Eh delta0`` at rest."""

    @abstractmethod
    def rise(self, delta: Any, p: MembraneProperties) -> Any:
        """Return c_T - c_T0, of the shape of ``delta``."""

    @abstractmethod
    def rate(self, p: MembraneProperties) -> Any:
        """Return d(c_T)/d(delta), a constant: both laws are straight lines."""

    @abstractmethod
    def energy(self, delta: Any, p: MembraneProperties) -> Any:
        """Return the energy, of the shape of ``delta``; at rest 2 Eh delta0^2."""

    def at_rest(self, p: MembraneProperties) -> Any:
        """Return c_T0 = 2 Eh delta0."""
        return 2.0 * p.stiffness * p.prestrain

    def tension(self, delta: Any, p: MembraneProperties) -> Any:
        """Return c_T, of the shape of ``delta``."""
        return self.at_rest(p) + self.rise(delta, p)


@final
class ConstantTension(TensionLaw):
    """``c_T = c_T0``, whatever the strain."""

    def rise(self, delta: Any, p: MembraneProperties) -> Any:  # noqa: ARG002
        """Return zeros, exact also as expressions."""
        return 0.0 * delta

    def rate(self, p: MembraneProperties) -> Any:  # noqa: ARG002
        """Return zero."""
        return 0.0

    def energy(self, delta: Any, p: MembraneProperties) -> Any:
        """Return 2 Eh delta0 (delta0 + 2 delta)."""
        return 2.0 * p.stiffness * p.prestrain * (p.prestrain + 2.0 * delta)


@final
class ElasticTension(TensionLaw):
    """Hooke's law, ``c_T = 2 Eh (delta0 + delta)``."""

    def rise(self, delta: Any, p: MembraneProperties) -> Any:
        """Return 2 Eh delta."""
        return 2.0 * p.stiffness * delta

    def rate(self, p: MembraneProperties) -> Any:
        """Return 2 Eh."""
        return 2.0 * p.stiffness

    def energy(self, delta: Any, p: MembraneProperties) -> Any:
        """Return 2 Eh (delta0 + delta)^2."""
        return 2.0 * p.stiffness * (p.prestrain + delta) ** 2
