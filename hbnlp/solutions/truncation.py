"""The error of a solution for want of harmonics, estimated from what the retained ones leave over.

A solution x of H harmonics balances its equations in these harmonics; the residual in those beyond them, the defect, is
what truncation costs. One Newton step with H' = 2 H + 1 harmonics answers it::

    [ R'_y ]        [ R'(y) ]
    [ row  ] d  = - [   0   ],        error = |d_x| / |x|,

R' being the residual with H' harmonics at the padded solution y. The step also corrects the retained harmonics, and
``row`` is the plane normal to the branch, so that the estimate stays finite at folds, where a change of the residual
moves the fold rather than the response. That a periodic Galerkin solution with a small defect has an exact one nearby
was shown by Urabe (1965, doi:10.1007/BF00284614).
"""

from __future__ import annotations

import numpy as np

from hbnlp.continuation.curve import Bordered
from hbnlp.core.checks import instance_of
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.types import Array
from hbnlp.solutions.equations import Equations, along_parameter
from hbnlp.solutions.solution import Solution, attached


@interrupts_kept()
def truncation_error(solution: Solution) -> float:
    """Return the estimated error of a solution for want of harmonics, at fixed parameters, relative to its size.

    Measured on Duffing oscillators and wings it is the true error to a third where that is below 0.1; larger ones are
    told to be large. For friction smoothed by tanh it was up to twice the true error. It grows without bound towards a
    fold, where the solution at a fixed parameter does so, too: `resolve_harmonics` measures normal to the branch.

    Raises
    ------
    ValueError
        If the solution came from a file, without its problem.
    """
    instance_of("solution", solution, Solution, "a Solution, such as branch.solution(0)")
    problem = attached(solution)
    values = problem.values(solution.parameters)
    curve = along_parameter(problem, values, "omega")
    return Estimate(curve, curve.point(solution.coefficients, solution.omega), curve.unknowns.fixing_last()).error


class Estimate:
    """The Newton step with 2 H + 1 harmonics at a point with H of a curve, and what it says."""

    def __init__(self, curve: Equations, y: Array, row: Array) -> None:
        self._n_harmonics = curve.problem.n_harmonics
        finer = curve.on(curve.problem.with_harmonics(2 * self._n_harmonics + 1))
        padded, plane = (finer.carried_from(curve, v) for v in (y, row))
        step = -Bordered.at(finer, padded, plane).solve(np.append(finer.residual(padded), 0.0))
        self._finer, self._bettered = finer, padded + step
        self._size = curve.unknowns.size_of(y)
        self.error = float(np.linalg.norm(finer.unknowns.coefficients(step))) / self._size

    def harmonics_for(self, tolerance: float) -> int:
        """Return the number of harmonics beyond which the bettered solution has half the tolerance left."""
        energies = np.sum(self._finer.coefficients(self._bettered) ** 2, axis=0)
        most = self._finer.problem.n_harmonics
        for n in range(self._n_harmonics + 1, most):
            if np.sqrt(energies[2 * n + 1 :].sum()) <= 0.5 * tolerance * self._size:
                return n
        return most
