"""The policy of sampling: how many samples a period suffice, so that harmonics do not fold back onto the retained ones.

Products of harmonics in a polynomial force have a known highest harmonic, and so a number of samples that is exact. The
number for any other force is a start: it is doubled until the residual stays.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from math import ceil

from hbnlp.core.checks import whole_number
from hbnlp.core.errors import CornerError
from hbnlp.core.kept import built_once
from hbnlp.core.sending import FieldsAlone
from hbnlp.core.types import Array
from hbnlp.fourier import FourierBasis, resize, stretch
from hbnlp.systems import signals
from hbnlp.systems.spectrum import Spectrum, spectra
from hbnlp.systems.system import System

HIGHEST_DEGREE = 9
OUTPUT_SAMPLES = 2048
"""Of outputs in a program that are no polynomials of the motion: their harmonics beyond those fold back."""
MANY_SAMPLES = 8192
"""A force that takes more is smooth but steep, or has a corner, of which no number is enough: it is asked for one."""
MOST_SAMPLES = 65_536
"""Enough for ``tanh(d / width)`` where d passes at a speed by phase of some 2,000 widths."""
MOST_HARMONICS = 10_000
"""The Jacobian of one degree of freedom fills 3 GB then."""
MOST_GIVEN_SAMPLES = 10_000_000
DENSE_SAMPLES = 2048
"""Of a force that is no polynomial, to check that a few, and twice as many, miss no narrow term."""
ALIASING_TOL = signals.ALIASING_TOL
"""More samples of the force must not move the residual by more than this, relative to its terms."""


@dataclass(frozen=True)
class Sampling(FieldsAlone):
    """At how many phases of a solution's period the force, the excitation and the outputs are sampled.

    Attributes
    ----------
    n_harmonics, periods : int
        Harmonics that are retained; forcing periods in a period of the solution.
    n_samples : int
        Samples of the force.
    settled : bool
        Whether these are known to do: exact for the force, or the user's word. Otherwise they are to be checked.
    degree : int or None
        Of the force as a polynomial.
    automatic : bool
        Whether the number is by the degree alone; if not, it was given by the user, or had to be raised.
    """

    n_harmonics: int
    periods: int
    n_samples: int
    settled: bool
    degree: int | None
    automatic: bool

    @classmethod
    def of(cls, system: System, n_harmonics: int, periods: int = 1, n_samples: int | None = None) -> Sampling:
        """Return the policy for a system; ``n_samples``, where given, is what the force takes."""
        n_harmonics = whole_number("n_harmonics", n_harmonics, least=1, most=MOST_HARMONICS)
        periods = whole_number("periods", periods, least=1, most=MOST_HARMONICS)
        given = None if n_samples is None else whole_number("n_samples", n_samples, least=1, most=MOST_GIVEN_SAMPLES)
        policy = cls._automatic(n_harmonics, periods, polynomial_degree(system))
        return policy if given is None else dataclasses.replace(policy, n_samples=given, settled=True, automatic=False)

    @classmethod
    def _automatic(cls, n_harmonics: int, periods: int, degree: int | None) -> Sampling:
        n_samples = sufficient_samples(n_harmonics, degree)
        return cls(n_harmonics, periods, n_samples, settled=degree is not None, degree=degree, automatic=True)

    @built_once
    def force(self) -> FourierBasis:
        """Samples of the force."""
        return FourierBasis(self.n_harmonics, self.n_samples)

    @property
    def n_harmonics_of_excitation(self) -> int:
        """Harmonics of omega that are among those of ``omega / periods``: all that forcing and motion have."""
        return self.n_harmonics // self.periods

    def over_periods(self, coefficients: Array) -> Array:
        """Return coefficients (..., 2H+1) of a signal given by those over one period of the forcing."""
        return resize(stretch(coefficients, self.periods), self.n_harmonics)

    def outputs(self, spectrum: Spectrum | None) -> FourierBasis:
        """Return the samples of outputs: exact for a known spectrum, otherwise what programs take."""
        least = max(self.n_samples, 8 * self.n_harmonics + 1)
        if spectrum is None:
            return FourierBasis(self.n_harmonics, max(least, OUTPUT_SAMPLES))
        highest = spectrum.degree * self.n_harmonics + self.periods * spectrum.highest
        return FourierBasis(self.n_harmonics, max(least, self.n_harmonics + highest + 1))

    def with_harmonics(self, n_harmonics: int) -> Sampling:
        """Return the policy for another number of harmonics.

        Where the number of samples was given there are no fewer, nor fewer a harmonic. Where it had to be raised there
        are no fewer: what the force takes depends on how steep it is, and is checked.
        """
        n_harmonics = whole_number("n_harmonics", n_harmonics, least=1, most=MOST_HARMONICS)
        other = Sampling._automatic(n_harmonics, self.periods, self.degree)
        if self.automatic:
            return other
        enough = self.n_samples
        if self.settled:
            in_proportion = ceil(enough * max(1.0, n_harmonics / self.n_harmonics))
            enough = max(enough, min(in_proportion, MANY_SAMPLES))
        n_samples = max(other.n_samples, enough)
        return dataclasses.replace(other, n_samples=n_samples, settled=self.settled, automatic=False)

    @property
    def may_double(self) -> bool:
        """Whether the force may take twice the samples."""
        return 2 * self.n_samples <= MOST_SAMPLES

    @property
    def doubles_to_many(self) -> bool:
        """Whether twice the samples of the force are more than one takes that is not steep: it may have a corner."""
        return 2 * self.n_samples > MANY_SAMPLES

    def dense(self) -> Sampling:
        """Return the policy with samples between which nothing wider than 1/2048 of a period is hidden."""
        n_samples = max(DENSE_SAMPLES, self.n_samples)
        return dataclasses.replace(self, n_samples=n_samples, settled=False, automatic=False)

    def last_doubled(self) -> Sampling:
        """Return the policy that doubling comes to before the force is asked for a corner."""
        n_samples = self.n_samples
        while 4 * n_samples <= MANY_SAMPLES:
            n_samples *= 2
        return dataclasses.replace(self, n_samples=n_samples, settled=False, automatic=False)

    def doubled(self) -> Sampling:
        """Return the policy with twice the samples of the force, still to be checked.

        Raises
        ------
        CornerError
            If these are more than a force may take.
        """
        if not self.may_double:
            raise CornerError(
                f"{2 * self.n_samples} samples a period would be needed for the force, more than {MOST_SAMPLES}: "
                "it is not smooth enough for this tolerance, or too steep; smooth it over some width, or pass n_samples"
            )
        return dataclasses.replace(self, n_samples=2 * self.n_samples, settled=False, automatic=False)


def sufficient_samples(n_harmonics: int, degree: int | None) -> int:
    """Return the samples that are exact for a polynomial force, (d + 1) H + 1, or a start for doubling (d = 7)."""
    return ((7 if degree is None else max(degree, 1)) + 1) * n_harmonics + 1


def polynomial_degree(system: System) -> int | None:
    """Return the degree of the force as a polynomial in (q, q'), or None if it is no polynomial or depends on tau.

    The degree is carried through the operations of the force one by one, so that it holds whatever the units and the
    parameter values: an upper bound (at least 1), exact unless terms cancel. Degrees above 9 count as no polynomial.
    """
    # inputs 0 and 1 are q and q', 2 is tau, 3 the parameters
    entries = spectra(system.compiled_force.value, 2, (0, 1))[0]
    degrees = [each.degree for each in entries if each is not None and not each.highest]
    highest = max(degrees, default=0)
    return max(highest, 1) if len(degrees) == len(entries) and highest <= HIGHEST_DEGREE else None
