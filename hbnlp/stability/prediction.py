"""How many intervals exponential collocation needs, from frequencies and amplitudes, before any is made.

What m Gauss nodes in an interval of length h leave out of a product of two oscillations of frequency w is about
``(2m + 1) j_m(w h / 2)^2``, with the spherical Bessel function j_m; of one whose other factor is slow, less.
"""

from __future__ import annotations

from math import lgamma, log

import numpy as np

from hbnlp.core.types import Array
from hbnlp.stability.modes import Modes

_STEP = 1.1  # ratio of the numbers of intervals that are tried


class Prediction:
    """What meshes of one motion are expected to leave out.

    Parameters
    ----------
    modes : Modes
        Of the constant part.
    amplitudes : (n_harmonics, n_rows, n_columns)
        Of what varies beside it, harmonic by harmonic.
    shift : (n_rows, n_columns)
        Size of what is constant beside it.
    period : float
        The repeating part, of which the harmonics are.
    whole : float
        The period of the motion.
    nodes : int
        m
    """

    def __init__(self, modes: Modes, amplitudes: Array, shift: Array, period: float, whole: float, nodes: int) -> None:
        coupling = modes.coupling(whole)
        self._nodes, self._period = nodes, period
        self._of_modes = np.tensordot(coupling, amplitudes.sum(axis=0) + shift, 2)
        self._phases = np.abs(modes.exponents) * period
        self._of_harmonics = np.tensordot(amplitudes, coupling.max(axis=0), 2)
        self._harmonic_phases = 2.0 * np.pi * np.arange(1.0, len(amplitudes) + 1.0)

    def left_out(self, intervals: Array | float) -> Array:
        """Return the error that stems from harmonics that a mesh does not resolve, for numbers of intervals."""
        return self._of_harmonics @ self._missed(np.divide.outer(self._harmonic_phases, intervals))

    def least(self, tol: float, most: int) -> float:
        """Return the fewest intervals that leave out less than ``tol`` of the harmonics, at most ``most``."""
        tried = np.append(np.arange(1.0, 8.0), 8.0 * _STEP ** np.arange(np.ceil(np.log(most / 8.0) / np.log(_STEP))))
        enough = np.flatnonzero(self.left_out(tried) <= tol)
        return float(tried[enough[0]]) if enough.size else float(most)

    def enough(self, tol: float) -> float:
        """Return the intervals with which lasting modes are expected to be right to ``tol``."""
        top = self._phases.max(initial=0.0)
        if not top or not self._of_modes @ self._phases:
            return 0.0
        relative = float(self._of_modes @ (self._phases / top) ** (2 * self._nodes))
        phase = self._resolved(relative / tol)
        return float(top / phase)

    def _missed(self, phases: Array) -> Array:
        """Return what is left out of oscillations that turn by these phases in an interval."""
        with np.errstate(over="ignore"):
            missed: Array = np.minimum((phases / self._resolved(1.0)) ** (2 * self._nodes), 1.0)
        return missed

    def _resolved(self, size: float) -> float:
        """Return the phase an interval of which as little as ``1 / size`` is left out."""
        m = self._nodes
        # j_m(x) is x^m / (2m + 1)!! for the small x of a mesh that resolves the phase
        double_factorial = lgamma(2 * m + 2) - lgamma(m + 1) - m * log(2.0)
        return 2.0 * float(np.exp((double_factorial - 0.5 * log((2 * m + 1) * size)) / m))
