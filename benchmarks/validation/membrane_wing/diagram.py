"""Explore the motions of the paper's wing at 2.5 degrees that a slow march can meet, to a tolerance, with their ends.

The branch from low frequencies, the branch of the motion that a march down begins with (from rest at omega = 70, see
`march.py`), and what crosses these where they are stable: no march goes to what crosses unstable parts. From the middle
of every stable stretch, one per cent larger, the equations are integrated in time: do they come back to the motion?
Results in ``../results``: ``wing_diagram_*.csv``, a line a point, thinned to what a curve needs; ``wing_points_*.csv``,
the special points, where ``changes`` says whether stability does; ``wing_reached_*.csv``, lifts traced and integrated;
``wing_intervals_*.csv``, both ends of each interval with several stable motions (`Diagram.intervals`);
``wing_falls_*.csv``, where slow marches go (`Diagram.march`), leg by leg. On one core the quasi-linear membrane
takes 4 min of CPU time to explore, the full one 13 min, and the integrations as long again or longer::

    python diagram.py quasi_linear

With ``--file diagram.npz`` the diagram is kept as well, whole; a run that finds the file goes on from it.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from march import HARMONICS, LONGEST, MEMBRANES, PITCH, RESULTS, Hold

import hbnlp
from hbnlp.fourier import to_real

SPAN = (0.1, 70.0)
TOLERANCE = 1e-3
DEPTH = 4
PUSH = 1.01
BEND = 2e-3
"""A point is left out where the line between its neighbours passes this near, in logarithms."""


def from_rest(wing: hbnlp.System, problem: hbnlp.HarmonicBalance) -> hbnlp.Solution:
    """Return the motion that a march down from rest begins with."""
    high = Hold(wing, SPAN[1], None, 2.0 * LONGEST)
    at = {"pitch_amplitude": PITCH, "omega": high.omega}
    response = hbnlp.integrate(wing, at=at, start=high.state, max_periods=1, method=high.method, throw=False)
    return hbnlp.solve(problem, at=at, start=to_real(response.displacement_harmonics(15)))


def explored(wing: hbnlp.System, path: Path | None) -> hbnlp.Diagram:
    """Return the diagram, gone on with from a file if that is there."""
    problem = hbnlp.HarmonicBalance(wing, tolerance=TOLERANCE)
    before = hbnlp.Diagram.load(path, problem=problem) if path is not None and path.exists() else None
    diagram = hbnlp.explore(
        problem,
        "omega",
        SPAN,
        at={"pitch_amplitude": PITCH},
        depth=DEPTH,
        known=[from_rest(wing, problem)],
        beside_stable=True,
        callbacks=[hbnlp.ProgressBar()],
        resume=before,
    )
    if path is not None:
        diagram.save(path)
    return diagram


def marches(diagram: hbnlp.Diagram) -> Iterator[list[object]]:
    """Yield what slow marches do, leg by leg: up from low frequencies, down from the motion that rest leads to."""
    found = {i for i, origin in enumerate(diagram.origins) if origin.value is not None}  # from the highest frequency
    highest = max((each for each in diagram.stretches() if each.stable and each.branch in found), key=lambda e: e.high)
    for way, branch in (("up", 0), ("down", highest.branch)):
        for leg in diagram.march(way, branch=branch).legs:
            point = leg.stretch.at_high if way == "up" else leg.stretch.at_low
            kind = "end" if point is None else point.kind.value
            falls_at = "" if leg.falls_at is None else f"{leg.falls_at:.8g}"
            numbers = [f"{leg.enters:.8g}", f"{leg.leaves:.8g}"]
            yield [way, leg.stretch.branch, *numbers, kind, leg.next.name.lower(), falls_at]


def bounded(diagram: hbnlp.Diagram) -> Iterator[list[object]]:
    """Yield the intervals in which several motions are stable, with what bounds them."""
    for each in diagram.intervals():
        kinds = ["end" if point is None else point.kind.value for point in (each.at_low, each.at_high)]
        numbers = sorted({stretch.branch for stretch in each.stretches})
        yield [f"{each.low:.8g}", f"{each.high:.8g}", *kinds, " ".join(f"b{number}" for number in numbers)]


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
    parser.add_argument("--file", type=Path, help="where the whole diagram is kept")
    given = parser.parse_args()
    clock = time.process_time()
    membrane = MEMBRANES[given.membrane](mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
    wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
    diagram = explored(wing, given.file)
    sys.stderr.write(f"{diagram!r}\n{time.process_time() - clock:.0f} s of CPU time\n")
    curves, special, motions = [], [], []
    for number, branch in enumerate(diagram.branches):
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
        for begin, end in ((s.begin, s.end) for s in diagram.stretches() if s.stable and s.branch == number):
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
    header = ["low", "high", "at_low", "at_high", "branches"]
    write(RESULTS / f"wing_intervals_{given.membrane}.csv", header, bounded(diagram))
    pairs = [f"{how}_{h}" for h in HARMONICS for how in ("traced", "integrated")]
    write(RESULTS / f"wing_reached_{given.membrane}.csv", ["branch", "omega", "begin", "end", *pairs], motions)
    header = ["way", "branch", "enters", "leaves", "at", "next", "falls_at"]
    write(RESULTS / f"wing_falls_{given.membrane}.csv", header, marches(diagram))
    sys.stderr.write(f"{time.process_time() - clock:.0f} s of CPU time\n")


if __name__ == "__main__":
    main()
