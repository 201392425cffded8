"""Motions over their period, in the plane of value and rate, and by their harmonics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes

from hbnlp.core.checks import flag
from hbnlp.core.quantities import quantities_of
from hbnlp.core.types import Array
from hbnlp.fourier import basis_derivatives, to_real
from hbnlp.plot.arguments import axes, axis, modulus, result

if TYPE_CHECKING:
    from hbnlp.integration.response import TimeResponse
    from hbnlp.solutions.solution import Solution
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
    found[0].harmonics(output)
    ax = axes(ax)
    for place, solution in enumerate(found, start=1):
        draw_signal(ax, solution, output, **{"linewidth": 1.4, "label": f"solution {place}", **options})
    if len(found) <= MOST_LABELLED:
        ax.legend(frameon=False)
    return ax


def plot_signal(solution: Solution, output: str, *, ax: Axes | None = None, **options: Any) -> Axes:
    """Draw an output of a solution over its period; options go to matplotlib.

    What is drawn has the harmonics of the output that are retained: see `Solution.signal`.
    """
    result("solution", solution, "Solution")
    solution.harmonics(output)
    ax = axes(ax)
    draw_signal(ax, solution, output, **{"linewidth": 1.4, **options})
    return ax


def plot_response(response: TimeResponse, output: str, *, ax: Axes | None = None, **options: Any) -> Axes:
    """Draw an output of a time response over its window as it was integrated; options go to matplotlib.

    Where the integration broke off, so does the line.
    """
    result("response", response, "TimeResponse")
    values = response.signal(output)
    ax = axes(ax)
    ax.plot(response.omega / (2.0 * np.pi) * response.t, values, **{"linewidth": 1.4, **options})
    ax.set(xlabel="forcing periods", ylabel=output, xlim=(0.0, response.periods))
    return ax


def plot_phase(solution: Solution, output: str, *, ax: Axes | None = None, **options: Any) -> Axes:
    """Draw the phase portrait of an output, its rate against its value, and a dot at each period of the forcing.

    Options go to matplotlib. One dot is a motion of the forcing's period, two a doubled one.
    """
    result("solution", solution, "Solution")
    rate = solution.omega / solution.periods
    coefficients = to_real(solution.harmonics(output))
    angles = 2.0 * np.pi * np.append(over_period(solution), np.arange(float(solution.periods))) / solution.periods
    rates = rate * basis_derivatives(angles, solution.n_harmonics) @ coefficients
    values = solution.signal(output, angles / rate)
    ax = axes(ax, figsize=(4.8, 4.4))
    style = {"linewidth": 1.4, **options}
    line = ax.plot(values[:TIMES], rates[:TIMES], **style)[0]
    told = "once a forcing period"
    label = None if told in ax.get_legend_handles_labels()[1] else told
    ax.plot(values[TIMES:], rates[TIMES:], "o", color=line.get_color(), label=label)
    ax.set(xlabel=axis(solution, output), ylabel=f"rate of {quantities_of(solution).label(output)}")
    ax.legend(frameon=False)
    return ax


def plot_harmonics(
    solution: Solution, output: str, *, logarithmic: bool = False, ax: Axes | None = None, **options: Any
) -> Axes:
    """Draw the harmonics of an output as bars, the mean at 0, over multiples of the forcing's frequency.

    Parameters
    ----------
    solution : Solution
    output : str
    logarithmic : bool
        Whether the amplitudes are on a logarithmic axis, as tells how they fall.
    ax : Axes, optional
        Where to draw; a new figure by default.
    **options
        For matplotlib's bars.
    """
    result("solution", solution, "Solution")
    flag("logarithmic", logarithmic)
    amplitudes = np.abs(solution.harmonics(output))
    multiples = np.arange(len(amplitudes)) / solution.periods
    ax = axes(ax)
    ax.bar(multiples, amplitudes, **{"width": 0.7 / solution.periods, **options})
    if logarithmic:
        ax.set_yscale("log")
    unit = quantities_of(solution).unit(output)
    size = modulus(quantities_of(solution).label(output))
    ax.set(xlabel=r"frequency $/\,\omega$", ylabel=f"{size} ({unit})" if unit else size)
    if len(amplitudes) <= MOST_LABELLED * 2 and solution.periods == 1:
        ax.set_xticks(multiples)
    return ax


def over_period(solution: Solution) -> Array:
    """Return the phases of a solution that a line is drawn through, in forcing periods, both ends included."""
    return np.linspace(0.0, solution.periods, TIMES)


def draw_signal(ax: Axes, solution: Solution, output: str, **style: Any) -> None:
    """Draw an output over the period of a solution."""
    phases = over_period(solution)
    ax.plot(phases, solution.signal(output, 2.0 * np.pi / solution.omega * phases), **style)
    ax.set(xlabel="forcing periods", ylabel=axis(solution, output), xlim=(0.0, solution.periods))
