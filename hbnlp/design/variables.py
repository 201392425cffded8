"""Parameters that a program may change, shared by all its responses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import casadi as ca
import numpy as np

from hbnlp.core.checks import instance_of, interval, position, refused, text
from hbnlp.core.sending import StaysHere
from hbnlp.systems.parameters import OMEGA, check_period


@final
class Variables(StaysHere):
    """Parameters that a program may change, each within finite bounds (lower, upper); all its responses share them."""

    _instead = "responses and programs share its symbols; send the bounds, and make it there, once for all of them"

    def __init__(self, bounds: Mapping[str, tuple[float, float]]) -> None:
        instance_of("bounds", bounds, Mapping, "a mapping of names to (lower, upper), such as {'force': (0.1, 0.2)}")
        if not bounds:
            raise refused(ValueError, "bounds", bounds, "one parameter at least with (lower, upper)")
        for name, given in bounds.items():
            text("a name of bounds", name)
            low, _ = interval(f"bounds[{name!r}]", given)
            if name == OMEGA:
                check_period(low, "the lower bound of omega is")
        self.names = tuple(bounds)
        self.limits = np.array(list(bounds.values()), dtype=float).reshape(-1, 2)
        self.scale = np.max(np.abs(self.limits), axis=1)
        self.symbols = ca.MX.sym("variables", len(self.names))

    def __getitem__(self, name: str) -> ca.MX:
        """Return a variable, for objectives and bounds."""
        index = position("variable", name, self.names)
        return self.scale[index] * self.symbols[index]
