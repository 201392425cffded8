"""The policy of sampling: how many samples a period suffice, so that harmonics do not fold back onto the retained ones.

Products of harmonics in a polynomial force have a known highest harmonic, and so a number of samples that is exact. The
number for any other force is a start: it is doubled until the residual stays.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import casadi as ca
import numpy as np

from hbnlp.core.errors import SamplingError
from hbnlp.core.sending import FieldsAlone
from hbnlp.fourier import FourierBasis
from hbnlp.systems.excitation_samples import excitation_samples
from hbnlp.systems.system import System

HIGHEST_DEGREE = 9
MOST_SAMPLES = 8192
ALIASING_TOL = 1e-9
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
        n_harmonics, periods = _whole("n_harmonics", n_harmonics), _whole("periods", periods)
        given = None if n_samples is None else _whole("n_samples", n_samples)
        policy = cls._automatic(n_harmonics, periods, polynomial_degree(system))
        return policy if given is None else dataclasses.replace(policy, n_samples=given, settled=True, automatic=False)

    @classmethod
    def _automatic(cls, n_harmonics: int, periods: int, degree: int | None) -> Sampling:
        n_samples = sufficient_samples(n_harmonics, degree)
        return cls(n_harmonics, periods, n_samples, settled=degree is not None, degree=degree, automatic=True)

    @cached_property
    def force(self) -> FourierBasis:
        """Samples of the force."""
        return FourierBasis(self.n_harmonics, self.n_samples)

    @cached_property
    def excitation(self) -> FourierBasis:
        """Samples of forcing and prescribed motion."""
        return FourierBasis(self.n_harmonics, excitation_samples(self.n_harmonics, self.periods))

    @cached_property
    def outputs(self) -> FourierBasis:
        """Samples of the outputs."""
        return FourierBasis(self.n_harmonics, max(self.n_samples, 8 * self.n_harmonics + 1))

    def with_harmonics(self, n_harmonics: int) -> Sampling:
        """Return the policy for another number of harmonics.

        Where the number of samples was given, or had to be raised, there are no fewer, nor fewer a harmonic.
        """
        other = Sampling._automatic(_whole("n_harmonics", n_harmonics), self.periods, self.degree)
        if self.automatic:
            return other
        in_proportion = ceil(self.n_samples * max(1.0, n_harmonics / self.n_harmonics))
        n_samples = max(other.n_samples, min(in_proportion, max(MOST_SAMPLES, self.n_samples)))
        return dataclasses.replace(other, n_samples=n_samples, settled=self.settled, automatic=False)

    def doubled(self) -> Sampling:
        """Return the policy with twice the samples of the force, still to be checked.

        Raises
        ------
        SamplingError
            If these are more than a smooth force would need.
        """
        if 2 * self.n_samples > MOST_SAMPLES:
            raise SamplingError(
                f"{2 * self.n_samples} samples a period would be needed for the force, more than {MOST_SAMPLES}: "
                "it is not smooth enough for this tolerance; smooth it or pass n_samples"
            )
        return dataclasses.replace(self, n_samples=2 * self.n_samples, settled=False, automatic=False)


def sufficient_samples(n_harmonics: int, degree: int | None) -> int:
    """Return the samples that are exact for a polynomial force, (d + 1) H + 1, or a start for doubling (d = 7)."""
    return ((7 if degree is None else max(degree, 1)) + 1) * n_harmonics + 1


def _whole(name: str, value: int) -> int:
    if not isinstance(value, int | np.integer) or value < 1:
        raise ValueError(f"{name} = {value!r}; a whole number of at least 1 is needed")
    return int(value)


def polynomial_degree(system: System) -> int | None:
    """Return the degree of the force as a polynomial in (q, q'), or None if it is no polynomial or depends on tau.

    The degree is carried through the operations of the force one by one, so that it holds whatever the units and the
    parameter values: an upper bound (at least 1), exact unless terms cancel. Degrees above 9 count as no polynomial.
    """
    force = system.compiled_force.value
    degrees: dict[int, int | None] = {}
    constants: dict[int, float] = {}
    highest = 1
    for k in range(force.n_instructions()):
        operation = force.instruction_id(k)
        inputs, outputs = force.instruction_input(k), force.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            degree = degrees[inputs[0]]
            if degree is None:
                return None
            highest = max(highest, degree)
            continue
        target = outputs[0]
        constants.pop(target, None)
        if operation == ca.OP_CONST:
            degrees[target], constants[target] = 0, force.instruction_constant(k)
        elif operation == ca.OP_INPUT:
            # inputs 0 and 1 are q and q', 2 is tau, 3 the parameters
            degrees[target] = (1, 1, None, 0)[inputs[0]]
        else:
            exponent = constants.get(inputs[1]) if len(inputs) > 1 else None
            degrees[target] = _degree(operation, [degrees[i] for i in inputs], exponent)
    return highest if highest <= HIGHEST_DEGREE else None


def _degree(operation: int, degrees: list[int | None], exponent: float | None) -> int | None:
    """Return the degree of the result of one operation, None where that is no polynomial."""
    known = [degree for degree in degrees if degree is not None]
    if len(known) < len(degrees):
        return None
    first, last = (known[0], known[-1]) if known else (0, 0)
    power = int(exponent) if exponent is not None and exponent >= 0.0 and exponent == int(exponent) else None
    if max(known, default=0) == 0:
        degree: int | None = 0
    elif operation in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN):
        degree = max(known)
    elif operation == ca.OP_MUL:
        degree = first + last
    elif operation == ca.OP_SQ:
        degree = 2 * first
    elif operation in (ca.OP_CONSTPOW, ca.OP_POW) and power is not None:
        degree = power * first
    else:
        degree = first if operation == ca.OP_DIV and last == 0 else None
    return degree
