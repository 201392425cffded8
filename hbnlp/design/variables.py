"""Parameters that a program may change, shared by all its responses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import casadi as ca
import numpy as np

from hbnlp.core.checks import position
from hbnlp.core.sending import StaysHere


@final
class Variables(StaysHere):
    """Parameters that a program may change, each within finite bounds (lower, upper); all its responses share them."""

    _instead = "responses and programs share its symbols; send the bounds, and make it there, once for all of them"

    def __init__(self, bounds: Mapping[str, tuple[float, float]]) -> None:
        for name, (low, high) in bounds.items():
            if not (np.isfinite(low) and np.isfinite(high) and low < high):
                raise ValueError(f"bounds of {name!r} are {(low, high)!r}; two finite, rising numbers are needed")
        self.names = tuple(bounds)
        self.limits = np.array(list(bounds.values()), dtype=float).reshape(-1, 2)
        self.scale = np.max(np.abs(self.limits), axis=1)
        self.symbols = ca.MX.sym("variables", len(self.names))

    def __getitem__(self, name: str) -> ca.MX:
        """Return a variable, for objectives and bounds."""
        index = position("variable", name, self.names)
        return self.scale[index] * self.symbols[index]
