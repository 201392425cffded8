"""Trace the motions of the paper's wing at 2.5 degrees that a slow march can meet, to a tolerance, with their ends.

The branch from low frequencies, the branch of the motion that a march down begins with (from rest at omega = 70, see
`march.py`), and what crosses these at branch points and period doublings beside which they are stable: no march goes to
what crosses unstable parts. From the middle of every stable stretch, one per cent larger, the equations are integrated
in time: do they come back to the motion? Results in ``../results``: ``wing_diagram_*.csv``, a line a point, thinned to
what a curve needs; ``wing_points_*.csv``, the special points, where ``changes`` says whether stability does;
``wing_reached_*.csv``, lifts traced and integrated. CPU time on one core: some 4 min for the quasi-linear membrane, 12
min for the full one::

    python diagram.py quasi_linear
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from march import HARMONICS, LONGEST, MEMBRANES, PITCH, RESULTS, Hold

import hbnlp
from hbnlp.fourier import to_real

SPAN = (0.1, 70.0)
TOLERANCE = 1e-3
CROSSED = (hbnlp.Kind.BRANCH_POINT, hbnlp.Kind.PERIOD_DOUBLING)
PUSH = 1.01
BEND = 2e-3
"""A point is left out where the line between its neighbours passes this near, in logarithms."""


def begun(wing: hbnlp.System, problem: hbnlp.HarmonicBalance) -> Iterator[tuple[hbnlp.Solution, int]]:
    """Yield the motions from which branches are traced, and which way."""
    yield hbnlp.solve(problem, at={"pitch_amplitude": PITCH, "omega": SPAN[0]}), 1
    high = Hold(wing, SPAN[1] * (1.0 - 1e-6), None, 2.0 * LONGEST)
    at = {"pitch_amplitude": PITCH, "omega": high.omega}
    response = hbnlp.integrate(wing, at=at, start=high.state, max_periods=1, method=high.method, throw=False)
    yield hbnlp.solve(problem, at=at, start=to_real(response.displacement_harmonics(15))), -1


def is_known(motion: hbnlp.Solution, found: Sequence[hbnlp.Branch]) -> bool:
    """Return whether a motion, or its mirror image, is on one of the branches."""
    others = [each for branch in found for each in branch.at(motion.omega) if each.periods == motion.periods]
    return any(hbnlp.relation(motion, other, tol=2.0 * TOLERANCE) is not None for other in others)


def branches(wing: hbnlp.System) -> list[hbnlp.Branch]:
    """Return the branches from the beginnings, and those that cross them beside stable motions."""
    found: list[hbnlp.Branch] = []

    def follow(start: hbnlp.Solution, direction: int) -> None:
        if is_known(start, found):
            return
        branch = hbnlp.trace(start, "omega", SPAN, direction=direction)
        sys.stderr.write(f"{branch!r}\n")
        found.append(branch)
        for point in branch.special_points:
            if point.kind in CROSSED and branch.stable[point.index : point.index + 2].any():
                for side in hbnlp.switch_branch(point):
                    follow(side, 1)

    for start, direction in begun(wing, hbnlp.HarmonicBalance(wing, tolerance=TOLERANCE)):
        follow(start, direction)
    return found


def stretches(branch: hbnlp.Branch) -> Iterator[tuple[int, int]]:
    """Yield the first and the last point of each stable stretch between two folds or changes of stability."""
    turns = [point.index + 1 for point in branch.folds]
    changes = np.flatnonzero(branch.stable[1:] != branch.stable[:-1]) + 1
    for begin, end in pairwise(sorted({0, *turns, *changes, len(branch)})):
        if branch.stable[begin]:
            yield begin, end - 1


def reached(wing: hbnlp.System, motion: hbnlp.Solution) -> np.ndarray:
    """Return the harmonics of the lift that integration from a motion, one per cent larger, leads to."""
    start = dataclasses.replace(motion, coefficients=PUSH * motion.coefficients)
    return Hold(wing, motion.omega, start, LONGEST).lift


def thinned(points: np.ndarray, keep: Iterable[int]) -> list[int]:
    """Return the indices of the points (k, 2) that a curve through them needs."""
    keep, chosen = set(keep), [0]
    for end in range(2, len(points)):
        first, last = points[chosen[-1]], points[end]
        between = points[chosen[-1] + 1 : end] - first
        way = (last - first) / max(np.linalg.norm(last - first), 1e-12)
        if end - 1 in keep or abs(between @ [-way[1], way[0]]).max() > BEND or np.linalg.norm(last - first) > 0.1:
            chosen.append(end - 1)
    return [*chosen, len(points) - 1]


def write(path: Path, header: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    part = path.with_suffix(".part")
    with part.open("w", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([header, *rows])
    part.replace(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("membrane", choices=MEMBRANES)
    given = parser.parse_args()
    clock = time.process_time()
    membrane = MEMBRANES[given.membrane](mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
    wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
    curves, special, motions = [], [], []
    for number, branch in enumerate(branches(wing)):
        lift = abs(branch.harmonics("C_L"))
        periods = branch.solution(0).periods
        kept = np.zeros((len(branch), max(lift.shape[1], periods * HARMONICS[-1] + 1)))
        kept[:, : lift.shape[1]] = lift
        lifts = kept[:, periods * np.array(HARMONICS)]
        changes = np.flatnonzero(branch.stable[1:] != branch.stable[:-1])
        places = np.log(np.column_stack([branch.parameter, lifts[:, 0]]))
        for i in thinned(places, {*changes, *(changes + 1), *(point.index for point in branch.folds)}):
            numbers = [f"{branch.parameter[i]:.7g}", *(f"{x:.4e}" for x in lifts[i])]
            curves.append([number, *numbers, int(branch.stable[i]), branch.n_harmonics[i]])
        for begin, end in stretches(branch):
            middle = (begin + end) // 2
            arrived = reached(wing, branch.solution(middle))
            numbers = [f"{branch.parameter[i]:.7g}" for i in (middle, begin, end)]
            numbers += [f"{x:.5e}" for pair in zip(lifts[middle], arrived, strict=True) for x in pair]
            motions.append([number, *numbers])
        for point in branch.special_points:
            multiplier = "" if point.multiplier is None else f"{point.multiplier:.6g}"
            numbers = [f"{point.value:.8g}", multiplier, f"{point.truncation_error:.1e}", point.n_harmonics]
            inside = point.index + 1 < len(branch)
            changed = inside and branch.stable[point.index] != branch.stable[point.index + 1]
            special.append([number, point.kind.value, *numbers, int(changed)])
    header = ["branch", "omega", *(f"lift_{h}" for h in HARMONICS), "stable", "n_harmonics"]
    write(RESULTS / f"wing_diagram_{given.membrane}.csv", header, curves)
    header = ["branch", "kind", "omega", "multiplier", "truncation_error", "n_harmonics", "changes"]
    write(RESULTS / f"wing_points_{given.membrane}.csv", header, special)
    pairs = [f"{how}_{h}" for h in HARMONICS for how in ("traced", "integrated")]
    write(RESULTS / f"wing_reached_{given.membrane}.csv", ["branch", "omega", "begin", "end", *pairs], motions)
    sys.stderr.write(f"{time.process_time() - clock:.0f} s of CPU time\n")


if __name__ == "__main__":
    main()
