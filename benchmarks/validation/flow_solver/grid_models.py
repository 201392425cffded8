"""Harmonic balance of the membrane with ROMs identified from the flow solver's own linear response, a grid each."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from results import RESULTS, complexes, exists, read

import hbnlp

N_MODES, HARMONICS = 10, 7
UP, LOWER = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (8.0, 6.0, 5.6, 5.3, 5.0, 4.7)
SHIPPED = hbnlp.aero.flat_plate_re100(n_modes=N_MODES)
# all poles: within 0.08 % of the finite elements
ELEMENTS = hbnlp.aero.flat_plate_re100(n_modes=N_MODES, full=True)


def grid_response(cells: int) -> hbnlp.aero.FrequencyResponse:
    """Linear response of the flow solver on a grid.

    Columns without a run (heave, which no pitching wing needs; modes 5 to 10 on the fine grid) are the finite
    elements'. The static response is theirs plus the difference at the lowest frequency: no run is at rest.
    """
    omega = np.array(read(f"band_pitch_{cells}")["omega"])
    values, static = ELEMENTS.transfer(1j * omega), ELEMENTS.stiffness.copy()
    for column, channel in enumerate(("pitch", "heave", *range(1, N_MODES + 1))):
        if exists(f"band_{channel}_{cells}"):
            data = read(f"band_{channel}_{cells}")
            measured = np.column_stack([complexes(data["lift"]), complexes(data["dCp"])])
            static[:, column] += (measured[0] - values[0, :, column]).real
            values[:, :, column] = measured
    source = f"hbnlp.dns, sharp plate of {cells} cells, six levels"
    return hbnlp.aero.FrequencyResponse(
        omega=omega,
        values=values,
        static=static,
        base_load=np.zeros(N_MODES + 1),
        provenance={"source": source, "reynolds": 100.0, "incidence": 0.0},
    )


def grid_rom(cells: int) -> hbnlp.aero.RationalFit:
    """ROM of a grid: eight common poles, 0.4 % at the lowest frequencies and 0.1 % above."""
    return hbnlp.aero.identify(grid_response(cells), tolerance=5e-3, most_poles=10)


@dataclass(frozen=True)
class Model:
    """First-harmonic lift by harmonic balance at the frequencies of the runs, and CPU seconds a frequency."""

    upper: dict[tuple[float, float], complex]
    lower: dict[tuple[float, float], complex]
    cpu_seconds: float


def solved(wing: hbnlp.System) -> Model:
    """Return the lift on the branch that comes from low frequency (traced) and on the one from high frequency."""
    begun = time.process_time()
    problem = hbnlp.HarmonicBalance(wing, n_harmonics=HARMONICS)
    upper: dict[tuple[float, float], complex] = {}
    lower: dict[tuple[float, float], complex] = {}
    at = {"omega": 2.0, "pitch_amplitude": math.radians(0.25)}
    upper[0.25, 2.0] = complex(hbnlp.solve(problem, at=at).harmonics("C_L")[1])
    at = {"pitch_amplitude": math.radians(2.5)}
    for side, span, omegas in ((upper, (0.9, 6.2), UP), (lower, (8.5, 4.0), LOWER)):
        branch = hbnlp.trace(problem, "omega", span, at=at, stability=None)
        for omega in omegas:
            # the first passage: the branch may fold further on
            passage = int(np.flatnonzero(np.diff(np.sign(branch.parameter - omega)))[0])
            solution = hbnlp.solve(problem, at={**at, "omega": omega}, start=branch.solution(passage))
            side[2.5, omega] = complex(solution.harmonics("C_L")[1])
    return Model(upper, lower, (time.process_time() - begun) / (len(upper) + len(lower)))


def models() -> dict[str, Model]:
    """Harmonic balance of either membrane with the shipped ROM and those of the grids."""
    roms = {"shipped": SHIPPED, **{str(cells): hbnlp.AeroROM.load(RESULTS / f"rom_{cells}.npz") for cells in (25, 50)}}
    membranes = {"nonlinear": hbnlp.NonlinearMembrane(), "quasi-linear": hbnlp.QuasiLinearMembrane()}
    return {
        f"{kind}, {name}": solved(hbnlp.membrane_wing(membrane, rom))
        for name, rom in roms.items()
        for kind, membrane in membranes.items()
    }
