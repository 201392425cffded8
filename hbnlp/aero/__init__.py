"""Linear unsteady aerodynamics: reduced-order models from the motion of a wing to its loads."""

from hbnlp.aero.flat_plate import flat_plate_re100, flat_plate_re100_response
from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.identification import (
    RationalFit,
    Realisation,
    ShortRecordWarning,
    balanced_truncation,
    identify,
    realise,
    reduce_to_band,
)
from hbnlp.aero.provenance import Provenance
from hbnlp.aero.rom import AeroROM
from hbnlp.aero.theodorsen import theodorsen_transfer, thin_airfoil

__all__ = [
    "AeroROM",
    "FrequencyResponse",
    "Provenance",
    "RationalFit",
    "Realisation",
    "ShortRecordWarning",
    "balanced_truncation",
    "flat_plate_re100",
    "flat_plate_re100_response",
    "identify",
    "realise",
    "reduce_to_band",
    "theodorsen_transfer",
    "thin_airfoil",
]
