"""The nonlinear force of a system and its exact derivatives, compiled: what all analyses of the force build on."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.core.kept import built_once
from hbnlp.core.types import Array, BoolArray, IntArray
from hbnlp.systems.slopes import slope_along


class CompiledForce:
    """f(q, q', tau; p) and its derivatives as CasADi functions, each compiled when first asked for.

    The entries of f_q and f_v that may differ from zero stand in one column, those of f_q first.

    Parameters
    ----------
    force, q, v, tau, p : casadi.SX
        The expression of f (n,) and its symbols.

    """

    def __init__(self, force: ca.SX, q: ca.SX, v: ca.SX, tau: ca.SX, p: ca.SX) -> None:
        self._force = ca.densify(force)
        self._q, self._v, self._p = q, v, p
        self._arguments = [q, v, tau, p]

    @built_once
    def value(self) -> ca.Function:
        """CasADi function (q, q', tau, p) -> f."""
        return ca.Function("force", self._arguments, [self._force])

    @built_once
    def derivatives(self) -> ca.Function:
        """CasADi function (q, q', tau, p) -> the entries of f_q and f_v."""
        return ca.Function("force_derivatives", self._arguments, [self._entries])

    @built_once
    def along(self) -> ca.Function:
        """CasADi function (q, q', tau, p, dq, dq', dp) -> the derivative of f along (dq, dq', dp)."""
        return self._along("force_along", self._force)

    @built_once
    def derivatives_along(self) -> ca.Function:
        """CasADi function (q, q', tau, p, dq, dq', dp) -> the derivative of the entries of f_q and f_v."""
        return self._along("force_derivatives_along", self._entries)

    @built_once
    def places_q(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the entries of f_q, column by column."""
        return _places(self._tangents[0])

    @built_once
    def places_v(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the entries of f_v, column by column."""
        return _places(self._tangents[1])

    @built_once
    def depends_on(self) -> BoolArray:
        """Whether f itself depends on each of the parameters (through q' it depends on omega besides)."""
        return np.array([ca.depends_on(self._force, self._p[i]) for i in range(self._p.numel())], dtype=bool)

    def tangents(self, q: Array, v: Array, tau: float, values: Array) -> tuple[Array, Array]:
        """Return f_q and f_v as numbers, (n, n) each."""
        entries = self.derivatives(q, v, tau, values).full().ravel()
        by_q, by_v = np.zeros((2, self._q.numel(), self._q.numel()))
        split = self.places_q[0].size
        by_q[self.places_q], by_v[self.places_v] = entries[:split], entries[split:]
        return by_q, by_v

    @built_once
    def _tangents(self) -> tuple[ca.SX, ca.SX]:
        return ca.jacobian(self._force, self._q), ca.jacobian(self._force, self._v)

    @built_once
    def _entries(self) -> ca.SX:
        nonzeros = [entry for matrix in self._tangents for entry in matrix.nonzeros()]
        return ca.cse(ca.vertcat(*nonzeros)) if nonzeros else ca.SX(0, 1)

    def _along(self, name: str, expression: ca.SX) -> ca.Function:
        dq, dv, dp = (ca.SX.sym("d", symbols.numel()) for symbols in (self._q, self._v, self._p))
        slope = slope_along(expression, self._p, dp, ca.vertcat(self._q, self._v), ca.vertcat(dq, dv))
        return ca.Function(name, [*self._arguments, dq, dv, dp], [slope])


def _places(matrix: ca.SX) -> tuple[IntArray, IntArray]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=int), np.array(columns, dtype=int)
