"""Solve for the ends of the paper's wing's motions by themselves, with other tolerances, modes and aerodynamics.

A diagram that ``diagram.py`` kept tells where the stable motions begin and end. Each such end is come to anew: from a
motion of the same branch on the stable side of it, solved again with the other tolerance, modes or ROM, a trace goes
towards the end until it meets a special point of that kind. So a variant takes seconds, not minutes. Results in
``../results/wing_ends_*.csv``: a line an end and variant (empty if it is not met), with its multiplier, the harmonics
that it took, and how far the motion there may be believed (camber, error of the tension against the exact arc, see
``wing.validity``). CPU time on one core: 10 min for the quasi-linear membrane::

    python diagram.py quasi_linear --file wing.npz
    python ends.py quasi_linear wing.npz

The variants are those of ``variants()``: tolerances of 1e-2, 1e-3 and 1e-4 of the motion; 10, 15 and 20 modes; the
shipped ROM, reduced (as everywhere) and with all its poles, and the ROMs of the flow solver's two grids
(``../flow_solver``). The kept ends of the full membrane were come to by `come_to` from motions that integration found.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from diagram import TOLERANCE, write
from march import MEMBRANES, PITCH, RESULTS

import hbnlp
from hbnlp.wing.membrane import Membrane

DISTANCES = (0.03, 0.1, 0.3)
"""How far from the end a trace begins, relative to its frequency: the nearest at which the motion is still there."""
ALIKE = 0.3
"""Of the lift's first harmonic: a motion of a variant that differs by more is another."""
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
    rom: hbnlp.AeroROM = field(default_factory=hbnlp.aero.flat_plate_re100)

    def wing(self, membrane: type[Membrane]) -> hbnlp.System:
        """Return its wing."""
        own = membrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=self.n_modes)
        return hbnlp.membrane_wing(own, self.rom)


def variants() -> Iterator[Variant]:
    """Yield the one that the diagram is of, and those in which one thing differs."""
    yield Variant(name="as is")
    for tolerance in (1e-2, 1e-4):
        yield Variant(name=f"tolerance {tolerance:.0e}", tolerance=tolerance)
    for n_modes in (15, 20):
        yield Variant(name=f"{n_modes} modes", n_modes=n_modes, rom=hbnlp.aero.flat_plate_re100(n_modes=n_modes))
    yield Variant(name="all poles", rom=hbnlp.aero.flat_plate_re100(full=True))
    for cells in (25, 50):
        yield Variant(name=f"flow solver {cells} cells", rom=hbnlp.AeroROM.load(RESULTS / f"rom_{cells}.npz"))


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


def come_to(end: EndOfMotion, problem: hbnlp.HarmonicBalance) -> hbnlp.SpecialPoint | None:
    """Return the special point of that kind that a trace with another problem comes to; None if it meets none."""
    modes = problem.shape[0]
    for motion in end.motions:
        start = np.zeros((max(modes, len(motion.coefficients)), motion.coefficients.shape[1]))
        start[: len(motion.coefficients)] = motion.coefficients
        at = {"pitch_amplitude": PITCH, "omega": motion.omega}
        here = hbnlp.solve(problem, at=at, start=start[:modes], throw=False)
        lifts = [abs(each.harmonics("C_L")[1]) for each in (motion, here)]
        if not here.converged or abs(lifts[1] / lifts[0] - 1.0) > ALIKE:
            continue
        beyond = end.point.value * (end.point.value / motion.omega) ** 3
        tracer = hbnlp.Tracer(here, "omega", (motion.omega, float(np.clip(beyond, 0.5 * end.point.value, 100.0))))
        for traced in tracer:
            for point in traced.special_points:
                if point.kind is end.point.kind:
                    return point
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("membrane", choices=MEMBRANES)
    parser.add_argument("file", type=Path, help="the diagram that diagram.py --file kept")
    given = parser.parse_args()
    clock, membrane = time.process_time(), MEMBRANES[given.membrane]
    path = RESULTS / f"wing_ends_{given.membrane}.csv"
    rows: list[list[object]] = []
    ends: list[EndOfMotion] = []
    for variant in variants():
        wing = variant.wing(membrane)
        problem = hbnlp.HarmonicBalance(wing, tolerance=variant.tolerance)
        if not ends:
            ends = list(
                ends_of(hbnlp.Diagram.load(given.file, problem=hbnlp.HarmonicBalance(wing, tolerance=TOLERANCE)))
            )
        for end in ends:
            named = [f"{end.point.value:.5g}", end.point.kind.value, variant.name]
            point = come_to(end, problem)
            if point is None:
                rows.append([*named, *[""] * (len(COLUMNS) - len(named))])
            else:
                believed = wing.validity(point.solution)
                numbers = [f"{point.value:.8g}", f"{point.multiplier:.6g}", f"{point.truncation_error:.1e}"]
                measures = (believed.camber, believed.tension_error, believed.beyond_band)
                rows.append([*named, *numbers, point.n_harmonics, *(f"{float(each[0]):.3g}" for each in measures)])
            sys.stderr.write(f"{time.process_time() - clock:7.1f} s  {' '.join(map(str, rows[-1]))}\n")
            write(path, COLUMNS, rows)


if __name__ == "__main__":
    main()
