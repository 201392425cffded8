"""Nonlinear programs over responses: variables shared by several periodic solutions, folds among them.

Every response brings its unknowns and its equations, and IPOPT moves responses and variables d at once::

    min  f(d, x_1, x_2, ...)   s.t.   R(x_i; d) = 0,   lower <= c(d, x_1, x_2, ...) <= upper

All derivatives, the second ones included, are CasADi's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import final

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import finite_array, flag, instance_of, list_of, real_number, refused, unknown_name
from hbnlp.core.errors import ConvergenceError, SamplingError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kept import by_one_thread
from hbnlp.core.sending import ReadOnlyArrays, StaysHere
from hbnlp.core.types import Array
from hbnlp.design.responses import Response, begun_at
from hbnlp.design.variables import Variables
from hbnlp.solutions.ipopt import Ipopt, Solver
from hbnlp.solutions.solution import Solution, make_solution

LARGEST_EXPANSION = 200_000
"""Scalar operations up to which a program is written out in them: derivatives of more take minutes and gigabytes."""


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Optimum(ReadOnlyArrays):
    """What a program found: ``values`` of the variables, the objective, and a Solution for each response.

    ``multipliers`` holds an array for each bound, by its name: minus the derivative of the objective by the limit that
    is active, hence negative at lower limits, positive at upper ones, and zero at neither. ``lam_g`` has all of them as
    CasADi does: those of the responses' equations first, then those of the bounds.
    """

    values: dict[str, float]
    objective: float
    solutions: tuple[Solution, ...] = field(repr=False)
    multipliers: dict[str, Array] = field(repr=False)
    lam_g: Array = field(repr=False)
    converged: bool
    message: str
    iterations: int
    unknowns: Array = field(repr=False)


@final
class Program(StaysHere):
    """A nonlinear program over responses, compiled once.

    Parameters
    ----------
    variables : Variables
    responses : sequence of Response
        All made with these variables.
    objective : casadi.MX
        What is minimised, best of order one: an expression of variables, responses and data.
    bounds : mapping of names to (lower, expression, upper), optional
        The expression may be a vector; the limits are numbers.
    data : casadi.MX, optional
        Symbols whose values are given to `solve`.
    method : Ipopt, optional
    expand : bool, optional
        Whether the program is written out in scalar operations: each iteration is then two to twenty times faster,
        while building it takes 20 to 40 microseconds and up to 5 kB an operation. By default it is, up to 200,000 of
        them: some tens of responses of thirty unknowns, two of a wing with many lag states.
    """

    _instead = "its symbols are those of its variables and responses; send problems and solutions, and make it there"

    @by_one_thread
    def __init__(
        self,
        variables: Variables,
        responses: Sequence[Response],
        *,
        objective: ca.MX,
        bounds: Mapping[str, tuple[float, ca.MX, float]] | None = None,
        data: ca.MX | None = None,
        method: Ipopt | None = None,
        expand: bool | None = None,
    ) -> None:
        instance_of("variables", variables, Variables, "the Variables(...) that the responses were made with")
        list_of("responses", responses, Response, "a list of responses, from response_at or fold_at")
        instance_of("objective", objective, ca.MX, "an expression of variables, responses and data, one number")
        instance_of("bounds", bounds, Mapping | None, "a mapping of names to (lower, expression, upper)")
        instance_of("data", data, ca.MX | None, "symbols, casadi.MX.sym(name, size)")
        instance_of("method", method, Ipopt | None, "Ipopt(...)")
        if expand is not None:
            flag("expand", expand)
        for name, bound in (bounds or {}).items():
            if not isinstance(bound, Sequence) or len(bound) != 3 or not isinstance(bound[1], ca.MX):
                raise refused(TypeError, f"bounds[{name!r}]", bound, "(lower, expression, upper)")
        if objective.numel() != 1:
            raise refused(ValueError, "objective", objective, "an expression of one number")
        if data is not None and not data.is_valid_input():
            raise refused(ValueError, "data", data, "symbols alone, casadi.MX.sym(name, size)")
        self.variables, self.responses, self.bounds = variables, tuple(responses), dict(bounds or {})
        if not responses:
            raise ValueError("responses is empty; a program needs one at least, from response_at or fold_at")
        given = ca.MX(0, 1) if data is None else data
        unknowns = ca.vertcat(variables.symbols, *(r.unknowns for r in responses))
        parts = [ca.vertcat(*(r.equations for r in responses)), *(ca.vec(b[1]) for b in self.bounds.values())]
        ends = np.cumsum([part.numel() for part in parts])
        self._rows = {name: slice(i, j) for name, i, j in zip(self.bounds, ends[:-1], ends[1:], strict=True)}
        self._n_equations = int(ends[0])
        self._limits = np.zeros((ends[-1], 2))
        for name, (lower, _, upper) in self.bounds.items():
            if not lower <= upper:
                raise ValueError(f"bound {name!r} is from {lower!r} to {upper!r}: nothing lies in between")
            self._limits[self._rows[name]] = lower, upper
        known = {hash(symbol) for symbol in ca.symvar(ca.vertcat(unknowns, given))}
        for symbol in ca.symvar(ca.vertcat(objective, *parts)):
            if hash(symbol) not in known:
                raise ValueError(
                    f"the symbol {symbol} is of neither these variables, these responses nor data: make all responses "
                    "with the same Variables, and write response(expression) for expressions of problem.x and problem.p"
                )
        # bounds reach IPOPT in their own sizes, which are known once a solve begins: its tolerances are absolute
        self._bounded = ca.Function("bounded", [unknowns, given], [ca.vertcat(*parts[1:])])
        sizes = ca.MX.sym("sizes", ends[-1] - ends[0])
        constraints = ca.vertcat(parts[0], ca.vertcat(*parts[1:]) / sizes)
        program = {"x": unknowns, "p": ca.vertcat(given, sizes), "f": objective, "g": constraints}
        options = (method or Ipopt(tol=1e-10)).options()
        if expand is None:
            one = ca.Function("one", [unknowns, given], [self.responses[0].equations])
            whole = ca.Function("whole", [unknowns, program["p"]], [objective, constraints])
            expand = len(responses) * _n_operations(one) <= LARGEST_EXPANSION >= _n_operations(whole)
        self._solver = Solver(program, {**options, "expand": expand})
        self._states = ca.Function("states", [unknowns, given], [e for r in responses for e in (r.x, r.p)])

    @interrupts_kept()
    def solve(
        self,
        start: Mapping[str, float] | Optimum,
        *,
        near: Sequence[Solution] | None = None,
        data: ArrayLike = (),
        throw: bool = True,
    ) -> Optimum:
        """Return a local optimum, from values of the variables and the responses' own starts, or from an earlier one.

        Parameters
        ----------
        start : mapping of names to values, or Optimum
            Values of the variables; or variables and responses, those of an earlier optimum.
        near : sequence of Solution, optional
            Where the responses begin instead, one each. Folds cannot.
        data : array, optional
            Values of the program's data.
        throw : bool
            Whether a failure is an error.

        Returns
        -------
        Optimum

        Raises
        ------
        ConvergenceError
            If none is found and ``throw`` is true: ``result`` is where IPOPT stopped, and the message names the bounds
            that are in the way.
        """
        instance_of("start", start, Mapping | Optimum, "a mapping of the variables to values, or an Optimum")
        flag("throw", throw)
        if near is not None:
            list_of("near", near, Solution, "a list of solutions, one a response")
            if len(near) != len(self.responses):
                raise refused(ValueError, "near", near, f"a solution for each of the {len(self.responses)} responses")
        over, given = self.variables, np.atleast_1d(finite_array("data", data))
        if isinstance(start, Optimum):
            first, x0 = start.unknowns[: len(over.names)], start.unknowns
        else:
            for name in {*over.names} ^ {*start}:
                raise KeyError(
                    f"start: {unknown_name('variable', name, over.names)}" if name in start else f"start lacks {name!r}"
                )
            first = np.array([real_number(name, start[name]) for name in over.names]) / over.scale
            x0 = np.concatenate([first, *(r.start for r in self.responses)])
        if near is not None:
            begun = [begun_at(response, solution) for response, solution in zip(self.responses, near, strict=True)]
            x0 = np.concatenate([first, *begun])
        for what, array, size in (("start", x0, self._states.size1_in(0)), ("data", given, self._states.size1_in(1))):
            if array.shape != (size,):
                raise ValueError(f"{what} has shape {array.shape}; ({size},) is needed for this program")
        box = np.tile([-np.inf, np.inf], (x0.size, 1))
        box[: len(over.names)] = over.limits / over.scale[:, None]
        sizes = self._sizes(x0, given)
        (lbx, ubx), (lbg, ubg) = box.T, (self._limits / sizes[:, None]).T
        p = np.append(given, sizes[self._n_equations :])
        answer, stats = self._solver(x0=x0, p=p, lbx=lbx, ubx=ubx, lbg=lbg, ubg=ubg)
        y, g, lam_g = (answer[key].full().ravel() for key in ("x", "g", "lam_g"))
        lam_g /= sizes
        states = [e.full().ravel() for e in self._states.call([y, given])]
        points = list(zip((r.problem for r in self.responses), states[::2], states[1::2], strict=True))
        message = "converged"
        if not stats["success"]:
            reached = np.maximum(lbg - g, g - ubg) > -1e-6
            met = " and ".join(repr(name) for name, rows in self._rows.items() if reached[rows].any())
            off = float(np.abs(g[: self._n_equations]).max())
            advice = f"at the bound {met}: relax it or those of the variables, or start" if met else "start"
            message = f"IPOPT ended with {stats['return_status']}, an equation off by {off:.2g}; {advice} nearer"
        else:
            message = _of_samples(points) or message
        optimum = Optimum(
            values={
                name: float(value) for name, value in zip(over.names, over.scale * y[: over.scale.size], strict=True)
            },
            objective=float(answer["f"]),
            solutions=tuple(make_solution(*point) for point in points),
            multipliers={name: lam_g[rows] for name, rows in self._rows.items()},
            lam_g=lam_g,
            converged=message == "converged",
            message=message,
            iterations=int(stats["iter_count"]),
            unknowns=y,
        )
        if throw and not optimum.converged:
            raise ConvergenceError(message, optimum)
        return optimum

    def _sizes(self, x0: Array, given: Array) -> Array:
        """Return the size of each constraint: of a bound its larger limit, or its expression where that is zero."""
        sizes: Array = np.where(np.isfinite(self._limits), np.abs(self._limits), 0.0).max(axis=1)
        sizes[: self._n_equations] = 1.0  # the responses' equations have no units
        at_start = self._bounded(x0, given).full().ravel()
        for rows in self._rows.values():
            if not sizes[rows].any():
                values = np.abs(at_start[rows.start - self._n_equations : rows.stop - self._n_equations])
                sizes[rows] = values[np.isfinite(values)].max(initial=0.0) or 1.0
        return sizes


def _of_samples(points: Sequence[tuple[HarmonicBalance, Array, Array]]) -> str:
    """Return what is wrong with the samples of the force on the motions of an optimum; nothing where they suffice."""
    try:
        if not all(problem.samples_suffice(x, p) for problem, x, p in points):
            return "the force is sampled too coarsely at the optimum; make the problems with larger n_samples"
    except SamplingError as error:
        return f"at the optimum, {error}"
    return ""


def _n_operations(function: ca.Function) -> float:
    """Return the number of scalar operations of a function; inf if it cannot be written out in them."""
    try:
        return float(function.expand().n_instructions())
    except RuntimeError:
        return np.inf
