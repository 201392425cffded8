"""When a change from one value to the next is looked at as a jump.

The proof that it is one is the way back: a jump is a change that it does not undo.
"""

from __future__ import annotations

import numpy as np

from hbnlp.continuation.curve import TINY
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import of_equal_length

SUSPICIOUS = 0.02
"""A relative change of the response from value to value that calls for the proof."""
SUDDEN = 5.0
"""A change this many times the last one calls for it, too, if it is above `VISIBLE`."""
VISIBLE = 1e-3
UNKNOWN = float("inf")
"""The change before the first one: nothing is sudden after it."""


def relative_change(before: Array | ComplexArray, after: Array | ComplexArray) -> float:
    """Return the change of coefficients or amplitudes, relative to the larger of the two.

    Zeros stand for the harmonics that only one of them has.
    """
    one, other = of_equal_length(before, after)
    size = max(float(np.linalg.norm(one)), float(np.linalg.norm(other)), TINY)
    return float(np.linalg.norm(other - one)) / size


def is_suspicious(change: float, last_change: float) -> bool:
    """Return whether a change, after the last one, may be a jump."""
    return change > SUSPICIOUS or change > max(VISIBLE, SUDDEN * last_change)
