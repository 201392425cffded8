"""The paper's wing, and what the scripts beside this one share: its motion from rest, slow marches, results."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

import hbnlp
from hbnlp.fourier import to_real

RESULTS = Path(__file__).parents[1] / "results"
MEMBRANES = {"quasi_linear": hbnlp.QuasiLinearMembrane, "nonlinear": hbnlp.NonlinearMembrane}
PITCH = float(np.radians(2.5))
SETTLE = 480.0
"""Units of time that a motion from rest is integrated for."""
LEG = ("way", "branch", "enters", "leaves", "at", "next", "falls_at")


def paper_wing(membrane: str, n_modes: int = 10, rom: hbnlp.AeroROM | None = None) -> hbnlp.System:
    """Return the wing with one of the `MEMBRANES`, on the shipped ROM where no other is given."""
    own = MEMBRANES[membrane](mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=n_modes)
    return hbnlp.membrane_wing(own, rom or hbnlp.aero.flat_plate_re100(n_modes=n_modes))


def from_rest(problem: hbnlp.HarmonicBalance, at: dict[str, float]) -> hbnlp.Solution | None:
    """Return the motion that rest leads to at these values, if it is a periodic one."""
    periods = int(SETTLE * at["omega"] / (2.0 * np.pi))
    response = hbnlp.integrate(problem.system, at=at, max_periods=periods, throw=False)
    if response.stopped_at is not None:
        return None
    motion = hbnlp.solve(problem, at=at, start=to_real(response.displacement_harmonics(15)), throw=False)
    return motion if motion.converged else None


def legs(diagram: hbnlp.Diagram) -> Iterator[dict[str, object]]:
    """Yield what slow marches do, leg by leg (`LEG`): up from low frequencies, down from the highest motion."""
    far = [each for each in diagram.stretches() if each.stable and diagram.origins[each.branch].value is not None]
    # rest leads to the last of those from the highest frequency; where to none, the march begins on what is stable
    highest = max(far, key=lambda each: (each.high, each.branch)).branch if far else None
    for way, branch in (("up", 0), ("down", highest)):
        for leg in diagram.march(way, branch=branch).legs:
            point = leg.stretch.at_high if way == "up" else leg.stretch.at_low
            kind = "end" if point is None else point.kind.value
            row = (way, leg.stretch.branch, leg.enters, leg.leaves, kind, leg.next.name.lower(), leg.falls_at)
            yield dict(zip(LEG, row, strict=True))


def write(path: Path, header: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table, whole or not at all."""
    part = path.with_suffix(".part")
    with part.open("w", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([header, *rows])
    part.replace(path)
