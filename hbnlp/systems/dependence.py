"""Whether the linearised equations of a system depend on omega."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import finite_array
from hbnlp.core.kept import by_one_thread
from hbnlp.systems.parameters import OMEGA

if TYPE_CHECKING:
    from hbnlp.systems.system import System


@by_one_thread
def depends_on_omega(system: System, rest: ArrayLike | None = None) -> bool:
    """Return whether the linearisation depends on omega: a matrix, or the derivative of the nonlinear force at rest."""
    q0 = np.zeros(system.n_dof) if rest is None else finite_array("rest", rest, (system.n_dof,))
    slope = ca.jacobian(system.force, ca.vertcat(system.q, system.v))
    state = ca.vertcat(system.q, system.v, system.tau)
    slope = ca.substitute(slope, state, np.concatenate([q0, np.zeros(system.n_dof + 1)]))
    omega = system.p[system.parameters.index(OMEGA)]
    laws = [system.mass, system.damping, system.stiffness, system.lag_output, slope]
    return any(ca.depends_on(law, omega) for law in laws)
