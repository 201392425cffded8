"""What the schemes of fixed steps share: how their steps are given, and where a state ceases to be finite."""

from __future__ import annotations

import numpy as np

from hbnlp.core.checks import whole_number
from hbnlp.core.types import Array
from hbnlp.integration.first_order import Window


def check_steps(steps_per_period: int | None) -> None:
    """Raise an error for a number of steps that makes no sense; None has them chosen."""
    if steps_per_period is not None:
        advice = ", or None to have it chosen"
        whole_number("steps_per_period", steps_per_period, least=4, most=10_000_000, advice=advice)


def broken_off(states: Array, first: int, last: int, steps: int) -> Window | None:
    """Return the window as far as it is finite if it ceases to be so between two of its states; None if it does not.

    What is not finite stays so. ``steps`` are those of a period.
    """
    if np.isfinite(states[last]).all():
        return None
    good = first + 1 + int(np.argmin(np.isfinite(states[first + 1 : last + 1]).all(axis=1)))
    step = 2.0 * np.pi / steps
    reason = (
        "the state is not finite any more; the system diverges, or the step is too long where its force stiffens: "
        f"try steps_per_period={2 * steps}, or Adaptive()"
    )
    return Window(states[:good], step, good * step, reason)
