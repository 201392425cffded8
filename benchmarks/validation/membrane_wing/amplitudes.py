"""Where slow marches of the paper's quasi-linear wing go, up and down, at twenty pitch amplitudes, to a tolerance.

At each amplitude the motions are explored in frequency, those that a slow march can meet: the branch from low
frequencies, that of the motion which integration from rest leads to at the highest, and what crosses these where
they are stable; `Diagram.march` goes along them and tells by integration where it lands. Where rest leads to no
stable periodic motion, the march down begins on the stable motion that reaches farthest. Results, leg by leg, in
``../results/wing_amplitudes.csv``, with the kind of the special point at which each ends. CPU time: two minutes an
amplitude. With ``--folder`` each amplitude is kept as it is done, and a run that was stopped goes on::

    python amplitudes.py --folder amplitudes
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from march import RESULTS

import hbnlp
from hbnlp.fourier import to_real

SPAN = (0.1, 20.0)
TOLERANCE = 1e-2
SETTLE = 240.0
"""Units of time that a motion from rest is integrated for."""
RATE = 360.0
"""Steps of the integration in a unit of time; see `march.py`."""


def from_rest(wing: hbnlp.System, problem: hbnlp.HarmonicBalance, at: dict[str, float]) -> list[hbnlp.Solution]:
    """Return the motion that rest leads to at the highest frequency, if it is a periodic one."""
    at = {"omega": SPAN[1], **at}
    period = 2.0 * np.pi / SPAN[1]
    method = hbnlp.RungeKutta4(steps_per_period=int(np.ceil(RATE * period)))
    options = {"max_periods": int(SETTLE / period), "periodic_tol": 1e-5, "throw": False}
    response = hbnlp.integrate(wing, at=at, method=method, **options)
    try:
        motion = hbnlp.solve(problem, at=at, start=to_real(response.displacement_harmonics(15)))
    except hbnlp.ConvergenceError:
        return []
    return [motion]


def legs(at: dict[str, float]) -> list[list[float | str]]:
    """Return what marches up and down do at an amplitude in degrees, leg by leg."""
    membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
    wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
    problem = hbnlp.HarmonicBalance(wing, tolerance=TOLERANCE)
    pitch = {"pitch_amplitude": float(np.radians(at["degrees"]))}
    known = from_rest(wing, problem, pitch)
    options = {"depth": 2, "max_points": 4000, "beside_stable": True}
    diagram = hbnlp.explore(problem, "omega", SPAN, at=pitch, known=known, **options)
    rows: list[list[float | str]] = []
    stable = {stretch.branch for stretch in diagram.stretches() if stretch.stable}
    highest = [i for i, origin in enumerate(diagram.origins) if origin.value == SPAN[1] and i in stable]
    for way, branch in (("up", 0), ("down", highest[-1] if highest else None)):  # None: what is stable there
        for leg in diagram.march(way, branch=branch).legs:
            point = leg.stretch.at_high if way == "up" else leg.stretch.at_low
            kind = "end" if point is None else point.kind.value
            falls_at = np.nan if leg.falls_at is None else leg.falls_at
            rows.append([way, leg.enters, leg.leaves, kind, leg.next.name.lower(), falls_at])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, help="where each amplitude is kept as it is done")
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    clock = time.perf_counter()
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        over = {"degrees": np.arange(0.5, 10.01, 0.5)}
        bar = hbnlp.ProgressBar()
        study = hbnlp.study(legs, over=over, executor=pool, folder=given.folder, callbacks=[bar])
    sys.stderr.write(f"{study}\n{time.perf_counter() - clock:.0f} s\n")
    with (RESULTS / "wing_amplitudes.csv").open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["degrees", "way", "enters", "leaves", "at", "next", "falls_at"])
        for point, rows in zip(study.points, study, strict=True):
            for way, enters, leaves, kind, following, falls_at in rows or []:
                writer.writerow(
                    [point["degrees"], way, *(f"{x:.7g}" for x in (enters, leaves)), kind, following, f"{falls_at:.7g}"]
                )


if __name__ == "__main__":
    main()
