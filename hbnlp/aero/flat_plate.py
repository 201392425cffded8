"""The shipped ROM of the flat plate at Re = 100 and zero incidence, and the response that it was fitted to."""

from __future__ import annotations

from functools import cache
from importlib.resources import as_file, files

import numpy as np

from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.identification.modal import lag_states
from hbnlp.aero.provenance import Provenance
from hbnlp.aero.rom import AeroROM
from hbnlp.core.checks import flag, whole_number
from hbnlp.core.storage import load_arrays

MOST_MODES = 20
_DATA = files("hbnlp.aero") / "data"
POLES_KIND = "poles and residues"


def flat_plate_re100(n_modes: int = 10, *, full: bool = False) -> AeroROM:
    """Return the aerodynamics of the flat plate at Reynolds number 100 and zero incidence.

    Fitted to the linear response of the Navier-Stokes equations by finite elements (`flat_plate_re100_response`) over
    angular frequencies 0.01 to 1000. Static heave gives no load, and heave velocity acts as minus pitch in the limit of
    low frequency, exactly.

    Parameters
    ----------
    n_modes : int
        Number N of membrane modes, up to 20: the leading block of what was computed.
    full : bool
        All poles, which is the better fit and has more lag states; by default they are reduced, to 60 or fewer for up
        to ten modes and 120 or fewer above. The errors reached are in the provenance of the ROM and in the
        documentation.

    Returns
    -------
    AeroROM

    Raises
    ------
    ValueError
        If ``n_modes`` is not from 0 to 20.
    """
    n = whole_number("n_modes", n_modes, least=0, most=MOST_MODES)
    flag("full", full)
    if full:
        return _full(n)
    return _reduced(10 if n <= 10 else MOST_MODES).truncated(n)


@cache
def flat_plate_re100_response() -> FrequencyResponse:
    """Return the raw response: 20 modes, 0 and 0.01 to 1000, with its provenance and error estimates."""
    with as_file(_DATA / "flat_plate_re100_response.npz") as path:
        return FrequencyResponse.load(path)


@cache
def _reduced(n_modes: int) -> AeroROM:
    with as_file(_DATA / f"flat_plate_re100_{n_modes}modes.npz") as path:
        return AeroROM.load(path)


@cache
def _full(n_modes: int) -> AeroROM:
    with as_file(_DATA / "flat_plate_re100_poles.npz") as path:
        arrays, about = load_arrays(path, POLES_KIND)
    y, u = slice(n_modes + 1), slice(n_modes + 2)
    a, b, c = lag_states(arrays["poles"], arrays["residues"][:, y, u])
    band: tuple[float, float] = (about["band"][0], about["band"][1])
    errors = np.asarray(about["errors"])
    return AeroROM(
        stiffness=arrays["stiffness"][y, u], damping=arrays["damping"][y, u], mass=arrays["mass"][y, u],
        lag_state=a, lag_input=b, lag_output=c,
        provenance=Provenance(
            source=about["source"], reynolds=100.0, band=band, fit_error=float(errors[n_modes])
        ),
    )  # fmt: skip
