"""The steady flow past the plate, by Newton's method on Taylor-Hood elements."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.aero.linear_flow.direct import factorise
from hbnlp.aero.linear_flow.mesh import check_incidence
from hbnlp.aero.linear_flow.sparse import free_unknowns, to_csr
from hbnlp.core.checks import instance_of, real_number, whole_number
from hbnlp.core.errors import ConvergenceError
from hbnlp.core.types import Array

if TYPE_CHECKING:
    import ngsolve

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class BaseFlow:
    """A steady flow.

    Attributes
    ----------
    mesh : ngsolve.Mesh
    order : int
        Polynomial order of the velocity; the pressure has one less.
    reynolds : float
        Reynolds number of chord.
    incidence : float
        Angle of the stream to the plate, rad.
    state : ngsolve.GridFunction
        Velocity and pressure (stream velocity, twice the dynamic pressure).
    reaction : ndarray, shape (unknowns,)
        Residual of the momentum equation: zero at free unknowns, minus the load of the fluid on the plate at those of
        the plate.
    corrections : tuple of float
        Newton's relative corrections.
    """

    mesh: ngsolve.Mesh
    order: int
    reynolds: float
    incidence: float
    state: ngsolve.GridFunction
    reaction: Array
    corrections: tuple[float, ...]

    @property
    def symmetric(self) -> bool:
        """Whether the mesh is the upper half plane only."""
        return "axis" in self.mesh.GetBoundaries()

    @property
    def plate(self) -> str:
        """NGSolve's pattern of the plate's boundaries."""
        return "upper" if self.symmetric else "upper|lower"


def steady_flow(
    mesh: ngsolve.Mesh, *, reynolds: float, incidence: float = 0.0, order: int = 4, tolerance: float = 1e-6
) -> BaseFlow:
    """Solve the steady incompressible Navier-Stokes equations past the plate.

    On a half mesh the flow is even about y = 0 and the top lets the displaced fluid out; on a slit mesh the far
    boundaries move with the stream. The outlet is free of traction.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Of `half_mesh` (only for zero incidence) or `slit_mesh`.
    reynolds : float
        Reynolds number of chord.
    incidence : float
        Angle of the stream to the plate, rad.
    order : int
        Polynomial order of the velocity, at least 2.
    tolerance : float
        Relative Newton correction after which to stop; the error left is about its square.

    Returns
    -------
    BaseFlow

    Raises
    ------
    ValueError
        If the Reynolds number is not positive, the order is below 2, or a half mesh is given with an incidence.
    ConvergenceError
        If Newton does not converge; the steady flow may not exist, or the mesh is too coarse for it.
    """
    import ngsolve as ng

    instance_of("mesh", mesh, ng.Mesh, "the mesh of half_mesh or slit_mesh")
    check_incidence(incidence)
    real_number("tolerance", tolerance, above=0.0, below=1.0)
    symmetric = "axis" in mesh.GetBoundaries()
    real_number("reynolds", reynolds, above=0.0)
    whole_number("order", order, least=2, advice=" for Taylor-Hood elements (4 is recommended)")
    if symmetric and incidence != 0.0:
        raise ValueError(f"incidence is {incidence:g} rad, but the mesh is a half plane; use slit_mesh")
    space = _space(mesh, order, symmetric)
    (u, p), (v, q) = space.TnT()
    stokes = ng.BilinearForm(space)
    stokes += stress_power(u, p, v, q, 1.0 / reynolds) * ng.dx
    momentum = ng.BilinearForm(space)
    # products of three polynomials: the default quadrature is for two, and its error at the edges costs half a percent
    momentum += (stress_power(u, p, v, q, 1.0 / reynolds) + ng.InnerProduct(ng.Grad(u) * u, v)) * ng.dx(
        bonus_intorder=order
    )
    state = ng.GridFunction(space)
    stream = ng.CF((np.cos(incidence), np.sin(incidence)))
    state.components[0].Set(stream, definedon=mesh.Boundaries("inlet|top" if symmetric else "inlet|top|bottom"))
    free = free_unknowns(space)
    values = state.vec.FV().NumPy()
    residual = state.vec.CreateVector()
    with ng.TaskManager():
        stokes.Assemble()
    matrix = to_csr(stokes.mat)
    with factorise(matrix[free][:, free]) as stokes_lu:
        values[free] -= stokes_lu.solve((matrix @ values)[free])
    corrections: list[float] = []
    while not corrections or corrections[-1] > tolerance:
        with ng.TaskManager():
            momentum.Apply(state.vec, residual)
            momentum.AssembleLinearization(state.vec)
        matrix = to_csr(momentum.mat)[free][:, free]
        with factorise(matrix) as lu:
            correction = lu.solve(residual.FV().NumPy()[free])
        values[free] -= correction
        corrections.append(float(np.linalg.norm(correction) / np.linalg.norm(values)))
        logger.info("base flow: Newton correction %d is %.2e", len(corrections), corrections[-1])
        if len(corrections) > 20 or not np.isfinite(corrections[-1]) or corrections[-1] > 1e3:
            raise ConvergenceError(
                f"the steady flow at Re = {reynolds:g}, incidence {np.rad2deg(incidence):g} degrees was not found "
                f"(correction {corrections[-1]:.1e} after {len(corrections)} steps); "
                "refine the mesh, or lower the Reynolds number or the incidence",
                tuple(corrections),
            )
    with ng.TaskManager():
        momentum.Apply(state.vec, residual)
    return BaseFlow(
        mesh=mesh, order=order, reynolds=reynolds, incidence=incidence, state=state,
        reaction=residual.FV().NumPy().copy(), corrections=tuple(corrections),
    )  # fmt: skip


def stress_power(u: Any, p: Any, v: Any, q: Any, viscosity: float) -> Any:
    """Return 2 nu eps(u):eps(v) - p div v - q div u, whose natural boundary value is the traction."""
    import ngsolve as ng

    return 2.0 * viscosity * ng.InnerProduct(strain(ng.Grad(u)), strain(ng.Grad(v))) - p * ng.div(v) - q * ng.div(u)


def strain(gradient: Any) -> Any:
    """Return the symmetric part of a velocity gradient."""
    return 0.5 * (gradient + gradient.trans)


def _space(mesh: ngsolve.Mesh, order: int, symmetric: bool) -> ngsolve.FESpace:
    import ngsolve as ng

    if symmetric:
        fixed = {"dirichletx": "inlet|top|upper", "dirichlety": "inlet|axis|upper"}
    else:
        fixed = {"dirichletx": "inlet|top|bottom|upper|lower", "dirichlety": "inlet|top|bottom|upper|lower"}
    return ng.VectorH1(mesh, order=order, **fixed) * ng.H1(mesh, order=order - 1)
