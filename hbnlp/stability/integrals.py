"""Integrals of exponentials times the polynomials of a Gauss interval, and the polynomials that measure its defect."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from hbnlp.core.types import Array, ComplexArray
from hbnlp.stability.collocation import Gauss

_BY_PARTS = 20.0  # beyond this product of eigenvalue and length, integrals are summed by parts
_QUADRATURE = 32
_DEFECTS = 3  # measured: with the two ends alone the defect's middle terms are missed, and four see no more


@dataclass(frozen=True)
class Polynomials:
    """The polynomials of an interval [0, 1] of m Gauss nodes.

    The first m are Lagrange's of the nodes, through which a function is interpolated. What it leaves out vanishes at
    the nodes: P_m times Lagrange's polynomials of three other places, both ends and an extremum of P_m between them.

    Attributes
    ----------
    defects : (3,)
        These places.
    places : (m + 3,)
        Nodes, then the places of the defect; the last one is 1.
    at_defects : (3, m)
        The first m polynomials at the places of the defect.
    """

    defects: Array
    places: Array
    at_defects: Array
    _values: Array  # at points of quadrature below each place: (m + 3, points, m + 3)
    _derivatives: Array  # of each order at 0 and at each place: (orders, m + 4, m + 3)
    _sigma: Array
    _weights: Array

    @staticmethod
    @lru_cache(maxsize=16)
    def of(nodes: int) -> Polynomials:
        """Return those of a number of Gauss nodes."""
        c = Gauss.of(nodes).c
        last = np.eye(nodes + 1)[nodes]
        extrema = legendre.legroots(legendre.legder(last)) if nodes > 1 else np.array([0.5])
        x = np.array([-1.0, extrema[np.argmin(np.abs(extrema))], 1.0])
        coefficients = np.zeros((nodes + _DEFECTS, nodes + _DEFECTS))
        coefficients[:nodes, :nodes] = np.linalg.inv(legendre.legvander(2.0 * c - 1.0, nodes - 1))
        between = np.linalg.inv(legendre.legvander(x, _DEFECTS - 1)) / legendre.legval(x, last)
        for i in range(_DEFECTS):
            of_defect = legendre.legmul(last, between[:, i])
            coefficients[: len(of_defect), nodes + i] = of_defect
        defects = (x + 1.0) / 2.0
        places = np.concatenate([c, defects])
        points, weights = legendre.leggauss(_QUADRATURE)
        sigma = (points + 1.0) / 2.0
        values = legendre.legval(2.0 * np.multiply.outer(places, sigma) - 1.0, coefficients).transpose(1, 2, 0)
        at = 2.0 * np.append(0.0, places) - 1.0
        orders = range(nodes + _DEFECTS)
        derivatives = np.array([legendre.legval(at, legendre.legder(coefficients, d, scl=2.0)).T for d in orders])
        at_defects = legendre.legval(x, coefficients[:, :nodes]).T
        return Polynomials(defects, places, at_defects, np.ascontiguousarray(values), derivatives, sigma, weights / 2.0)

    def integrals(self, z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return exp(z c) and the integrals over s from 0 to c of exp(z (c - s)) p(s), for c at all places.

        (n, m + 3) and, with the m + 3 polynomials p as last index, (n, m + 3, m + 3).
        """
        growth = np.exp(np.multiply.outer(z, self.places))
        integrals = np.empty((len(z), len(self.places), len(self.places)), dtype=complex)
        small = np.abs(z) <= _BY_PARTS
        below = self.places[:, None] * (1.0 - self._sigma)
        kernel = np.exp(np.multiply.outer(z[small], below)) * (self.places[:, None] * self._weights)
        integrals[small] = (kernel.transpose(1, 0, 2) @ self._values).transpose(1, 0, 2)
        large = z[~small]
        powers = large[:, None] ** -(1.0 + np.arange(len(self.places)))
        at_start = powers @ self._derivatives[:, 0]
        at_ends = np.tensordot(powers, self._derivatives[:, 1:], 1)
        integrals[~small] = growth[~small][:, :, None] * at_start[:, None, :] - at_ends
        return growth, integrals
