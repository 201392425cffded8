"""Coupled runs against harmonic balance: ``python benchmarks/validation/flow_solver/compare_with_model.py``.

The runs themselves are cases of ``run_cases.py`` (``coupled_*``, ``march_*``), as are the linear responses of the same
grids (``band_*``). From those a ROM a grid is identified; harmonic balance with it and with the shipped ROM gives the
lift that the runs are compared with. Writes ``rom_25.npz``, ``rom_50.npz`` and the tables ``coupled_model.csv``,
``branches.csv`` and ``sensitivity.csv`` in benchmarks/validation/results, in half a minute.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

from grid_models import Model, grid_rom, models, solved
from results import RESULTS, Row, exists, read, read_all, write_table

import hbnlp

# where the branch from high frequency ends: harmonic balance finds it at 5 and not at 4
FOLD = 4.5


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
                if not exists(name):
                    continue
                data = read(name)
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
            rows.append([f"{degrees:g}", name, "", *polar(value), *beside])
    return rows


def _compared(lift: complex, same: complex, shipped: complex) -> Row:
    return [*polar(lift), f"{abs(same):.5f}", _apart(lift, same), _apart(lift, shipped)]


def polar(lift: complex) -> Row:
    """Modulus, and phase against the pitch in degrees, as the table shows them."""
    return [f"{abs(lift):.5f}", f"{math.degrees(cmath.phase(1j * lift)):.2f}"]


def branch_rows(found: dict[str, Model]) -> list[Row]:
    """Both branches at 2.5 degrees: the run that came from low frequency and the one that came from high frequency."""
    header = ["coming from", "omega", "h", "dt", "C_L", "still changing %", "camber", "same grid", "% from it"]
    rows = [[*header, "shipped", "% from it", "CPU s", "model CPU s"]]
    for way in ("up", "down"):
        entries = []
        for data in read_all(f"march_{way}"):
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
    rom = hbnlp.AeroROM.load(RESULTS / "rom_50.npz")
    damping = rom.damping.copy()
    damping[:, 2:] *= 1.1
    changed = replace(rom, damping=damping, provenance=hbnlp.aero.Provenance())
    damped = solved(hbnlp.membrane_wing(hbnlp.NonlinearMembrane(), changed))
    rows = [["omega", "run: C_L %", "run: phase (deg)", "damping + 10 %: C_L %", "phase (deg)"]]
    for hold in read("march_up_50")["holds"]:
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
        identified.rom.save(RESULTS / f"rom_{cells}.npz")
    found = models()
    write_table("coupled_model", coupled_rows(found))
    write_table("branches", branch_rows(found))
    write_table("sensitivity", sensitivity_rows(found))


if __name__ == "__main__":
    main()
