"""CPU time of a time step, and how it grows with the grid: ``python benchmarks/dns_step.py``.

The reference case is a fixed plate, five levels, h = 0.02 and a fine box of 3 x 2 chords. Run it on a quiet machine
with one thread (OMP_NUM_THREADS=1).
"""

from __future__ import annotations

import time

import numpy as np

from hbnlp import NonlinearMembrane, dns


def milliseconds(flow: dns.Simulation, steps: int) -> float:
    """CPU milliseconds a step, the least of five batches."""
    flow.run(flow.time + 3 * flow.dt)
    best = np.inf
    for _ in range(5):
        begun = time.process_time()
        flow.run(flow.time + steps * flow.dt)
        best = min(best, (time.process_time() - begun) / steps)
    return 1e3 * best


def cases(cells: int) -> dict[str, dns.Simulation]:
    """The flows that are timed."""
    grid = dns.Grid.around_plate(cells=cells, levels=5, above=1.0)
    motion = dns.Motion.sinusoidal(2.0, pitch=0.04)
    return {
        "fixed plate": dns.Simulation(grid, dns.SharpPlate()),
        "membrane": dns.Simulation(grid, dns.Membrane(NonlinearMembrane()), motion=motion),
    }


def main() -> None:
    """Print a table."""
    print(
        f"{'h':>7} {'grid points':>12} {'fixed plate':>14} {'membrane':>14}   (ms CPU a step, five levels, box 3 x 2)"
    )
    points, times = [], []
    for cells in (25, 50, 100):
        flows = cases(cells)
        steps = max(3, 500 // cells)
        found = {name: milliseconds(flow, steps) for name, flow in flows.items()}
        nx, ny = flows["fixed plate"].grid.shape
        points.append(5 * nx * ny)
        times.append(found["fixed plate"])
        print(f"{1 / cells:7.3f} {points[-1]:12d} {found['fixed plate']:14.1f} {found['membrane']:14.1f}")
    growth = np.polyfit(np.log(points), np.log(times), 1)[0]
    print(f"time grows as (grid points)^{growth:.2f}")


if __name__ == "__main__":
    main()
