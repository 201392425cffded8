"""Parameters from measured amplitudes, with their uncertainty."""

from hbnlp.identification.fitting import Identification, Identified
from hbnlp.identification.measured import MeasuredFit, identify
from hbnlp.identification.measurements import Measurements

__all__ = ["Identification", "Identified", "MeasuredFit", "Measurements", "identify"]
