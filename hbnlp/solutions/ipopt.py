"""The one way to minimise over periodic solutions with IPOPT, some of the parameters free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.curve import relative_residual
from hbnlp.core.checks import real_number, whole_number
from hbnlp.core.interrupts import INTERRUPTS, check_interrupts
from hbnlp.core.kept import by_one_thread
from hbnlp.core.locks import lasting_lock
from hbnlp.core.types import Array
from hbnlp.solutions.equations import along_load
from hbnlp.solutions.sizes import sizes_at

LARGEST_PROGRAM = 1_000_000
"""Samples times unknowns of a program for which IPOPT is taken unasked: of a larger one an iteration takes seconds."""


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
        real_number("tol", self.tol, above=0.0, below=1e-2)
        whole_number("max_iterations", self.max_iterations, least=1)

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


def is_quick(problem: HarmonicBalance) -> bool:
    """Return whether some hundred iterations of IPOPT on a balance are over in a minute or so."""
    return problem.n_samples * problem.size <= LARGEST_PROGRAM


class FreeParameters:
    """A balance with some of its parameters among the decision variables.

    Attributes
    ----------
    unknowns : casadi.MX
        Those of the balance, then the free parameters.
    """

    @by_one_thread
    def __init__(self, problem: HarmonicBalance, names: Sequence[str]) -> None:
        self._problem = problem
        free = ca.MX.sym("free", len(names))
        symbols = [problem.p[i] for i in range(problem.p.numel())]
        for i, name in enumerate(names):
            symbols[problem.system.parameters.index(name)] = free[i]
        self._p = ca.vertcat(*symbols)
        self.unknowns = ca.vertcat(problem.x, free)

    @by_one_thread
    def __call__(self, expression: ca.MX) -> ca.MX:
        """Return an expression of ``problem.x`` and ``problem.p`` as one of `unknowns` and ``problem.p``."""
        return ca.substitute(expression, self._problem.p, self._p)


# MUMPS, which factorises for IPOPT, has memory that all its callers share: two threads in it end the process
_ALONE = lasting_lock()


class Solver:
    """A program compiled for IPOPT, which Ctrl-C ends after an iteration.

    Parameters
    ----------
    program : mapping of "x", "p", "f", "g" to casadi.MX
    options : mapping
        Of CasADi's ``nlpsol``.
    """

    @by_one_thread
    def __init__(self, program: Mapping[str, ca.MX], options: Mapping[str, object]) -> None:
        sizes = {key: expression.numel() for key, expression in program.items()}
        self._watch = _Watch(sizes)  # CasADi keeps a bare pointer
        self._function = ca.nlpsol("solver", "ipopt", program, {**options, "iteration_callback": self._watch})

    def __call__(self, **arguments: Any) -> tuple[dict[str, ca.DM], dict[str, Any]]:
        """Return the answer of IPOPT and its statistics; of several threads, one at a time is in IPOPT."""
        with _ALONE:
            answer = self._function(**arguments), self._function.stats()
        check_interrupts()
        return answer


class _Watch(ca.Callback):  # type: ignore[misc]
    """What CasADi asks after each iteration of IPOPT: to stop, by 1, or to go on."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        super().__init__()
        self._sizes = sizes
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i).removeprefix("lam_")])

    def eval(self, _state: Sequence[ca.DM]) -> list[int]:
        return [int(INTERRUPTS.noted)]


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """What IPOPT made of a program over one solution.

    Attributes
    ----------
    x : array (n (2H+1),)
        The solution.
    values : array
        All parameters, the free ones as found.
    multipliers : array (n (2H+1),)
        Those of the balance.
    residual : float
        Of the balance, relative to its terms.
    success : bool
    status : str
        IPOPT's word for how it ended.
    iterations : int
    """

    x: Array
    values: Array
    multipliers: Array
    residual: float
    success: bool
    status: str
    iterations: int


def minimise(
    problem: HarmonicBalance,
    objective: ca.MX | float,
    x: Array,
    values: Array,
    *,
    free: Sequence[str] = (),
    method: Ipopt,
    bounds: Sequence[tuple[float, float]] | None = None,
) -> Minimum:
    """Return the solution that minimises an objective: ``min f(x, p)  s.t.  R(x, p) = 0``, some entries of p free.

    Parameters
    ----------
    problem : HarmonicBalance
    objective : casadi.MX
        An expression of ``problem.x`` and ``problem.p``, best of order one.
    x, values : array
        Where to begin: unknowns, and all parameters in order.
    free : sequence of str
        The free parameters; none of them: a solution is found, and the objective does not matter.
    method : Ipopt
    bounds : sequence of (lower, upper), optional
        Of the free parameters.
    """
    substituted = FreeParameters(problem, free)
    places = [problem.system.parameters.index(name) for name in free]
    limits = np.array(bounds if bounds is not None else [(-np.inf, np.inf)] * len(free)).reshape(-1, 2)
    sizes = sizes_at(problem, x, values)
    # bounds and unknowns reach IPOPT in their own sizes: its tolerances are absolute
    units = [abs(float(values[i])) or _largest(limit) or 1.0 for i, limit in zip(places, limits, strict=True)]
    scale = np.append(np.full(problem.size, sizes.length), units)
    scaled = ca.MX.sym("scaled", scale.size)
    f, g = substituted(ca.MX(objective)), substituted(problem.g) / sizes.force
    f, g = ca.substitute([f, g], [substituted.unknowns], [scale * scaled])
    program = {"x": scaled, "p": problem.p, "f": f, "g": g}
    solver = Solver(program, method.options())
    unbounded = np.tile([-np.inf, np.inf], (problem.size, 1))
    lower, upper = (np.vstack([unbounded, limits]) / scale[:, None]).T
    x0 = np.append(x, values[places]) / scale
    answer, statistics = solver(x0=x0, p=values, lbx=lower, ubx=upper, lbg=0.0, ubg=0.0)
    found = scale * answer["x"].full().ravel()
    there = values.copy()
    there[places] = found[problem.size :]
    curve = along_load(problem, there)
    with np.errstate(all="ignore"):
        residual = relative_residual(curve, curve.unknowns.joined(found[: problem.size], [1.0]))
    return Minimum(
        x=found[: problem.size],
        values=there,
        multipliers=answer["lam_g"].full().ravel() / sizes.force,
        residual=residual,
        success=bool(statistics["success"]),
        status=str(statistics["return_status"]),
        iterations=int(statistics["iter_count"]),
    )


def _largest(limits: Array) -> float:
    """Return the largest modulus of finite limits, 0 where there are none."""
    return float(np.abs(limits[np.isfinite(limits)]).max(initial=0.0))
