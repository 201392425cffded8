"""Identification of a ROM from a frequency response, and the report of how good it is."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.identification.balancing import reduce_to_band
from hbnlp.aero.identification.modal import lag_states
from hbnlp.aero.identification.vector_fitting import PoleFit, fit_residues, vector_fit
from hbnlp.aero.provenance import Provenance
from hbnlp.aero.rom import AeroROM
from hbnlp.core.checks import finite_array, instance_of, interval, real_number, whole_number
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.types import Array, ComplexArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure


logger = logging.getLogger(__name__)

EXACT = 1e-8
"""An error below this comes of round-off: the data are a rational function of these poles."""

ONE_BY_ONE = 10
"""Up to so many poles every number is tried, then the even ones; one that is surplus is left out anyway."""

AHEAD = 4
"""So many more poles than the tolerance needs are tried, for data that they fit exactly."""

ROUNDING = 1e-11
"""A share of the data, relative to a column, below which nothing is told from round-off."""

UNSEEN = 1e-3
"""Lag states whose share in the data is below this part of the error are left out."""

CANCELS = 1e5
"""Poles with a larger share in the data cancel each other, as they do in fits of noise and of unstable flows."""

SURPLUS = 1.01
"""A pole without which the error grows by no more than this factor is not in the data."""


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


@interrupts_kept()
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

    The static value is exact, the lag states are stable by construction. Data that are a rational function, to
    round-off, of at most four poles more than the tolerance needs get all its poles. Poles that the data do not need
    are left out, and a pole has as many lag states as the data show of its residue; so quasi-steady data give none.
    Every error that is reported is that of the ROM that is returned. Data of an unstable flow have no ROM: what is
    returned is a stable fit with an error that says so.

    Where no number of poles reaches the tolerance, the data are taken to be noisy, and the number of poles is that of
    the least Schwarz criterion [1]_, ``d log(e^2) + c log(d)``, of d real numbers in the data, fitted by c coefficients
    with the root mean square e of the column errors. Further poles lower the error in the data, and raise that of the
    ROM. The noise is then estimated as ``e / sqrt(1 - c / d)``.

    Parameters
    ----------
    response : FrequencyResponse
    tolerance : float
        Largest relative error of any column within the band, for the fit before reduction. For measured data, the
        largest error of the data.
    band : tuple of two floats, optional
        Frequencies at which the error counts; all by default. Data outside are fitted as well.
    n_lags : int, optional
        Number of lag states that are kept at most, by balancing over the band and refitting; all by default.
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
        If the band holds no data, there are fewer than three frequencies, ``n_lags`` is negative, or a column of D is
        given as known whose data are zero.
    TypeError
        If ``response`` is something else.

    References
    ----------
    .. [1] G. Schwarz, "Estimating the dimension of a model", Ann. Statist. 6 (1978) 461-464,
       doi:10.1214/aos/1176344136.
    """
    instance_of("response", response, FrequencyResponse, "a FrequencyResponse, of a table FrequencyResponse.from_csv")
    real_number("tolerance", tolerance, above=0.0, below=1.0, advice=", relative to the columns")
    if n_lags is not None:
        whole_number("n_lags", n_lags, least=0)
    if band is not None:
        band = interval("band", band, least=0.0)
    whole_number("most_poles", most_poles, least=0)
    real_number("least_damping", least_damping, least=0.0, below=1.0)
    instance_of("damping", damping, Mapping | None, "a mapping of columns, counted from 0, to their values")
    for column, known in (damping or {}).items():
        whole_number("a column of damping", column, least=0, most=response.n_modes + 1)
        finite_array(f"damping[{column}]", known, (response.n_modes + 1,))
    for column, known in (damping or {}).items():
        if np.any(known) and not response.values[:, :, column].any():
            raise ValueError(
                f"damping[{column}] is {known}, but the response to {response.motion_names[column]} is zero at all "
                "frequencies; leave that column out, or give the response"
            )
    band = (float(response.omega[0]), float(response.omega[-1])) if band is None else band
    inside = response.band(*band)
    limit = min(most_poles, response.omega.size - 2)
    if limit < 1:
        raise ValueError(
            f"{response.omega.size} frequencies and most_poles {most_poles} are too few; give 3 and 1 or more"
        )
    tried: list[_Trial] = []
    enough = None
    for n_poles in (n for n in range(limit + 1) if n <= ONE_BY_ONE or n % 2 == 0):
        if enough is not None and n_poles > enough.n_poles + AHEAD:
            break
        fit = vector_fit(response, n_poles=n_poles, damping=damping, least_damping=least_damping)
        trial = _Trial.of(fit, response, inside)
        logger.info("%d poles: error %.2e, noise %.2e if any", n_poles, trial.error, trial.noise)
        tried.append(trial)
        if trial.error <= EXACT:
            enough = trial
            break
        if enough is None and trial.error <= tolerance:
            enough = trial
    best = min(tried, key=lambda trial: (trial.cancels, trial.criterion)) if enough is None else enough
    fit = without_surplus(best.fit, response, inside, damping=damping)
    rom = rom_from_poles(fit, response, band=band)
    if n_lags is not None and n_lags < rom.n_lags:
        rom = stated(reduce_to_band(rom, inside, n_lags=n_lags, known=tuple(damping or ())), response, band=band)
    found = RationalFit(rom=rom, response=response, band=band, n_poles=fit.poles.size)
    if enough is None:
        advice = (
            f"up to {limit} poles only fit the noise, some {best.noise:.1e}: "
            f"set tolerance to its largest, {best.error:.1e}"
            if best.n_poles < limit
            else "more poles may reach it, most_poles, or data at more frequencies"
        )
        logger.warning(
            "the error is %.2e with %d poles, above the tolerance %.2e; %s",
            found.error, found.n_poles, tolerance, advice,
        )  # fmt: skip
    return found


class _Trial(NamedTuple):
    """A fit with its error, whether its poles cancel, and noise and Schwarz's criterion if all error is noise."""

    fit: PoleFit
    error: float
    cancels: bool
    noise: float
    criterion: float

    @classmethod
    def of(cls, fit: PoleFit, response: FrequencyResponse, inside: FrequencyResponse) -> _Trial:
        errors = inside.column_errors(fit.transfer(np.asarray(1j * inside.omega, dtype=complex)))
        square, n, data = float(np.mean(errors**2)), fit.poles.size, 2 * response.values.size
        coefficients = (n + 2) * response.static.size + n
        shares = np.linalg.norm(fit.residues * reach(fit.poles, response)[:, None], axis=(1, 2))
        return cls(
            fit, float(errors.max()), bool(shares.max(initial=0.0) > CANCELS),
            float(np.sqrt(square / (1.0 - coefficients / data))),
            data * float(np.log(max(square, np.finfo(float).tiny))) + coefficients * float(np.log(data)),
        )  # fmt: skip

    @property
    def n_poles(self) -> int:
        return int(self.fit.poles.size)


def without_surplus(
    fit: PoleFit, response: FrequencyResponse, inside: FrequencyResponse, *, damping: Mapping[int, Array] | None = None
) -> PoleFit:
    """Return the fit without the poles that its error does not need: far outside the band, or two that cancel."""
    s = np.asarray(1j * inside.omega, dtype=complex)
    bound = max(SURPLUS * float(inside.column_errors(fit.transfer(s)).max()), ROUNDING)
    position = 0
    while position < fit.poles.size:
        pole = fit.poles[position]
        width = 1 if pole.imag == 0.0 else 2
        fewer = fit_residues(response, np.delete(fit.poles, slice(position, position + width)), damping=damping)
        if float(inside.column_errors(fewer.transfer(s)).max()) <= bound:
            logger.info("the pole %s is not in the data", pole)
            fit = fewer
        else:
            position += width
    return fit


def rom_from_poles(fit: PoleFit, response: FrequencyResponse, *, band: tuple[float, float]) -> AeroROM:
    """Return the ROM of a fit, every pole with as many lag states as its residue has rank in the data."""
    inside = response.band(*band)
    error = float(inside.column_errors(fit.transfer(np.asarray(1j * inside.omega, dtype=complex))).max())
    a, b, c = lag_states(
        fit.poles, fit.residues, weights=reach(fit.poles, response), drop=max(UNSEEN * error, ROUNDING)
    )
    base_motion = np.zeros(response.n_modes + 2)
    base_motion[0] = float(response.provenance.get("incidence", 0.0))
    rom = AeroROM(
        stiffness=fit.stiffness, damping=fit.damping, mass=fit.mass, lag_state=a, lag_input=b, lag_output=c,
        base_motion=base_motion, base_load=response.base_load,
    )  # fmt: skip
    return stated(rom, response, band=band)


def reach(poles: ComplexArray, response: FrequencyResponse) -> Array:
    """Return the largest share in a column that a unit of a pole's residue has at any frequency, (n, N+2)."""
    distance = np.abs(1j * response.omega[:, None] - poles) / np.where(poles.imag != 0.0, 2.0, 1.0)
    share = response.omega[:, None] ** 2 / distance
    return np.asarray(np.max(share[:, :, None] / response.column_sizes[:, None], axis=0))


def stated(rom: AeroROM, response: FrequencyResponse, *, band: tuple[float, float]) -> AeroROM:
    """Return the ROM with the provenance of the response, its own error within the band included."""
    inside = response.band(*band)
    bare = replace(rom, provenance=Provenance())
    error = float(inside.column_errors(bare.transfer(1j * inside.omega)).max())
    return replace(rom, provenance=provenance(response, band=band, error=error))


def provenance(response: FrequencyResponse, *, band: tuple[float, float], error: float) -> Provenance:
    """Return the ROM's provenance from the response's."""
    about: dict[str, Any] = dict(response.provenance)
    return Provenance(
        source=str(about.get("source", "frequency response")), reynolds=about.get("reynolds"),
        incidence=float(about.get("incidence", 0.0)), band=band, fit_error=error,
    )  # fmt: skip
