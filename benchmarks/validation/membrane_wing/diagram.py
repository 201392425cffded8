"""Explore the motions of the paper's wing at 2.5 degrees that a slow march can meet, to a tolerance, with their ends.

The branch from low frequencies, the branch of the motion that a march down begins with (from rest at omega = 70, see
`march.py`), and what crosses these where they are stable: no march goes to what crosses unstable parts. From the middle
of every stable stretch, one per cent larger, the equations are integrated in time: do they come back to the motion?
Results in ``../results``: ``wing_diagram_*.csv``, a line a point, thinned to what a curve needs; ``wing_points_*.csv``,
the special points, where ``changes`` says whether stability does; ``wing_reached_*.csv``, lifts traced and integrated;
``wing_intervals_*.csv``, both ends of each interval with several stable motions (`Diagram.intervals`);
``wing_stretches_*.csv``, the stable stretches by mode and symmetry; ``wing_falls_*.csv``, where slow marches go
(`Diagram.march`), leg by leg. On one core the quasi-linear membrane takes 2 min of CPU time to explore, the full one
13 min, and the integrations as long again or longer::

    python diagram.py quasi_linear

With ``--file diagram.npz`` the diagram is kept as well, whole; a run that finds the file goes on from it.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from case import LEG, MEMBRANES, PITCH, RESULTS, from_rest, legs, paper_wing, write
from march import HARMONICS, LONGEST, Hold

import hbnlp

SPAN = (0.1, 70.0)
TOLERANCE = 1e-3
DEPTH = 4
PUSH = 1.01
BEND = 2e-3
"""A point is left out where the line between its neighbours passes this near, in logarithms."""


def explored(wing: hbnlp.System, path: Path | None) -> hbnlp.Diagram:
    """Return the diagram, gone on with from a file if that is there."""
    problem = hbnlp.HarmonicBalance(wing, tolerance=TOLERANCE)
    before = hbnlp.Diagram.load(path, problem=problem) if path is not None and path.exists() else None
    rest = from_rest(problem, {"pitch_amplitude": PITCH, "omega": SPAN[1]})
    diagram = hbnlp.explore(
        problem,
        "omega",
        SPAN,
        at={"pitch_amplitude": PITCH},
        depth=DEPTH,
        known=[] if rest is None else [rest],
        beside_stable=True,
        callbacks=[hbnlp.ProgressBar()],
        resume=before,
    )
    if path is not None:
        diagram.save(path)
    return diagram


def bounded(diagram: hbnlp.Diagram) -> Iterator[list[object]]:
    """Yield the intervals in which several motions are stable, with what bounds them."""
    for each in diagram.intervals():
        kinds = ["end" if point is None else point.kind.value for point in (each.at_low, each.at_high)]
        numbers = sorted({stretch.branch for stretch in each.stretches})
        yield [f"{each.low:.8g}", f"{each.high:.8g}", *kinds, " ".join(f"b{number}" for number in numbers)]


def named(diagram: hbnlp.Diagram) -> Iterator[list[object]]:
    """Yield the stable stretches, with what bounds them, the mode that is largest in their middle, its symmetry."""
    for each in diagram.stretches():
        if each.stable:
            kinds = ["end" if point is None else point.kind.value for point in (each.at_low, each.at_high)]
            middle = diagram.branches[each.branch].solution((each.begin + each.end) // 2)
            mode = 1 + int(np.linalg.norm(middle.coefficients, axis=1).argmax())
            form = "symmetric" if middle.is_odd else "asymmetric"
            yield [each.branch, f"{each.low:.8g}", f"{each.high:.8g}", *kinds, mode, form]


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("membrane", choices=MEMBRANES)
    parser.add_argument("--file", type=Path, help="where the whole diagram is kept")
    given = parser.parse_args()
    clock = time.process_time()
    wing = paper_wing(given.membrane)
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
    header = ["branch", "low", "high", "at_low", "at_high", "mode", "form"]
    write(RESULTS / f"wing_stretches_{given.membrane}.csv", header, named(diagram))
    rows = ([x if not isinstance(x, float) else f"{x:.8g}" for x in leg.values()] for leg in legs(diagram))
    write(RESULTS / f"wing_falls_{given.membrane}.csv", LEG, rows)
    sys.stderr.write(f"{time.process_time() - clock:.0f} s of CPU time\n")


if __name__ == "__main__":
    main()
