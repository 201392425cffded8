"""From a linear system that has one motion to the system itself: a start that needs no guess.

The balance R(x) = 0 is blended into that of the same mass on springs and dampers of its own, unloaded::

    share R(x) + (1 - share) B x = 0,      B x:  w^2 M (q + dq/dtau),      w = omega / periods

At share 0 there is the one solution x = 0, and B is regular. A system whose damping takes more power than its force
gives, as soon as motions are large, has bounded motions at every share: so the curve from x = 0 can neither run away
nor come back, and leads to share 1 [1]_. Wells, parametric excitation and resonances do not matter. Where the load
alone grows from zero, rest is one solution of several: that curve may close before the load has its size.

References
----------
.. [1] S. N. Chow, J. Mallet-Paret, J. A. Yorke, "Finding zeroes of maps: homotopy methods that are constructive with
   probability one", Math. Comp. 32 (1978) 887-899.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.arclength import PseudoArclength, Stop
from hbnlp.continuation.point import start_point
from hbnlp.continuation.walk import Walk
from hbnlp.core.types import Array
from hbnlp.fourier import differentiation

MOST_STEPS = 10_000
"""Between wells the way turns again and again: with five degrees of freedom and seven harmonics some 3,000 times."""
RUNS_AWAY = 1e6
"""Motions that are larger by this factor than those of either linear system will not come back."""


class Way(NamedTuple):
    """Where a way ends: the unknowns of a motion of the system, or None and the reason."""

    x: Array | None
    reason: str = ""


class Homotopy:
    """A `Curve`: the balance at fixed parameters, blended with a linear one; ``y`` ends with the balance's share.

    Parameters
    ----------
    problem : HarmonicBalance
    values : array
        All parameters in order.
    linear : array
        The response of the system linearised about rest.

    Attributes
    ----------
    largest : float
        Size of the larger of the motions of both linear systems.
    """

    parts = None  # its motions are any

    def __init__(self, problem: HarmonicBalance, values: Array, linear: Array) -> None:
        self.size = problem.size
        self._assembly, self._values = problem.assembly, values
        rate = float(values[problem.system.parameters.index("omega")]) / problem.periods
        by_tau = differentiation(problem.n_harmonics)
        mass = problem.system.state_matrices(values)[0]
        self._reference = np.kron(rate**2 * mass, np.eye(by_tau.shape[0]) + by_tau)
        at_rest = self._assembly.residual(np.zeros(self.size), values)
        sizes = [float(np.linalg.norm(x)) for x in (linear, np.linalg.solve(self._reference, at_rest))]
        self.largest = max(sizes) or 1.0
        self._floor = max(1e-3 * min(sizes), 1e-9 * self.largest)  # at a resonance one of them is round-off

    def residual(self, y: Array) -> Array:
        """Return the blended balance, (size,)."""
        x, share = y[:-1], y[-1]
        return np.asarray(share * self._assembly.residual(x, self._values) + (1.0 - share) * (self._reference @ x))

    def jacobian(self, y: Array, out: Array) -> None:
        """Write its derivative into an array (size, size + 1) of zeros."""
        x, share = y[:-1], y[-1]
        self._assembly.jacobian(x, self._values, out[:, :-1])
        out[:, :-1] *= share
        out[:, :-1] += (1.0 - share) * self._reference
        out[:, -1] = self._assembly.residual(x, self._values) - self._reference @ x

    def scale(self, y: Array) -> Array:
        """Return the sizes (size + 1,) by which changes of y are measured."""
        scale = np.full(y.size, max(float(np.linalg.norm(y[:-1])), self._floor))
        scale[-1] = max(abs(float(y[-1])), 0.1)
        return scale

    def term_size(self, y: Array) -> float:
        """Return the size of the terms whose sum is the blended balance."""
        x, share = y[:-1], abs(float(y[-1]))
        linear = float(np.abs(self._reference @ x).max())
        return share * self._assembly.term_size(x, self._values) + abs(1.0 - share) * linear

    def carried_from(self, _other: Homotopy, y: Array) -> Array:
        """Return a point or direction of another such curve: it has the same unknowns."""
        return y


@np.errstate(all="ignore")  # what is not finite ends the walk
def from_linear_system(problem: HarmonicBalance, values: Array, linear: Array) -> Way:
    """Return where the way from a linear system leads; ``linear`` is the response of this one linearised about rest."""
    curve = Homotopy(problem, values, linear)
    start = np.zeros(curve.size + 1)
    onward = np.append(start[:-1], 1.0)
    walk = Walk(curve, start_point(curve, start, onward), PseudoArclength(max_points=MOST_STEPS), limits=(0.0, 1.0))
    for _before, after in walk:
        if after.value == 1.0:
            return Way(after.y[:-1])
        if not np.linalg.norm(after.y[:-1]) <= RUNS_AWAY * curve.largest:
            return Way(
                None,
                "on the way from a damped linear system to this one motions grow without bound: perhaps no bounded "
                "motion of these periods exists; hbnlp.integrate(...) shows to what the system settles, or that it "
                "escapes",
            )
    ends = f"the way from a damped linear system ends at {walk.point.value:.2g} of this one"
    if walk.stop is None or walk.stop is Stop.MAX_POINTS:
        return Way(None, f"{ends}, after {MOST_STEPS} steps")
    return Way(None, f"{ends}: {walk.stop.value}")
