"""Fold points: located by Newton's method on the bordered system, or as the optimum of a nonlinear program.

At a fold the Jacobian has a null vector v while the parameter is stationary along the branch. Both descriptions are
used::

    R(x, p) = 0,  R_x v = 0,  v.v = 1               (Moore and Spence 1980), solved by Newton
    min or max  lambda   s.t.  R(x, p) = 0          whose multiplier is the left null vector w, solved by IPOPT

and w gives the fold's derivative with respect to every parameter, ``d lambda / d p_j = - w.R_pj / w.R_lambda``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.along import Along
from hbnlp.continuation.curve import Bordered, null_vector, relative_residual
from hbnlp.continuation.newton import LARGEST_RESIDUAL, Correction, Newton, correct
from hbnlp.core.types import Array
from hbnlp.solutions.equations import Equations, along_folds, along_parameter
from hbnlp.solutions.ipopt import Ipopt, minimise

LARGEST_CONDITION = 1e12
"""Of the bordered system at a fold; a larger one means that the kernel has several dimensions."""


@dataclass(frozen=True, kw_only=True)
class LocatedFold:
    """What a method made of the neighbourhood of a fold.

    Attributes
    ----------
    x : array (n (2H+1),)
        The solution.
    value : float
        The parameter.
    null, left : array (n (2H+1),) or None
        Right null vector (Newton's method has it) and left null vector (the program's multiplier), of unit length.
    converged : bool
    residual : float
        Relative to its terms.
    iterations : int
    reason : str
        Why it did not converge.
    by_newton : bool
        False where Newton's method failed and least squares served, as they do where the kernel has several dimensions.
    """

    x: Array = field(repr=False)
    value: float
    null: Array | None = field(default=None, repr=False)
    left: Array | None = field(default=None, repr=False)
    converged: bool
    residual: float
    iterations: int
    reason: str
    by_newton: bool = True


def fold_by_newton(
    problem: HarmonicBalance,
    x: Array,
    values: Array,
    name: str,
    newton: Newton,
    null: Array | None = None,
    *,
    kind: type[Equations] = Equations,
) -> LocatedFold:
    """Return the fold near a point of a curve of this kind; ``null`` is a guess of v."""
    curve = along_folds(problem, x, values, name, kind=kind)
    if null is None:
        null = null_vector(problem.assembly.jacobian(x, values))
    here = values[problem.system.parameters.index(name)]
    guess = curve.unknowns.joined(x, [here, 1.0], null / np.linalg.norm(null))
    found = correct(curve, guess, curve.unknowns.fixing_last(), newton)
    regular = found.converged
    if not regular:
        found = _by_least_squares(curve, guess, newton)
    return LocatedFold(
        x=curve.unknowns.coefficients(found.y),
        value=float(curve.unknowns.scalars(found.y)[0]),
        null=curve.unknowns.added(found.y),
        converged=found.converged,
        residual=found.residual,
        iterations=found.iterations,
        reason=found.reason,
        by_newton=regular,
    )


def _by_least_squares(curve: Equations, guess: Array, newton: Newton) -> Correction:
    """Return a fold whose kernel has several dimensions, by the smallest of the steps that solve Newton's equations.

    Any vector of the kernel serves as v, so that the fold's equations are singular at their solutions; these form a
    manifold, onto which Gauss and Newton's method converges quadratically (Ben-Israel 1966,
    doi:10.1016/0022-247X(66)90115-6).
    """
    y, scale = guess.copy(), curve.scale(guess)
    matrix, size = np.zeros((curve.size, y.size)), np.inf
    for iteration in range(1, newton.max_iterations + 1):
        matrix[:] = 0.0
        curve.jacobian(y, matrix)
        residual = curve.residual(y)
        if not (np.isfinite(matrix).all() and np.isfinite(residual).all()):
            break
        step = np.linalg.lstsq(matrix[:, :-1] * scale[:-1], -residual, rcond=1e-8)[0] * scale[:-1]
        y[:-1] += step
        size = float(np.linalg.norm(step / scale[:-1]))
        if size <= newton.tol:
            remaining = relative_residual(curve, y)
            return Correction(
                y=y,
                converged=remaining <= LARGEST_RESIDUAL,
                iterations=iteration,
                factorisations=iteration,
                error=size,
                residual=remaining,
                reason="" if remaining <= LARGEST_RESIDUAL else f"the residual is {remaining:.1e} of its terms",
            )
    return Correction(
        y=y,
        converged=False,
        iterations=newton.max_iterations,
        factorisations=newton.max_iterations,
        error=size,
        residual=np.inf,
        reason="no fold was found by Newton's method or by least squares",
    )


def fold_by_program(
    problem: HarmonicBalance, x: Array, values: Array, name: str, ipopt: Ipopt, *, maximum: bool
) -> LocatedFold:
    """Return the fold near a point as the largest or the smallest parameter of the solutions."""
    index = problem.system.parameters.index(name)
    free = problem.symbol(name) / (abs(float(values[index])) or 1.0)
    found = minimise(problem, -free if maximum else free, x, values, free=[name], method=ipopt)
    return LocatedFold(
        x=found.x,
        value=float(found.values[index]),
        left=found.multipliers / np.linalg.norm(found.multipliers),
        converged=found.success,
        residual=found.residual,
        iterations=found.iterations,
        reason="" if found.success else found.status,
    )


def left_null_vector(
    problem: HarmonicBalance, x: Array, values: Array, name: str, null: Array, *, kind: type[Equations] = Equations
) -> Array:
    """Return w with w.R_x = 0 at a fold with null vector v, scaled to w.R_lambda = 1.

    It solves the transpose of the system [R_x, R_lambda; v, 0], which is regular at a fold. Where the kernel has
    several dimensions it is singular, and w the smallest solution.
    """
    curve = along_parameter(problem, values, name, kind=kind)
    y = curve.unknowns.joined(x, [values[problem.system.parameters.index(name)]])
    seen = Along(curve)
    matrix = np.zeros((seen.size + 1, seen.size + 1))
    seen.jacobian(seen.part(y), matrix[:-1])
    matrix[-1] = seen.part(np.append(null, 0.0))
    columns, unit = seen.part(curve.scale(y)), seen.part(curve.unknowns.fixing_last())
    rows = np.abs(matrix * columns).max(axis=1)
    dimensionless = matrix * columns / np.where(rows > 0.0, rows, 1.0)[:, None]
    if np.linalg.cond(dimensionless) > LARGEST_CONDITION:
        smallest = np.linalg.lstsq(dimensionless.T, unit * columns, rcond=1.0 / LARGEST_CONDITION)[0]
        return seen.whole(smallest / rows)[: problem.size]
    return seen.whole(Bordered(matrix).solve_transposed(unit))[: problem.size]


def fold_sensitivity(problem: HarmonicBalance, x: Array, values: Array, name: str, left: Array) -> dict[str, float]:
    """Return d lambda / d p_j along the fold for every other parameter, from a left null vector of any length.

    Of a parameter at the edge of its domain, where the equations have no derivative, it is not finite.
    """
    names = problem.system.parameters.names
    with np.errstate(all="ignore"):
        slopes = {other: left @ problem.assembly.parameter_derivative(x, values, i) for i, other in enumerate(names)}
        return {other: float(-slope / slopes[name]) for other, slope in slopes.items() if other != name}
