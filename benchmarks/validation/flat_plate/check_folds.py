"""Folds of the paper's wing with all poles of the shipped ROM and with the reduced one."""

from __future__ import annotations

import numpy as np

import hbnlp
from hbnlp.aero import flat_plate_re100

SPAN = (8.0, 0.6)


def folds(*, full: bool, degrees: float, n_harmonics: int = 5) -> list[float]:
    """Return the folds in omega of the quasi-linear wing, mu = 0.5, Eh = 250, delta0 = 0.002, ten modes."""
    membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
    wing = hbnlp.membrane_wing(
        membrane, flat_plate_re100(full=full), parameters={"pitch_amplitude": np.deg2rad(degrees)}
    )
    branch = hbnlp.trace(hbnlp.HarmonicBalance(wing, n_harmonics=n_harmonics), "omega", SPAN)
    return [fold.value for fold in branch.folds]


def main() -> None:
    for degrees in (2.5, 5.0):
        full, reduced = (folds(full=full, degrees=degrees) for full in (True, False))
        print(f"{degrees} degrees: {len(full)} folds with all poles, {len(reduced)} reduced")
        for a, b in zip(full, reduced, strict=False):
            print(f"  {a:.6f} {b:.6f}  {b / a - 1:+.2e}", flush=True)


if __name__ == "__main__":
    main()
