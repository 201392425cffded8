"""The phases at which signals of tau and the parameters switch, in numbers and as expressions of the parameters."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.core.kept import built_once
from hbnlp.core.types import Array
from hbnlp.systems.chunks import in_chunks, of_columns
from hbnlp.systems.quadrature import Breaks, Rule, find_breaks
from hbnlp.systems.switches import switches


class SwitchPoints:
    """Where an expression of the phase and the parameters is not smooth; ``what`` it is, for messages."""

    def __init__(self, what: str, expression: ca.SX, tau: ca.SX, p: ca.SX) -> None:
        self._what, self._tau, self._p = what, tau, p
        self._switches = ca.densify(switches(expression, lambda quantity: ca.jacobian(quantity, tau)))
        self.move = bool(ca.depends_on(self._switches, p))
        """Whether parameters move them."""

    def at(self, values: Array) -> Breaks:
        """Return where a period is to be cut at parameter values."""
        return self._found(values) if self.move else self._fixed

    def along(self, breaks: Breaks, values: Array, index: int) -> Array:
        """Return how fast the breaks move as a parameter grows."""
        by = np.zeros(breaks.phases.size)
        for k in np.flatnonzero(breaks.of >= 0) if self.move else ():
            by_tau, by_p = (e.full() for e in self._slopes(breaks.phases[k], values))
            row = breaks.of[k]
            if by_tau[row, 0]:
                by[k] = -by_p[row, index] / by_tau[row, 0]
        return by

    def moving(self, rule: Rule, p: ca.MX, n_harmonics: int) -> tuple[ca.MX, ca.MX]:
        """Return a rule's nodes (1, n) and projection (2H+1, n) between breaks that move with the parameters."""
        phases = ca.vertcat(*[self._symbolic(k, rule.breaks, p) for k in range(rule.breaks.phases.size)])
        ends = ca.vertcat(phases, phases[0] + 2.0 * np.pi)
        # a list of indices into a single entry gives a row, into several a column
        first, last = (ca.reshape(ends[(rule.piece + k).tolist()], -1, 1) for k in (0, 1))
        lengths = last - first
        nodes = (first + ca.DM(rule.inside) * lengths).T
        weights = lengths.T * ca.DM((rule.weights / rule.lengths)[None, :]) / np.pi
        rows = [0.5 * weights]
        for h in range(1, n_harmonics + 1):
            rows += [weights * ca.cos(h * nodes), weights * ca.sin(h * nodes)]
        return nodes, ca.vertcat(*rows)

    def _symbolic(self, k: int, breaks: Breaks, p: ca.MX) -> ca.MX:
        near, row = float(breaks.phases[k]), int(breaks.of[k])
        if row < 0 or not ca.depends_on(self._switches[row], self._p):
            return ca.MX(near)
        equation = {"x": self._tau, "p": self._p, "g": self._switches[row]}
        return ca.rootfinder(f"switch_{k}_of_{self._what.split()[0]}", "newton", equation)(x0=near, p=p)["x"]

    def _found(self, values: Array) -> Breaks:
        if not self._switches.numel():
            return find_breaks(lambda theta: np.zeros((0, theta.size)))
        return find_breaks(lambda theta: in_chunks(self._quantities, theta[None, :], values))

    @built_once
    def _fixed(self) -> Breaks:
        return self._found(np.zeros(self._p.numel()))

    @built_once
    def _quantities(self) -> ca.Function:
        return of_columns(ca.Function("switches", [self._tau, self._p], [self._switches]), [1])

    @built_once
    def _slopes(self) -> ca.Function:
        slopes = [ca.densify(ca.jacobian(self._switches, each)) for each in (self._tau, self._p)]
        return ca.Function("switch_slopes", [self._tau, self._p], slopes)
