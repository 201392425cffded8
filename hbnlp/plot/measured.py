"""Identified responses: measured amplitudes on the branch that they give, and what is left between the two."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from hbnlp.plot.arguments import axis, result
from hbnlp.plot.branches import plot_branch

if TYPE_CHECKING:
    from hbnlp.identification.measured import MeasuredFit

WAYS = {"up": ("^", "measured, up"), "down": ("v", "measured, down"), "": ("o", "measured")}
USED: dict[str, Any] = {
    "color": "tab:orange",
    "markersize": 6.0,
    "linestyle": "none",
    "markeredgecolor": "white",
    "markeredgewidth": 0.5,
}
WRONG: dict[str, Any] = {"marker": "x", "color": "tab:red", "markersize": 7.0, "linestyle": "none", "zorder": 4}


def plot_measured_fit(fit: MeasuredFit) -> Figure:
    """Draw measurements on the branch of the identified values, and their residuals in standard deviations below.

    The band of residuals is that of two standard deviations. Wrong measurements are crosses, in both.
    """
    result("fit", fit, "MeasuredFit")
    measured, used = fit.measurements, fit.used
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(6.4, 5.6), height_ratios=(3, 1.2), sharex=True, layout="constrained"
    )
    plot_branch(fit.branch, fit.output, ax=above, harmonic=fit.harmonic, color="tab:blue", special=False)
    residuals = np.sqrt(fit.weights) * fit.residuals / fit.identified.noise
    for way, (marker, label) in WAYS.items():
        of_way = used & np.array([each == way for each in measured.way])
        if of_way.any():
            above.plot(measured.omega[of_way], measured.amplitude[of_way], marker=marker, label=label, **USED)
            below.plot(measured.omega[of_way], residuals[of_way], marker=marker, **USED)
    largest = 1.25 * max(float(np.abs(residuals[used]).max(initial=0.0)), 2.5)
    if fit.wrong.size:
        above.plot(measured.omega[fit.wrong], measured.amplitude[fit.wrong], label="wrong, left out", **WRONG)
        below.plot(measured.omega[fit.wrong], np.clip(residuals[fit.wrong], -largest, largest), **WRONG, clip_on=False)
    above.set_xlabel("")
    above.set_title(_values(fit), fontsize="medium", loc="left")
    above.legend(frameon=False)
    below.axhspan(-2.0, 2.0, color="0.92", zorder=0)
    below.axhline(0.0, color="0.5", linewidth=0.8)
    wide = 0.04 * float(np.ptp(measured.omega))
    below.set(
        xlabel=axis(fit.branch, "omega"), ylabel=r"residual $/\,\sigma$", ylim=(-largest, largest),
        xlim=(measured.omega.min() - wide, measured.omega.max() + wide),
    )  # fmt: skip
    return figure


def _values(fit: MeasuredFit) -> str:
    """Return the identified values with half the widths of their intervals of 95 per cent."""
    said = []
    for name, (low, high) in fit.confidence().items():
        rest = "at its limit" if name in fit.at_limit else rf"$\pm$ {0.5 * (high - low):.2g}"
        said.append(f"{name} {fit.values[name]:.4g} {rest}")
    return "\n".join(said)
