"""A solution from nothing: the linear response, fewer harmonics, the way from rest as the load grows, IPOPT."""

from __future__ import annotations

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.continuation.newton import Newton, correct
from hbnlp.continuation.point import start_point
from hbnlp.continuation.walk import Walk
from hbnlp.core.errors import NonFiniteError
from hbnlp.core.types import Array
from hbnlp.solutions.attempt import Method, attempt
from hbnlp.solutions.equations import along_load
from hbnlp.solutions.ipopt import Ipopt
from hbnlp.solutions.solution import Solution


def linear_guess(problem: HarmonicBalance, values: Array) -> Array:
    """Return the response of the system linearised about rest, as a vector of unknowns.

    Raises
    ------
    NonFiniteError
        If the force or its derivative at rest is not finite.
    """
    rest = np.zeros(problem.size)
    with np.errstate(all="ignore"):
        residual, jacobian = problem.assembly.residual(rest, values), problem.assembly.jacobian(rest, values)
    for what, array in (("value", residual), ("derivative", jacobian)):
        if not np.all(np.isfinite(array)):
            raise NonFiniteError(
                f"the {what} of nonlinear_force, of forcing or of a matrix is not finite at rest "
                f"(q = 0, {problem.system.parameters.as_dict(values)}): smooth it there, or give a start"
            )
    return np.asarray(-np.linalg.lstsq(jacobian, residual, rcond=None)[0])


def cold_start(problem: HarmonicBalance, values: Array, method: Method) -> Solution:
    """Return the best of a start from the linear response, one harmonic, a growing load, and IPOPT, in this order."""
    try:
        linear = linear_guess(problem, values)
    except NonFiniteError:
        solution = attempt(problem, values, np.full(problem.size, 1e-3), method, start="near rest")
        if not solution.converged:
            raise
        return solution
    solution = attempt(problem, values, linear, method, start="linear response")
    if solution.converged or not isinstance(method, Newton):
        return solution
    if problem.n_harmonics > 1:
        fewer = problem.with_harmonics(1)
        coarse = attempt(fewer, values, fewer.vector(linear.reshape(problem.shape)), method, start="linear response")
        if coarse.converged:
            solution = attempt(problem, values, problem.vector(coarse.coefficients), method, start="one harmonic")
    if not solution.converged:
        grown = from_rest(problem, values, method)
        if grown is not None:
            solution = attempt(problem, values, grown, method, start="growing load")
    # at a resonance without damping the linear response says nothing: begin away from rest as well
    load = float(np.max(np.abs(problem.assembly.load_derivative(values))))
    for guess, start in ((linear, "linear response"), (linear + load, "a shifted linear response")):
        if not solution.converged:
            solution = attempt(problem, values, guess, Ipopt(), start=start)
    return solution


def from_rest(problem: HarmonicBalance, values: Array, newton: Newton) -> Array | None:
    """Return the unknowns reached by continuation in the load from rest to its full size, or None."""
    curve = along_load(problem, values)
    full = curve.unknowns.fixing_last()
    rest = correct(curve, np.zeros(full.size), full, newton)
    if not rest.converged:
        return None
    linear = linear_guess(problem, values)
    curve = along_load(problem, values, floor=1e-3 * float(np.linalg.norm(linear)) or 1.0)
    # at a linear resonance the curve leaves rest without a slope in the load: either way may be the one that grows
    for toward in (full, -start_point(curve, rest.y, full).tangent):
        walk = Walk(curve, start_point(curve, rest.y, toward), PseudoArclength(max_points=2000), limits=(-1.0, 1.0))
        for _before, after in walk:
            if after.value == 1.0:
                return curve.unknowns.coefficients(after.y)
    return None
