"""All unknowns at one parameter point: Newton's method, CasADi's rootfinder or IPOPT, from a guess or from nothing."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.arclength import Continuation, PseudoArclength, StopContinuation, start_point
from hbnlp.continuation.newton import Correction, Newton, correct
from hbnlp.core.checks import instance_of
from hbnlp.core.errors import ConvergenceError, NonFiniteError
from hbnlp.core.kinds import Status
from hbnlp.core.types import Array
from hbnlp.solutions.equations import LoadCurve
from hbnlp.solutions.solution import Solution, guess_for, make_solution

ALIASING_TOL = 1e-9
"""More samples of the force must not move the residual by more than this, relative to its terms."""


@dataclass(frozen=True, kw_only=True)
class Ipopt:
    """IPOPT with exact first and second derivatives: slower than Newton's method, and content with worse guesses.

    Parameters
    ----------
    tol : float
        Its convergence tolerance, on scaled optimality and feasibility.
    max_iterations : int

    References
    ----------
    Waechter, Biegler (2006), Math. Program. 106, 25-57, doi:10.1007/s10107-004-0559-y.
    """

    tol: float = 1e-12
    max_iterations: int = 500

    def __post_init__(self) -> None:
        if not 0.0 < self.tol < 1e-2:
            raise ValueError(f"tol = {self.tol!r}; a tolerance between 0 and 0.01 is needed")
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations = {self.max_iterations!r}; at least 1 is needed")

    def options(self) -> dict[str, object]:
        """Return the options of CasADi's ``nlpsol``."""
        return {
            "print_time": False,
            "show_eval_warnings": False,
            "error_on_fail": False,
            "ipopt": {
                "tol": self.tol,
                "constr_viol_tol": self.tol,
                "acceptable_iter": 0,
                "max_iter": self.max_iterations,
                "print_level": 0,
                "sb": "yes",
                "mu_strategy": "adaptive",
                "nlp_scaling_method": "gradient-based",
            },
        }


@dataclass(frozen=True, kw_only=True)
class Rootfinder:
    """CasADi's ``rootfinder`` on the symbolic residual.

    Parameters
    ----------
    plugin : str
        "newton", "fast_newton" or "kinsol".
    tol : float
        Absolute tolerance on the residual.
    max_iterations : int
    """

    plugin: str = "newton"
    tol: float = 1e-12
    max_iterations: int = 100

    def __post_init__(self) -> None:
        known = ("newton", "fast_newton", "kinsol")
        if self.plugin not in known:
            raise ValueError(f"plugin = {self.plugin!r}; one of {', '.join(known)} is needed")
        if not 0.0 < self.tol < 1e-2:
            raise ValueError(f"tol = {self.tol!r}; a tolerance between 0 and 0.01 is needed")
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations = {self.max_iterations!r}; at least 1 is needed")


Method = Newton | Ipopt | Rootfinder


def solve(
    problem: HarmonicBalance,
    *,
    at: Mapping[str, float] | None = None,
    guess: Solution | ArrayLike | None = None,
    method: Method | None = None,
    throw: bool = True,
) -> Solution:
    """Return a periodic solution at one parameter point.

    Without a guess it starts from the linear response and, where Newton's method fails there, from the solution with
    fewer harmonics, then along the solutions that lead from rest as the load grows to its value (a continuation, so
    folds on the way do not matter), and last by IPOPT.

    Parameters
    ----------
    problem : HarmonicBalance
    at : mapping, optional
        Parameter values; the system's own for the rest.
    guess : Solution or array (n_dof, any odd number), optional
        A start.
    method : Newton, Ipopt or Rootfinder, optional
        Newton by default.
    throw : bool
        Raise a ConvergenceError, with the unconverged solution as ``result``, rather than returning that.

    Raises
    ------
    ConvergenceError
        If nothing converged and ``throw`` is true.
    KeyError, ValueError
        For a parameter that is not known, or has no value.
    TypeError
        For a problem or a method of another kind.
    NonFiniteError
        If there is no guess, and the force or its derivative is not finite at rest.
    """
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
    values = problem.values(at)
    method = Newton() if method is None else method
    instance_of("method", method, Method, "Newton(), Ipopt() or Rootfinder()")
    if guess is not None:
        start = guess_for(problem, guess)
        if not np.all(np.isfinite(start)):
            raise ValueError("the guess has entries that are not finite; give finite coefficients")
        solution = attempt(problem, values, start, method, start="guess")
    else:
        solution = _cold(problem, values, method)
    if solution.converged or not throw:
        return solution
    point = ", ".join(f"{k}={v:g}" for k, v in solution.parameters.items())
    raise ConvergenceError(
        f"no solution at {point}: {solution.statistics['reason']}. {Status.NOT_CONVERGED.value}", solution
    )


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
                f"(q = 0, {problem.system.parameters.as_dict(values)}): smooth it there, or give a guess"
            )
    return np.asarray(-np.linalg.lstsq(jacobian, residual, rcond=None)[0])


def _cold(problem: HarmonicBalance, values: Array, method: Method) -> Solution:
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
    curve = LoadCurve(problem, values)
    full = np.zeros(problem.size + 1)
    full[-1] = 1.0
    rest = correct(curve, np.zeros(problem.size + 1), full, newton)
    if not rest.converged:
        return None
    linear = linear_guess(problem, values)
    curve.solution_floor = 1e-3 * float(np.linalg.norm(linear)) or 1.0
    # at a linear resonance the curve leaves rest without a slope in the load: either way may be the one that grows
    for toward in (full, -start_point(curve, rest.y, full).tangent):
        walk = Continuation(curve, start_point(curve, rest.y, toward), PseudoArclength(max_points=2000))
        with contextlib.suppress(StopContinuation):
            for _ in range(walk.options.max_points):
                if walk.advance((-1.0, 1.0)).parameter in (-1.0, 1.0):
                    break
        if walk.point.parameter == 1.0:
            return walk.point.y[:-1]
    return None


def attempt(problem: HarmonicBalance, values: Array, guess: Array, method: Method, *, start: str) -> Solution:
    """Return what the method makes of a guess, with enough samples of the force; ``start`` says where it is from."""
    correction = iterate(problem, guess, values, method)
    while correction.converged and not samples_suffice(problem, correction.y, values):
        problem = problem.oversampled()
        correction = iterate(problem, correction.y, values, method)
    statistics: dict[str, float | str] = {
        "start": start,
        "method": type(method).__name__,
        "iterations": correction.iterations,
        "residual": correction.residual,
    }
    if correction.reason:
        statistics["reason"] = correction.reason
    status = Status.CONVERGED if correction.converged else Status.NOT_CONVERGED
    return make_solution(problem, correction.y, values, status=status, statistics=statistics)


def samples_suffice(problem: HarmonicBalance, x: Array, values: Array) -> bool:
    """Return whether twice the samples of the force leave the residual at a solution within the aliasing tolerance."""
    if problem.samples_are_settled:
        return True
    fine, coarse = (each.assembly.residual(x, values) for each in (problem.oversampled(), problem))
    moved = float(np.max(np.abs(fine - coarse)))
    return moved <= ALIASING_TOL * max(problem.assembly.term_size(x, values), float(np.finfo(float).tiny))


def iterate(problem: HarmonicBalance, guess: Array, values: Array, method: Method) -> Correction:
    """Return what the method makes of a guess; ``y`` holds the unknowns alone."""
    if isinstance(method, Newton):
        row = np.zeros(problem.size + 1)
        row[-1] = 1.0
        with np.errstate(all="ignore"):  # what is not finite ends the iteration
            found = correct(LoadCurve(problem, values), np.append(guess, 1.0), row, method)
        return dataclasses.replace(found, y=found.y[:-1])
    solver = _compiled(problem, method)
    if isinstance(method, Ipopt):
        answer = solver(x0=guess, p=values, lbg=0.0, ubg=0.0)
        x = answer["x"].full().ravel()
    else:
        x = solver(guess, values).full().ravel()
    statistics = solver.stats()
    with np.errstate(all="ignore"):
        size = max(problem.assembly.term_size(x, values), float(np.finfo(float).tiny))
        residual = float(np.max(np.abs(problem.assembly.residual(x, values)))) / size
    converged = bool(statistics["success"]) and residual < 1e-6
    reason = f"the residual is {residual:.1e} of its terms"
    if not statistics["success"]:
        reason = str(statistics.get("return_status", "the rootfinder failed"))
    return Correction(
        y=x,
        converged=converged,
        iterations=int(statistics.get("iter_count", 0)),
        factorisations=int(statistics.get("iter_count", 0)),
        error=np.nan,
        residual=residual,
        reason="" if converged else reason,
    )


def _compiled(problem: HarmonicBalance, method: Ipopt | Rootfinder) -> ca.Function:
    if isinstance(method, Ipopt):
        return ca.nlpsol("solver", "ipopt", problem.nlp, method.options())
    options: dict[str, object] = {"error_on_fail": False, "show_eval_warnings": False, "abstol": method.tol}
    if method.plugin != "fast_newton":
        options |= {"linear_solver": "lapacklu", "max_iter": method.max_iterations}
    return ca.rootfinder("solver", method.plugin, problem.residual, options)
