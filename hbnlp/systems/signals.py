"""Fourier coefficients of a system's own signals, forcing and motion, at parameter values and as expressions of them.

Sums and products of sines and cosines have a highest harmonic, and equidistant samples are exact. All other signals are
put on panels between their switches (`quadrature`), anew at each parameter point, as their parameters may make them
steep; what they are wrong by is known, and an error where it is more than the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import casadi as ca
import numpy as np

from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import FourierBasis, basis_derivatives, n_coefficients
from hbnlp.systems.parameters import ParameterSet
from hbnlp.systems.quadrature import TOGETHER, Breaks, Resolved, Rule, find_breaks, resolve
from hbnlp.systems.spectrum import spectra
from hbnlp.systems.switches import switches
from hbnlp.systems.system import System

ALIASING_TOL = 1e-9
"""Nothing that is sampled may be wrong by more than this, relative to its size, for want of samples."""
CHUNK = TOGETHER
"""Phases at which a compiled signal is evaluated in one call."""


class PeriodicSignals:
    """Signals (k,) of the phase tau and the parameters, with their harmonics.

    Parameters
    ----------
    what : str
        For messages: "forcing".
    expression : casadi.SX
    tau, p : casadi.SX
        Its symbols.
    parameters : ParameterSet
        What p holds.

    Attributes
    ----------
    highest : int or None
        The highest harmonic; None where there is none that could be told.
    """

    def __init__(self, what: str, expression: ca.SX, tau: ca.SX, p: ca.SX, parameters: ParameterSet) -> None:
        self._what, self._parameters = what, parameters
        self._expression, self._tau, self._p = ca.densify(expression), tau, p
        self._value = ca.Function("signals", [tau, p], [self._expression])
        orders = [each.highest if each is not None else None for each in spectra(self._value, 0)[0]]
        known = [order for order in orders if order is not None]
        self.highest = max(known, default=0) if len(known) == len(orders) else None
        self._matters = np.array([ca.depends_on(self._expression, p[i]) for i in range(p.numel())], dtype=bool)
        self._latest: tuple[bytes, Resolved] | None = None

    def coefficients(self, values: Array, n_harmonics: int) -> Array:
        """Return the coefficients (k, 2H+1) at parameter values.

        Raises
        ------
        ValueError
            If the signals are not smooth enough between their switches.
        """
        if self.highest is not None:
            basis = self._equidistant(n_harmonics)
            return np.asarray(self._sampled(basis.theta, values) @ basis.projection.T)
        resolved = self._resolved(values, n_harmonics)
        return np.asarray(resolved.samples @ resolved.rule.projection(n_harmonics).T)

    def slope(self, values: Array, index: int, n_harmonics: int) -> Array:
        """Return the derivatives (k, 2H+1) of the coefficients by one parameter, which may move the switches, too."""
        direction = (np.arange(values.size) == index).astype(float)
        if self.highest is not None:
            basis = self._equidistant(n_harmonics)
            by_parameter = in_chunks(
                self._along, basis.theta[None, :], np.zeros((1, basis.n_samples)), values, direction
            )
            return np.asarray(by_parameter @ basis.projection.T)
        rule, samples, _ = self._resolved(values, n_harmonics)
        nodes, weights = rule.moved(self._breaks_along(rule.breaks, values, index))
        along = in_chunks(self._along, rule.theta[None, :], nodes[None, :], values, direction)
        projection = rule.projection(n_harmonics)
        turned = basis_derivatives(rule.theta, n_harmonics) * (rule.weights / np.pi * nodes)[:, None]
        turned[:, 0] = 0.0
        relative = np.divide(weights, rule.weights)
        return np.asarray((along + samples * relative) @ projection.T + samples @ turned)

    def symbolic(self, p: ca.MX, n_harmonics: int) -> ca.MX:
        """Return the coefficients (k, 2H+1) as an expression of the parameters.

        The samples are those that are exact, or twice those that the default values of the parameters take; switches
        that the parameters move are solved for.
        """
        if self.highest is not None:
            basis = self._equidistant(n_harmonics)
            samples = self._value.map(basis.n_samples)(ca.DM(basis.theta[None, :]), ca.repmat(p, 1, basis.n_samples))
            return samples @ ca.DM(basis.projection.T)
        typical = self._parameters.ordered(self._parameters.defaults)
        typical = np.where(np.isfinite(typical), typical, 1.0)
        rule = self._resolved(typical, n_harmonics).rule.halved()
        count = rule.theta.size
        phases, basis_at = ca.MX(ca.DM(rule.theta[None, :])), ca.MX(ca.DM(rule.projection(n_harmonics)))
        if self._switches_move:
            phases, basis_at = self._moving(rule, p, n_harmonics)
        return self._value.map(count)(phases, ca.repmat(p, 1, count)) @ basis_at.T

    def integrals(self, values: Array, kernel: Callable[[Array], ComplexArray]) -> ComplexArray:
        """Return the integrals (r, k) of the signals times functions over 0 <= tau < 2 pi, ``kernel`` (n,) -> (r, n)."""
        self._check_period(values)

        def products(theta: Array) -> Array:
            complex_rows = kernel(np.mod(theta, 2.0 * np.pi))[:, None] * self._sampled(theta, values)
            return np.concatenate([complex_rows.real, complex_rows.imag]).reshape(-1, theta.size)

        phases, of = self._fixed_breaks if not self._switches_move else self._breaks(values)
        order = np.argsort(np.append(phases, 2.0 * np.pi))
        breaks = Breaks(np.append(phases, 2.0 * np.pi)[order], np.append(of, -1)[order])
        rule, samples, error = resolve(products, breaks, 0)
        self._check_error(error)
        real, imaginary = (samples @ rule.weights).reshape(2, -1, self._expression.numel())
        return np.asarray(real + 1j * imaginary)

    # -- numbers ----------------------------------------------------------------------------------------------------

    def _equidistant(self, n_harmonics: int) -> FourierBasis:
        assert self.highest is not None
        least = max(128, 8 * n_coefficients(n_harmonics))
        return FourierBasis(n_harmonics, max(least, n_harmonics + self.highest + 1))

    def _sampled(self, theta: Array, values: Array) -> Array:
        return in_chunks(self._in_chunk, theta[None, :], values)

    def _resolved(self, values: Array, n_harmonics: int) -> Resolved:
        """Return the signals on panels; what was asked for last is kept."""
        key = values[self._matters].tobytes() + n_harmonics.to_bytes(8, "little")
        latest = self._latest
        if latest is not None and latest[0] == key:
            return latest[1]
        self._check_period(values)
        breaks = self._fixed_breaks if not self._switches_move else self._breaks(values)
        resolved = resolve(lambda theta: self._sampled(theta, values), breaks, n_harmonics)
        self._check_error(resolved.error)
        self._latest = (key, resolved)
        return resolved

    def _check_error(self, error: float) -> None:
        if error > ALIASING_TOL:
            raise ValueError(
                f"the harmonics of {self._what} are known to {error:.1e} only, {ALIASING_TOL:.0e} is needed: it is "
                "singular, or so steep that its own values are rounded; smooth it"
            )

    def _check_period(self, values: Array) -> None:
        """Raise a ValueError where a parameter multiplies the phase by a number that is not whole."""
        phases = np.random.default_rng(11).uniform(0.0, 2.0 * np.pi, 16)
        now, later = np.hsplit(self._sampled(np.concatenate([phases, phases + 2.0 * np.pi]), values), 2)
        if np.any(np.abs(later - now) > 1e-6 * np.max(np.abs(now), axis=1, keepdims=True)):
            at = ", ".join(
                f"{name} = {value:g}" for name, value in self._parameters.as_dict(values).items() if name != "omega"
            )
            raise ValueError(
                f"{self._what} is not 2 pi-periodic in tau = omega t at {at}: a parameter that multiplies tau has to "
                "be a whole number"
            )

    def _breaks(self, values: Array) -> Breaks:
        if not self._switches.numel():
            return find_breaks(lambda theta: np.zeros((0, theta.size)))
        return find_breaks(lambda theta: in_chunks(self._switching, theta[None, :], values))

    def _breaks_along(self, breaks: Breaks, values: Array, index: int) -> Array:
        """Return how fast the breaks move as a parameter grows."""
        by = np.zeros(breaks.phases.size)
        if not self._switches_move:
            return by
        for k in np.flatnonzero(breaks.of >= 0):
            by_tau, by_p = (e.full() for e in self._switch_slopes(breaks.phases[k], values))
            row = breaks.of[k]
            if by_tau[row, 0]:
                by[k] = -by_p[row, index] / by_tau[row, 0]
        return by

    @cached_property
    def _in_chunk(self) -> ca.Function:
        return self._value.map("signals_in_chunk", "serial", CHUNK, [1], [])

    @cached_property
    def _along(self) -> ca.Function:
        """(tau, dtau, p, dp) -> the derivative of the signals along (dtau, dp), a chunk at once."""
        ahead, direction = ca.SX.sym("ahead"), ca.SX.sym("direction", self._p.numel())
        slope = ca.jtimes(self._expression, ca.vertcat(self._tau, self._p), ca.vertcat(ahead, direction))
        function = ca.Function("signals_along", [self._tau, ahead, self._p, direction], [ca.densify(slope)])
        return function.map("signals_along_in_chunk", "serial", CHUNK, [2, 3], [])

    @cached_property
    def _switches(self) -> ca.SX:
        return ca.densify(switches(self._expression, lambda quantity: ca.jacobian(quantity, self._tau)))

    @cached_property
    def _switches_move(self) -> bool:
        return bool(self._switches.numel()) and bool(ca.depends_on(self._switches, self._p))

    @cached_property
    def _fixed_breaks(self) -> Breaks:
        return self._breaks(np.zeros(self._p.numel()))

    @cached_property
    def _switching(self) -> ca.Function:
        function = ca.Function("switches", [self._tau, self._p], [self._switches])
        return function.map("switches_in_chunk", "serial", CHUNK, [1], [])

    @cached_property
    def _switch_slopes(self) -> ca.Function:
        slopes = [ca.densify(ca.jacobian(self._switches, each)) for each in (self._tau, self._p)]
        return ca.Function("switch_slopes", [self._tau, self._p], slopes)

    # -- symbols ----------------------------------------------------------------------------------------------------

    def _moving(self, rule: Rule, p: ca.MX, n_harmonics: int) -> tuple[ca.MX, ca.MX]:
        """Return the nodes (1, n) and the projection (2H+1, n) between breaks that move with the parameters."""
        phases = ca.vertcat(*[self._break(k, rule.breaks, p) for k in range(rule.breaks.phases.size)])
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

    def _break(self, k: int, breaks: Breaks, p: ca.MX) -> ca.MX:
        near, row = float(breaks.phases[k]), int(breaks.of[k])
        switch = self._switches[row] if row >= 0 else ca.SX(0)
        if row < 0 or not ca.depends_on(switch, self._p):
            return ca.MX(near)
        equation = {"x": self._tau, "p": self._p, "g": switch}
        return ca.rootfinder(f"switch_{k}_of_{self._what.split()[0]}", "newton", equation)(x0=near, p=p)["x"]


def in_chunks(function: ca.Function, *arguments: Array) -> Array:
    """Return a function of columns (size, n), and of vectors that are the same for all, at any number n of columns."""
    count = arguments[0].shape[1]
    missing = -count % CHUNK
    columns = [np.pad(each, ((0, 0), (0, missing)), mode="edge") if each.ndim == 2 else each for each in arguments]
    parts = [
        function(*[each[:, k : k + CHUNK] if each.ndim == 2 else each for each in columns]).full()
        for k in range(0, count + missing, CHUNK)
    ]
    return np.concatenate(parts, axis=1)[:, :count]


def excitation_signals(system: System) -> tuple[PeriodicSignals, PeriodicSignals]:
    """Return the forcing and the prescribed motion of a system with their harmonics."""
    of = (system.tau, system.p, system.parameters)
    return PeriodicSignals("forcing", system.forcing, *of), PeriodicSignals("motion", system.motion, *of)
