"""The linearised Navier-Stokes equations in coordinates that move with the plate.

The material point of the mesh is at X + eta(X, t), eta being the plate's displacement carried smoothly into the fluid.
Velocity u' and pressure p' are perturbations at fixed X (arbitrary Lagrangian-Eulerian form), test functions move with
the mesh. To first order a derivative changes by ``-(d eta_k / d x_i) d/dx_k`` and an area by ``1 + div eta``, and the
mesh moves through the fluid with velocity s eta. For all test functions (v, q)::

    <v, s u' + U.grad u' + u'.grad U> + nu 2 eps(u'):eps(v) - p' div v - q div u'
        = - (first-order change of the steady residual by eta) + <v, s eta . grad U>,      u' = s xi on the plate

The wall data are then smooth at the edges, and the residual at the plate's unknowns is the load.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from hbnlp.aero.linear_flow.base_flow import BaseFlow, strain, stress_power
from hbnlp.aero.linear_flow.sparse import free_unknowns, to_csr

if TYPE_CHECKING:
    import ngsolve


@dataclass(frozen=True, kw_only=True)
class LinearisedFlow:
    """Matrices of ``(stiffness + s mass) [u', p'] + (shape_stiffness + s shape_mass) eta = reaction``.

    Attributes
    ----------
    velocity : ngsolve.FESpace
        Its unknowns come first; displacements live in it too.
    free : ndarray of int
        Unknowns without Dirichlet data.
    stiffness, mass : csr_matrix, shape (unknowns, unknowns)
    shape_stiffness, shape_mass : csr_matrix, shape (unknowns, velocity unknowns)
        Change of the steady residual by a displacement of the mesh and by its velocity.
    """

    velocity: ngsolve.FESpace
    free: NDArray[np.intp]
    stiffness: sp.csr_matrix
    mass: sp.csr_matrix
    shape_stiffness: sp.csr_matrix
    shape_mass: sp.csr_matrix


def linearise(flow: BaseFlow) -> LinearisedFlow:
    """Assemble the linearised equations about a steady flow.

    On a half mesh the perturbation is odd about y = 0: on the axis u_x' = 0 and the normal traction vanishes. The top
    is closed to the perturbation, whose vortex pair then decays exponentially upstream instead of algebraically.
    """
    import ngsolve as ng

    velocity = _velocity_space(flow)
    space = velocity * ng.H1(flow.mesh, order=flow.order - 1)
    base_u, base_p = flow.state.components
    nu, order = 1.0 / flow.reynolds, flow.order
    (u, p), (v, q) = space.TnT()
    eta = velocity.TrialFunction()
    convection = ng.Grad(u) * base_u + ng.Grad(base_u) * u
    forms = {
        "stiffness": _form(space, space, stress_power(u, p, v, q, nu) + ng.InnerProduct(convection, v), bonus=order),
        "mass": _form(space, space, ng.InnerProduct(u, v), bonus=0),
        "shape_stiffness": _form(velocity, space, _shape_derivative(base_u, base_p, eta, v, q, nu), bonus=2 * order),
        "shape_mass": _form(velocity, space, -ng.InnerProduct(ng.Grad(base_u) * eta, v), bonus=order),
    }
    return LinearisedFlow(velocity=velocity, free=free_unknowns(space), **forms)


def _shape_derivative(u: Any, p: Any, eta: Any, v: Any, q: Any, nu: float) -> Any:
    """Return the first-order change of the steady residual of (u, p) when the mesh is displaced by eta."""
    import ngsolve as ng

    def turned(w: Any) -> Any:
        return -ng.Grad(w) * ng.Grad(eta)

    steady = stress_power(u, p, v, q, nu) + ng.InnerProduct(ng.Grad(u) * u, v)
    viscous = ng.InnerProduct(strain(turned(u)), strain(ng.Grad(v))) + ng.InnerProduct(
        strain(ng.Grad(u)), strain(turned(v))
    )
    pressure = p * ng.Trace(turned(v)) + q * ng.Trace(turned(u))
    return ng.div(eta) * steady + ng.InnerProduct(turned(u) * u, v) + 2.0 * nu * viscous - pressure


def _form(trial: ngsolve.FESpace, test: ngsolve.FESpace, integrand: Any, *, bonus: int) -> sp.csr_matrix:
    """Assemble, with a quadrature exact for the base flow's polynomials too (the default is for two factors)."""
    import ngsolve as ng

    form = ng.BilinearForm(test) if trial is test else ng.BilinearForm(trialspace=trial, testspace=test)
    form += integrand.Compile() * ng.dx(bonus_intorder=bonus)
    with ng.TaskManager():
        form.Assemble()
    return to_csr(form.mat)


def _velocity_space(flow: BaseFlow) -> ngsolve.FESpace:
    import ngsolve as ng

    if flow.symmetric:
        fixed = {"dirichletx": "inlet|axis|upper", "dirichlety": "inlet|top|upper"}
    else:
        fixed = {"dirichletx": "inlet|upper|lower", "dirichlety": "inlet|top|bottom|upper|lower"}
    return ng.VectorH1(flow.mesh, order=flow.order, **fixed)
