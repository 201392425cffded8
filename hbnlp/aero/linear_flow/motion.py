"""The motions of the plate and their smooth continuation into the fluid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.aero.linear_flow.base_flow import BaseFlow
from hbnlp.core.types import Array

if TYPE_CHECKING:
    import ngsolve


@dataclass(frozen=True, kw_only=True)
class Motions:
    """Displacements per unit of [alpha, z, W_1..W_N], as coefficients of the velocity space.

    Attributes
    ----------
    fields : ndarray, shape (velocity unknowns, N+2)
        Displacement of the mesh: the plate's, carried smoothly into the fluid.
    traces : ndarray, shape (velocity unknowns, N+2)
        The same on the plate, zero at all other unknowns.
    """

    fields: Array
    traces: Array


def plate_motions(flow: BaseFlow, space: ngsolve.FESpace, n_modes: int) -> Motions:
    """Interpolate the motions in the frame of the plate, whose x axis is the chord.

    Pitch displaces by -x and W_k by sin(k pi x) along the normal; heave is normal to the stream. Any continuation into
    the fluid gives the same loads up to the discretisation; this one falls to zero over a distance that shrinks with
    the wavelength of the mode, faster than any power. In heave the whole mesh moves, so that static heave gives no load
    by construction.

    Parameters
    ----------
    flow : BaseFlow
    space : ngsolve.FESpace
        Of the velocity.
    n_modes : int
        Number N of sine modes.
    """
    import ngsolve as ng

    on_plate = np.unique(
        [dof for element in space.Elements(ng.BND) if element.mat in flow.plate.split("|") for dof in element.dofs]
    )
    fields = np.zeros((space.ndof, n_modes + 2))
    traces = np.zeros_like(fields)
    function = ng.GridFunction(space)
    for column, displacement in enumerate(_displacements(flow.incidence, n_modes)):
        reach = 1.5 if column == 0 else min(1.5, 3.0 / (max(1, column - 1) * np.pi))
        taper = ng.CF(1.0) if column == 1 else _taper(reach)
        with ng.TaskManager():
            function.Set(displacement * taper)
        fields[:, column] = function.vec.FV().NumPy()
        traces[:, column] = trace(function, displacement, flow.plate)
        fields[on_plate, column] = traces[on_plate, column]
    return Motions(fields=fields, traces=traces)


def load_tests(flow: BaseFlow, space: ngsolve.FESpace, n_modes: int) -> Array:
    """Return the functions whose virtual work is the load: lift, then sin(k pi x) along the normal; (unknowns, N+1)."""
    import ngsolve as ng

    function = ng.GridFunction(space)
    _, lift, *modes = _displacements(flow.incidence, n_modes)
    return np.stack([trace(function, test, flow.plate) for test in (lift, *modes)], axis=1)


def trace(function: ngsolve.GridFunction, value: Any, plate: str) -> Array:
    """Return the coefficients of a field that is ``value`` on the plate and zero at all other unknowns."""
    function.vec[:] = 0.0
    function.Set(value, definedon=function.space.mesh.Boundaries(plate))
    return np.array(function.vec.FV().NumPy())


def _taper(reach: float) -> Any:
    import ngsolve as ng

    beside = ng.IfPos(-ng.x, -ng.x, ng.IfPos(ng.x - 1.0, ng.x - 1.0, 0.0))
    return ng.exp(-((beside / reach) ** 4) - (ng.y / reach) ** 4)


def _displacements(incidence: float, n_modes: int) -> list[Any]:
    import ngsolve as ng

    pitch, heave = ng.CF((0.0, -ng.x)), ng.CF((-np.sin(incidence), np.cos(incidence)))
    return [pitch, heave, *(ng.CF((0.0, ng.sin(k * np.pi * ng.x))) for k in range(1, n_modes + 1))]
