"""The coupled second-order system with lag states: symbols, parameter values, and what the user wrote as equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import unknown_name
from hbnlp.core.errors import NonFiniteError
from hbnlp.core.types import Array
from hbnlp.systems.parameters import Namespace, ParameterSet

Matrix = ArrayLike | Callable[[Any], Any]
Force = Callable[[ca.SX, ca.SX, ca.SX, Any], Any]
Signal = Callable[[ca.SX, Any], Any]
Output = Callable[[Any], Any]


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

        self.mass = self._matrix("mass", mass)
        n = self.mass.shape[0]
        self.mass = self._matrix("mass", mass, (n, n))
        self.damping = self._matrix("damping", damping, (n, n))
        self.stiffness = self._matrix("stiffness", stiffness, (n, n))
        self.n_dof = n

        self.motion = _column("motion", motion(self.tau, self._named)) if motion else ca.SX(0, 1)
        n_u = self.n_inputs
        self.input_stiffness = self._matrix("input_stiffness", input_stiffness, (n, n_u))
        self.input_damping = self._matrix("input_damping", input_damping, (n, n_u))
        self.input_mass = self._matrix("input_mass", input_mass, (n, n_u))

        self.lag_state = _numbers("lag_state", lag_state, None)
        m = self.n_lags
        self.lag_input = _numbers("lag_input", lag_input, (m, n))
        self.lag_motion = _numbers("lag_motion", lag_motion, (m, n_u))
        self.lag_output = self._matrix("lag_output", lag_output, (n, m))

        self.q = ca.SX.sym("q", n)
        self.v = ca.SX.sym("v", n)
        self.force = ca.SX.zeros(n)
        if nonlinear_force:
            value = nonlinear_force(self.q, self.v, self.tau, self._named)
            self.force = _column("nonlinear_force", value, n)
        self.forcing = _column("forcing", forcing(self.tau, self._named), n) if forcing else ca.SX.zeros(n)
        self._check_symbols()
        self._check_periodicity()
        self._outputs = dict(outputs) if outputs is not None else _displacements(n)
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
            rows.append(_column(f"output {name!r}", rule(seen), 1))
            _check_symbols(f"output {name!r}", rows[-1], arguments)
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

        The nonlinear force is linearised at ``q = rest`` (zero by default), ``q' = 0`` and tau = 0; omega, where it
        has no value, is taken as zero: a system whose matrices depend on it has no linearisation without one.
        """
        values = np.nan_to_num(self.parameters.values(at, but=("omega",)))
        mass, damping, stiffness, lag_output = self.state_matrices(values)
        q0 = np.zeros(self.n_dof) if rest is None else np.asarray(rest, dtype=float)
        force_q, force_v = (e.full() for e in self._force_tangent(q0, np.zeros(self.n_dof), 0.0, values))
        if not np.all(np.isfinite(force_q)) or not np.all(np.isfinite(force_v)):
            raise NonFiniteError("the derivative of nonlinear_force is not finite at rest; smooth it there")
        n, m = self.n_dof, self.n_lags
        acceleration = np.linalg.solve(mass, np.hstack([-(stiffness + force_q), -(damping + force_v), lag_output]))
        state = np.zeros((2 * n + m, 2 * n + m))
        state[:n, n : 2 * n] = np.eye(n)
        state[n : 2 * n] = acceleration
        state[2 * n :] = self.lag_input @ acceleration
        state[2 * n :, 2 * n :] += self.lag_state
        return state

    @cached_property
    def _force_tangent(self) -> ca.Function:
        by_q, by_v = (ca.densify(ca.jacobian(self.force, unknown)) for unknown in (self.q, self.v))
        return ca.Function("tangent", [self.q, self.v, self.tau, self.p], [by_q, by_v])

    # -- construction -----------------------------------------------------------------------------------------------

    def _matrix(self, what: str, given: Matrix | None, shape: tuple[int, int] | None = None) -> ca.SX:
        if given is None and shape is not None:
            return ca.SX.zeros(*shape)
        value = given(self._named) if callable(given) else given
        if isinstance(value, ca.SX | ca.DM):
            matrix = ca.SX(value)
        else:
            array = np.array(value, dtype=object)
            if array.ndim == 0:
                array = array.reshape(1, 1)
            if array.ndim != 2:
                raise ValueError(f"{what} has shape {array.shape}; a matrix is needed")
            matrix = ca.SX(*array.shape)
            for i, j in np.ndindex(array.shape):
                matrix[i, j] = _expression(what, array[i, j])
        if shape is None:
            shape = (matrix.shape[0], matrix.shape[0])
        if matrix.shape != shape:
            raise ValueError(f"{what} has shape {matrix.shape}; {shape} is needed")
        _check_symbols(what, matrix, [self.p])
        return _with_finite_numbers(what, matrix)

    def _check_symbols(self) -> None:
        _check_symbols("nonlinear_force", self.force, [self.q, self.v, self.tau, self.p])
        _check_symbols("forcing", self.forcing, [self.tau, self.p])
        _check_symbols("motion", self.motion, [self.tau, self.p])

    def _check_periodicity(self) -> None:
        rng = np.random.default_rng(7)
        defaults = np.array(list(self.parameters.defaults.values()))
        values = np.where(np.isfinite(defaults) & (defaults != 0.0), defaults, 1.0)
        for what, expression in (("nonlinear_force", self.force), ("forcing", self.forcing), ("motion", self.motion)):
            if not ca.depends_on(expression, self.tau):
                continue
            function = ca.Function("signal", [self.tau, self.q, self.v, self.p], [ca.densify(expression)])
            state = rng.uniform(-1.0, 1.0, (2, self.n_dof))
            for tau in rng.uniform(0.0, 2.0 * np.pi, 4):
                now, later = (function(tau + lapse, *state, values).full() for lapse in (0.0, 2.0 * np.pi))
                if np.max(np.abs(later - now)) > 1e-6 * np.max(np.abs(now)):
                    raise ValueError(
                        f"{what} is not 2 pi-periodic in tau = omega t (at tau = {tau:.3g} it is {now.ravel()}, a "
                        f"period later {later.ravel()}); write it with sines and cosines of whole multiples of tau"
                    )

    def __repr__(self) -> str:
        values = self.parameters.defaults.items()
        given = ", ".join(f"{k}={'?' if np.isnan(v) else f'{v:g}'}" for k, v in values)
        dofs = f"{self.n_dof} degree{'s' if self.n_dof > 1 else ''} of freedom"
        return (
            f"System {self.name!r}: {dofs}, {self.n_lags} lag states\n"
            f"  parameters: {given}\n"
            f"  outputs: {', '.join(self.output_names)}"
        )


def check_mass(mass: Array) -> None:
    """Raise a ValueError if a mass matrix (n, n) is singular: there is no acceleration to solve for then."""
    if np.linalg.slogdet(mass)[0] == 0.0:
        bare = np.flatnonzero(~mass.any(axis=1)).tolist()
        where = f" (row {bare[0]} is zero)" if bare else ""
        raise ValueError(
            f"the mass matrix is singular{where}; every degree of freedom needs some mass: "
            "give it a small one, or eliminate it from the equations"
        )


def _displacements(n: int) -> dict[str, Output]:
    def reader(i: int) -> Output:
        return lambda s: s.q[i]

    return {"x" if n == 1 else f"x{i + 1}": reader(i) for i in range(n)}


def _column(what: str, value: Any, size: int | None = None) -> ca.SX:
    """Return a user's value as a column of ``size`` expressions."""
    if isinstance(value, ca.SX | ca.DM):
        column = ca.SX(value)
        column = column.T if column.shape[0] == 1 and column.shape[1] > 1 else column
    else:
        column = ca.SX(0, 1)
        for entry in np.atleast_1d(np.array(value, dtype=object)).ravel():
            column = ca.vertcat(column, _expression(what, entry))
    if column.shape[1] != 1 or (size is not None and column.shape[0] != size):
        raise ValueError(
            f"{what} returned shape {column.shape}; {size} expressions are needed, one a degree of freedom"
        )
    return _with_finite_numbers(what, ca.densify(column))


def _expression(what: str, entry: Any) -> ca.SX:
    try:
        return ca.SX(entry)
    except NotImplementedError:
        raise ValueError(
            f"{what} has the entry {entry!r}; a number or an expression of the symbols given to it is needed"
        ) from None


def _check_symbols(what: str, expression: ca.SX, arguments: list[ca.SX]) -> None:
    strange = ca.Function("check", arguments, [expression], {"allow_free": True}).get_free()
    if strange:
        raise ValueError(f"{what} uses {strange[0]!r}, which is neither its argument nor a parameter")


def _with_finite_numbers(what: str, expression: ca.SX) -> ca.SX:
    if not all(np.isfinite(float(entry)) for entry in expression.nonzeros() if entry.is_constant()):
        raise ValueError(f"{what} has entries that are not finite")
    return expression


def _numbers(what: str, given: ArrayLike | None, shape: tuple[int, int] | None) -> Array:
    """Return a constant matrix, checked; ``shape`` None: square of any size."""
    if given is None:
        return np.zeros(shape or (0, 0))
    array = np.array(given, dtype=float)
    wanted = shape or (array.shape[0], array.shape[0])
    if array.ndim != 2 or array.shape != wanted:
        raise ValueError(f"{what} has shape {array.shape}; {wanted} is needed")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{what} has entries that are not finite")
    return array
