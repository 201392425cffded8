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

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Bordered
from hbnlp.core.types import Array
from hbnlp.solutions.equations import ParameterCurve
from hbnlp.solutions.solution import Solution


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
    if solution.problem is None:
        raise ValueError("a solution from a file has no problem to be estimated with; solve it again from there")
    values = np.array(list(solution.parameters.values()))
    fixed = np.zeros(solution.coefficients.size + 1)
    fixed[-1] = 1.0
    curve = ParameterCurve(solution.problem, values, "omega", 1.0)
    y = np.append(solution.coefficients.ravel(), values[curve.index])
    return Estimate(solution.problem, curve, y, fixed).error


class Estimate:
    """The Newton step with 2 H + 1 harmonics at a solution of H, and what it says."""

    def __init__(self, problem: HarmonicBalance, curve: ParameterCurve, y: Array, row: Array) -> None:
        self._n_harmonics = problem.n_harmonics
        self._finer = problem.with_harmonics(2 * problem.n_harmonics + 1)
        finer = ParameterCurve(self._finer, curve.values(y), curve.name, curve.floor)
        padded, plane = (resized(v, problem, self._finer) for v in (y, row))
        step = -Bordered.at(finer, padded, plane).solve(np.append(finer.residual(padded), 0.0))
        self._bettered = padded + step
        self._size = max(float(np.linalg.norm(y[:-1])), curve.solution_floor)
        self.error = float(np.linalg.norm(step[:-1])) / self._size

    def harmonics_for(self, tolerance: float) -> int:
        """Return the number of harmonics beyond which the bettered solution has half the tolerance left."""
        columns = self._bettered[:-1].reshape(self._finer.shape)
        energies = np.sum(columns**2, axis=0)
        for n in range(self._n_harmonics + 1, self._finer.n_harmonics):
            if np.sqrt(energies[2 * n + 1 :].sum()) <= 0.5 * tolerance * self._size:
                return n
        return self._finer.n_harmonics


def resized(y: Array, problem: HarmonicBalance, other: HarmonicBalance) -> Array:
    """Return (x, parameter) of one balance with the harmonics of another: zeros added, or the highest cut off."""
    coefficients = y[:-1].reshape(problem.shape)
    result = np.zeros(other.shape)
    kept = min(problem.shape[1], other.shape[1])
    result[:, :kept] = coefficients[:, :kept]
    return np.append(result.ravel(), y[-1])
