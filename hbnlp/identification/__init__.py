"""Parameters from measured amplitudes, with their uncertainty."""

from hbnlp.identification.fitting import Identification, Identified

__all__ = ["Identification", "Identified"]
