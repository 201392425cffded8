"""Pictures of identified ROMs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hbnlp.aero.identification import Identification


def plot_identification(fit: Identification) -> Figure:
    """Draw data (points) against fit (lines), a panel a motion, and the relative error of the columns in the last.

    A load is drawn as ``|G - G(0)| / omega``, which shows low and high frequencies alike.
    """
    response, rom = fit.response, fit.rom
    names = ["alpha", "z", *(f"W_{k}" for k in range(1, response.n_modes + 1))]
    loads = ["C_L", *(f"dCp_{k}" for k in range(1, response.n_modes + 1))]
    shown = min(len(names), 8)
    fine = np.geomspace(response.omega[0], response.omega[-1], 400)
    lines = np.abs(rom.transfer(1j * fine) - rom.stiffness) / fine[:, None, None]
    points = np.abs(response.values - response.static) / response.omega[:, None, None]
    figure, axes = plt.subplots(3, 3, figsize=(11, 9), sharex=True, layout="constrained")
    for column, ax in zip(range(shown), axes.flat, strict=False):
        for row in range(min(len(loads), 4)):
            ax.loglog(fine, lines[:, row, column], color=f"C{row}", label=loads[row])
            ax.loglog(response.omega, points[:, row, column], ".", color=f"C{row}", markersize=4)
        ax.set_title(names[column])
        ax.grid(visible=True, alpha=0.3)
    for ax in axes.flat[shown:-1]:
        ax.set_visible(False)
    axes.flat[0].legend(fontsize="small")
    errors = response.column_errors(rom.transfer(1j * response.omega))
    ax = axes.flat[-1]
    ax.loglog(response.omega, errors, color="0.6", linewidth=0.8)
    ax.loglog(response.omega, errors.max(axis=1), color="k", label="largest")
    ax.axvspan(*fit.band, color="C0", alpha=0.1, label="band")
    ax.set_title("relative error of the columns")
    ax.legend(fontsize="small")
    for ax in axes[-1]:
        ax.set_xlabel("omega c/U")
    figure.suptitle("|G - G(0)| / omega: data (points) and ROM (lines)")
    return figure
