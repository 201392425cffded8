"""Where membrane and aerodynamics meet: a membrane wing is a `System`.

With the reduced-order model's matrices split into lift and pressures (rows C_L and p) and into prescribed motion and
membrane (columns u = [alpha, z] and W), the wing's equations are::

    (2 mu I - M_pW) W'' - D_pW W' + (k^2 pi^2 c_T0 - K_pW) W + f(W)
        = C_p x + K_pu u + D_pu u' + (M_pu + inertia) u'' + y_b - K u_b,      x' = A x + B_W W'' + B_u u''

where ``inertia`` is the load ``C_f = 2 mu (alpha'' x - z'')`` of the moving frame, in sine coefficients.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Mapping
from typing import Any, final

import casadi as ca
import numpy as np

from hbnlp.aero import AeroROM, RationalFit, Realisation
from hbnlp.core.checks import instance_of, real_number, refused, unknown_name
from hbnlp.core.errors import ValidityWarning
from hbnlp.core.kept import Kept
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.types import Array
from hbnlp.core.warned import users_level
from hbnlp.systems.definition import Definition
from hbnlp.systems.expressions import Output
from hbnlp.systems.parameters import ParameterSet
from hbnlp.systems.system import System
from hbnlp.wing.labels import labels_and_units
from hbnlp.wing.membrane import Membrane
from hbnlp.wing.validity import DEGREES, Validity, ValidityLimits, validity

Motion = Callable[[Any, Any], Any]

LEAST = {"mass_ratio": 0.0, "stiffness": 0.0, "prestrain": 0.0}
"""What the membrane's parameters are not less than."""


@final
class MembraneWing(System):
    """A membrane coupled with aerodynamics, made by `membrane_wing`: a `System`, so that every verb takes it.

    Attributes
    ----------
    membrane : Membrane
        With the values that it was made with; those of the parameters may be others.
    rom : AeroROM
        Of as many modes as the membrane.
    limits : ValidityLimits
        Beyond them its motions are not to be believed, of which a run warns once: `solve`, `trace`, `sweep`, `find_all`
        and `explore`, not `integrate`.
    """

    def __init__(self, membrane: Membrane, rom: AeroROM, limits: ValidityLimits, *matrices: Any, **terms: Any) -> None:
        super().__init__(*matrices, **terms)
        self.membrane, self.rom, self.limits = membrane, rom, limits

    def validity(self, record: Any, *, limits: ValidityLimits | None = None) -> Validity:
        """Return what speaks against believing a solution, or each point of a branch, a sweep or a diagram.

        Parameters
        ----------
        record : Solution, Branch, Sweep or another record with ``solution(i)``, or Diagram
            Of this wing. The points of a diagram's branches stand one branch after another.
        limits : ValidityLimits, optional
            The wing's own by default.

        Raises
        ------
        TypeError, ValueError
            If the record is something else, or of another system.
        """
        instance_of("limits", limits, ValidityLimits | None, "hbnlp.ValidityLimits(camber=0.1)")
        return validity(self.membrane, self.rom, record, limits or self.limits)

    def warn_of(self, record: Any) -> None:
        """Give one ValidityWarning if any point of a record is beyond the limits."""
        self.validity(record).warn()

    def __reduce__(self) -> tuple[Callable[..., MembraneWing], tuple[Any, ...]]:
        """Send the definition and what the wing is made of; the same one again is the wing that was built."""
        return _received, (self._definition.content, self.membrane, self.rom, self.limits)

    def __copy__(self) -> MembraneWing:
        """Return another wing of the same equations, with symbols of its own."""
        return _of(self._definition, self.membrane, self.rom, self.limits)

    def __deepcopy__(self, memo: dict[int, Any]) -> MembraneWing:
        """Return another wing of the same equations, which shares nothing that changes with this one."""
        return _of(Definition.of(self._definition.content), self.membrane, self.rom, self.limits)


_RECEIVED: Kept[MembraneWing] = Kept(8)


def _received(content: bytes, membrane: Membrane, rom: AeroROM, limits: ValidityLimits) -> MembraneWing:
    """Return the wing of a definition that came from elsewhere, built once."""
    key = hashlib.sha256(content).digest(), membrane, rom, limits
    return _RECEIVED.get(key, lambda: _of(Definition.of(content), membrane, rom, limits))


def _of(definition: Definition, membrane: Membrane, rom: AeroROM, limits: ValidityLimits) -> MembraneWing:
    wing = object.__new__(MembraneWing)
    wing._set_up(definition)
    wing.membrane, wing.rom, wing.limits = membrane, rom, limits
    return wing


@renamed_arguments()
def membrane_wing(
    membrane: Membrane,
    rom: AeroROM,
    *,
    pitch_axis: float = 0.0,
    motion: Motion | None = None,
    parameters: Mapping[str, float] | None = None,
    limits: ValidityLimits | None = None,
) -> MembraneWing:
    """Return the membrane wing in prescribed pitch and heave, coupled with its linear aerodynamics.

    Its parameters are ``mass_ratio``, ``stiffness`` and ``prestrain`` with the membrane's values, ``pitch_axis``,
    ``omega``, and those of the motion. The default motion is::

        alpha = pitch_mean + pitch_amplitude sin(tau),      heave = heave_amplitude sin(tau + heave_phase)

    with ``tau = omega t``, all four zero by default. The degrees of freedom are the modal amplitudes W_1..W_N. The
    outputs are

    - ``"C_L"``: the lift coefficient, the ROM's steady lift included; ``"tension"``: c_T;
    - ``"W1"``, ``"W2"``, ...: modal amplitudes; ``"midchord"``: the displacement w at x = 1/2;
    - ``"alpha"``, ``"z"``: incidence and heave of the leading edge; ``"alpha_acceleration"``: alpha''.

    Parameters
    ----------
    membrane : Membrane
        `LinearMembrane`, `QuasiLinearMembrane` or `NonlinearMembrane`.
    rom : AeroROM
        Aerodynamics of at least as many modes as the membrane's; of more, the leading block is taken.
    pitch_axis : float
        Distance of the pitch axis from the leading edge, in chords.
    motion : callable (tau, p) -> (alpha, heave), optional
        Another motion, 2 pi-periodic in tau, of CasADi symbols: incidence (rad, nose up) and heave of the pitch axis
        (chords, up). Its own parameters are given by ``parameters``.
    parameters : mapping of names to values, optional
        Values that override those above; with ``motion``, also its own parameters.
    limits : ValidityLimits, optional
        Up to where its motions are to be believed. A run that goes beyond them gives one ValidityWarning at its end
        (`solve`, `trace`, `sweep`, `find_all`, `explore`).

    Returns
    -------
    MembraneWing
        A `System` that knows its membrane and its ROM, and of solutions whether they may be believed (``validity``).

    Raises
    ------
    TypeError
        If ``membrane`` or ``rom`` is something else.
    ValueError
        If the ROM has fewer modes than the membrane, or ``motion`` does not return two expressions.
    KeyError
        If ``parameters`` names something that the default motion does not have.

    Warns
    -----
    ValidityWarning
        If the pitch of the default motion looks like degrees.

    Notes
    -----
    The centrifugal load, ``2 mu alpha'^2 w``, is left out, as in all models of the package.

    Examples
    --------
    >>> from hbnlp.aero import thin_airfoil
    >>> from hbnlp.wing.membrane import QuasiLinearMembrane
    >>> membrane_wing(QuasiLinearMembrane(prestrain=0.008, n_modes=3), thin_airfoil(3))
    System 'membrane wing': 3 degrees of freedom, 2 lag states
      parameters: mass_ratio=0.5, stiffness=250, prestrain=0.008, pitch_axis=0, pitch_amplitude=0, pitch_mean=0, \
heave_amplitude=0, heave_phase=0, omega=?
      outputs: C_L, tension, midchord, alpha, z, alpha_acceleration, W1, W2, W3
    """
    instance_of("membrane", membrane, Membrane, "a LinearMembrane, QuasiLinearMembrane or NonlinearMembrane")
    n = membrane.n_modes
    for result in (RationalFit, Realisation):
        if isinstance(rom, result):
            raise refused(TypeError, "rom", rom, f"its ROM, the attribute `rom` of the {result.__name__}")
    instance_of("rom", rom, AeroROM, f"an AeroROM, for instance hbnlp.aero.thin_airfoil(n_modes={n})")
    real_number("pitch_axis", pitch_axis, advice=", in chords from the leading edge")
    instance_of("motion", motion, Callable | None, "a function (tau, p) -> (alpha, heave), or None")
    instance_of("parameters", parameters, Mapping | None, "a mapping of names to values, or None")
    instance_of("limits", limits, ValidityLimits | None, "hbnlp.ValidityLimits(camber=0.1)")
    for name, least in LEAST.items():
        if parameters is not None and name in parameters:
            real_number(f"parameters[{name!r}]", parameters[name], least=least)
    if rom.n_modes < n:
        raise ValueError(
            f"the ROM has {rom.n_modes} modes and the membrane {n}: give a ROM with at least {n} modes, "
            f"or a membrane with n_modes={rom.n_modes}"
        )
    rom = rom.truncated(n)
    values = {
        "mass_ratio": membrane.mass_ratio,
        "stiffness": membrane.stiffness,
        "prestrain": membrane.prestrain,
        "pitch_axis": pitch_axis,
    }
    if motion is None:
        motion = _pitch_and_heave
        values |= {"pitch_amplitude": 0.0, "pitch_mean": 0.0, "heave_amplitude": 0.0, "heave_phase": 0.0}
        for name in parameters or {}:
            if name not in (*values, "omega"):
                raise KeyError(unknown_name("parameter", name, (*values, "omega")))
        _warn_of_degrees(parameters or {})
    own = tuple(values)  # a user's motion may have others, in whatever unit
    values |= parameters or {}

    frame = _frame_inertia(n)
    static = rom.base_load - rom.stiffness @ rom.base_motion
    lift = {"C_L": _lift(rom, float(static[0])), "tension": lambda s: membrane.tension(s.q, s.p)}
    midchord = ca.DM(membrane.shape([0.5]))
    outputs = {
        **lift,
        "midchord": lambda s: midchord @ s.q,
        "alpha": lambda s: s.u[0],
        "z": lambda s: s.u[1],
        "alpha_acceleration": lambda s: s.ddu[0],
        **{f"W{k + 1}": _amplitude(k) for k in range(n)},
    }
    return MembraneWing(
        membrane,
        rom,
        limits or ValidityLimits(),
        lambda p: membrane.mass_matrix(p) - ca.DM(rom.mass[1:, 2:]),
        -rom.damping[1:, 2:],
        lambda p: membrane.stiffness_matrix(p) - ca.DM(rom.stiffness[1:, 2:]),
        nonlinear_force=lambda q, v, tau, p: membrane.nonlinear_force(q, p),
        forcing=lambda tau, p: static[1:],
        parameters=ParameterSet(values, least=LEAST),
        outputs=outputs,
        lag_state=rom.lag_state,
        lag_input=rom.lag_input[:, 2:],
        lag_output=rom.lag_output[1:],
        motion=_leading_edge(motion),
        input_stiffness=rom.stiffness[1:, :2],
        input_damping=rom.damping[1:, :2],
        input_mass=lambda p: ca.DM(rom.mass[1:, :2]) + 2.0 * p.mass_ratio * ca.DM(frame),
        lag_motion=rom.lag_input[:, :2],
        **labels_and_units(("omega", *own, *outputs), n),
        name="membrane wing",
    )


def _warn_of_degrees(parameters: Mapping[str, Any]) -> None:
    for name in ("pitch_amplitude", "pitch_mean"):
        value = parameters.get(name, 0.0)
        if isinstance(value, int | float | np.number) and abs(float(value)) > DEGREES:
            warnings.warn(
                f"{name} is {value:g} rad, which looks like degrees: give numpy.radians({value:g})",
                ValidityWarning,
                stacklevel=users_level(),
            )


def _frame_inertia(n_modes: int) -> Array:
    """Return the sine coefficients (N, 2) of x and -1: the inertial load per 2 mu alpha'' and 2 mu z''."""
    k = np.arange(1, n_modes + 1)
    sign = (-1.0) ** k
    return np.column_stack([-2.0 * sign / (k * np.pi), -2.0 * (1.0 - sign) / (k * np.pi)])


def _pitch_and_heave(tau: Any, p: Any) -> list[Any]:
    alpha = p.pitch_mean + p.pitch_amplitude * ca.sin(tau)
    return [alpha, p.heave_amplitude * ca.sin(tau + p.heave_phase)]


def _leading_edge(motion: Motion) -> Motion:
    """Return the motion as [alpha, z], z being that of the leading edge, from the heave of the pitch axis."""

    def moved(tau: Any, p: Any) -> Any:
        value = motion(tau, p)
        entries = ca.vertsplit(ca.vec(value)) if isinstance(value, ca.SX | ca.DM) else list(np.atleast_1d(value))
        if len(entries) != 2:
            raise ValueError(f"motion returned {len(entries)} expressions; two are needed, (alpha, heave)")
        alpha, heave = entries
        return ca.vertcat(alpha, p.pitch_axis * alpha + heave)

    return moved


def _lift(rom: AeroROM, static: float) -> Output:
    """Return the ROM's first row as an output of the coupled system."""
    stiffness, damping, mass, lag = (ca.DM(e[:1]) for e in (rom.stiffness, rom.damping, rom.mass, rom.lag_output))

    def lift(s: Any) -> Any:
        motion, rate, acceleration = ca.vertcat(s.u, s.q), ca.vertcat(s.du, s.v), ca.vertcat(s.ddu, s.a)
        return static + stiffness @ motion + damping @ rate + mass @ acceleration + lag @ s.x

    return lift


def _amplitude(index: int) -> Output:
    return lambda s: s.q[index]
