"""Follow the folds of the paper's wing's first tongue, to a tolerance, in frequency and amplitude of the pitch.

From the fold at which the quiet motion begins at 2.5 degrees, to both sides: over the cusp along the lower edge of the
resonant motion, and up. Results in ``../results/wing_tongue_*.csv``: a line a point, with the harmonics that it took
and its error of truncation, and one for each cusp, birth and merge of an isola, named in the last column. CPU time on
one core: 50 s for the quasi-linear membrane, up to omega = 60; 14 min for the full one, up to 20::

    python first_tongue.py quasi_linear
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np
from case import MEMBRANES, PITCH, RESULTS, paper_wing, write
from diagram import TOLERANCE

import hbnlp

LIMITS = {"quasi_linear": (0.5, 60.0), "nonlinear": (0.5, 20.0)}
"""In frequency: the full membrane's first resonance ends much earlier."""
COLUMNS = ("omega", "degrees", "n_harmonics", "truncation_error", "event")


def fold_of_the_quiet_motion(wing: hbnlp.System) -> hbnlp.SpecialPoint:
    """Return the fold from a motion near it, which has the quiet one's first harmonic."""
    at = {"pitch_amplitude": PITCH}
    branch = hbnlp.trace(hbnlp.HarmonicBalance(wing, 1), "omega", (0.5, 60.0), at=at, stability=None)
    quiet = min(branch.at(5.0), key=lambda solution: float(abs(solution.harmonics("W1")[1])))
    problem = hbnlp.HarmonicBalance(wing, tolerance=TOLERANCE)
    motion = hbnlp.solve(problem, at={"omega": 5.0, **at}, start=quiet)
    return hbnlp.trace(motion, "omega", (5.0, 4.0), stability=None).folds[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("membrane", choices=MEMBRANES)
    given, clock = parser.parse_args(), time.process_time()
    fold = fold_of_the_quiet_motion(paper_wing(given.membrane))
    span = (np.radians(0.5), np.radians(8.0))
    limits, bar = LIMITS[given.membrane], hbnlp.ProgressBar()
    curve = hbnlp.follow(fold, "pitch_amplitude", limits=limits, span=span, callbacks=[bar])
    rows: list[list[object]] = []
    for i in range(len(curve)):
        place = [f"{curve.first[i]:.8g}", f"{np.degrees(curve.second[i]):.8g}"]
        rows.append([*place, curve.n_harmonics[i], f"{curve.truncation_error[i]:.1e}", ""])
    rows.extend(
        [f"{event.first:.8g}", f"{np.degrees(event.second):.8g}", "", "", event.kind.value] for event in curve.events
    )
    write(RESULTS / f"wing_tongue_{given.membrane}.csv", COLUMNS, rows)
    sys.stderr.write(f"{time.process_time() - clock:.0f} s of CPU\n{curve}\n")


if __name__ == "__main__":
    main()
