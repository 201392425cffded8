"""The coupled second-order system with lag states: symbols, parameter values, and what the user wrote as equations."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import finite_array, position, refused, text
from hbnlp.core.errors import NonFiniteError
from hbnlp.core.kept import Kept, built_once, by_one_thread
from hbnlp.core.quantities import quantities
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.types import Array
from hbnlp.systems.calling import called
from hbnlp.systems.compiled_force import CompiledForce
from hbnlp.systems.definition import Definition
from hbnlp.systems.dependence import depends_on_omega
from hbnlp.systems.equivariance import Equivariance
from hbnlp.systems.expressions import (
    Force,
    Matrix,
    Output,
    Signal,
    column,
    compiled_outputs,
    displacements,
    matrix,
    motion_derivatives,
    numbers,
)
from hbnlp.systems.invariance import Invariance, angle_positions, list_of_symmetries, names_of_displacements
from hbnlp.systems.parameters import OMEGA, Namespace, ParameterSet
from hbnlp.systems.periodicity import check_signals
from hbnlp.systems.plant import Plant, check_mass
from hbnlp.systems.symmetry import Symmetry
from hbnlp.systems.terms import check_functions, check_inputs, check_lags, check_motion


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
    symmetries : sequence of Symmetry, optional
        What the equations are invariant under: permutations of equal parts, reflections, with shifts of the phase. They
        are checked, at the default parameters (at 1 where there is none), and used wherever they hold. The change of
        sign, half a forcing period and both together are found without being named.
    angles : sequence of str or int, optional
        Displacements that count modulo 2 pi, by name or number from 0. Where angles only turn together, as those of
        pendulums on a common spring, take their differences as coordinates.
    labels, units : mapping of names of parameters and outputs to texts, optional
        What stands on axes in the place of a name, and in which unit: ``labels={"x": "deflection"}``,
        ``units={"x": "mm", "omega": "rad/s"}``. Tables have them as attributes; a pure number's unit is "1".
    name : str
        Used in the repr, in plots and in saved files.

    Raises
    ------
    ValueError
        For a matrix or force of the wrong shape, a value that is not finite, or a symmetry or angle that the equations
        do not have: the message says in which term, and by how much. Also for whatever a user's function raises: the
        message says in which line, and what to write; the error itself is its cause.
    TypeError
        For a function of other arguments than its own.
    KeyError
        For an angle that is no displacement, a label or unit of what is no parameter or output.

    Attributes
    ----------
    outputs : casadi.Function
        (q, q', q'', x, tau, p) -> all outputs in the order of ``output_names``.
    quantities : Quantities
        Labels and units.

    Notes
    -----
    Many methods: what all analyses ask of the equations is compiled here, once.

    A system is picklable: what is sent are small CasADi functions, whatever the user's functions were.

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

    @renamed_arguments()
    @by_one_thread
    def __init__(
        self,
        mass: Matrix,
        damping: Matrix,
        stiffness: Matrix,
        *,
        nonlinear_force: Force | None = None,
        forcing: Signal | None = None,
        parameters: Mapping[str, float] | ParameterSet | None = None,
        outputs: Mapping[str, Output] | None = None,
        lag_state: ArrayLike | None = None,
        lag_input: ArrayLike | None = None,
        lag_output: Matrix | None = None,
        motion: Signal | None = None,
        input_stiffness: Matrix | None = None,
        input_damping: Matrix | None = None,
        input_mass: Matrix | None = None,
        lag_motion: ArrayLike | None = None,
        symmetries: Sequence[Symmetry] = (),
        angles: Sequence[str | int] = (),
        labels: Mapping[str, str] | None = None,
        units: Mapping[str, str] | None = None,
        name: str = "system",
    ) -> None:
        text("name", name)
        check_functions(nonlinear_force, forcing, motion, outputs)
        inputs = {
            "input_stiffness": input_stiffness,
            "input_damping": input_damping,
            "input_mass": input_mass,
            "lag_motion": lag_motion,
        }
        for what, matrix_given in (("mass", mass), ("damping", damping), ("stiffness", stiffness)):
            if matrix_given is None:
                raise refused(ValueError, what, matrix_given, "a matrix, of zeros where there is none")
        known = parameters
        if not isinstance(known, ParameterSet):
            known = ParameterSet({} if known is None else known)
        p, tau = ca.SX.sym("p", len(known.names)), ca.SX.sym("tau")
        named = Namespace("parameter", {key: p[i] for i, key in enumerate(known.names)})

        m_q = matrix("mass", mass, p, named)
        n = m_q.shape[0]
        if n == 0:
            raise refused(ValueError, "mass", mass, "a matrix of one degree of freedom at least")
        d_q, k_q = matrix("damping", damping, p, named, (n, n)), matrix("stiffness", stiffness, p, named, (n, n))

        check_inputs(motion, inputs)
        u = ca.SX(0, 1) if motion is None else column("motion", called("motion", motion, tau=tau, p=named))
        n_u = u.shape[0]
        k_u = matrix("input_stiffness", input_stiffness, p, named, (n, n_u))
        d_u = matrix("input_damping", input_damping, p, named, (n, n_u))
        m_u = matrix("input_mass", input_mass, p, named, (n, n_u))

        if lag_state is None:
            check_lags(lag_state, lag_input, lag_motion, lag_output)
        a_x = numbers("lag_state", lag_state, None)
        m = a_x.shape[0]
        b_q, b_u = numbers("lag_input", lag_input, (m, n)), numbers("lag_motion", lag_motion, (m, n_u))
        l_x = matrix("lag_output", lag_output, p, named, (n, m))

        q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
        force, load = ca.SX.zeros(n), ca.SX.zeros(n)
        if nonlinear_force is not None:
            value = called("nonlinear_force", nonlinear_force, q=q, v=v, tau=tau, p=named)
            force = column("nonlinear_force", value, n, each=", one for each degree of freedom")
        if forcing is not None:
            value = called("forcing", forcing, tau=tau, p=named)
            load = column("forcing", value, n, each=", one for each degree of freedom")
        check_signals(known, force, load, u, (q, v, tau, p))
        check_motion(motion, inputs, outputs)
        check_lags(lag_state, lag_input, lag_motion, lag_output)
        rules = dict(outputs) if outputs is not None else displacements(n)
        signals = compiled_outputs(rules, (q, v, tau, p), u, m, named)
        self._set_up(
            Definition(
                name=name,
                parameters=known,
                output_names=tuple(rules),
                lag_state=a_x,
                lag_input=b_q,
                lag_motion=b_u,
                matrices=ca.Function("matrices", [p], [m_q, d_q, k_q, l_x, k_u, d_u, m_u]),
                force=ca.Function("force", [q, v, tau, p], [force]),
                signals=ca.Function("signals", [tau, p], [load, u]),
                outputs=signals,
                symmetries=list_of_symmetries(symmetries, n),
                angles=angle_positions(angles, names_of_displacements(signals, tuple(rules)), n),
                quantities=quantities(labels, units, (*known.names, *rules)),
            )
        )
        if self.symmetries or self.angles:
            self.invariance.check_given(self.angles)

    def _set_up(self, definition: Definition) -> None:
        self._definition = definition
        self.name, self.parameters, self.output_names = definition.name, definition.parameters, definition.output_names
        self.lag_state, self.lag_input = definition.lag_state, definition.lag_input
        self.lag_motion = definition.lag_motion
        self.outputs, self.quantities = definition.outputs, definition.quantities
        self.symmetries, self.angles = definition.symmetries, definition.angles
        self.p, self.tau = ca.SX.sym("p", len(self.parameters.names)), ca.SX.sym("tau")
        matrices = definition.matrices.call([self.p])
        self.mass, self.damping, self.stiffness, self.lag_output = matrices[:4]
        self.input_stiffness, self.input_damping, self.input_mass = matrices[4:]
        self.n_dof: int = self.mass.shape[0]
        self.q, self.v = ca.SX.sym("q", self.n_dof), ca.SX.sym("v", self.n_dof)
        (self.force,) = definition.force.call([self.q, self.v, self.tau, self.p])
        self.forcing, self.motion = definition.signals.call([self.tau, self.p])

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

    @built_once
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

    @built_once
    def compiled_force(self) -> CompiledForce:
        """The force f and its derivatives as CasADi functions."""
        return CompiledForce(self.force, self.q, self.v, self.tau, self.p)

    @built_once
    def motion_derivatives(self) -> tuple[ca.SX, ca.SX]:
        """Expressions of u' and u'' (derivatives by time, so with factors omega and omega squared)."""
        return motion_derivatives(self.motion, self.tau, self.p[self.parameters.index("omega")])

    @built_once
    def excitation(self) -> ca.Function:
        """CasADi function (tau, p) -> (K_u u + D_u u' + M_u u'' + forcing, B_u u''), the time-dependent right sides."""
        du, ddu = self.motion_derivatives
        load = self.input_stiffness @ self.motion + self.input_damping @ du + self.input_mass @ ddu + self.forcing
        return ca.Function(
            "excitation", [self.tau, self.p], [ca.densify(load), ca.densify(ca.DM(self.lag_motion) @ ddu)]
        )

    def output_index(self, name: str) -> int:
        """Return the position of output ``name``, or raise a KeyError with the nearest known name."""
        return position("output", name, self.output_names)

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
        q0 = np.zeros(self.n_dof) if rest is None else finite_array("rest", rest, (self.n_dof,))
        plant = Plant(*self.state_matrices(values), self.lag_state, self.lag_input)
        force_q, force_v = self.compiled_force.tangents(q0, np.zeros(self.n_dof), 0.0, values)
        if not np.all(np.isfinite(force_q)) or not np.all(np.isfinite(force_v)):
            raise NonFiniteError("the derivative of nonlinear_force is not finite at rest; smooth it there")
        return plant.state_matrix(force_q, force_v)

    # -- symmetries -------------------------------------------------------------------------------------------------

    def symmetries_at(self, at: Mapping[str, float] | Array | None = None) -> tuple[Symmetry, ...]:
        """Return the symmetries of the equations at parameter values, all but the identity.

        They form a group with it: the named ones that hold there come first, then the change of sign with half a
        forcing period, the change of sign and half a period where they hold, then products of these.

        Parameters
        ----------
        at : mapping or array (n_parameters,), optional
            Overrides of the defaults by name, or all values in order. omega counts as 1 where it has no value.
        """
        return self.invariance.at(at)

    @built_once
    def invariance(self) -> Invariance:
        """What tells the symmetries of the equations from those that they lack, and by how much."""
        omega, force = self.parameters.index("omega"), self.compiled_force.value
        equations = Equivariance(self.matrices, force, self.excitation, self.lag_state, self.lag_input, omega)
        return Invariance(equations, self.parameters, self.symmetries)

    def warn_of(self, record: Any) -> None:
        """Warn, at the end of a run, of motions that the system is no model for; equations alone tell of none."""

    # -- copies and other processes ---------------------------------------------------------------------------------

    def __reduce__(self) -> tuple[Callable[[bytes], System], tuple[bytes]]:
        """Send the definition; a process that gets the same one again returns the system that it has built from it."""
        return _received, (self._definition.content,)

    def __copy__(self) -> System:
        """Return another system of the same equations, with symbols of its own."""
        return _of(self._definition)

    def __deepcopy__(self, memo: dict[int, Any]) -> System:
        """Return another system of the same equations, which shares nothing with this one."""
        return _of(Definition.of(self._definition.content))

    def __repr__(self) -> str:
        values = self.parameters.defaults.items()
        given = ", ".join(f"{k}={'?' if np.isnan(v) else f'{v:g}'}" for k, v in values)
        dofs = f"{self.n_dof} degree{'s' if self.n_dof > 1 else ''} of freedom"
        return (
            f"System {self.name!r}: {dofs}, {self.n_lags} lag states\n"
            f"  parameters: {given}\n"
            f"  outputs: {', '.join(self.output_names)}"
        )


_RECEIVED: Kept[System] = Kept(8)


def _received(content: bytes) -> System:
    """Return the system of a definition that came from elsewhere, built once."""
    return _RECEIVED.get(hashlib.sha256(content).digest(), lambda: _of(Definition.of(content)))


def _of(definition: Definition) -> System:
    system = object.__new__(System)
    system._set_up(definition)
    return system
