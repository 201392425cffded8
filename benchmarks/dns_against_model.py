"""Coupled runs of the flow solver against harmonic balance: ``python benchmarks/dns_against_model.py``.

The runs themselves are cases of ``benchmarks/dns_validation.py`` (``coupled_*``, ``march_*``), as are the linear
responses of the same grids (``band_*``). From those a ROM a grid is identified; harmonic balance with it and with the
shipped ROM gives the lift that the runs are compared with. Writes ``rom_25.npz``, ``rom_50.npz`` and the
tables ``coupled_model.csv``, ``branches.csv`` and ``sensitivity.csv`` in docs/data/dns, in half a minute.
"""

from __future__ import annotations

import cmath
import csv
import json
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import hbnlp

DATA = Path(__file__).parent.parent / "docs" / "data" / "dns"
N_MODES, HARMONICS = 10, 7
UP, LOWER = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (8.0, 6.0, 5.6, 5.3, 5.0, 4.7)
# where the branch from high frequency ends: harmonic balance finds it at 5 and not at 4
FOLD = 4.5
SHIPPED = hbnlp.aero.flat_plate_re100(n_modes=N_MODES)
# all poles: within 0.08 % of the finite elements
ELEMENTS = hbnlp.aero.flat_plate_re100(n_modes=N_MODES, full=True)
Row = list[str]


def _read(name: str) -> dict[str, Any]:
    return dict(json.loads((DATA / f"{name}.json").read_text()))


def _complexes(pairs: Any) -> np.ndarray:
    array = np.asarray(pairs, dtype=float)
    return array[..., 0] + 1j * array[..., 1]


def grid_response(cells: int) -> hbnlp.aero.FrequencyResponse:
    """Linear response of the flow solver on a grid.

    Columns without a run (heave, which no pitching wing needs; modes 5 to 10 on the fine grid) are the finite
    elements'. The static response is theirs plus the difference at the lowest frequency: no run is at rest.
    """
    omega = np.array(_read(f"band_pitch_{cells}")["omega"])
    values, static = ELEMENTS.transfer(1j * omega), ELEMENTS.stiffness.copy()
    for column, channel in enumerate(("pitch", "heave", *range(1, N_MODES + 1))):
        if (DATA / f"band_{channel}_{cells}.json").exists():
            data = _read(f"band_{channel}_{cells}")
            measured = np.column_stack([_complexes(data["lift"]), _complexes(data["dCp"])])
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
            solution = hbnlp.solve(problem, at={**at, "omega": omega}, guess=branch.solution(passage))
            side[2.5, omega] = complex(solution.harmonics("C_L")[1])
    return Model(upper, lower, (time.process_time() - begun) / (len(upper) + len(lower)))


def models() -> dict[str, Model]:
    """Harmonic balance of either membrane with the shipped ROM and those of the grids."""
    roms = {"shipped": SHIPPED, **{str(cells): hbnlp.AeroROM.load(DATA / f"rom_{cells}.npz") for cells in (25, 50)}}
    membranes = {"nonlinear": hbnlp.NonlinearMembrane(), "quasi-linear": hbnlp.QuasiLinearMembrane()}
    return {
        f"{kind}, {name}": solved(hbnlp.membrane_wing(membrane, rom))
        for name, rom in roms.items()
        for kind, membrane in membranes.items()
    }


def _apart(run: complex, model: complex) -> str:
    """Difference of the moduli and modulus of the difference, per cent."""
    return f"{100.0 * (abs(run) / abs(model) - 1.0):+.2f} ({100.0 * abs(run - model) / abs(model):.2f})"


def coupled_rows(found: dict[str, Model]) -> list[Row]:
    """Omega = 2: two grids and two time steps at two amplitudes, and what is left when the time step goes to zero.

    The time step's error is of second order; runs that are not there are left out.
    """
    header = [
        "alpha_2 (deg)",
        "h",
        "dt",
        "C_L",
        "phase (deg)",
        "same grid",
        "% from it",
        "% from shipped",
        "CPU s",
    ]
    rows = [header]
    for degrees in (0.25, 2.5):
        shipped = found["nonlinear, shipped"].upper[degrees, 2.0]
        for cells in (25, 50):
            same = found[f"nonlinear, {cells}"].upper[degrees, 2.0]
            steps, spacing = [], 0.0
            for suffix in ("", "_half_dt"):
                name = f"coupled_{degrees:g}_{cells}{suffix}"
                if not (DATA / f"{name}.json").exists():
                    continue
                data = _read(name)
                spacing = data["h"]
                steps.append(complex(*data["lift"]))
                about = [f"{degrees:g}", f"{data['h']:.4f}", f"{data['dt']:.4f}"]
                rows.append([*about, *_compared(steps[-1], same, shipped), f"{data['provenance']['cpu_seconds']:.0f}"])
            if len(steps) == 2:
                limit = steps[1] + (steps[1] - steps[0]) / 3.0
                rows.append([f"{degrees:g}", f"{spacing:.4f}", "to 0", *_compared(limit, same, shipped), ""])
        for kind in ("nonlinear", "quasi-linear"):
            model = found[f"{kind}, shipped"]
            value = model.upper[degrees, 2.0]
            name = f"harmonic balance, {kind}"
            beside = ["", "", _apart(value, shipped), f"{model.cpu_seconds:.2f}"]
            rows.append([f"{degrees:g}", name, "", *_polar(value), *beside])
    return rows


def _compared(lift: complex, same: complex, shipped: complex) -> Row:
    return [*_polar(lift), f"{abs(same):.5f}", _apart(lift, same), _apart(lift, shipped)]


def _polar(lift: complex) -> Row:
    return [f"{abs(lift):.5f}", f"{math.degrees(cmath.phase(1j * lift)):.2f}"]


def branch_rows(found: dict[str, Model]) -> list[Row]:
    """Both branches at 2.5 degrees: the run that came from low frequency and the one that came from high frequency."""
    header = ["coming from", "omega", "h", "dt", "C_L", "still changing %", "camber", "same grid", "% from it"]
    rows = [[*header, "shipped", "% from it", "CPU s", "model CPU s"]]
    for way in ("up", "down"):
        entries = []
        for path in sorted(DATA.glob(f"march_{way}_*.json")):
            data = json.loads(path.read_text())
            entries += [(hold["omega"], -data["h"], -data["dt"], hold) for hold in data["holds"]]
        for omega, h, dt, hold in sorted(entries, key=lambda item: item[:3]):
            cells = round(-1.0 / h)
            # the lower branch ends at its fold before omega = 4
            side = "lower" if way == "down" and omega > FOLD else "upper"
            same, shipped = (getattr(found[f"nonlinear, {name}"], side)[2.5, omega] for name in (cells, "shipped"))
            lift = complex(*hold["lift"][0])
            rows.append(
                [{"up": "below", "down": "above"}[way], f"{omega:g}", f"{-h:.4f}", f"{-dt:.4f}", f"{abs(lift):.4f}",
                 f"{100.0 * hold['change_over_last_period']:.2f}", f"{hold['camber']:.3f}", f"{abs(same):.4f}",
                 _apart(lift, same), f"{abs(shipped):.4f}", _apart(lift, shipped), f"{hold['cpu_seconds']:.0f}",
                 f"{found[f'nonlinear, {cells}'].cpu_seconds:.2f}"]
            )  # fmt: skip
    return rows


def sensitivity_rows(found: dict[str, Model]) -> list[Row]:
    """How far lift on the large branch is off, and what a tenth more aerodynamic damping of the membrane does to it."""
    rom = hbnlp.AeroROM.load(DATA / "rom_50.npz")
    damping = rom.damping.copy()
    damping[:, 2:] *= 1.1
    arrays = {name: getattr(rom, name) for name in ("stiffness", "mass", "lag_state", "lag_input", "lag_output")}
    damped = solved(hbnlp.membrane_wing(hbnlp.NonlinearMembrane(), hbnlp.AeroROM(damping=damping, **arrays)))
    rows = [["omega", "run: C_L %", "run: phase (deg)", "damping + 10 %: C_L %", "phase (deg)"]]
    for hold in _read("march_up_50")["holds"]:
        model = found["nonlinear, 50"].upper[2.5, hold["omega"]]
        row = [f"{hold['omega']:g}"]
        for other in (complex(*hold["lift"][0]), damped.upper[2.5, hold["omega"]]):
            turned = math.degrees(cmath.phase(other / model))
            row += [f"{100.0 * (abs(other / model) - 1.0):+.2f}", f"{turned:+.2f}"]
        rows.append(row)
    return rows


def main() -> None:
    """Identify, solve, and write everything."""
    for cells in (25, 50):
        identified = grid_rom(cells)
        print(identified)
        identified.rom.save(DATA / f"rom_{cells}.npz")
    found = models()
    tables = {
        "coupled_model": coupled_rows(found),
        "branches": branch_rows(found),
        "sensitivity": sensitivity_rows(found),
    }
    for name, rows in tables.items():
        with (DATA / f"{name}.csv").open("w", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows(rows)


if __name__ == "__main__":
    main()
