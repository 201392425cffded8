"""The coupled second-order system with lag states: symbols, parameter values, and what the user wrote as equations."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import unknown_name
from hbnlp.core.errors import NonFiniteError
from hbnlp.core.types import Array
from hbnlp.systems.compiled_force import CompiledForce
from hbnlp.systems.expressions import (
    Force,
    Matrix,
    Output,
    Signal,
    check_periodicity,
    check_symbols,
    column,
    displacements,
    matrix,
    numbers,
)
from hbnlp.systems.parameters import OMEGA, Namespace, ParameterSet
from hbnlp.systems.plant import Plant, check_mass


class System:
    """A periodically forced second-order system with lag states.

    The equations are, with ``tau = omega t`` and everything 2 pi-periodic in tau::

        M(p) q'' + D(p) q' + K(p) q + f(q, q', tau; p) = L_x(p) x + K_u u + D_u u' + M_u u'' + forcing(tau; p)
        x' = A x + B q'' + B_u u''

    Parameters
    ----------
    mass, damping, stiffness : array (n, n) or callable p -> (n, n)
        M, D and K. A callable gets the parameters by name (``p.omega``) as CasADi symbols.
    nonlinear_force : callable (q, v, tau, p) -> n expressions, optional
        f; q and v = q' are CasADi column vectors, tau the forcing phase. Parametric excitation belongs here.
    forcing : callable (tau, p) -> n expressions, optional
        External load of any harmonic content, static part included.
    parameters : mapping of names to values, optional
        Every physical parameter. ``omega`` is always one; without a value it must be given where the system is used.
    outputs : mapping of names to callables s -> expression, optional
        Named scalar signals; ``s`` holds q, v, a (= q''), x, u, du, ddu, tau and p. By default the displacements,
        ``"x"`` for one degree of freedom and ``"x1"``, ``"x2"``, ... for more.
    lag_state, lag_input, lag_output : arrays, optional
        A (m, m), B (m, n), and L_x (n, m) (array or callable of p).
    motion : callable (tau, p) -> n_u expressions, optional
        The prescribed motion u.
    input_stiffness, input_damping, input_mass : array (n, n_u) or callable, optional
        K_u, D_u, M_u.
    lag_motion : array (m, n_u), optional
        B_u.
    name : str
        Used in the repr, in plots and in saved files.

    Raises
    ------
    ValueError
        For a matrix or force of the wrong shape, a value that is not finite, or a name that is not known.

    Examples
    --------
    >>> System(
    ...     [[1.0]],
    ...     [[0.05]],
    ...     [[1.0]],
    ...     nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3],
    ...     forcing=lambda tau, p: [p.force * ca.cos(tau)],
    ...     parameters={"cubic": 0.1, "force": 0.18},
    ... )
    System 'system': 1 degree of freedom, 0 lag states
      parameters: cubic=0.1, force=0.18, omega=?
      outputs: x
    """

    def __init__(
        self,
        mass: Matrix,
        damping: Matrix,
        stiffness: Matrix,
        *,
        nonlinear_force: Force | None = None,
        forcing: Signal | None = None,
        parameters: Mapping[str, float] | None = None,
        outputs: Mapping[str, Output] | None = None,
        lag_state: ArrayLike | None = None,
        lag_input: ArrayLike | None = None,
        lag_output: Matrix | None = None,
        motion: Signal | None = None,
        input_stiffness: Matrix | None = None,
        input_damping: Matrix | None = None,
        input_mass: Matrix | None = None,
        lag_motion: ArrayLike | None = None,
        name: str = "system",
    ) -> None:
        self.name = name
        self.parameters = ParameterSet(parameters or {})
        self.p = ca.SX.sym("p", len(self.parameters.names))
        self.tau = ca.SX.sym("tau")
        symbols = {key: self.p[i] for i, key in enumerate(self.parameters.names)}
        self._named = Namespace("parameter", symbols)

        self.mass = matrix("mass", mass, self.p, self._named)
        self.n_dof = n = self.mass.shape[0]
        self.damping = matrix("damping", damping, self.p, self._named, (n, n))
        self.stiffness = matrix("stiffness", stiffness, self.p, self._named, (n, n))

        self.motion = column("motion", motion(self.tau, self._named)) if motion else ca.SX(0, 1)
        n_u = self.n_inputs
        self.input_stiffness = matrix("input_stiffness", input_stiffness, self.p, self._named, (n, n_u))
        self.input_damping = matrix("input_damping", input_damping, self.p, self._named, (n, n_u))
        self.input_mass = matrix("input_mass", input_mass, self.p, self._named, (n, n_u))

        self.lag_state = numbers("lag_state", lag_state, None)
        m = self.n_lags
        self.lag_input = numbers("lag_input", lag_input, (m, n))
        self.lag_motion = numbers("lag_motion", lag_motion, (m, n_u))
        self.lag_output = matrix("lag_output", lag_output, self.p, self._named, (n, m))

        self.q = ca.SX.sym("q", n)
        self.v = ca.SX.sym("v", n)
        self.force = ca.SX.zeros(n)
        if nonlinear_force:
            value = nonlinear_force(self.q, self.v, self.tau, self._named)
            self.force = column("nonlinear_force", value, n)
        self.forcing = column("forcing", forcing(self.tau, self._named), n) if forcing else ca.SX.zeros(n)
        self._check_signals()
        self._outputs = dict(outputs) if outputs is not None else displacements(n)
        self.output_names: tuple[str, ...] = tuple(self._outputs)
        _ = self.outputs  # what is wrong with them is said here

    # -- sizes ------------------------------------------------------------------------------------------------------

    @property
    def n_lags(self) -> int:
        """Number of lag states."""
        return int(self.lag_state.shape[0])

    @property
    def n_inputs(self) -> int:
        """Number of prescribed motions u."""
        return int(self.motion.shape[0])

    @property
    def n_state(self) -> int:
        """Size of the full state (q, q', x)."""
        return int(2 * self.n_dof + self.n_lags)

    @property
    def is_nonlinear(self) -> bool:
        """Whether there is a force f besides the matrices (it may be a constant load)."""
        return not bool(self.force.is_zero())

    # -- compiled functions -----------------------------------------------------------------------------------------

    @cached_property
    def matrices(self) -> ca.Function:
        """CasADi function p -> (M, D, K, L_x, K_u, D_u, M_u)."""
        expressions = [
            self.mass,
            self.damping,
            self.stiffness,
            self.lag_output,
            self.input_stiffness,
            self.input_damping,
            self.input_mass,
        ]
        return ca.Function("matrices", [self.p], [ca.densify(e) for e in expressions])

    @cached_property
    def compiled_force(self) -> CompiledForce:
        """The force f and its derivatives as CasADi functions."""
        return CompiledForce(self.force, self.q, self.v, self.tau, self.p)

    @cached_property
    def motion_derivatives(self) -> tuple[ca.SX, ca.SX]:
        """Expressions of u' and u'' (derivatives by time, so with factors omega and omega squared)."""
        omega = self._named.omega
        first = ca.jacobian(self.motion, self.tau)
        second = ca.jacobian(first, self.tau)
        return omega * first, omega**2 * second

    @cached_property
    def excitation(self) -> ca.Function:
        """CasADi function (tau, p) -> (K_u u + D_u u' + M_u u'' + forcing, B_u u''), the time-dependent right sides."""
        du, ddu = self.motion_derivatives
        load = self.input_stiffness @ self.motion + self.input_damping @ du + self.input_mass @ ddu + self.forcing
        return ca.Function(
            "excitation", [self.tau, self.p], [ca.densify(load), ca.densify(ca.DM(self.lag_motion) @ ddu)]
        )

    @cached_property
    def outputs(self) -> ca.Function:
        """CasADi function (q, q', q'', x, tau, p) -> all outputs in the order of `output_names`."""
        a, x = ca.SX.sym("a", self.n_dof), ca.SX.sym("x", self.n_lags)
        du, ddu = self.motion_derivatives
        signals = {"q": self.q, "v": self.v, "a": a, "x": x, "u": self.motion, "du": du, "ddu": ddu}
        seen = Namespace("signal", {**signals, "tau": self.tau, "p": self._named})
        arguments = [self.q, self.v, a, x, self.tau, self.p]
        rows = []
        for name, rule in self._outputs.items():
            rows.append(column(f"output {name!r}", rule(seen), 1))
            check_symbols(f"output {name!r}", rows[-1], arguments)
        return ca.Function("outputs", arguments, [ca.densify(ca.vertcat(*rows)) if rows else ca.SX(0, 1)])

    def output_index(self, name: str) -> int:
        """Return the position of output ``name``, or raise a KeyError with the nearest known name."""
        if name not in self.output_names:
            raise KeyError(unknown_name("output", name, self.output_names))
        return self.output_names.index(name)

    def state_matrices(self, values: Array) -> tuple[Array, Array, Array, Array]:
        """Return M, D, K and L_x as numbers at the parameter values (ordered, n_parameters).

        Raises
        ------
        ValueError
            If the mass matrix is singular.
        """
        mass, damping, stiffness, lag_output = (e.full() for e in self.matrices(values)[:4])
        check_mass(mass)
        return mass, damping, stiffness, lag_output

    def linearisation(self, at: Mapping[str, float] | None = None, *, rest: ArrayLike | None = None) -> Array:
        """Return the state matrix (n_state, n_state) of (q, q', x), linearised about rest.

        The nonlinear force is linearised at ``q = rest`` (zero by default), ``q' = 0`` and tau = 0. Omega needs a
        value, of any sign, only where the linearisation depends on it: a rotor's speed.

        Raises
        ------
        ValueError
            If the linearisation depends on omega, which has no value, or the mass matrix is singular.
        NonFiniteError
            If the force has no finite derivative there.
        """
        values = self.parameters.values(at, but=(OMEGA,))
        if np.isnan(values).any():
            if depends_on_omega(self, rest):
                raise ValueError(
                    f"the linearisation of {self.name!r} depends on omega, which has no value; give one, for instance "
                    "at={'omega': 1.0}"
                )
            values = np.where(np.isnan(values), 1.0, values)
        q0 = np.zeros(self.n_dof) if rest is None else np.asarray(rest, dtype=float)
        plant = Plant(*self.state_matrices(values), self.lag_state, self.lag_input)
        force_q, force_v = self.compiled_force.tangents(q0, np.zeros(self.n_dof), 0.0, values)
        if not np.all(np.isfinite(force_q)) or not np.all(np.isfinite(force_v)):
            raise NonFiniteError("the derivative of nonlinear_force is not finite at rest; smooth it there")
        return plant.state_matrix(force_q, force_v)

    def _check_signals(self) -> None:
        """Raise a ValueError for a force, forcing or motion of other symbols than its own, or not periodic."""
        state = [*np.random.default_rng(7).uniform(-1.0, 1.0, (2, self.n_dof))]
        defaults = self.parameters.ordered(self.parameters.defaults)
        state.append(np.where(np.isfinite(defaults) & (defaults != 0.0), defaults, 1.0))
        others = [self.q, self.v, self.p]
        check_symbols("nonlinear_force", self.force, [self.tau, *others])
        check_symbols("forcing", self.forcing, [self.tau, self.p])
        check_symbols("motion", self.motion, [self.tau, self.p])
        for what, expression in (("nonlinear_force", self.force), ("forcing", self.forcing), ("motion", self.motion)):
            check_periodicity(what, expression, self.tau, others, state)

    def __repr__(self) -> str:
        values = self.parameters.defaults.items()
        given = ", ".join(f"{k}={'?' if np.isnan(v) else f'{v:g}'}" for k, v in values)
        dofs = f"{self.n_dof} degree{'s' if self.n_dof > 1 else ''} of freedom"
        return (
            f"System {self.name!r}: {dofs}, {self.n_lags} lag states\n"
            f"  parameters: {given}\n"
            f"  outputs: {', '.join(self.output_names)}"
        )


def depends_on_omega(system: System, rest: ArrayLike | None = None) -> bool:
    """Return whether the linearisation depends on omega: a matrix, or the derivative of the nonlinear force at rest."""
    q0 = np.zeros(system.n_dof) if rest is None else np.asarray(rest, dtype=float)
    slope = ca.jacobian(system.force, ca.vertcat(system.q, system.v))
    state = ca.vertcat(system.q, system.v, system.tau)
    slope = ca.substitute(slope, state, np.concatenate([q0, np.zeros(system.n_dof + 1)]))
    omega = system.p[system.parameters.index(OMEGA)]
    laws = [system.mass, system.damping, system.stiffness, system.lag_output, slope]
    return any(ca.depends_on(law, omega) for law in laws)
