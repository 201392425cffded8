"""Fold points: located by Newton's method on the bordered system, or as the optimum of a nonlinear program.

At a fold the Jacobian has a null vector v while the parameter is stationary along the branch. Both descriptions are
used::

    R(x, p) = 0,  R_x v = 0,  v.v = 1               (Moore and Spence 1980), solved by Newton
    min or max  lambda   s.t.  R(x, p) = 0          whose multiplier is the left null vector w, solved by IPOPT

and w gives the fold's derivative with respect to every parameter, ``d lambda / d p_j = - w.R_pj / w.R_lambda``.
"""

from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.newton import Bordered, Correction, Newton, correct
from hbnlp.core.types import Array
from hbnlp.solutions.solving import Ipopt


class FoldCurve:
    """Folds ``y = (x, v, lambda, mu)`` in two parameters, or at fixed mu; by default mu scales the load."""

    def __init__(self, problem: HarmonicBalance, values: Array, first: str, second: str | None = None) -> None:
        self.problem = problem
        self.n = problem.size
        self.size = 2 * self.n + 1
        self.first = problem.system.parameters.index(first)
        self.second = problem.system.parameters.index(second) if second is not None else None
        self._values = values.copy()
        self._floor = 1e-3 * np.maximum(np.abs(self._values[[self.first, self.second or 0]]), np.finfo(float).tiny)

    def values(self, y: Array) -> Array:
        """Return all parameters at a point."""
        values = self._values.copy()
        values[self.first] = y[-2]
        if self.second is not None:
            values[self.second] = y[-1]
        return values

    def load(self, y: Array) -> float:
        """Return the factor on the excitation."""
        return 1.0 if self.second is not None else float(y[-1])

    def residual(self, y: Array) -> Array:
        """Return R(y), (size,)."""
        assembly, values = self.problem.assembly, self.values(y)
        x, v = y[: self.n], y[self.n : -2]
        result = np.empty(self.size)
        result[: self.n] = assembly.residual(x, values, self.load(y))
        result[self.n : -1] = assembly.jacobian(x, values) @ v
        result[-1] = 0.5 * (v @ v - 1.0)
        return result

    def jacobian(self, y: Array, out: Array) -> None:
        """Write dR/dy into an array (size, size + 1) of zeros."""
        assembly, values, n = self.problem.assembly, self.values(y), self.n
        x, v, matrix = y[:n], y[n:-2], out
        matrix[:n, :n] = assembly.jacobian(x, values)
        matrix[n:-1, n:-2] = matrix[:n, :n]
        matrix[n:-1, :n] = assembly.jacobian_along(x, values, v)
        matrix[-1, n:-2] = v
        for column, index in ((-2, self.first), (-1, self.second)):
            if index is None:
                matrix[:n, column] = assembly.load_derivative(values)
            else:
                matrix[:n, column] = assembly.parameter_derivative(x, values, index, self.load(y))
                matrix[n:-1, column] = assembly.jacobian_along(x, values, None, index) @ v

    def scale(self, y: Array) -> Array:
        """Return the sizes (size + 1,) by which changes of y are measured."""
        scale = np.ones(y.size)
        scale[: self.n] = max(float(np.linalg.norm(y[: self.n])), np.finfo(float).tiny)
        scale[-2:] = np.maximum(np.abs(y[-2:]), self._floor)
        return scale

    def term_size(self, y: Array) -> float:
        """Return the size of the terms whose sum is R."""
        assembly, values, x = self.problem.assembly, self.values(y), y[: self.n]
        products = np.abs(assembly.jacobian(x, values)) @ np.abs(y[self.n : -2])
        return max(assembly.term_size(x, values), float(products.max()))


def fold_by_newton(
    problem: HarmonicBalance, x: Array, values: Array, name: str, newton: Newton, null: Array | None = None
) -> Correction:
    """Return the fold near a point as a correction whose ``y`` is (x, v, lambda); ``null`` is a guess of v."""
    curve = FoldCurve(problem, values, name)
    if null is None:
        null = np.linalg.svd(problem.assembly.jacobian(x, values))[2][-1]
    guess = np.concatenate([x, null / np.linalg.norm(null), [values[curve.first], 1.0]])
    row = np.zeros(guess.size)
    row[-1] = 1.0
    found = correct(curve, guess, row, newton)
    return dataclasses.replace(found, y=found.y[:-1])


def fold_by_program(
    problem: HarmonicBalance, x: Array, values: Array, name: str, ipopt: Ipopt, *, maximum: bool
) -> tuple[Correction, Array]:
    """Return the fold near a point as (x, lambda), and the multiplier: the left null vector of unit length."""
    index = problem.system.parameters.index(name)
    free = ca.MX.sym("free")
    symbols = ca.vertcat(*(free if i == index else problem.p[i] for i in range(values.size)))
    residual = ca.substitute(problem.g, problem.p, symbols)
    size, scale = max(problem.assembly.term_size(x, values), np.finfo(float).tiny), max(abs(values[index]), 1e-12)
    program = {
        "x": ca.vertcat(problem.x, free),
        "p": problem.p,
        "f": (-free if maximum else free) / scale,
        "g": residual / size,
    }
    solver = ca.nlpsol("fold", "ipopt", program, ipopt.options())
    answer = solver(x0=np.append(x, values[index]), p=values, lbg=0.0, ubg=0.0)
    y = answer["x"].full().ravel()
    multiplier = answer["lam_g"].full().ravel()
    stats = solver.stats()
    at = values.copy()
    at[index] = y[-1]
    remaining = float(np.max(np.abs(problem.assembly.residual(y[:-1], at)))) / size
    correction = Correction(
        y=y,
        converged=bool(stats["success"]),
        iterations=int(stats["iter_count"]),
        factorisations=int(stats["iter_count"]),
        error=np.nan,
        residual=remaining,
        reason="" if stats["success"] else str(stats["return_status"]),
    )
    return correction, multiplier / np.linalg.norm(multiplier)


def left_null_vector(problem: HarmonicBalance, x: Array, values: Array, name: str, null: Array) -> Array:
    """Return w with w.R_x = 0 at a fold with null vector v, scaled to w.R_lambda = 1.

    It solves the transpose of the system [R_x, R_lambda; v, 0], which is regular at a fold.
    """
    index = problem.system.parameters.index(name)
    matrix = np.zeros((problem.size + 1, problem.size + 1))
    matrix[:-1, :-1] = problem.assembly.jacobian(x, values)
    matrix[:-1, -1] = problem.assembly.parameter_derivative(x, values, index)
    matrix[-1, :-1] = null
    last = np.zeros(problem.size + 1)
    last[-1] = 1.0
    return Bordered(matrix).solve_transposed(last)[:-1]


def fold_sensitivity(problem: HarmonicBalance, x: Array, values: Array, name: str, left: Array) -> dict[str, float]:
    """Return d lambda / d p_j along the fold for every other parameter, from a left null vector of any length."""
    names = problem.system.parameters.names
    slopes = {other: left @ problem.assembly.parameter_derivative(x, values, i) for i, other in enumerate(names)}
    return {other: float(-slope / slopes[name]) for other, slope in slopes.items() if other != name}
