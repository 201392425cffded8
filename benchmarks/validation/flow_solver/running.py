"""What all runs have in common: the way they go on, and what is kept of how they were set up."""

from __future__ import annotations

from results import Result

from hbnlp import dns


def settings(flow: dns.Simulation) -> Result:
    """Grid, time step, Reynolds number and time reached."""
    grid = flow.grid
    return {
        "h": grid.spacing,
        "shape": list(grid.shape),
        "corner": list(grid.corner),
        "levels": grid.levels,
        "dt": flow.dt,
        "reynolds": flow.reynolds,
        "end": flow.time,
    }


def advance(flow: dns.Simulation, until: float, label: str) -> dns.History:
    """Run up to a time, with a progress bar."""
    with dns.ProgressBar(until, label=label) as bar:
        return flow.run(until, callback=bar)
