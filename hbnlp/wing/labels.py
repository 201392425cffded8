"""What the quantities of a wing are called on axes: without dimension, by chord, stream velocity and density."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

LABELS = {
    "omega": r"$\omega c/U$",
    "mass_ratio": r"$\mu$",
    "stiffness": "$Eh$",
    "prestrain": r"$\delta_0$",
    "pitch_axis": "pitch axis $/c$",
    "pitch_amplitude": "pitch amplitude",
    "pitch_mean": "mean pitch",
    "heave_amplitude": "heave amplitude $/c$",
    "heave_phase": "phase of the heave",
    "C_L": "$C_L$",
    "tension": "$c_T$",
    "midchord": r"$w_{1/2}/c$",
    "alpha": r"$\alpha$",
    "z": "$z/c$",
    "alpha_acceleration": r"$\alpha''$",
}
_ANGLES = {"alpha", "alpha_acceleration", "pitch_amplitude", "pitch_mean", "heave_phase"}


def labels_and_units(names: Iterable[str], n_modes: int) -> dict[str, Any]:
    """Return labels and units of these parameters and outputs of a wing, and of its modal amplitudes."""
    labels = {name: LABELS[name] for name in names if name in LABELS}
    labels |= {f"W{k}": f"$W_{{{k}}}/c$" for k in range(1, n_modes + 1)}
    return {"labels": labels, "units": {name: "rad" if name in _ANGLES else "1" for name in labels}}
