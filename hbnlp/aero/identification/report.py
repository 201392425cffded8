"""Identification of a ROM from a frequency response, and the report of how good it is."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.identification.balancing import reduce_to_band
from hbnlp.aero.identification.modal import lag_states
from hbnlp.aero.identification.vector_fitting import PoleFit, vector_fit
from hbnlp.aero.provenance import Provenance
from hbnlp.aero.rom import AeroROM
from hbnlp.core.checks import instance_of, real_number
from hbnlp.core.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


logger = logging.getLogger(__name__)

NO_BETTER = 1.2
"""More poles that lower the estimated noise by no more than this factor fit the noise itself."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RationalFit:
    """A ROM with the data that it was fitted to.

    Attributes
    ----------
    rom : AeroROM
    response : FrequencyResponse
        The data.
    band : tuple of two floats
        Where the error is stated.
    n_poles : int
        Number of common poles of the fit before any reduction.
    """

    rom: AeroROM
    response: FrequencyResponse
    band: tuple[float, float]
    n_poles: int

    @property
    def errors(self) -> Array:
        """Relative error of every column at the frequencies within the band, (m, N+2)."""
        inside = self.response.band(*self.band)
        return inside.column_errors(self.rom.transfer(1j * inside.omega))

    @property
    def error(self) -> float:
        """The largest of `errors`."""
        return float(self.errors.max())

    def plot(self) -> Figure:
        """Draw data against fit, an input a panel; see `hbnlp.plot.plot_rational_fit`."""
        from hbnlp.plot import plot_rational_fit

        figure: Figure = plot_rational_fit(self)
        return figure

    def __repr__(self) -> str:
        worst = self.errors.max(axis=0)
        column = int(worst.argmax())
        return (
            f"RationalFit: {self.n_poles} poles, {self.rom.n_lags} lag states\n"
            f"  largest relative error of a column {worst[column]:.2e} ({self.response.motion_names[column]}), "
            f"band {self.band[0]:g} to {self.band[1]:g}"
        )


def identify(
    response: FrequencyResponse,
    *,
    tolerance: float = 5e-3,
    band: tuple[float, float] | None = None,
    n_lags: int | None = None,
    damping: Mapping[int, Array] | None = None,
    most_poles: int = 40,
    least_damping: float = 1e-6,
) -> RationalFit:
    """Identify a ROM: as few common poles as reach the tolerance, then, if asked, as few lag states as given.

    The static value is exact, the lag states are stable by construction.

    Where no number of poles reaches the tolerance, the data are taken to be noisy. A fit of n poles to m frequencies
    has n + 2 coefficients for the 2 m real numbers of an entry, so the noise is estimated as the root mean square of
    the column errors over ``sqrt(1 - (n + 2) / 2 m)``; the fewest poles are taken whose estimate is within a fifth of
    the least one. Further poles lower the error in the data, and raise that of the ROM.

    Parameters
    ----------
    response : FrequencyResponse
    tolerance : float
        Largest relative error of any column within the band, for the fit before reduction. For measured data, the
        largest error of the data.
    band : tuple of two floats, optional
        Frequencies at which the error counts; all by default. Data outside are fitted as well.
    n_lags : int, optional
        Number of lag states to reduce to, by balancing over the band and refitting; all by default.
    damping : mapping of int to ndarray, shape (N+1,), optional
        Columns of D that are known, by their index (see `vector_fit`).
    most_poles : int
        Where the search for the number of poles ends.
    least_damping : float
        Least damping ratio of a pole (see `vector_fit`).

    Returns
    -------
    RationalFit
        Its ``error`` is what was reached, which a warning of the log says if it is above the tolerance.

    Raises
    ------
    ValueError
        If the band holds no data, or ``n_lags`` is more than the fit has.
    TypeError
        If ``response`` is something else.
    """
    instance_of("response", response, FrequencyResponse, "a FrequencyResponse, of a table FrequencyResponse.from_csv")
    real_number("tolerance", tolerance, above=0.0)
    band = (float(response.omega[0]), float(response.omega[-1])) if band is None else band
    inside = response.band(*band)
    limit = min(most_poles, response.omega.size - 2)
    tried: list[tuple[float, float, PoleFit]] = []
    for n_poles in range(min(4, limit), limit + 1, 2):
        fit = vector_fit(response, n_poles=n_poles, damping=damping, least_damping=least_damping)
        errors = inside.column_errors(fit.transfer(np.asarray(1j * inside.omega, dtype=complex)))
        error = float(errors.max())
        noise = float(np.sqrt(np.mean(errors**2) / (1.0 - (n_poles + 2) / (2 * response.omega.size))))
        logger.info("%d poles: error %.2e, noise %.2e if any", n_poles, error, noise)
        tried.append((error, noise, fit))
        if error <= tolerance:
            break
    if not tried:
        raise ValueError(f"{response.omega.size} frequencies are too few; give at least 6")
    error, noise, fit = tried[-1]
    if error > tolerance:
        enough = NO_BETTER * min(noise for _, noise, _ in tried)
        error, noise, fit = next(each for each in tried if each[1] <= enough)
        most = tried[-1][2].poles.size
        advice = f"up to {most} poles only fit the noise, some {noise:.1e}: set tolerance to its largest, {error:.1e}"
        if fit.poles.size == most:
            advice = "more poles may reach it, most_poles, or data at more frequencies"
        logger.warning(
            "the error is %.2e with %d poles, above the tolerance %.2e; %s", error, fit.poles.size, tolerance, advice
        )
    rom = rom_from_poles(fit, response, band=band, error=error)
    if n_lags is not None:
        rom = reduce_to_band(rom, inside, n_lags=n_lags, known=tuple(damping or ()))
        error = float(inside.column_errors(rom.transfer(1j * inside.omega)).max())
        rom = replace(rom, provenance=provenance(response, band=band, error=error))
    return RationalFit(rom=rom, response=response, band=band, n_poles=fit.poles.size)


def rom_from_poles(fit: PoleFit, response: FrequencyResponse, *, band: tuple[float, float], error: float) -> AeroROM:
    """Return the ROM of a fit, every pole with as many lag states as its residue has rank."""
    a, b, c = lag_states(fit.poles, fit.residues)
    about = provenance(response, band=band, error=error)
    base_motion = np.zeros(response.n_modes + 2)
    base_motion[0] = about.incidence
    return AeroROM(
        stiffness=fit.stiffness, damping=fit.damping, mass=fit.mass, lag_state=a, lag_input=b, lag_output=c,
        base_motion=base_motion, base_load=response.base_load, provenance=about,
    )  # fmt: skip


def provenance(response: FrequencyResponse, *, band: tuple[float, float], error: float) -> Provenance:
    """Return the ROM's provenance from the response's."""
    about: dict[str, Any] = dict(response.provenance)
    return Provenance(
        source=str(about.get("source", "frequency response")), reynolds=about.get("reynolds"),
        incidence=float(about.get("incidence", 0.0)), band=band, fit_error=error,
    )  # fmt: skip
