"""Adaptive multistep integration by CVODES."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import casadi as ca
import numpy as np

from hbnlp.core.checks import flag, real_number, whole_number
from hbnlp.core.interrupts import interrupts_at_once
from hbnlp.core.types import Array
from hbnlp.integration.first_order import FirstOrderForm, Propagator, Window


@final
@dataclass(frozen=True, kw_only=True)
class Adaptive:
    """Variable-step, variable-order multistep integration by CVODES.

    Parameters
    ----------
    rtol, atol : float
        Tolerances of a step; ``atol`` is relative to the largest displacement, velocity or lag state of the last
        window. The error of a periodic response is some tens of times larger, by its memory (Q factor): 2e-9 relative
        for a Duffing oscillator with 2.5 % of critical damping, near its fold.
    samples_per_period : int
        Uniform output a period of the forcing; it has no influence on the steps.
    stiff : bool
        False: Adams formulas (orders 1 to 12), accurate for oscillators. True: backward differentiation (orders 1 to 5)
        with the exact Jacobian, for lag states that decay much faster than anything of interest; less accurate, and
        slightly unstable for undamped fast modes.

    References
    ----------
    Hindmarsh et al. (2005), SUNDIALS, ACM Trans. Math. Softw. 31, 363-396, doi:10.1145/1089014.1089020.
    """

    rtol: float = 1e-10
    atol: float = 1e-12
    samples_per_period: int = 256
    stiff: bool = False

    def __post_init__(self) -> None:
        real_number("rtol", self.rtol, above=0.0, below=1.0)
        real_number("atol", self.atol, above=0.0, below=1.0)
        whole_number("samples_per_period", self.samples_per_period, least=4, most=1_000_000)
        flag("stiff", self.stiff)

    def propagator(self, form: FirstOrderForm, packed: Array, state: Array, periods: int) -> Propagator:
        """Return CVODES at one parameter point; the first window takes its sizes from ``state`` and the load."""
        step = 2.0 * np.pi / self.samples_per_period
        integrator = form.compiled((self, periods), lambda: self._cvodes(form, periods))
        sizes = _expected_sizes(form, packed, state)

        def run(start: Array) -> Window:
            nonlocal sizes
            try:
                with interrupts_at_once():
                    scaled = integrator(x0=start / sizes, p=np.append(packed, sizes))["xf"].full().T
            except RuntimeError as error:
                flag = str(error).partition('returned "')[2].partition('"')[0]
                reason = (
                    f"CVODES could not go on ({flag or error}); the system diverges, or the tolerances are too tight, "
                    "or some lag states too fast: try larger rtol and atol, or stiff=True; or a step of the force "
                    "holds the motion fast: round it, ca.tanh(d / width) for sign(d)"
                )
                if any(called.class_name() == "CallbackInternal" for called in form.rate.find_functions()):
                    reason += "; or a casadi.Callback raised an error, which stands in what CasADi wrote to stderr"
                return Window(start[None], step, float(integrator.stats().get("tcur", 0.0)), reason)
            states = np.vstack([start, sizes * scaled])
            sizes = form.sizes(states)
            return Window(states, step)

        return run

    def _cvodes(self, form: FirstOrderForm, periods: int) -> ca.Function:
        n_steps = self.samples_per_period * periods
        grid = 2.0 * np.pi * periods * np.arange(1, n_steps + 1) / n_steps
        n_state = form.system.n_state
        y, tau, packed = ca.MX.sym("y", n_state), ca.MX.sym("tau"), ca.MX.sym("packed", form.n_packed)
        sizes = ca.MX.sym("sizes", n_state)
        rate = form.rate(sizes * y, tau, packed) / sizes
        equations = {"x": y, "t": tau, "p": ca.vertcat(packed, sizes), "ode": rate}
        options = {
            "reltol": self.rtol,
            "abstol": self.atol,
            "linear_multistep_method": "bdf" if self.stiff else "adams",
            "nonlinear_solver_iteration": "newton" if self.stiff else "functional",
            "disable_internal_warnings": True,
            "show_eval_warnings": False,
        }
        return ca.integrator("cvodes", "cvodes", equations, 0.0, grid, options)


def _expected_sizes(form: FirstOrderForm, packed: Array, state: Array) -> Array:
    """Return the sizes (n_state,) of a motion that begins at a state: of the state, or of what drives it."""
    n, phases = form.system.n_dof, 2.0 * np.pi * np.arange(16) / 16
    rates = np.array([form.rate(y, tau, packed).full().ravel() for y in (0.0 * state, state) for tau in phases])
    rates = rates[np.isfinite(rates).all(axis=1)]
    # dq/dtau is of the size of q, and so is dv/dtau over omega
    omega = packed[form.system.parameters.index("omega")]
    driven = np.hstack([rates[:, n : 2 * n] / omega, rates[:, n:]])
    return form.sizes(np.vstack([state, rates, driven]))
