"""CasADi's rootfinder on the symbolic residual."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import real_number, refused, whole_number
from hbnlp.core.kept import by_one_thread
from hbnlp.solutions.sizes import Sizes


@dataclass(frozen=True, kw_only=True)
class Rootfinder:
    """CasADi's ``rootfinder`` on the symbolic residual.

    Parameters
    ----------
    plugin : str
        "newton", "fast_newton" or "kinsol".
    tol : float
        Tolerance on the residual, relative to the size of its terms at the guess.
    max_iterations : int
    """

    plugin: str = "newton"
    tol: float = 1e-12
    max_iterations: int = 100

    def __post_init__(self) -> None:
        known = ("newton", "fast_newton", "kinsol")
        if not isinstance(self.plugin, str) or self.plugin not in known:
            raise refused(ValueError, "plugin", self.plugin, f"one of {', '.join(known)}")
        real_number("tol", self.tol, above=0.0, below=1e-2)
        whole_number("max_iterations", self.max_iterations, least=1)

    @by_one_thread
    def solver(self, problem: HarmonicBalance, sizes: Sizes) -> ca.Function:
        """Return the compiled rootfinder (x, p) -> x for the dimensionless balance: x stands for ``length * x``."""
        x, p = ca.MX.sym("x", problem.size), ca.MX.sym("p", problem.p.numel())
        residual = ca.Function("residual", [x, p], [problem.residual(sizes.length * x, p) / sizes.force])
        options: dict[str, object] = {"error_on_fail": False, "show_eval_warnings": False, "abstol": self.tol}
        if self.plugin != "fast_newton":
            options |= {"linear_solver": "lapacklu", "max_iter": self.max_iterations}
        return ca.rootfinder("solver", self.plugin, residual, options)
