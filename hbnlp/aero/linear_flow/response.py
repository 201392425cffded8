"""The response of the loads to harmonic motion, frequency by frequency."""

from __future__ import annotations

import numpy as np

from hbnlp.aero.linear_flow import loads
from hbnlp.aero.linear_flow.arnoldi import arnoldi
from hbnlp.aero.linear_flow.base_flow import BaseFlow
from hbnlp.aero.linear_flow.direct import factorise
from hbnlp.aero.linear_flow.motion import load_tests, plate_motions
from hbnlp.aero.linear_flow.operator import linearise
from hbnlp.core.checks import instance_of, whole_number
from hbnlp.core.types import ComplexArray


class LinearResponse:
    """G(s) from [alpha, z, W_1..W_N] to [C_L, dCp_1..dCp_N] about a steady flow.

    Parameters
    ----------
    flow : BaseFlow
        Of `steady_flow`.
    n_modes : int
        Number N of membrane modes.

    Raises
    ------
    ValueError
        If ``n_modes`` is negative.
    """

    def __init__(self, flow: BaseFlow, *, n_modes: int) -> None:
        instance_of("flow", flow, BaseFlow, "the BaseFlow of steady_flow")
        n_modes = whole_number("n_modes", n_modes, least=0, advice=", 0 for a rigid plate")
        self._matrices = linearise(flow)
        velocity = self._matrices.velocity
        motions = plate_motions(flow, velocity, n_modes)
        pad = ((0, self._matrices.stiffness.shape[0] - velocity.ndof), (0, 0))
        self._wall = np.pad(motions.traces, pad)
        self._tests = np.pad(load_tests(flow, velocity, n_modes), pad)
        self._source = self._matrices.shape_stiffness @ motions.fields
        self._source_rate = self._matrices.shape_mass @ motions.fields
        self._friction = loads.turned_friction(flow, n_modes)
        self._factor = loads.force_factor(flow)
        self.base_load = loads.base_load(flow, n_modes)
        self.drag = loads.drag(flow)

    @property
    def unknowns(self) -> int:
        """Number of free unknowns."""
        return len(self._matrices.free)

    def eigenvalues(self, near: complex, *, within: float = 2.5, steps: int = 40) -> ComplexArray:
        """Return isolated eigenvalues s of the flow within a distance of a point, (any number,), by shift and invert.

        A positive real part means that the steady flow is not what the fluid does: it sheds vortices, and the linear
        response about it is of no use. Vortex shedding has Im s of some 1 to 10. The stable wake has a continuous
        spectrum beside the imaginary axis, which a discretisation turns into a row of eigenvalues close together: the
        point should lie to the right of the axis, or only these are seen. Of an Arnoldi process of ``steps`` steps
        those values are returned that have converged, which are those that stand alone and about as near to the point
        as the wake's; where all is stable there may be none. Those far away are artefacts of the infinite eigenvalues
        that belong to the pressure. On a half mesh only motions that are odd about the plate are seen, as shedding is.
        """
        m, free = self._matrices, self._matrices.free
        mass = m.mass[free][:, free].tocsr()
        with factorise((m.stiffness + near * m.mass).tocsr()[free][:, free].astype(complex)) as factors:
            inverse = arnoldi(lambda x: factors.solve(mass @ x), np.ones(len(free), dtype=complex), steps=steps)
        values: ComplexArray = near - 1.0 / inverse[np.abs(inverse) * within > 1.0]
        return values

    def transfer(self, s: complex) -> ComplexArray:
        """Return G(s), (N+1, N+2), loads per motion exp(s t); real and exact for s = 0."""
        m, free = self._matrices, self._matrices.free
        shift = complex(s) if s != 0 else 0.0
        matrix = (m.stiffness + shift * m.mass).tocsr()
        state = (shift * self._wall).astype(np.result_type(shift))
        source = self._source + shift * self._source_rate
        with factorise(matrix[free][:, free]) as factors:
            state[free] -= factors.solve((matrix @ state + source)[free])
        reaction = matrix @ state + source
        transfer: ComplexArray = (self._factor * (self._tests.T @ reaction)).astype(complex)
        transfer[1:] *= 2.0
        return transfer - self._friction
