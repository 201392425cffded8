"""A solution from nothing: the linear response, one harmonic, the way from a linear system, IPOPT."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.errors import NonFiniteError
from hbnlp.core.types import Array
from hbnlp.solutions.attempt import ROUGH, Method, attempt, meets_a_corner
from hbnlp.solutions.homotopy import from_linear_system
from hbnlp.solutions.ipopt import Ipopt, is_quick
from hbnlp.solutions.solution import Solution

PATIENCE = 50
"""Iterations of IPOPT where the force has corners: it converges soon then, to a motion beside them, or not at all."""


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


def linear_size(problem: HarmonicBalance, values: Array) -> float:
    """Return the size of that response; zero where there is none, because the force is not finite at rest."""
    with contextlib.suppress(NonFiniteError):
        return float(np.linalg.norm(linear_guess(problem, values)))
    return 0.0


def cold_start(problem: HarmonicBalance, values: Array, method: Method) -> Solution:
    """Return what the first start that leads to a solution leads to, or else the failure that tells most.

    The starts are the linear response, one harmonic, the way from a linear system, and IPOPT, in this order. Each fails
    for itself: a motion on which the force is not smooth enough says nothing about other motions.

    Raises
    ------
    NonFiniteError
        If the force or its derivative is not finite at rest, and starts beside it lead nowhere.
    """
    singular: NonFiniteError | None = None
    told: list[str] = []
    try:
        starts = _from_linear(problem, values, method, linear_guess(problem, values), told)
    except NonFiniteError as error:
        singular, starts = error, _beside_rest(problem, values, method)
    failed: list[Solution] = []
    for guess, by, start in starts:
        at_corners = isinstance(by, Ipopt) and by is not method and any(map(meets_a_corner, failed))
        patient = Ipopt(max_iterations=PATIENCE) if at_corners else by
        solution = attempt(problem, values, guess, patient, start=start)
        if solution.converged:
            return solution
        failed.append(solution)
    if singular is not None:
        raise singular
    rough = [solution for solution in failed if str(solution.statistics["reason"]).startswith(ROUGH)]
    best = (rough or failed[-1:])[0]
    reason = "; ".join([str(best.statistics["reason"]), *told])
    return dataclasses.replace(best, statistics={**best.statistics, "reason": reason})


def _from_linear(
    problem: HarmonicBalance, values: Array, method: Method, linear: Array, told: list[str]
) -> Iterator[tuple[Array, Method, str]]:
    """Yield guesses, each with the method that begins there and a word for it; dear ones are made when asked for.

    Why one could not be made is added to what is ``told``.
    """
    yield linear, method, "linear response"
    if problem.n_harmonics > 1:
        fewer = problem.with_harmonics(1)
        coarse = attempt(fewer, values, fewer.vector(linear.reshape(problem.shape)), method, start="linear response")
        if coarse.converged:
            yield problem.vector(coarse.coefficients), method, "one harmonic"
    way = from_linear_system(problem, values, linear)
    if way.x is not None:
        yield way.x, method, "from a linear system"
    else:
        told.append(way.reason)
    if not is_quick(problem):
        told.append(
            f"IPOPT, which would take {problem.n_samples} samples times {problem.size} unknowns, was not tried: give "
            "method=hbnlp.Ipopt() and some minutes, or fewer n_samples"
        )
        return
    # at a resonance without damping the linear response says nothing: begin away from rest as well
    load = float(np.max(np.abs(problem.assembly.load_derivative(values))))
    yield linear, Ipopt(), "linear response"
    yield linear + load, Ipopt(), "a shifted linear response"


def _beside_rest(problem: HarmonicBalance, values: Array, method: Method) -> Iterator[tuple[Array, Method, str]]:
    """Yield guesses as `_from_linear` does, for a force that is singular at rest.

    The first has all harmonics, as a force of the velocity alone needs; then come means, to both sides: of a force
    between two parts that attract or repel each other, rest lies somewhere on one.
    """
    load, unit = float(np.max(np.abs(problem.assembly.load_derivative(values)))), np.ones(problem.size)
    length = load / problem.assembly.linear.term_size(unit.reshape(problem.shape), values) or 1.0
    near = 1e-3 * length * unit
    yield near, method, "near rest"
    mean = np.zeros(problem.shape)
    for mean[:, 0] in (length * size * sign for size in (1.0, 1e2, 1e-2) for sign in (1.0, -1.0)):
        yield mean.ravel().copy(), method, "a mean beside rest"
    yield near, Ipopt(), "near rest"
