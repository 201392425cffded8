"""The linear wing as a state space of python-control, from accelerations of pitch and heave to all outputs.

With prescribed motion r = [alpha, heave of the pitch axis], displacements q and lag states x, about an equilibrium::

    q'' = a_r r + a_dr r' + a_ddr r'' + a_q q + a_v q' + a_x x,      x' = A x + B q'' + B_u u'',      u = T r

where u = [alpha, z of the leading edge]; the states are [r, r', q, q', x], and the input r'' is integrated twice.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import finite_array, instance_of
from hbnlp.core.extras import from_extra
from hbnlp.core.kept import by_one_thread
from hbnlp.core.types import Array
from hbnlp.systems.parameters import OMEGA
from hbnlp.systems.system import System

if TYPE_CHECKING:
    import control

AMPLITUDES = ("pitch_amplitude", "heave_amplitude")
"""Parameters by which pitch and heave are proportional to sin(tau), in the wing's own motion."""


def linear_wing(
    wing: System, *, at: Mapping[str, float] | None = None, rest: ArrayLike | None = None
) -> control.StateSpace:
    """Return the wing, linear about rest or an equilibrium, as a ``control.StateSpace``.

    Its inputs are ``alpha_acceleration`` (rad per squared time) and ``heave_acceleration`` (of the pitch axis, up), its
    outputs those of the wing, as changes from the equilibrium: all nondimensional with chord and stream velocity. Its
    states are alpha and heave, their velocities, the modal amplitudes W1, W2, ..., theirs, and the lag states. The four
    states of the motion make double integrators, so that four poles are zero; the others are `hbnlp.eigenvalues`.

    Parameters
    ----------
    wing : System
        A wing made by `hbnlp.membrane_wing` with its own motion.
    at : mapping of parameter names to values, optional
        Overrides of the wing's values. Amplitudes and omega do not matter.
    rest : array_like, shape (n_modes,), optional
        Modal amplitudes of the equilibrium; zero by default. One is
        ``solve(problem, at={"pitch_amplitude": 0.0, ...}).coefficients[:, 0]``.

    Raises
    ------
    ImportError
        If the package ``control`` is not installed (extra ``hbnlp[control]``).
    TypeError, ValueError
        If ``wing`` is something else, or has a motion of the user's, of which pitch and heave are not known.

    Examples
    --------
    >>> import hbnlp
    >>> wing = hbnlp.membrane_wing(hbnlp.LinearMembrane(n_modes=2), hbnlp.aero.thin_airfoil(2))
    >>> hbnlp.linear_wing(wing).ninputs
    2
    """
    instance_of("wing", wing, System, "a wing made by hbnlp.membrane_wing")
    if not {*AMPLITUDES, "pitch_axis"} <= {*wing.parameters.names}:
        raise ValueError(f"{wing.name!r} has no pitch_amplitude and heave_amplitude; give a wing with its own motion")
    n, m = wing.n_dof, wing.n_lags
    q0 = np.zeros(n) if rest is None else finite_array("rest", rest, (n,))
    values = wing.parameters.values(at, but=(OMEGA,))
    for name in (*AMPLITUDES, "heave_phase", OMEGA):
        values[wing.parameters.index(name)] = 0.0
    package = from_extra("control", "control", "a control.StateSpace")
    leading_edge = np.array([[1.0, 0.0], [values[wing.parameters.index("pitch_axis")], 1.0]])
    free = wing.linearisation({name: float(v) for name, v in zip(wing.parameters.names, values, strict=True)}, rest=q0)
    mass = wing.state_matrices(values)[0]
    # accelerations q'' (n, 2) by the motion r, by r' and by r''
    by_motion = [np.linalg.solve(mass, e.full() @ leading_edge) for e in wing.matrices(values)[4:]]
    drive = [np.vstack([np.zeros((n, 2)), a, wing.lag_input @ a]) for a in by_motion]
    drive[2][2 * n :] += wing.lag_motion @ leading_edge
    none, one = np.zeros((2, 2)), np.eye(2)
    rows = np.zeros((2, 2 * n + m))
    q, v, a, x = np.split(_by_state(wing, q0, values), [n, 2 * n, 3 * n], axis=1)
    output = [own + a @ each for own, each in zip(_by_motion(wing, q0, values), by_motion, strict=True)]
    names = [f"W{k + 1}" for k in range(n)]
    return package.StateSpace(
        np.block([[none, one, rows], [none, none, rows], [drive[0], drive[1], free]]),
        np.vstack([none, one, drive[2]]),
        np.hstack([output[0], output[1], np.hstack([q, v, x]) + a @ free[n : 2 * n]]),
        output[2],
        inputs=["alpha_acceleration", "heave_acceleration"],
        outputs=list(wing.output_names),
        states=[
            *("alpha", "heave", "alpha_velocity", "heave_velocity"),
            *names,
            *(f"{name}_velocity" for name in names),
            *(f"lag{i + 1}" for i in range(m)),
        ],
        name=wing.name,
        remove_useless_states=False,
    )


@by_one_thread
def _by_state(wing: System, q0: Array, values: Array) -> Array:
    """Return the derivatives of all outputs by q, q', q'' and x, (n_outputs, 3 n + m), at an equilibrium."""
    n, m = wing.n_dof, wing.n_lags
    signals = ca.SX.sym("signals", 3 * n + m)
    parts = ca.vertsplit(signals, [0, n, 2 * n, 3 * n, 3 * n + m])
    slopes = ca.densify(ca.jacobian(wing.outputs(*parts, 0.0, wing.p), signals))
    point = np.concatenate([q0, np.zeros(2 * n + m)])
    return np.asarray(ca.Function("slopes", [signals, wing.p], [slopes])(point, values).full())


@by_one_thread
def _by_motion(wing: System, q0: Array, values: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives of all outputs by r, r' and r'', each (n_outputs, 2).

    An output knows the motion as amplitude sin(tau), so r' = omega amplitude cos(tau): its derivative by the amplitude
    is that by r' at tau = 0 and omega = 1, that by r at tau = pi/2 and omega = 0, and that by r less that by r'' at
    tau = pi/2 and omega = 1.
    """
    n, m, omega = wing.n_dof, wing.n_lags, wing.parameters.index(OMEGA)
    tau = ca.SX.sym("tau")
    outputs = wing.outputs(ca.DM(q0), ca.DM.zeros(n), ca.DM.zeros(n), ca.DM.zeros(m), tau, wing.p)
    amplitudes = ca.vertcat(*(wing.p[wing.parameters.index(name)] for name in AMPLITUDES))
    slopes = ca.Function("slopes", [tau, wing.p], [ca.densify(ca.jacobian(outputs, amplitudes))])

    def slope(phase: float, frequency: float) -> Array:
        point = values.copy()
        point[omega] = frequency
        return np.asarray(slopes(phase, point).full())

    by_motion = slope(0.5 * np.pi, 0.0)
    # cos(pi / 2) is not zero but 6e-17: taken off, so that no rate is left in it
    by_rate = slope(0.0, 1.0)
    by_acceleration = by_motion + np.cos(0.5 * np.pi) * by_rate - slope(0.5 * np.pi, 1.0)
    return by_motion, by_rate, by_acceleration
