"""Lift responses of wings, and fits of reduced-order models to data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from hbnlp.fourier import decibels
from hbnlp.plot.arguments import axes, result
from hbnlp.plot.branches import UNSTABLE

if TYPE_CHECKING:
    from hbnlp.aero.identification.report import RationalFit
    from hbnlp.wing.lift import LiftResponse


def plot_lift_response(response: LiftResponse, *, ax: Axes | None = None, **options: Any) -> Axes:
    """Draw C_L / alpha'' in decibels over log omega: a line a tension, from dark to light, and the rigid wing dotted.

    A wing that is unstable about rest never reaches its response: its line is dashed and thin.
    """
    result("response", response, "LiftResponse")
    ax = axes(ax)
    shades = plt.get_cmap("viridis")(np.linspace(0.0, 0.85, response.tensions.size))
    for tension, gain, growth, shade in zip(response.tensions, response.membrane, response.growth, shades, strict=True):
        style = {"linewidth": 1.4} if growth < 0.0 else UNSTABLE
        note = "" if growth < 0.0 else " (unstable)"
        drawn = {"color": shade, **style, "label": f"$c_T = {tension:g}${note}", **options}
        ax.semilogx(response.omega, decibels(gain), **drawn)
    ax.semilogx(response.omega, decibels(response.rigid), "k:", label="rigid wing")
    ax.set(xlabel=r"$\omega c/U$", ylabel=r"$|C_L| \,/\, |\alpha''|$ (dB)")
    ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.legend(frameon=False, fontsize="small")
    return ax


def plot_rational_fit(fit: RationalFit) -> Figure:
    """Draw data (points) against fit (lines), a panel a motion, and the relative error of the columns in the last.

    A load is drawn as ``|G - G(0)| / omega``, which shows low and high frequencies alike.
    """
    result("fit", fit, "RationalFit")
    response, rom = fit.response, fit.rom
    names, loads = response.motion_names, response.load_names
    shown = min(len(names), 8)
    fine = np.geomspace(response.omega[0], response.omega[-1], 400)
    lines = np.abs(rom.transfer(1j * fine) - rom.stiffness) / fine[:, None, None]
    points = np.abs(response.values - response.static) / response.omega[:, None, None]
    figure, panels = plt.subplots(3, 3, figsize=(11, 9), sharex=True, layout="constrained")
    for column, ax in zip(range(shown), panels.flat, strict=False):
        for row in range(min(len(loads), 4)):
            ax.loglog(fine, lines[:, row, column], color=f"C{row}", label=loads[row])
            ax.loglog(response.omega, points[:, row, column], ".", color=f"C{row}", markersize=4)
        ax.set_title(names[column])
        ax.grid(visible=True, alpha=0.3)
    for ax in panels.flat[shown:-1]:
        ax.set_visible(False)
    panels.flat[0].legend(fontsize="small")
    errors = response.column_errors(rom.transfer(1j * response.omega))
    ax = panels.flat[-1]
    ax.loglog(response.omega, errors, color="0.6", linewidth=0.8)
    ax.loglog(response.omega, errors.max(axis=1), color="k", label="largest")
    ax.axvspan(*fit.band, color="C0", alpha=0.1, label="band")
    ax.set_title("relative error of the columns")
    ax.set_ylabel("error / size")
    ax.legend(fontsize="small")
    for ax in panels[-1]:
        ax.set_xlabel(r"$\omega c/U$")
    for ax in panels[: 1 + (shown - 1) // 3, 0]:
        ax.set_ylabel(r"$|G - G(0)| \,/\, \omega$")
    figure.suptitle("data (points) and ROM (lines), a panel a motion")
    return figure
