"""Identification of parameters from measured amplitudes: least squares over responses, with its uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import finite_array, finite_numbers, instance_of, list_of, real_number, refused
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kept import by_one_thread
from hbnlp.core.sending import ReadOnlyArrays, StaysHere
from hbnlp.core.types import Array
from hbnlp.design.program import Optimum, Program
from hbnlp.design.responses import response_at
from hbnlp.design.variables import Variables
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.solution import Solution

INDISTINCT = 1e8
"""A larger condition number of the scaled Jacobian means that the measurements do not determine the variables."""

TOUCHES = 1e-6
"""A variable this near to a limit, relative to its range, is at it."""

NEAR = 1e-3
"""One this near is at it if the measurements would have it beyond: an interior-point method stops short of a limit."""


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Identified(ReadOnlyArrays):
    """Variables identified from measured amplitudes.

    Attributes
    ----------
    values : dict
    covariance : array (n, n)
        Of the variables, in the order of ``values``. A variable at a limit has none, but nan; that of the others holds
        on condition that it has this value.
    at_limit : dict
        Names and limits of the variables that the measurements would have beyond their limits. Their values are those
        of the limits, not of the measurements: widen the limits, or give a variable up.
    residuals : array (n_measurements,)
        Fitted less measured amplitudes.
    noise : float
        Standard deviation of a measurement that the covariance is based on: as given, or estimated from the residuals.
    freedom : float
        Degrees of freedom of the estimate: measurements with a weight less variables that they determine; infinite
        where the noise was given.
    optimum : Optimum
        The fitted responses are ``optimum.solutions``.
    """

    values: dict[str, float]
    covariance: Array
    at_limit: dict[str, float]
    residuals: Array = field(repr=False)
    noise: float
    freedom: float
    optimum: Optimum = field(repr=False)

    @property
    def converged(self) -> bool:
        """Whether the fit was found."""
        return self.optimum.converged

    @property
    def message(self) -> str:
        """What became of it."""
        return self.optimum.message

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard deviation of each variable, nan for those at a limit."""
        return {name: float(error) for name, error in zip(self.values, np.sqrt(np.diag(self.covariance)), strict=True)}

    def confidence(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return the interval in which each variable lies with this probability, nan for those at a limit.

        By Student's t distribution where the noise was estimated, by the normal one where it was given.
        """
        real_number("level", level, above=0.0, below=1.0, advice=", such as 0.95")
        reach = float(stats.t.ppf(0.5 + 0.5 * level, self.freedom))
        errors = self.standard_errors
        return {n: (value - reach * errors[n], value + reach * errors[n]) for n, value in self.values.items()}

    def __repr__(self) -> str:
        errors = self.standard_errors
        values = ", ".join(
            f"{name} = {value:.6g} " + ("at its limit" if name in self.at_limit else f"+- {errors[name]:.2g}")
            for name, value in self.values.items()
        )
        lines = [f"Identified from {self.residuals.size} amplitudes: {values}", f"  noise {self.noise:.3g}"]
        if self.at_limit:
            limits = ", ".join(f"{name} {limit:g}" for name, limit in self.at_limit.items())
            lines.append(f"  limits that bind: {limits}; errors hold on that condition, and those variables have none")
        return "\n".join(lines)


@final
class Identification(StaysHere):
    """Least squares over responses, compiled once: the variables whose amplitudes of an output fit measured ones best.

    The responses are unknowns beside the variables and need not solve the equations on the way. Still the fit is local:
    begin near enough for each measurement to have a solution on its branch.

    Parameters
    ----------
    variables : Variables
    problem : HarmonicBalance
    points : sequence of (mapping, Solution)
        For each measurement the parameters that were set, such as ``{"omega": 3.9}``, and a solution near it, best on
        the same branch; the remaining parameters are those of the solution.
    output, harmonic
        Whose amplitude was measured.
    """

    _instead = "its symbols are those of its program; send problem, points and what fit returned, and make it there"

    @by_one_thread
    def __init__(
        self,
        variables: Variables,
        problem: HarmonicBalance,
        points: Sequence[tuple[Mapping[str, float], Solution]],
        output: str,
        *,
        harmonic: int = 1,
    ) -> None:
        instance_of("variables", variables, Variables, "the Variables(...) to be found")
        instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
        list_of("points", points, Sequence, "a list of (parameters, solution), one a measurement")
        for point in points:
            if len(point) != 2 or not isinstance(point[0], Mapping) or not isinstance(point[1], Solution):
                raise refused(TypeError, "an entry of points", point, "(parameters, solution)")
        responses = [response_at(problem, variables, near, at=set_to) for set_to, near in points]
        amplitude = ca.sqrt(problem.amplitude_squared(output, harmonic))
        fitted = ca.vertcat(*(response(amplitude) for response in responses))
        measured = ca.MX.sym("measured", len(points))
        weights = ca.MX.sym("weights", len(points))
        misfit = 0.5 * ca.sum1(weights * (fitted - measured) ** 2) / ca.sumsqr(measured)
        self.variables = variables
        self._n_points = len(points)
        self._program = Program(variables, responses, objective=misfit, data=ca.vertcat(measured, weights))
        slopes = [ca.jacobian(e, s) for e in (amplitude, problem.g) for s in (problem.x, problem.p)]
        self._slopes = ca.Function("slopes", [problem.x, problem.p], [amplitude, *slopes])
        self._chosen = [problem.system.parameters.index(name) for name in variables.names]

    @interrupts_kept()
    def fit(
        self,
        measured: ArrayLike,
        start: Mapping[str, float] | Identified,
        *,
        near: Sequence[Solution] | None = None,
        weights: ArrayLike | None = None,
        noise: float | None = None,
    ) -> Identified:
        """Return the variables that fit measured amplitudes best.

        Their covariance is ``noise^2 (J^T W J)^-1``, with the weights W and the derivative J of the amplitudes a by the
        variables d, the responses eliminated: ``J = a_d - a_x R_x^-1 R_d``. It holds for independent errors whose
        variances are inverse to the weights, small enough that J does not vary over them. Variables at a limit are
        taken as given: they have no covariance, and are not counted among what the measurements determine.

        Parameters
        ----------
        measured : array (n_measurements,)
            In the order of ``points``.
        start : mapping of names to values, or Identified
            Where the variables begin; or variables and responses, those of an earlier fit.
        near : sequence of Solution, optional
            Where the responses begin, one a measurement, instead of the solutions of ``points``.
        weights : array (n_measurements,), optional
            Of the squared residuals; one by default. One that is zero takes its measurement out of the fit.
        noise : float, optional
            Standard deviation of a measurement of weight one; by default it is estimated from the residuals.

        Raises
        ------
        ConvergenceError
            If the fit fails.
        ValueError
            If the measurements do not determine all variables, or there are too few to estimate the noise.
        """
        amplitudes = finite_numbers("measured", measured)
        if amplitudes.size != self._n_points:
            raise refused(ValueError, "measured", measured, f"an amplitude for each of the {self._n_points} points")
        if amplitudes.min() < 0.0 or not amplitudes.any():
            raise refused(ValueError, "measured", measured, "amplitudes, which are not negative nor all zero")
        instance_of("start", start, Mapping | Identified, "a mapping of the variables to values, or an earlier fit")
        if noise is not None:
            real_number("noise", noise, above=0.0, advice=", or None to have it estimated")
        given = np.ones(self._n_points) if weights is None else finite_array("weights", weights, (self._n_points,))
        if given.min() < 0.0:
            raise refused(ValueError, "weights", weights, "weights that are not negative")
        optimum = self._program.solve(
            start.optimum if isinstance(start, Identified) else start,
            near=near,
            data=np.concatenate([amplitudes, given]),
        )
        return self.described(optimum, amplitudes, given, noise)

    def described(self, optimum: Optimum, amplitudes: Array, weights: Array, noise: float | None) -> Identified:
        """Return the record of a fit, its errors as they are with these weights of the measurements; see `fit`."""
        fitted, rows = zip(*(self._row(solution) for solution in optimum.solutions), strict=True)
        jacobian, residuals = np.array(rows), np.array(fitted) - amplitudes
        roots, counted = np.sqrt(weights), np.count_nonzero(weights)
        jacobian, weighted = roots[:, None] * jacobian, roots * residuals
        at_limit = self._at_limit(optimum, jacobian, weighted)
        free = [i for i, name in enumerate(self.variables.names) if name not in at_limit]
        jacobian = jacobian[:, free]
        sizes = np.linalg.norm(jacobian, axis=0)
        if counted < sizes.size or not np.all(sizes > 0.0) or (free and np.linalg.cond(jacobian / sizes) > INDISTINCT):
            raise ValueError(
                f"these measurements do not determine {' and '.join(self.variables.names[i] for i in free)} together; "
                "add some at other parameters or on another branch, or fix a variable"
            )
        excess = counted - sizes.size
        if noise is None and excess < 1:
            raise ValueError(f"{counted} measurements leave nothing to estimate the noise from; give noise=...")
        deviation = float(np.sqrt(weighted @ weighted / excess)) if noise is None else float(noise)
        scaled = np.linalg.inv((jacobian / sizes).T @ (jacobian / sizes))
        covariance = np.full((len(self.variables.names),) * 2, np.nan)
        covariance[np.ix_(free, free)] = deviation**2 * scaled / np.outer(sizes, sizes)
        return Identified(
            values=optimum.values,
            covariance=covariance,
            at_limit=at_limit,
            residuals=residuals,
            noise=deviation,
            freedom=float(excess) if noise is None else np.inf,
            optimum=optimum,
        )

    def _at_limit(self, optimum: Optimum, jacobian: Array, residuals: Array) -> dict[str, float]:
        """Return the limits at which the fit would be better beyond, or that it touches, by the variables' names."""
        steps = -(jacobian.T @ residuals) / np.maximum(np.sum(jacobian**2, axis=0), np.finfo(float).tiny)
        found = {}
        for (name, value), limits, step in zip(optimum.values.items(), self.variables.limits, steps, strict=True):
            width = limits[1] - limits[0]
            for limit, outward in zip(limits, (-1.0, 1.0), strict=True):
                distance = abs(limit - value)
                if distance <= TOUCHES * width or (distance <= NEAR * width and outward * step > distance):
                    found[name] = float(limit)
        return found

    def _row(self, solution: Solution) -> tuple[float, Array]:
        """Return the amplitude of a fitted response, and its derivatives by the variables."""
        values = attached(solution).values(solution.parameters)
        amplitude, a_x, a_p, r_x, r_p = (e.full() for e in self._slopes(solution.coefficients.ravel(), values))
        return float(amplitude[0, 0]), (a_p[0] - np.linalg.solve(r_x.T, a_x[0]) @ r_p)[self._chosen]
