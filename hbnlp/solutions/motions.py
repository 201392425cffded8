"""Motions at one parameter point, each there once, with their images under the symmetries of the system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Newton
from hbnlp.core.types import Array
from hbnlp.solutions.accuracy import problem_and_guess
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.attempt import attempt, iterate
from hbnlp.solutions.cold_start import linear_size
from hbnlp.solutions.identity import meets, moved, without_turns
from hbnlp.solutions.solution import Solution, guess_for
from hbnlp.systems.symmetry import Symmetry

REST = 1e-6
"""Solutions are told apart relative to their size, or to this part of the largest: Newton's method ends near rest."""
MODEST = 5
"""Harmonics of the forcing's frequency with which solutions are looked for where a tolerance says how many they get."""
WITHIN = 10.0
"""Solutions nearer to each other than this multiple of the tolerance are compared with the same number of harmonics."""


class Motions:
    """The motions found so far, each followed by its images, which need not be searched for.

    Attributes
    ----------
    searched : HarmonicBalance
        The balance with which motions are looked for.
    found : list of Solution
    is_image : list of bool
        Whether each of them was made instead of found: whatever is traced from it is an image, too.
    roots : list of array (size,)
        Each of them as the balance that is searched with has it.
    spurious : list of array (size,)
        Roots of that balance which, with the harmonics that they need, are no motions, or were known.
    """

    def __init__(self, problem: HarmonicBalance, values: Array, newton: Newton, separation: float) -> None:
        self.found: list[Solution] = []
        self.is_image: list[bool] = []
        self.roots: list[Array] = []
        self.spurious: list[Array] = []
        self._problem, self._values = problem, values
        self._newton, self._separation = newton, separation
        policy = problem.truncation
        self.searched = problem if policy is None else problem.with_harmonics(policy.above(MODEST * policy.periods))
        self._identity = Symmetry.identity(problem.system.n_dof)
        self._symmetries = problem.system.symmetries_at(values)
        self._least = linear_size(problem, values)

    @property
    def largest(self) -> float:
        """Size of the largest solution, or of the linear response; 1 where all is at rest."""
        return max([self._least, *(float(np.linalg.norm(s.coefficients)) for s in self.found)]) or 1.0

    def polish(self, near: Solution | Array, start: str) -> None:
        """Add what Newton's method makes of a solution, or of unknowns of the balance that is searched with.

        ``start`` says where they are from.
        """
        given = near if isinstance(near, Solution) else near.reshape(self.searched.shape)
        problem, guess = problem_and_guess(self._problem, given)
        self.add(attempt(problem, self._values, guess, self._newton, start=start))

    def polish_root(self, root: Array, start: str) -> None:
        """Add what Newton's method makes of a root of the balance that is searched with: from now on it is known."""
        n_found = len(self.found)
        self.polish(root, start)
        if len(self.found) == n_found and self._problem.truncation is not None:
            self.spurious.append(root)

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
        self.take(solution, is_image=is_image)

    def take(self, solution: Solution, *, is_image: bool) -> None:
        """Add a motion as it is, which is known to be none of the others."""
        root = self._with_harmonics(self.searched, solution)
        self.roots.append(root)
        self.is_image.append(is_image)
        self.found.append(solution)

    def poles(self) -> list[Array]:
        """Return the vectors from which deflation leads away: all motions, as they look from any forcing period."""
        poles = []
        for root in (*self.roots, *self.spurious):
            seen: list[Array] = []
            for k in range(self._problem.periods):
                x = moved(root.reshape(self.searched.shape), self._identity, self._problem.periods, later=k).ravel()
                # a motion of fewer periods is there once: two poles in one place would push twice as far
                if all(np.linalg.norm(x - other) > self._separation * np.linalg.norm(x) for other in seen):
                    seen.append(x)
            poles += seen
        return poles

    def has(self, solution: Solution) -> bool:
        """Whether a motion is among them."""
        return any(self._are_one(solution, other) for other in self.found)

    def _are_one(self, one: Solution, other: Solution) -> bool:
        """Return whether two solutions are one motion; they are compared with the same number of harmonics."""
        if self._meet(one, other, self._separation):
            return True
        policy, (fewer, more) = self._problem.truncation, sorted((one, other), key=lambda each: each.n_harmonics)
        if (
            policy is None
            or fewer.n_harmonics == more.n_harmonics
            or not self._meet(one, other, WITHIN * policy.tolerance)
        ):
            return False
        raised = self._with_harmonics(attached(more), fewer).reshape(more.coefficients.shape)
        return self._meet(replace(more, coefficients=raised), more, self._separation)

    def _meet(self, one: Solution, other: Solution, tol: float) -> bool:
        return meets(one, other, self._identity, tol, floor=REST * self.largest)

    def _with_harmonics(self, problem: HarmonicBalance, solution: Solution) -> Array:
        """Return the unknowns of a solution with the harmonics of a balance, its own cut where there is none."""
        guess = guess_for(problem, solution)
        if problem.n_harmonics == solution.n_harmonics:
            return guess
        found = iterate(problem, guess, self._values, self._newton)
        return found.y if found.converged else guess
