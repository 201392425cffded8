"""How many harmonics a response needs: the error of truncation, estimated from what the retained harmonics leave over.

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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbnlp.balance import HarmonicBalance
from hbnlp.branch import Branch
from hbnlp.checks import real_number, whole_number
from hbnlp.curves import ParameterCurve
from hbnlp.fourier import Array
from hbnlp.newton import Bordered, Newton, correct
from hbnlp.solution import Solution, make_solution


@dataclass(frozen=True, kw_only=True, eq=False)
class ResolvedBranch:
    """A branch with as many harmonics at each point as a tolerance asks for.

    Attributes
    ----------
    name : str
        The continuation parameter.
    parameter : array (n_points,)
    n_harmonics : array (n_points,), int
    truncation_error : array (n_points,)
        Estimate relative to the size of the solution; nan where no solution was found near the branch.
    solutions : tuple of Solution or None
    tolerance : float
    """

    name: str
    parameter: Array
    n_harmonics: NDArray[np.int_]
    truncation_error: Array
    solutions: tuple[Solution | None, ...]
    tolerance: float

    def __len__(self) -> int:
        return int(self.parameter.size)

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Whether the tolerance is met, (n_points,)."""
        return np.asarray(self.truncation_error <= self.tolerance)

    def __repr__(self) -> str:
        return (
            f"ResolvedBranch: {len(self)} points with {self.n_harmonics.min()} to {self.n_harmonics.max()} harmonics\n"
            f"  truncation error at most {self.tolerance:g} at {np.count_nonzero(self.reached)} points, not reached at "
            f"{np.count_nonzero(self.truncation_error > self.tolerance)}, no solution near the branch at "
            f"{np.count_nonzero(np.isnan(self.truncation_error))}"
        )


def truncation_error(solution: Solution) -> float:
    """Return the estimated error of a solution for want of harmonics, at fixed parameters, relative to its size.

    Measured on Duffing oscillators and wings it is the true error to a third where that is below 0.1; larger ones are
    told to be large. It grows without bound towards a fold, where the solution at a fixed parameter does so, too; along
    a branch `resolve_harmonics` measures normal to the branch instead.

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
    return _Estimate(solution.problem, curve, y, fixed).error


def resolve_harmonics(
    branch: Branch, tolerance: float, *, least: int = 1, at_most: int = 31, method: Newton | None = None
) -> ResolvedBranch:
    """Solve the points of a branch again, each with as few harmonics as meet a tolerance.

    Each point is sought in the plane normal to the branch, so that folds are no obstacle. The number of harmonics is
    raised until the estimated error falls below the tolerance; the next point begins with one less.

    Parameters
    ----------
    branch : Branch
        From `hbnlp.trace`, of two points or more; its own number of harmonics need only be enough to lead.
    tolerance : float
        Bound on the truncation error, relative to the size of the solution.
    least, at_most : int
        Numbers of harmonics between which the choice is made. Where ``at_most`` does not do, ``reached`` is False.
    method : Newton, optional

    Raises
    ------
    ValueError
        For a tolerance that is not between 0 and 1, numbers out of order, or a branch from a file.
    """
    real_number("tolerance", tolerance, above=0.0)
    if tolerance >= 1.0:
        raise ValueError(f"tolerance = {tolerance!r}; a relative error below 1 is needed")
    whole_number("least", least, least=1)
    whole_number("at_most", at_most, least=least)
    if branch.problem is None:
        raise ValueError("a branch from a file has no problem to be solved again with; trace it again from there")
    if len(branch) < 2:
        raise ValueError("the branch has a single point, and so no direction; trace two points or more")
    problems = {branch.n_harmonics: branch.problem}
    points = np.column_stack([branch.coefficients.reshape(len(branch), -1), branch.parameter])
    numbers, errors, solutions = [], [], []
    parameters = np.empty(len(branch))
    n_harmonics = least
    for i in range(len(branch)):
        tangent = points[min(i + 1, len(branch) - 1)] - points[max(i - 1, 0)]
        values = branch.problem.values(branch.values(i))
        while True:
            problem = problems.setdefault(n_harmonics, branch.problem.with_harmonics(n_harmonics))
            curve = ParameterCurve(problem, values, branch.name, 0.01 * abs(branch.span[1] - branch.span[0]))
            guess, along = (_resized(v, branch.problem, problem) for v in (points[i], tangent))
            row = along / curve.scale(guess) ** 2
            found = correct(curve, guess, row / np.linalg.norm(row), method or Newton())
            if not found.converged and n_harmonics < at_most:
                n_harmonics += 1
                continue
            if not found.converged:
                error = np.nan
                break
            estimate = _Estimate(problem, curve, found.y, row)
            error = estimate.error
            if error <= tolerance or n_harmonics >= at_most:
                break
            n_harmonics = min(at_most, estimate.harmonics_for(tolerance))
        numbers.append(n_harmonics)
        errors.append(error)
        parameters[i] = found.y[-1] if found.converged else branch.parameter[i]
        solutions.append(make_solution(problem, found.y[:-1], curve.values(found.y)) if found.converged else None)
        n_harmonics = max(least, n_harmonics - 1)
    return ResolvedBranch(
        name=branch.name,
        parameter=parameters,
        n_harmonics=np.array(numbers),
        truncation_error=np.array(errors),
        solutions=tuple(solutions),
        tolerance=float(tolerance),
    )


class _Estimate:
    """The Newton step with 2 H + 1 harmonics at a solution of H, and what it says."""

    def __init__(self, problem: HarmonicBalance, curve: ParameterCurve, y: Array, row: Array) -> None:
        self._n_harmonics = problem.n_harmonics
        self._finer = problem.with_harmonics(2 * problem.n_harmonics + 1)
        finer = ParameterCurve(self._finer, curve.values(y), curve.name, curve.floor)
        padded, plane = (_resized(v, problem, self._finer) for v in (y, row))
        step = -Bordered.at(finer, padded, plane).solve(np.append(finer.residual(padded), 0.0))
        self._bettered, self._size = padded + step, float(np.linalg.norm(y[:-1]))
        length = float(np.linalg.norm(step[:-1]))
        self.error = length / self._size if self._size > 0.0 else (0.0 if length == 0.0 else np.inf)

    def harmonics_for(self, tolerance: float) -> int:
        """Return the number of harmonics beyond which the bettered solution has half the tolerance left."""
        columns = self._bettered[:-1].reshape(self._finer.shape)
        energies = np.sum(columns**2, axis=0)
        for n in range(self._n_harmonics + 1, self._finer.n_harmonics):
            if np.sqrt(energies[2 * n + 1 :].sum()) <= 0.5 * tolerance * self._size:
                return n
        return self._finer.n_harmonics


def _resized(y: Array, problem: HarmonicBalance, other: HarmonicBalance) -> Array:
    """Return (x, parameter) of one balance with the harmonics of another: zeros added, or the highest cut off."""
    coefficients = y[:-1].reshape(problem.shape)
    result = np.zeros(other.shape)
    kept = min(problem.shape[1], other.shape[1])
    result[:, :kept] = coefficients[:, :kept]
    return np.append(result.ravel(), y[-1])
