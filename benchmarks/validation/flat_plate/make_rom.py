"""Make the shipped ROM of the flat plate from a campaign: fit, reduce, check, write the data files and the pictures.

python -m hbnlp.aero.linear_flow response.npz --probes 5
python benchmarks/validation/flat_plate/make_rom.py response.npz
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np

from hbnlp.aero.flat_plate import MOST_MODES, POLES_KIND
from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.identification import PoleFit, reduce_to_band, vector_fit
from hbnlp.aero.identification.report import RationalFit, provenance, rom_from_poles
from hbnlp.aero.rom import AeroROM
from hbnlp.core.storage import save_arrays

mpl.use("Agg")
BAND = (0.01, 1000.0)
ROOT = Path(__file__).parents[3]
DATA = ROOT / "hbnlp" / "aero" / "data"
REDUCED = {10: 60, 20: 120}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("response", type=Path)
    parser.add_argument("--poles", type=int, default=0, help="number of poles; by default found by the tolerance")
    parser.add_argument("--pictures", type=Path, default=ROOT / "docs" / "_static" / "linear_flow")
    options = parser.parse_args()
    computed = FrequencyResponse.load(options.response)
    response, damping = without_static_heave(computed)
    response.save(DATA / "flat_plate_re100_response.npz")
    fit, error = full_fit(response, damping, options.poles)
    inside = response.band(*BAND)
    errors = [
        float(inside.truncated(n).column_errors(fit.transfer(1j * inside.omega)[:, : n + 1, : n + 2]).max())
        for n in range(MOST_MODES + 1)
    ]
    about = provenance(response, band=BAND, error=error)
    save_arrays(
        DATA / "flat_plate_re100_poles.npz",
        POLES_KIND,
        {name: getattr(fit, name) for name in ("poles", "residues", "stiffness", "damping", "mass")},
        {"source": about.source, "band": list(BAND), "errors": errors},
    )
    summary = {"poles": [[p.real, p.imag] for p in fit.poles], "error_full": errors}
    options.pictures.mkdir(parents=True, exist_ok=True)
    for n_modes, n_lags in REDUCED.items():
        block = response.truncated(n_modes)
        part = replace(
            fit,
            residues=fit.residues[:, : n_modes + 1, : n_modes + 2],
            stiffness=block.static,
            damping=fit.damping[: n_modes + 1, : n_modes + 2],
            mass=fit.mass[: n_modes + 1, : n_modes + 2],
        )
        full = rom_from_poles(part, block, band=BAND)
        started = time.perf_counter()
        rom = with_error(reduce_to_band(full, block, n_lags=n_lags, known=(1,)), block)
        rom.save(DATA / f"flat_plate_re100_{n_modes}modes.npz")
        report = RationalFit(rom=rom, response=block, band=BAND, n_poles=fit.poles.size)
        report.plot().savefig(options.pictures / f"fit_{n_modes}modes.png", dpi=90)
        summary[f"{n_modes} modes"] = {
            "lag_states_full": full.n_lags,
            "lag_states": rom.n_lags,
            "error": report.error,
            "seconds": time.perf_counter() - started,
        }
        print(report, flush=True)
    print(json.dumps(summary, indent=1))


def without_static_heave(computed: FrequencyResponse) -> tuple[FrequencyResponse, dict[int, np.ndarray]]:
    """Return the response less its static heave, and the damping of heave that theory gives.

    Static heave is null; where the discretisation leaves a load it is the same at all low frequencies, and is taken off
    there too.
    """
    rest = computed.static[:, 1].copy()
    static, values = computed.static.copy(), computed.values.copy()
    static[:, 1] = 0.0
    values[:, :, 1] -= rest
    damping = -static[:, 0]
    damping[0] -= computed.provenance["drag"]
    about = dict(computed.provenance) | {"static_heave_taken_off": float(np.abs(rest).max())}
    return replace(computed, static=static, values=values, provenance=about), {1: damping}


def full_fit(response: FrequencyResponse, damping: dict[int, np.ndarray], n_poles: int) -> tuple[PoleFit, float]:
    """Return the fit with the number of poles asked for, or with the least number that reaches a tenth of a percent."""
    inside = response.band(*BAND)
    for n in [n_poles] if n_poles else range(8, 33, 2):
        fit = vector_fit(response, n_poles=n, damping=damping, least_damping=0.7)
        error = float(inside.column_errors(fit.transfer(1j * inside.omega)).max())
        print(f"{n} poles: {error:.2e}", flush=True)
        if error < 1e-3:
            break
    return fit, error


def with_error(rom: AeroROM, response: FrequencyResponse) -> AeroROM:
    inside = response.band(*BAND)
    error = float(inside.column_errors(rom.transfer(1j * inside.omega)).max())
    return replace(rom, provenance=provenance(response, band=BAND, error=error))


if __name__ == "__main__":
    main()
