"""Identification of a ROM from frequency responses and time records."""

from hbnlp.aero.identification.balancing import Balanced, balanced_truncation, reduce_to_band
from hbnlp.aero.identification.era import Realisation, ShortRecordWarning, realise
from hbnlp.aero.identification.report import RationalFit, identify
from hbnlp.aero.identification.vector_fitting import PoleFit, vector_fit

__all__ = [
    "Balanced",
    "PoleFit",
    "RationalFit",
    "Realisation",
    "ShortRecordWarning",
    "balanced_truncation",
    "identify",
    "realise",
    "reduce_to_band",
    "vector_fit",
]
