"""Motions at one parameter point, each there once, with their images under the symmetries of the system."""

from __future__ import annotations

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Newton
from hbnlp.core.types import Array
from hbnlp.solutions.attempt import attempt
from hbnlp.solutions.cold_start import linear_size
from hbnlp.solutions.identity import meets, moved, without_turns
from hbnlp.solutions.solution import Solution
from hbnlp.systems.symmetry import Symmetry

REST = 1e-6
"""Solutions are told apart relative to their size, or to this part of the largest: Newton's method ends near rest."""


class Motions:
    """The motions found so far, each followed by its images, which need not be searched for.

    Attributes
    ----------
    found : list of Solution
    is_image : list of bool
        Whether each of them was made instead of found: whatever is traced from it is an image, too.
    """

    def __init__(self, problem: HarmonicBalance, values: Array, newton: Newton, separation: float) -> None:
        self.found: list[Solution] = []
        self.is_image: list[bool] = []
        self._problem, self._values = problem, values
        self._newton, self._separation = newton, separation
        self._identity = Symmetry.identity(problem.system.n_dof)
        self._symmetries = problem.system.symmetries_at(values)
        self._least = linear_size(problem, values)

    @property
    def largest(self) -> float:
        """Size of the largest solution, or of the linear response; 1 where all is at rest."""
        return max([self._least, *(float(np.linalg.norm(s.coefficients)) for s in self.found)]) or 1.0

    def polish(self, guess: Array, start: str) -> None:
        """Add what Newton's method makes of a guess; ``start`` says where it is from."""
        self.add(attempt(self._problem, self._values, guess, self._newton, start=start))

    def add(self, solution: Solution) -> None:
        """Add a motion and its images, unless it did not converge or is known."""
        if not solution.converged or self.has(solution):
            return
        self._keep(solution, is_image=False)
        for image in (solution.image(symmetry) for symmetry in self._symmetries):
            if not self.has(image):
                self._keep(image, is_image=True)

    def _keep(self, solution: Solution, *, is_image: bool) -> None:
        angles = self._problem.system.angles
        if angles:
            solution = solution.with_coefficients(without_turns(solution.coefficients, angles))
        self.is_image.append(is_image)
        self.found.append(solution)

    def poles(self) -> list[Array]:
        """Return the vectors from which deflation leads away: all motions, as they look from any forcing period."""
        poles = []
        for solution in self.found:
            seen: list[Array] = []
            for k in range(self._problem.periods):
                x = moved(solution.coefficients, self._identity, solution.periods, later=k).ravel()
                # a motion of fewer periods is there once: two poles in one place would push twice as far
                if all(np.linalg.norm(x - other) > self._separation * np.linalg.norm(x) for other in seen):
                    seen.append(x)
            poles += seen
        return poles

    def has(self, solution: Solution) -> bool:
        """Whether a motion is among them."""
        floor, tol = REST * self.largest, self._separation
        return any(meets(solution, other, self._identity, tol, floor=floor) for other in self.found)
