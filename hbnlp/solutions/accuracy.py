"""Whether a solution has the harmonics that a tolerance asks for, and how many that would be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.balance.sampling import MOST_HARMONICS
from hbnlp.balance.truncation import Truncation
from hbnlp.continuation.curve import TINY, Bordered
from hbnlp.core.checks import position
from hbnlp.core.types import Array
from hbnlp.fourier import to_complex
from hbnlp.solutions.equations import Equations
from hbnlp.solutions.solution import Solution, guess_for
from hbnlp.solutions.truncation import Estimate

NEAR_REST = 1e-3
"""What is smaller than this part of the largest on the branch is measured against that part."""
NOTHING = 1e-9
"""A displacement that is smaller than this part of all together is nothing but round-off."""
NEGLIGIBLE = 0.05
"""Harmonics whose part of a solution is below this part of the tolerance are not missed."""
SAFETY = 0.3
"""What is to be left of the tolerance for the harmonics beyond those that are tried next."""


class Judgement(NamedTuple):
    """The estimated error of a solution, and the number of harmonics that it should have: more, or those it has.

    ``better`` (n_dof, 4H+3) are the coefficients with the error taken away.
    """

    error: float
    n_harmonics: int
    better: Array


class Accuracy:
    """The errors of solutions along one branch, each displacement and each output named against its own size.

    Parameters
    ----------
    problem : HarmonicBalance
        With a tolerance.
    """

    def __init__(self, problem: HarmonicBalance) -> None:
        assert problem.truncation is not None
        self.policy: Truncation = problem.truncation
        names = problem.system.output_names
        self._outputs = [position("output", name, names) for name in self.policy.outputs]
        self._largest = np.zeros(problem.shape[0])
        self._largest_outputs = np.zeros(len(self._outputs))

    def see(self, curve: Equations, y: Array) -> None:
        """Take a solution as one of the branch, against whose largest those near rest are measured."""
        self._largest = np.maximum(self._largest, np.linalg.norm(curve.coefficients(y), axis=1))
        if self._outputs:
            outputs = np.linalg.norm(self._harmonics(curve, y), axis=1)
            self._largest_outputs = np.maximum(self._largest_outputs, outputs)

    def judge(self, curve: Equations, y: Array, row: Array, factors: Bordered | None = None) -> Judgement:
        """Return the error of a solution on a curve, in the plane normal to ``row``, and the harmonics it should have.

        ``factors`` are those of [dR/dy; row] at the solution, where there are some.
        """
        own, policy = curve.problem.n_harmonics, self.policy
        estimate = Estimate(curve, y, row, factors)
        error, better = self._error(curve, y, estimate), estimate.finer.coefficients(estimate.padded + estimate.change)
        if error <= policy.tolerance or own >= policy.most_harmonics:
            return Judgement(error, own, better)
        wanted = harmonics_that_matter(better, self._sizes(curve, y), SAFETY * policy.tolerance)
        return Judgement(error, policy.above(max(wanted, own + 1)), better)

    def enough(self, curve: Equations, y: Array) -> int:
        """Return how many of the harmonics of a solution are not negligible, as a number that is tried."""
        sizes = self._sizes(curve, y)
        wanted = harmonics_that_matter(curve.coefficients(y), sizes, NEGLIGIBLE * self.policy.tolerance)
        return min(self.policy.above(wanted), curve.problem.n_harmonics)

    def difference(self, curve: Equations, one: Array, other: Array) -> float:
        """Return how far two points of a curve are apart, measured as errors are."""
        apart = np.linalg.norm(curve.coefficients(one - other), axis=1) / self._sizes(curve, other)
        return max(float(apart.max()), float(abs(one[-1] - other[-1]) / curve.scale(other)[-1]))

    def _error(self, curve: Equations, y: Array, estimate: Estimate) -> float:
        change = np.linalg.norm(estimate.coefficients, axis=1) / self._sizes(curve, y)
        along = abs(estimate.change[-1]) / curve.scale(y)[-1]
        errors = [float(change.max()), float(along)]
        if self._outputs:
            here, better = (
                self._harmonics(estimate.finer, each) for each in (estimate.padded, estimate.padded + estimate.change)
            )
            here[:, curve.problem.n_harmonics + 1 :] = 0.0  # which the record does not have
            sizes = np.linalg.norm(here, axis=1)
            sizes = np.maximum(np.maximum(sizes, NEAR_REST * self._largest_outputs), TINY)
            errors.append(float(np.max(np.linalg.norm(better - here, axis=1) / sizes)))
        return max(errors)

    def _sizes(self, curve: Equations, y: Array) -> Array:
        """Return by what the error of each displacement is measured, (n_dof,)."""
        own = np.linalg.norm(curve.coefficients(y), axis=1)
        return np.asarray(np.maximum(np.maximum(own, NEAR_REST * self._largest), NOTHING * curve.unknowns.size_of(y)))

    def _harmonics(self, curve: Equations, y: Array) -> Array:
        amplitudes = curve.problem.output_harmonics(curve.unknowns.coefficients(y), curve.values(y))
        return np.asarray(amplitudes[0, self._outputs])


def problem_and_guess(problem: HarmonicBalance, near: Solution | ArrayLike) -> tuple[HarmonicBalance, Array]:
    """Return what `guess_for` does; with a tolerance, in a problem with as many harmonics as the solution asks for."""
    policy = problem.truncation
    if policy is None:
        return problem, guess_for(problem, near)
    its = np.shape(near.coefficients if isinstance(near, Solution) else near)[-1:]
    most = (its[0] if its else 1) // 2 * problem.periods
    wide = problem.with_harmonics(min(max(most, problem.n_harmonics), MOST_HARMONICS))
    coefficients = guess_for(wide, near).reshape(wide.shape)
    sizes = np.linalg.norm(coefficients, axis=1)
    sizes = np.maximum(sizes, NOTHING * float(np.linalg.norm(sizes))) + TINY
    wanted = harmonics_that_matter(coefficients, sizes, NEGLIGIBLE * policy.tolerance)
    own = problem.with_harmonics(policy.above(wanted))
    return own, own.vector(coefficients)


def harmonics_that_matter(coefficients: Array, sizes: Array, part: float) -> int:
    """Return the number beyond which the harmonics of each displacement are at most a part of its size."""
    squares = np.abs(to_complex(coefficients)) ** 2
    beyond = np.sqrt(np.cumsum(squares[:, ::-1], axis=1)[:, ::-1]) / sizes[:, None]
    matter = np.flatnonzero(np.max(beyond, axis=0) > part)
    return max(1, int(matter[-1])) if matter.size else 1
