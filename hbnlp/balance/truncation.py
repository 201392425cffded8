"""The policy of truncation: how exact a motion is to be for want of harmonics, and which numbers of them are tried."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from hbnlp.balance.sampling import MOST_HARMONICS
from hbnlp.core.checks import instance_of, position, real_number, refused, whole_number
from hbnlp.systems.spectrum import Spectrum, spectra
from hbnlp.systems.system import System

LEAST_TOLERANCE = 1e-9
"""Beside singular points round-off may leave more in a solution."""
LARGEST_TOLERANCE = 0.1
"""Beyond it the estimate of the error, which is linear in it, says little."""
FIRST = 3
"""Harmonics of the forcing's frequency that a motion begins with."""
CAP = 127
"""Harmonics of the forcing's frequency that are tried at most unless the user says otherwise."""
ONE_BY_ONE = 15
"""Odd numbers up to this are tried one after the other, larger ones in growing steps: each is compiled once."""
GROWTH = 1.25


@dataclass(frozen=True)
class Truncation:
    """How exact motions are to be, and how many harmonics they may take for it.

    Attributes
    ----------
    tolerance : float
        Bound on the estimated error of each displacement, and of the outputs named, relative to their size.
    outputs : tuple of str
    most_harmonics : int
        The cap.
    periods : int
        Forcing periods in one of the motion.
    least : int
        Harmonics of the forcing's frequency that a motion has in any case: those of the excitation and of what it
        multiplies, where these are known. What lies beyond twice as many would not show in the estimate.
    """

    tolerance: float
    outputs: tuple[str, ...]
    most_harmonics: int
    periods: int
    least: int

    @classmethod
    def of(
        cls, system: System, tolerance: float, outputs: Sequence[str], most_harmonics: int | None, periods: int
    ) -> Truncation:
        """Return the policy that a user asks for.

        Raises
        ------
        ValueError, TypeError, KeyError
            For a tolerance that is too small or too large, a cap below the harmonics of the excitation, an unknown
            output.
        """
        real_number("tolerance", tolerance, least=LEAST_TOLERANCE, most=LARGEST_TOLERANCE)
        periods = whole_number("periods", periods, least=1, most=MOST_HARMONICS)
        if isinstance(outputs, str):
            raise refused(TypeError, "outputs", outputs, f"a list of names, [{outputs!r}]")
        instance_of("outputs", outputs, Sequence, "a list of names of outputs")
        for name in outputs:
            position("output", name, system.output_names)
        least = max(1, min(_highest_of_excitation(system), MOST_HARMONICS // periods))
        if most_harmonics is None:
            most_harmonics = min(max(CAP, 2 * least) * periods, MOST_HARMONICS)
        advice = ", those of the excitation"
        whole_number("most_harmonics", most_harmonics, least=least * periods, most=MOST_HARMONICS, advice=advice)
        return cls(float(tolerance), tuple(outputs), most_harmonics, periods, least)

    @property
    def first(self) -> int:
        """The number of harmonics that a motion begins with."""
        return min(max(FIRST, self.least) * self.periods, self.most_harmonics)

    def above(self, wanted: int) -> int:
        """Return the smallest number that is tried and no less than the one that is wanted, or the cap."""
        number = self.least
        while number * self.periods < min(wanted, self.most_harmonics):
            number = _next(number)
        return min(number * self.periods, self.most_harmonics)

    def doubled(self) -> Truncation:
        """Return the policy for motions over twice as many periods."""
        most = min(2 * self.most_harmonics, MOST_HARMONICS)
        return dataclasses.replace(self, most_harmonics=most, periods=2 * self.periods)


def _next(number: int) -> int:
    """Return the number after one among those that are tried."""
    odd = number + 1 + number % 2
    return odd if odd <= ONE_BY_ONE else 2 * round(0.5 * (GROWTH * number - 1.0)) + 1


def _highest_of_excitation(system: System) -> int:
    """Return the highest harmonic of the phase in forcing, motion and force, of those that have one."""
    read = [each for signal in (system.forcing, system.motion) for each in _spectra_of(system, signal)]
    read += spectra(system.compiled_force.value, 2, (0, 1))[0]
    return max((each.highest for each in read if each is not None), default=0)


def _spectra_of(system: System, signal: ca.SX) -> list[Spectrum | None]:
    return spectra(ca.Function("signal", [system.tau, system.p], [ca.densify(signal)]), 0)[0]
