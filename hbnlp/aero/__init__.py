"""Linear unsteady aerodynamics: reduced-order models from the motion of a wing to its loads."""

from hbnlp.aero.provenance import Provenance
from hbnlp.aero.rom import AeroROM
from hbnlp.aero.theodorsen import theodorsen_transfer, thin_airfoil

__all__ = ["AeroROM", "Provenance", "theodorsen_transfer", "thin_airfoil"]
