"""Where slow marches of the paper's quasi-linear wing go, up and down, at twenty pitch amplitudes, to a tolerance.

At each amplitude the motions are explored in frequency, those that a slow march can meet: the branch from low
frequencies, that of the motion which integration from rest leads to at the highest, and what crosses these where
they are stable; `Diagram.march` goes along them and tells by integration where it lands. Where rest leads to no
stable periodic motion, the march down begins on the stable motion that reaches farthest. Results, leg by leg, in
``../results/wing_amplitudes_*.csv`` by the highest frequency, with the kind of the special point at which each ends.
CPU time: two minutes an amplitude. With ``--folder`` each amplitude is kept as it is done, and a run that was stopped
goes on::

    python amplitudes.py 20
    python amplitudes.py 60 --folder amplitudes
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from case import LEG, RESULTS, from_rest, legs, paper_wing, write

import hbnlp

LOW = 0.1
TOLERANCE = 1e-2


def marches(at: dict[str, float]) -> list[dict[str, object]]:
    """Return what marches up to a ``highest`` frequency and down do at an amplitude in ``degrees``, leg by leg."""
    problem = hbnlp.HarmonicBalance(paper_wing("quasi_linear"), tolerance=TOLERANCE)
    pitch = {"pitch_amplitude": float(np.radians(at["degrees"]))}
    rest = from_rest(problem, {"omega": at["highest"], **pitch})
    options = {"depth": 2, "max_points": 4000, "beside_stable": True, "known": [] if rest is None else [rest]}
    return list(legs(hbnlp.explore(problem, "omega", (LOW, at["highest"]), at=pitch, **options)))


def as_text(value: object) -> str:
    """Return a number, or what is none, as the file has it."""
    return value if isinstance(value, str) else f"{np.nan if value is None else value:.7g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("highest", type=float, help="frequency, in chords and the stream's velocity")
    parser.add_argument("--folder", type=Path, help="where each amplitude is kept as it is done")
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    clock = time.perf_counter()
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        over = {"highest": [given.highest], "degrees": np.arange(0.5, 10.01, 0.5)}
        bar = hbnlp.ProgressBar()
        study = hbnlp.study(marches, over=over, executor=pool, folder=given.folder, callbacks=[bar])
    sys.stderr.write(f"{study}\n{time.perf_counter() - clock:.0f} s\n")
    columns = [name for name in LEG if name != "branch"]
    rows = (
        [point["degrees"], *map(as_text, map(leg.get, columns))]
        for point, of_amplitude in zip(study.points, study, strict=True)
        for leg in of_amplitude or []
    )
    write(RESULTS / f"wing_amplitudes_{given.highest:g}.csv", ("degrees", *columns), rows)


if __name__ == "__main__":
    main()
