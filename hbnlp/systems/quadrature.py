"""Fourier coefficients of a periodic signal that need not be smooth: Gauss's rule on panels between its switches.

Equidistant samples alias: a step leaves an error of the order of their spacing. Here the period is cut where the signal
switches, the pieces into panels, and these are halved until the samples of the halves agree with the polynomial through
those of the whole: panels become small where the signal is steep. A jump at a place that is not known is closed in upon
by halving alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hbnlp.core.kept import built_once
from hbnlp.core.types import Array, IntArray
from hbnlp.fourier import basis_values

PANELS = 64
"""A period is cut into so many panels, or into half as many as there are harmonics, before any is halved."""
ORDER = 16
"""Nodes of a panel."""
GRID = 2048
"""Phases at which the signs of the switching quantities are compared."""
TOGETHER = 512
"""Phases that are asked for in one call while a switch is sought."""
JUMP = 1e-4
"""Of a quantity, relative to its largest modulus."""
AIM = 1e-12
"""What a panel may be wrong by, relative to the integral of the modulus; panels are halved until it is not."""
SHORTEST, MOST_NODES = 1e-15, 200_000

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(ORDER)
_NODES = 0.5 * (_NODES + 1.0)
_WEIGHTS = 0.5 * _WEIGHTS


class Breaks(NamedTuple):
    """Where a period is cut: phases in ascending order, and which switching quantity is zero there (-1: none)."""

    phases: Array
    of: IntArray


class Resolved(NamedTuple):
    """A signal on a rule by which its Fourier coefficients can be had.

    ``samples`` is (k, n), ``error`` what the panels that are as small as they get may be wrong by, relative to the
    integral of the modulus.
    """

    rule: Rule
    samples: Array
    error: float


@dataclass(frozen=True, eq=False)
class Rule:
    """Nodes and weights over a period, and where they are between the breaks.

    Attributes
    ----------
    theta, weights : array (n,)
        The weights add up to 2 pi.
    breaks : Breaks
        One at least; the last piece ends a period after the first break.
    piece : array (n,) of int
        The piece between two breaks that a node lies in, 0 the one after the first break.
    """

    theta: Array
    weights: Array
    breaks: Breaks
    piece: IntArray

    @classmethod
    def on(cls, breaks: Breaks, low: Array, high: Array) -> Rule:
        """Return the rule on panels, none of which contains a break."""
        theta = _nodes(low, high)
        piece = np.searchsorted(breaks.phases, 0.5 * (low + high), side="right") - 1
        weights = (high - low)[:, None] * _WEIGHTS
        return cls(theta.ravel(), weights.ravel(), breaks, np.repeat(piece, ORDER))

    def projection(self, n_harmonics: int) -> Array:
        """Return the matrix (2H+1, n) from samples to coefficients."""
        matrix = (basis_values(self.theta, n_harmonics) * (self.weights / np.pi)[:, None]).T
        matrix[0] *= 0.5
        return matrix

    @built_once
    def lengths(self) -> Array:
        """Length of the piece in which each node lies, (n,)."""
        return np.diff(np.append(self.breaks.phases, self.breaks.phases[0] + 2.0 * np.pi))[self.piece]

    @built_once
    def inside(self) -> Array:
        """Where a node lies in its piece, from 0 to 1, (n,)."""
        return np.asarray((self.theta - self.breaks.phases[self.piece]) / self.lengths)

    def moved(self, by: Array) -> tuple[Array, Array]:
        """Return how nodes move (n,), and weights change, as the breaks move by ``by`` (len(breaks),)."""
        first, last = by[self.piece], by[(self.piece + 1) % by.size]
        return first + self.inside * (last - first), self.weights / self.lengths * (last - first)

    def halved(self) -> Rule:
        """Return the rule on panels of half the length."""
        half = self.weights.reshape(-1, ORDER).sum(axis=1) / 2.0
        middle = (self.theta.reshape(-1, ORDER) @ _WEIGHTS).ravel()
        low, high = np.stack([middle - half, middle], axis=1), np.stack([middle, middle + half], axis=1)
        return Rule.on(self.breaks, low.ravel(), high.ravel())


def find_breaks(switching: Callable[[Array], Array]) -> Breaks:
    """Return the zeros of switching quantities within a period, ``switching`` (n,) -> (m, n).

    A quantity that comes near zero between two phases of the grid is looked at there: it may cross twice, or touch.
    """
    start = 2.0 * np.pi / GRID * 0.38197  # off the phases at which users' switches are
    grid: Array = start + 2.0 * np.pi / GRID * np.arange(GRID + 1, dtype=float)
    with np.errstate(all="ignore"):
        sampled = np.nan_to_num(switching(grid))
        above = sampled > 0.0
        of, at = np.nonzero(above[:, 1:] != above[:, :-1])
        low: Array = grid[at]
        high: Array = grid[at + 1]
        touching, places = _near_zero(switching, grid, sampled)
        value = np.nan_to_num(_each(switching, touching, places[:, None])[:, 0])
        index = np.clip(np.searchsorted(grid, places) - 1, 0, GRID)
        side = above[touching, index]
        crossed = (value > 0.0) != side
        reach = 1.5 * (grid[1] - grid[0])
        low = np.concatenate([low, places[crossed] - reach, places[crossed]])
        high = np.concatenate([high, places[crossed], places[crossed] + reach])
        of = np.concatenate([of, touching[crossed], touching[crossed]])
        zeros = _closed_in_upon(switching, of, low, high)
        # a touch is found to the root of the rounding: a crossing near it is where it is
        nearest = np.min(np.abs(places[:, None] - zeros), axis=1, initial=np.inf)
        touches = (
            ~crossed
            & (nearest > 1e-6)
            & (np.abs(value) <= 1e-12 * np.max(np.abs(sampled), axis=1, initial=0.0)[touching])
        )
    phases = np.concatenate([zeros, places[touches]])
    of = np.concatenate([of, touching[touches]])
    order = np.argsort(phases, kind="stable")
    phases, of = phases[order], of[order]
    if phases.size:
        new = np.append(True, np.diff(phases) > 1e-12)
        new[-1] &= phases.size == 1 or phases[-1] - phases[0] < 2.0 * np.pi - 1e-12
        phases, of = phases[new], of[new]
    return Breaks(phases, of) if phases.size else Breaks(np.zeros(1), np.array([-1]))


def find_jumps(quantities: Callable[[Array], Array]) -> tuple[Array, IntArray]:
    """Return the phases at which quantities jump, ``quantities`` (n,) -> (m, n), and which of them.

    Nothing but their values tells: where one moves most between two phases of the grid is closed in upon, and if it
    still moves by `JUMP` of its largest modulus, it jumps. Of several jumps between two phases one is found.
    """
    grid = np.linspace(0.0, 2.0 * np.pi, GRID + 1) + 2.0 * np.pi / GRID * 0.38197
    with np.errstate(all="ignore"):
        sampled = np.nan_to_num(quantities(grid))
        least = JUMP * np.abs(sampled).max(axis=1, initial=0.0)
        of, at = np.nonzero(np.abs(np.diff(sampled, axis=1)) > least[:, None])
        low, high = grid[at], grid[at + 1]
        while of.size and np.max(high - low) > 1e-12:
            phases = _between(low, high)
            steps = np.abs(np.diff(np.nan_to_num(_each(quantities, of, phases)), axis=1))
            most = np.argmax(steps, axis=1)[:, None]
            jumps = np.take_along_axis(steps, most, axis=1)[:, 0] > least[of]
            low = np.take_along_axis(phases, most, axis=1)[:, 0]
            high = np.take_along_axis(phases, most + 1, axis=1)[:, 0]
            of, low, high = of[jumps], low[jumps], high[jumps]
    return 0.5 * (low + high), of


def _near_zero(switching: Callable[[Array], Array], grid: Array, sampled: Array) -> tuple[IntArray, Array]:
    """Return quantities and phases at which their modulus is least between three phases of the grid of one sign."""
    size, above = np.abs(sampled), sampled > 0.0
    same = (above[:, 1:-1] == above[:, :-2]) & (above[:, 1:-1] == above[:, 2:])
    dip = same & (size[:, 1:-1] <= size[:, :-2]) & (size[:, 1:-1] < size[:, 2:])
    # a parabola through the three would not go below zero by far: no need to look
    bend = size[:, 2:] - 2.0 * size[:, 1:-1] + size[:, :-2]
    of, at = np.nonzero(dip & (size[:, 1:-1] <= bend))
    low, high = grid[at], grid[at + 2]
    side = np.where(above[of, at], 1.0, -1.0)[:, None]
    while of.size and np.max(high - low) > 1e-9:
        phases = _between(low, high)
        least = np.argmin(side * _each(switching, of, phases), axis=1)[:, None]
        low = np.take_along_axis(phases, np.maximum(least - 1, 0), axis=1)[:, 0]
        high = np.take_along_axis(phases, np.minimum(least + 1, phases.shape[1] - 1), axis=1)[:, 0]
    return of, 0.5 * (low + high)


def _closed_in_upon(switching: Callable[[Array], Array], of: IntArray, low: Array, high: Array) -> Array:
    """Return where quantities of one sign at ``low`` and another at ``high`` change it."""
    while of.size and np.max(high - low) > 4e-15:
        phases = _between(low, high)
        above = _each(switching, of, phases) > 0.0
        changed = np.argmax(above != above[:, :1], axis=1)[:, None]
        changed[changed == 0] = phases.shape[1] - 1
        low = np.take_along_axis(phases, changed - 1, axis=1)[:, 0]
        high = np.take_along_axis(phases, changed, axis=1)[:, 0]
    return 0.5 * (low + high)


def _between(low: Array, high: Array) -> Array:
    """Return phases (m, k) from ``low`` to ``high``: as many in all as are evaluated at once."""
    return np.asarray(np.linspace(low, high, max(5, TOGETHER // low.size), axis=1))


def _each(switching: Callable[[Array], Array], of: IntArray, phases: Array) -> Array:
    """Return the quantity ``of[i]`` at ``phases[i]``, an array (m, k)."""
    if not of.size:
        return np.zeros(phases.shape)
    return np.asarray(switching(phases.ravel()).reshape(-1, *phases.shape)[of, np.arange(of.size)])


def resolve(signal: Callable[[Array], Array], breaks: Breaks, n_harmonics: int) -> Resolved:
    """Return a signal, ``signal`` (n,) -> (k, n), on panels that are as small as it needs.

    The error is nan where the signal is not finite.
    """
    ends = np.append(breaks.phases, breaks.phases[0] + 2.0 * np.pi)
    longest = 2.0 * np.pi / max(PANELS, n_harmonics // 2)
    edges = [np.linspace(a, b, int(np.ceil((b - a) / longest)) + 1) for a, b in pairwise(ends)]
    low, high = np.concatenate([e[:-1] for e in edges]), np.concatenate([e[1:] for e in edges])
    values = _on_panels(signal, low, high)
    lows, highs, samples = [], [], []
    modulus = np.zeros(values.shape[0])  # of the panels that are done
    error, n_nodes = 0.0, values[0].size
    while low.size:
        middle = 0.5 * (low + high)
        low, high = np.stack([low, middle], axis=1), np.stack([middle, high], axis=1)
        halves = _on_panels(signal, low.ravel(), high.ravel()).reshape(values.shape[0], -1, 2 * ORDER)
        n_nodes += halves[0].size
        lengths = high[:, 1] - low[:, 0]
        integrals = lengths * (np.abs(halves) @ np.tile(0.5 * _WEIGHTS, 2))
        size = modulus + integrals.sum(axis=1)
        with np.errstate(all="ignore"):
            moved = np.max(np.abs(halves - values @ _HALVES), axis=2) * lengths
            wrong = np.max(np.divide(moved, size[:, None], out=np.zeros_like(moved), where=size[:, None] > 0.0), axis=0)
        if not np.all(np.isfinite(size)):
            wrong, error = np.zeros(low.shape[0]), np.nan
        done = wrong <= AIM
        small = ~done & ((lengths < SHORTEST) | (n_nodes > MOST_NODES))
        error += float(wrong[small].sum())
        done |= small
        modulus += integrals[:, done].sum(axis=1)
        lows.append(low[done].ravel())
        highs.append(high[done].ravel())
        samples.append(halves[:, done].reshape(values.shape[0], -1))
        low, high = low[~done].ravel(), high[~done].ravel()
        values = halves[:, ~done].reshape(values.shape[0], -1, ORDER)
    rule = Rule.on(breaks, np.concatenate(lows), np.concatenate(highs))
    return Resolved(rule, np.concatenate(samples, axis=1), error)


def _nodes(low: Array, high: Array) -> Array:
    return np.asarray(low[:, None] + (high - low)[:, None] * _NODES)


def _on_panels(signal: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Return samples (k, n_panels, ORDER)."""
    sampled = signal(_nodes(low, high).ravel())
    return sampled.reshape(sampled.shape[0], -1, ORDER)


def _halves() -> Array:
    """Return the matrix (ORDER, 2 ORDER) from a panel's samples to the polynomial through them at its halves' nodes."""
    at = np.concatenate([0.5 * _NODES, 0.5 + 0.5 * _NODES])
    gaps = _NODES[:, None] - _NODES + np.eye(ORDER)
    barycentric = 1.0 / gaps.prod(axis=1)
    terms = barycentric[:, None] / (at - _NODES[:, None])
    return np.asarray(terms / terms.sum(axis=0))


_HALVES = _halves()
