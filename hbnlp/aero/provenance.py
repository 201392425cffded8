"""Where a ROM comes from and where it holds."""

from __future__ import annotations

from dataclasses import dataclass

from hbnlp.core.checks import real_number


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
        if not isinstance(self.source, str):
            raise TypeError(f"source is {self.source!r}; give text that says what made the ROM")
        checked: dict[str, object] = {"incidence": real_number("incidence", self.incidence)}
        if self.reynolds is not None:
            checked["reynolds"] = real_number(
                "reynolds", self.reynolds, above=0.0, advice=", or None if it is inviscid"
            )
        if self.fit_error is not None:
            checked["fit_error"] = real_number("fit_error", self.fit_error, least=0.0, advice=", or None")
        if self.band is not None:
            band = tuple(real_number("band", edge, least=0.0) for edge in self.band)
            if len(band) != 2 or band[0] >= band[1]:
                raise ValueError(f"band is {self.band!r}; give (lowest, highest) angular frequency, lowest < highest")
            checked["band"] = band
        for name, value in checked.items():
            object.__setattr__(self, name, value)
