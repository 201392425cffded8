"""The tables of docs/dns.md from the result files: ``python benchmarks/validation/flow_solver/write_tables.py``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from results import Row, complexes, read, read_all, write_table

from hbnlp.aero import flat_plate_re100

PUBLISHED = {
    40: {"C_D": "1.50-1.54", "wake_length": "2.13-2.35"},
    100: {"C_D": "1.33-1.35", "C_L": ".33-.34", "St": ".164-.166"},
    200: {"C_D": "1.31-1.35", "C_L": ".68-.75", "St": ".192-.197"},
}


def _cylinder_rows() -> list[Row]:
    rows = [["Re", "quantity", "computed", "published"]]
    for data in sorted(read_all("cylinder"), key=lambda item: float(item["reynolds"])):
        for name, published in PUBLISHED[round(data["reynolds"])].items():
            rows.append([f"{data['reynolds']:g}", name, f"{data[name]:.4f}", published])
    return rows


def _wake_rows() -> list[Row]:
    """Cylinders that shed, in other fine boxes and on other cells; those of the cylinder's own table come last."""
    rows = [["Re", "fine box: x", "y", "levels", "h", "C_D", "C_L", "St"]]
    own = [read(f"cylinder_{reynolds}") for reynolds in (100, 200)]
    for group in (read_all("wake"), own):
        found = []
        for data in group:
            edges = zip(data["corner"], data["shape"], strict=True)
            spans = [f"{low:.2f} to {low + cells * data['h']:.2f}" for low, cells in edges]
            figures = [f"{data[name]:.4f}" for name in ("h", "C_D", "C_L", "St")]
            found.append([f"{data['reynolds']:g}", *spans, f"{data['levels']}", *figures])
        rows += sorted(found)
    return rows


def _plate_rows() -> list[Row]:
    rows = [["h", "levels", "C_D", "lift slope per rad", "change over the last 5 c/U"]]
    rows += [
        [f"{d['h']:.4f}", f"{d['levels']}", f"{d['C_D']:.4f}", f"{d['lift_slope']:.3f}", f"{d['change_in_5']:.3f}"]
        for d in sorted(read_all("plate"), key=lambda item: (-float(item["h"]), item["levels"]))
    ]
    return rows


def _column(data: dict[str, Any]) -> np.ndarray:
    """Loads [C_L, dCp_1, ...] per unit of the input, a frequency a row."""
    return np.column_stack([complexes(data["lift"]), complexes(data["dCp"])])


def _distance(values: np.ndarray, reference: np.ndarray) -> str:
    return f"{100.0 * np.linalg.norm(values - reference) / np.linalg.norm(reference):.1f}"


def _response_rows() -> list[Row]:
    """Every grid and the finite elements, an input and frequency at a time."""
    found: dict[str, dict[float, dict[str, Any]]] = {}
    for data in read_all("response"):
        found.setdefault(str(data["channel"]), {})[data["h"]] = data
    elements = flat_plate_re100(full=True)
    rows = [["input", "omega", "h", "C_L", "dCp_1", "dCp_2", "dCp_3", "difference %", "up to dCp_6 %", "order"]]
    for channel, grids in sorted(found.items()):
        omegas = np.array(next(iter(grids.values()))["omega"])
        index = 0 if channel == "pitch" else int(channel) + 1
        columns = {h: _column(d) for h, d in grids.items()}
        reference = elements.transfer(1j * omegas)[:, : next(iter(columns.values())).shape[1], index]
        spacings = sorted(columns)
        entries = [(f"{h:.4f}", columns[h]) for h in reversed(spacings)]
        orders = [""] * omegas.size
        if len(spacings) > 1:
            fine, coarse = spacings[:2]
            errors = [np.linalg.norm((columns[h] - reference)[:, :4], axis=1) for h in (fine, coarse)]
            orders = [f"{order:.2f}" for order in np.log(errors[1] / errors[0]) / math.log(coarse / fine)]
        label = channel if channel == "pitch" else f"W_{channel}"
        for i, omega in enumerate(omegas):
            for name, values in entries:
                loads = [f"{z:.3f}" for z in values[i, :4]]
                errors_here = [_distance(values[i, :n], reference[i, :n]) for n in (4, 7)]
                order = orders[i] if name == f"{spacings[0]:.4f}" else ""
                rows.append([label, f"{omega:.3g}", name, *loads, *errors_here, order])
            finite = [f"{z:.3f}" for z in reference[i, :4]]
            rows.append([label, f"{omega:.3g}", "finite elements", *finite, "", "", ""])
    return rows


def _era_rows() -> list[Row]:
    """Difference of the realised response from the finite elements' and from the measured one of the same grid."""
    elements = flat_plate_re100(full=True)
    rows = [["input", "omega", "h", "from finite elements %", "from the response of the grid %"]]
    for data in sorted(read_all("era"), key=lambda item: -float(item["h"])):
        cells, omegas = round(1.0 / data["h"]), np.array(data["omega"])
        reference = elements.transfer(1j * omegas)
        for channel in ("pitch", "1", "2", "3"):
            index = 0 if channel == "pitch" else int(channel) + 1
            values = complexes(data["columns"][channel])
            measured = _column(read(f"band_{channel}_{cells}"))[:, :4]
            label = channel if channel == "pitch" else f"W_{channel}"
            rows += [
                [label, f"{omega:g}", f"{data['h']:.4f}"]
                + [_distance(values[i], other) for other in (reference[i, :4, index], measured[i])]
                for i, omega in enumerate(omegas)
                if omega in {0.5, 1.0, 3.0, 10.0}
            ]
    return rows


def _coupled_rows() -> list[Row]:
    rows = [
        [
            "alpha_2 (deg)",
            "h",
            "dt",
            "C_L amplitude",
            "C_L / alpha''",
            "W_1",
            "max strain",
            "centrifugal / dCp",
            "CPU s",
        ]
    ]
    rows += [
        [
            f"{d['degrees']:g}",
            f"{d['h']:.4f}",
            f"{d['dt']:.4f}",
            f"{abs(complex(*d['lift'])):.4f}",
            f"{d['lift_per_acceleration']:.3f}",
            f"{abs(complex(*d['W'][0])):.4f}",
            f"{d['max_strain']:.2e}",
            f"{d['centrifugal_over_pressure']:.1e}",
            f"{d['provenance']['cpu_seconds']:.0f}",
        ]
        for d in sorted(read_all("coupled"), key=lambda item: (item["degrees"], -float(item["h"]), -float(item["dt"])))
    ]
    return rows


TABLES = {
    "cylinder": _cylinder_rows,
    "wake": _wake_rows,
    "plate": _plate_rows,
    "response": _response_rows,
    "era": _era_rows,
    "coupled": _coupled_rows,
}


def write_tables() -> None:
    """Write them all."""
    for name, rows in TABLES.items():
        write_table(name, rows())


if __name__ == "__main__":
    write_tables()
