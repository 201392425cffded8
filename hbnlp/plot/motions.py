"""Motions over their period."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes

from hbnlp.plot.arguments import axes, result

if TYPE_CHECKING:
    from hbnlp.solutions.solution_set import SolutionSet

TIMES = 401
"""Points a line."""
MOST_LABELLED = 8
"""More lines than these have no legend."""


def plot_solutions(found: SolutionSet, output: str, *, ax: Axes | None = None, **options: Any) -> Axes:
    """Draw an output of all solutions of a set over their period, the smallest first; options go to matplotlib.

    What is drawn has the harmonics of the output that are retained: see `Solution.signal`.
    """
    result("found", found, "SolutionSet")
    if not len(found):
        raise ValueError(f"the solution set has no solutions to draw: {found.message}")
    phases = np.linspace(0.0, found.periods, TIMES)
    signals = [solution.signal(output, 2.0 * np.pi / solution.omega * phases) for solution in found]
    ax = axes(ax)
    for place, signal in enumerate(signals, start=1):
        ax.plot(phases, signal, **{"linewidth": 1.4, "label": f"solution {place}", **options})
    ax.set_xlabel("forcing periods")
    ax.set_ylabel(output)
    ax.set_xlim(0.0, found.periods)
    if len(found) <= MOST_LABELLED:
        ax.legend(frameon=False)
    return ax
