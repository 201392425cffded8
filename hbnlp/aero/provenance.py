"""Where a ROM comes from and where it holds."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from hbnlp.core.checks import interval, real_number, text
from hbnlp.core.errors import OutsideBandWarning
from hbnlp.core.types import ComplexArray


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Where a ROM comes from and where it holds; everything may be left out.

    Attributes
    ----------
    source : str
        What made it: a theory with its reference, a solver with its grid, an identification.
    reynolds : float or None
        Reynolds number of chord; None if not known, and for an inviscid ROM.
    incidence : float
        Mean incidence about which it was linearised, rad.
    band : tuple of two floats or None
        Lowest and highest angular frequency (U/c) to which it was fitted; None if it is not a fit.
    fit_error : float or None
        Relative error of the fit within the band, by the measure that ``source`` states.
    """

    source: str = ""
    reynolds: float | None = None
    incidence: float = 0.0
    band: tuple[float, float] | None = None
    fit_error: float | None = None

    def __post_init__(self) -> None:
        text("source", self.source)
        checked: dict[str, object] = {"incidence": real_number("incidence", self.incidence)}
        if self.reynolds is not None:
            checked["reynolds"] = real_number(
                "reynolds", self.reynolds, above=0.0, advice=", or None if it is inviscid"
            )
        if self.fit_error is not None:
            checked["fit_error"] = real_number("fit_error", self.fit_error, least=0.0, advice=", or None")
        if self.band is not None:
            checked["band"] = interval("band", self.band, least=0.0, advice=", angular frequencies")
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def facts(self) -> str:
        """What is known besides the source, in one line."""
        facts = [
            "inviscid or unknown Reynolds number" if self.reynolds is None else f"Re = {self.reynolds:g}",
            f"incidence {self.incidence:g} rad",
        ]
        if self.band is not None:
            facts.append(f"band {self.band[0]:g} to {self.band[1]:g}")
        if self.fit_error is not None:
            facts.append(f"fit error {self.fit_error:.2g}")
        return ", ".join(facts)

    def warn_outside_band(self, points: ComplexArray, *, stacklevel: int) -> None:
        """Warn of points of the imaginary axis, but zero, whose frequencies lie outside the band.

        Parameters
        ----------
        points : ndarray of complex, any shape
            Points of the s plane.
        stacklevel : int
            Whose line the warning names: 2 is that of the caller, 3 that of the caller's caller.
        """
        if self.band is None:
            return
        lowest, highest = self.band
        omega = np.abs(points.imag[(points.real == 0.0) & (points.imag != 0.0)])
        # round-off of a band's own ends is no departure from it
        outside = omega[(omega < lowest * (1.0 - 1e-9)) | (omega > highest * (1.0 + 1e-9))]
        if outside.size:
            warnings.warn(
                f"{outside.size} of {points.size} frequencies, from {outside.min():.4g} to {outside.max():.4g}, lie "
                f"outside the band {lowest:g} to {highest:g} for which the ROM's error is known: "
                "keep to the band, or identify a ROM from data that reach further",
                OutsideBandWarning,
                stacklevel=stacklevel,
            )
