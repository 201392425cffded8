"""Second-order systems with lag states: equations and parameters, linear analysis, oscillators of the literature."""

from hbnlp.systems.oscillators import chain, duffing, tuned_absorber

__all__ = ["chain", "duffing", "tuned_absorber"]
