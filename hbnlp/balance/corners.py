"""Corners of the force along a motion: where it jumps or has a kink, and over which width it can be rounded.

The poles of ``sqrt(d^2 + w^2)`` and ``tanh(d / w)`` lie about ``w / s`` beside the real phases where the quantity d
passes at the speed s by phase, so that harmonic k falls as ``exp(-k w / s)``: some ``20 s / w`` samples a period are
needed for the width w. For a corner, w = 0, no number will do.
"""

from __future__ import annotations

import textwrap
from typing import NamedTuple

import casadi as ca
import numpy as np

from hbnlp.core.kept import built_once
from hbnlp.core.types import Array, IntArray
from hbnlp.fourier import basis_values, differentiated
from hbnlp.systems.called import Call, calls
from hbnlp.systems.chunks import in_chunks, of_columns
from hbnlp.systems.quadrature import find_breaks, find_jumps
from hbnlp.systems.switches import switches
from hbnlp.systems.system import System

ASIDE = 1e-6
"""Phase before and after a switch at which the force is compared."""
KINK = 1e-3
"""Slopes by phase that differ by more than this part of the largest one are a kink."""
WIDTH = 0.01
"""Width of rounding, in terms of the largest speed of the quantity by phase; it takes 1,000 to 3,000 samples."""


class Corner(NamedTuple):
    """A jump or a kink of the force on a motion.

    Attributes
    ----------
    entry : int
        Degree of freedom whose force it is.
    quantity : str
        What is zero there, in the user's symbols: ``q[0] - gap``; of a function that is called, its arguments.
    phases : tuple of float
        Of the forcing, from 0 to ``2 pi periods``.
    jump : float
        Of the force; zero for a kink.
    width : float
        Over which it can be rounded and sampled, in units of the quantity; nan for a function that is called.
    by_phase : bool
        Whether the quantity is one of tau and parameters alone.
    settled : bool
        Whether the number of samples is the user's word.
    called : str
        The function that has the corner, and what to do about it; empty if the force itself has it.
    """

    entry: int
    quantity: str
    phases: tuple[float, ...]
    jump: float
    width: float
    by_phase: bool
    settled: bool
    called: str

    def __str__(self) -> str:
        kind = f"a step of {self.jump:.3g}" if self.jump else "a corner"
        phases = ", ".join(f"{phase:.4g}" for phase in self.phases[:4]) + (", ..." if len(self.phases) > 4 else "")
        instead = (
            "; a term of tau and parameters alone belongs into forcing, where jumps are integrated exactly"
            if self.by_phase
            else ""
        )
        if not self.settled:
            instead += "; or pass n_samples, and see what twice as many change"
        here = f"nonlinear_force[{self.entry}] has {kind} on this motion at tau = {phases}"
        if self.called:
            return f"{here}, which is that of {self.called}{instead}"
        return (
            f"{here}, where d = {self.quantity} is zero: round it over a width in units of d, {self.width:g} or more "
            "here, writing ca.sqrt(d**2 + width**2) for |d|, half of d + ca.sqrt(d**2 + width**2) for max(d, 0), "
            f"ca.tanh(d / width) for sign(d){instead}"
        )


class Corners:
    """What finds the corners of a system's force along motions of so many forcing periods."""

    def __init__(self, system: System, periods: int, *, settled: bool) -> None:
        self._system, self._periods, self._settled = system, periods, settled
        self._omega = system.parameters.index("omega")

    def worst(self, coefficients: Array, values: Array) -> Corner | None:
        """Return the largest step of the force, or else its sharpest kink, on a motion; None where it has neither.

        Parameters
        ----------
        coefficients : array (n_dof, 2H+1)
        values : array (n_parameters,)
        """
        if not np.all(np.isfinite(coefficients)):
            return None
        phases, of = self._candidates(coefficients, values)
        if not phases.size:
            return None
        n = self._system.n_dof
        with np.errstate(all="ignore"):
            along = self._at(self._force, coefficients, values, np.linspace(0.0, 2.0 * np.pi, 257))
            before, after = (self._at(self._force, coefficients, values, phases + s * ASIDE) for s in (-1.0, 1.0))
            slopes = np.maximum(np.abs(before[n:]), np.abs(after[n:]))
            steps = np.abs(after[:n] - before[:n])
            steps[steps <= 20.0 * ASIDE * slopes + 1e-9 * np.abs(along[:n]).max(axis=1, keepdims=True)] = 0.0
            kinks = np.abs(after[n:] - before[n:])
            kinks[kinks <= KINK * np.maximum(np.abs(along[n:]).max(axis=1, keepdims=True), slopes)] = 0.0
        found = np.nan_to_num(steps if steps.any() else kinks)
        if not found.any():
            return None
        entry, k = (int(i) for i in np.unravel_index(np.argmax(found), found.shape))
        here = phases[(of == of[k]) & (found[entry] > 0.0)]
        call = self._calls[of[k] - self._switches.numel()] if of[k] >= self._switches.numel() else None
        quantity = self._switches[of[k]] if call is None else call.arguments
        name = self._name(quantity)
        return Corner(
            entry=entry,
            quantity=name,
            phases=tuple(self._periods * here % (2.0 * np.pi * self._periods)),
            jump=float(steps[entry, k]),
            width=self._width(coefficients, values, of[k]) if call is None else np.nan,
            by_phase=not ca.depends_on(quantity, ca.vertcat(self._system.q, self._system.v)),
            settled=self._settled,
            called="" if call is None else f"{call.function.name()}({name}), {call.advice}",
        )

    def _candidates(self, coefficients: Array, values: Array) -> tuple[Array, IntArray]:
        """Return phases where the force may have a corner, and which: of the switches, or after them of the calls."""
        phases, of = np.zeros(0), np.zeros(0, dtype=int)
        if self._switches.numel():
            phases, of = find_breaks(lambda theta: self._at(self._quantities, coefficients, values, theta))
            phases, of = phases[of >= 0], of[of >= 0]
        if self._calls:
            jumps, slope = find_jumps(lambda theta: self._at(self._slopes, coefficients, values, theta))
            phases = np.append(phases, jumps)
            of = np.append(of, self._switches.numel() + np.repeat(np.arange(len(self._calls)), self._n_slopes)[slope])
        return phases, of

    def _width(self, coefficients: Array, values: Array, quantity: int) -> float:
        """Return the width of rounding with one digit, upwards."""
        theta = np.linspace(0.0, 2.0 * np.pi, 513)
        passed = np.diff(self._at(self._quantities, coefficients, values, theta)[quantity])
        width = WIDTH * float(np.max(np.abs(passed))) / (theta[1] - theta[0])
        digit = 10.0 ** np.floor(np.log10(width))
        return float(np.ceil(width / digit) * digit)

    def _at(self, function: ca.Function, coefficients: Array, values: Array, theta: Array) -> Array:
        """Return what a function of (q, v, tau, p, q', v') gives at phases of the motion's own period."""
        basis, rate = basis_values(theta, coefficients.shape[1] // 2), values[self._omega] / self._periods
        by_phase = differentiated(coefficients)
        q, slope, bend = (each @ basis.T for each in (coefficients, by_phase, differentiated(by_phase)))
        return in_chunks(function, q, rate * slope, self._periods * theta[None, :], values, slope, rate * bend)

    def _name(self, quantity: ca.SX) -> str:
        """Return a quantity, or several, in the user's symbols."""
        system = self._system
        symbols = [*ca.vertsplit(system.q), *ca.vertsplit(system.v), *ca.vertsplit(system.p)]
        names = [f"{letter}[{i}]" for letter in "qv" for i in range(system.n_dof)] + list(system.parameters.names)
        named = ca.vertcat(*[ca.SX.sym(name) for name in names])
        (said,) = ca.substitute([quantity], [ca.vertcat(*symbols)], [named])
        return textwrap.shorten(", ".join(map(str, ca.vertsplit(said))), 60, placeholder=" ...")

    @built_once
    def _switches(self) -> ca.SX:
        return ca.densify(switches(self._system.force))

    @built_once
    def _calls(self) -> list[Call]:
        return calls(self._system.force)

    @built_once
    def _n_slopes(self) -> list[int]:
        """How many slopes each call has."""
        return [int(call.slopes().numel()) for call in self._calls]

    @built_once
    def _slopes(self) -> ca.Function:
        return self._function("slopes", ca.vertcat(*[call.slopes() for call in self._calls]))

    @built_once
    def _quantities(self) -> ca.Function:
        return self._function("quantities", self._switches)

    @built_once
    def _force(self) -> ca.Function:
        """(q, v, tau, p, q', v') -> the force, and its derivative by the phase of the motion below it."""
        system = self._system
        symbols, slopes = ca.vertcat(system.q, system.v, system.tau), ca.vertcat(*self._rates, self._periods)
        slope = ca.jtimes(system.force, symbols, slopes)
        return self._function("force_and_slope", ca.vertcat(ca.densify(system.force), ca.densify(slope)))

    @built_once
    def _rates(self) -> tuple[ca.SX, ca.SX]:
        return ca.SX.sym("dq", self._system.n_dof), ca.SX.sym("dv", self._system.n_dof)

    def _function(self, name: str, expression: ca.SX) -> ca.Function:
        system = self._system
        return of_columns(
            ca.Function(name, [system.q, system.v, system.tau, system.p, *self._rates], [expression]), shared=[3]
        )
