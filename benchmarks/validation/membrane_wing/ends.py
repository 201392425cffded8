"""Solve for the ends of the paper's wing's motions by themselves, with other tolerances, modes and aerodynamics.

A diagram that ``diagram.py`` kept tells where the stable motions begin and end. Each such end is come to anew: from a
motion of the same branch on the stable side of it, solved again with the other tolerance, modes or ROM, and stable
there as well (where Newton's method does not come to it, after an integration from it), a trace goes towards the end
until it meets a special point of that kind. Results in
``../results/wing_ends_*.csv``: a line an end and variant (empty if it is not met), with its multiplier, the harmonics
that it took, and how far the motion there may be believed (camber, error of the tension against the exact arc, see
``wing.validity``). CPU time on one core: 5 min for the quasi-linear membrane, 70 min for the full one::

    python diagram.py quasi_linear --file wing.npz
    python ends.py quasi_linear wing.npz

The variants are those of ``variants()``: tolerances of 1e-2, 1e-3 and 1e-4 of the motion; 10, 15 and 20 modes; the
shipped ROM, reduced (as everywhere) and with all its poles, and the ROMs of the flow solver's two grids
(``../flow_solver``).
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from case import MEMBRANES, PITCH, RESULTS, SETTLE, paper_wing, write
from diagram import TOLERANCE

import hbnlp
from hbnlp.fourier import to_real

DISTANCES = (0.03, 0.1, 0.3)
"""How far from the end a trace begins, relative to its frequency: the nearest at which the motion is still there."""
ALIKE = 0.3
"""Of the lift's first harmonic: a motion of a variant that differs by more is another."""
MOST_POINTS = 300
"""Of a trace."""
COLUMNS = (
    "end",
    "kind",
    "variant",
    "omega",
    "multiplier",
    "truncation_error",
    "n_harmonics",
    "camber",
    "tension_error",
    "beyond_band",
)


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One way to compute the ends."""

    name: str
    tolerance: float = TOLERANCE
    n_modes: int = 10
    rom: hbnlp.AeroROM | None = None


def variants() -> Iterator[Variant]:
    """Yield the one that the diagram is of, and those in which one thing differs.

    Special points are solved for with more harmonics until they stay: those of other wings are traced to 1e-2.
    """
    yield Variant(name="as is")
    for tolerance in (1e-2, 1e-4):
        yield Variant(name=f"tolerance {tolerance:.0e}", tolerance=tolerance)
    yield Variant(name="all poles", tolerance=1e-2, rom=hbnlp.aero.flat_plate_re100(full=True))
    for cells in (25, 50):
        rom = hbnlp.AeroROM.load(RESULTS / f"rom_{cells}.npz")
        yield Variant(name=f"flow solver {cells} cells", tolerance=1e-2, rom=rom)
    for n_modes in (15, 20):
        yield Variant(name=f"{n_modes} modes", tolerance=1e-2, n_modes=n_modes)


@dataclass(frozen=True, kw_only=True)
class EndOfMotion:
    """A special point that bounds a stable stretch, and motions of that on the way to it, the nearest first."""

    point: hbnlp.SpecialPoint
    motions: tuple[hbnlp.Solution, ...]


def ends_of(diagram: hbnlp.Diagram) -> Iterator[EndOfMotion]:
    """Yield the ends of all stable stretches, each once."""
    known: list[hbnlp.SpecialPoint] = []
    for stretch in diagram.stretches():
        branch = diagram.branches[stretch.branch]
        for point, order in ((stretch.at_low, 1.0), (stretch.at_high, -1.0)):
            if point is None or not stretch.stable or any(point is other for other in known):
                continue
            away = order * (branch.parameter / point.value - 1.0)
            inside = np.arange(stretch.begin, stretch.end + 1)
            motions = []
            for distance in DISTANCES:
                far = inside[away[inside] >= distance]
                if far.size:
                    motions.append(branch.solution(int(far[np.argmin(away[far])])))
            if motions:
                known.append(point)
                yield EndOfMotion(point=point, motions=tuple(motions))


def again(motion: hbnlp.Solution, problem: hbnlp.HarmonicBalance) -> hbnlp.Solution | None:
    """Return the motion of another problem that is like one, and stable; None if there is none."""
    modes, at = problem.shape[0], {"pitch_amplitude": PITCH, "omega": motion.omega}
    start = np.zeros((max(modes, len(motion.coefficients)), motion.coefficients.shape[1]))
    start[: len(motion.coefficients)] = motion.coefficients
    start = start[:modes]
    lift = abs(motion.harmonics("C_L")[1])
    for integrated in (False, True):
        if integrated:
            most = max(1, int(0.5 * SETTLE * motion.omega / (2.0 * np.pi)))
            response = hbnlp.integrate(problem.system, at=at, start=start, max_periods=most, throw=False)
            if response.stopped_at is not None:
                break
            start = to_real(response.displacement_harmonics(motion.n_harmonics))
        found = hbnlp.solve(problem, at=at, start=start, throw=False)
        alike = found.converged and abs(abs(found.harmonics("C_L")[1]) / lift - 1.0) <= ALIKE
        if alike and hbnlp.floquet(found).stable:
            return found
    return None


def come_to(end: EndOfMotion, problem: hbnlp.HarmonicBalance) -> hbnlp.SpecialPoint | None:
    """Return the special point of that kind that a trace with another problem comes to; None if it meets none."""
    for motion in end.motions:
        here = again(motion, problem)
        if here is None:
            continue
        beyond = end.point.value * (end.point.value / motion.omega) ** 3
        span = (motion.omega, float(np.clip(beyond, 0.5 * end.point.value, 100.0)))
        # the multipliers of many modes cost as much again as the rest
        told = problem.shape[0] <= len(motion.coefficients) or end.point.kind is hbnlp.Kind.NEIMARK_SACKER
        stability, method = hbnlp.Floquet() if told else None, hbnlp.PseudoArclength(max_points=MOST_POINTS)
        for traced in hbnlp.Tracer(here, "omega", span, stability=stability, method=method):
            for point in traced.special_points:
                if point.kind is end.point.kind:
                    return point
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("membrane", choices=MEMBRANES)
    parser.add_argument("file", type=Path, help="the diagram that diagram.py --file kept")
    parser.add_argument("--resume", action="store_true", help="keep the lines that are there")
    given = parser.parse_args()
    clock = time.process_time()
    path = RESULTS / f"wing_ends_{given.membrane}.csv"
    rows: list[list[object]] = []
    if given.resume:
        with path.open(newline="") as stream:
            rows.extend(list(csv.reader(stream))[1:])
    there = {(row[0], row[2]) for row in rows}
    ends: list[EndOfMotion] = []
    for variant in variants():
        wing = paper_wing(given.membrane, variant.n_modes, variant.rom)
        problem = hbnlp.HarmonicBalance(wing, tolerance=variant.tolerance)
        if not ends:
            ends = list(
                ends_of(hbnlp.Diagram.load(given.file, problem=hbnlp.HarmonicBalance(wing, tolerance=TOLERANCE)))
            )
        for end in ends:
            named = [f"{end.point.value:.5g}", end.point.kind.value, variant.name]
            if (named[0], variant.name) in there:
                continue
            point = come_to(end, problem)
            if point is None:
                rows.append([*named, *[""] * (len(COLUMNS) - len(named))])
            else:
                believed = wing.validity(point.solution)
                numbers = [
                    f"{point.value:.8g}",
                    "" if point.multiplier is None else f"{point.multiplier:.6g}",
                    f"{point.truncation_error:.1e}",
                ]
                measures = (believed.camber, believed.tension_error, believed.beyond_band)
                rows.append([*named, *numbers, point.n_harmonics, *(f"{float(each[0]):.3g}" for each in measures)])
            sys.stderr.write(f"{time.process_time() - clock:7.1f} s  {' '.join(map(str, rows[-1]))}\n")
            write(path, COLUMNS, rows)


if __name__ == "__main__":
    main()
