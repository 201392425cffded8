"""Loads by the reaction of the plate: the residual of the momentum equation, never an integral of edge pressures.

The traction's virtual work in a displacement phi of the plate is minus the residual tested with any field that is phi
on the plate. It converges twice as fast as the pressure itself and sees no edge singularity. Total force, friction
included, is the lift; the pressure jump is what remains when the steady friction, turned with the surface by its slope
xi', is taken off: ``2 int dCp phi = 4 force(phi) - 2 int C_f xi' phi``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hbnlp.aero.linear_flow.base_flow import BaseFlow
from hbnlp.aero.linear_flow.motion import load_tests, trace
from hbnlp.core.types import Array

if TYPE_CHECKING:
    import ngsolve


def force_factor(flow: BaseFlow) -> float:
    """Return the factor from residual to force coefficient (2/(rho U^2 c)), both sides of the plate counted."""
    return -4.0 if flow.symmetric else -2.0


def drag(flow: BaseFlow) -> float:
    """Return the drag coefficient of the steady flow, both sides, force along the stream."""
    import ngsolve as ng

    return _steady(flow, ng.CF((np.cos(flow.incidence), np.sin(flow.incidence))))


def base_load(flow: BaseFlow, n_modes: int) -> Array:
    """Return [C_L, dCp_1..dCp_N] of the steady flow, (N+1,); zero by symmetry on a half mesh."""
    if flow.symmetric:
        return np.zeros(n_modes + 1)
    velocity = flow.state.space.components[0]
    tests = load_tests(flow, velocity, n_modes)
    loads = force_factor(flow) * (flow.reaction[: velocity.ndof] @ tests)
    loads[1:] *= 2.0
    return loads


def turned_friction(flow: BaseFlow, n_modes: int) -> Array:
    """Return the normal force of the steady friction per motion, (N+1, N+2), to be taken off the pressure rows.

    Row k > 0, column xi: ``2 int C_f xi' sin(k pi x) dx`` with C_f the friction of both sides; row 0 is zero, as the
    lift keeps it. Products of sines and cosines are written as sums, so 2 N + 1 residuals serve all entries.
    """
    import ngsolve as ng

    sines = np.array([_steady(flow, ng.CF((ng.sin(m * np.pi * ng.x), 0.0))) for m in range(1, 2 * n_modes + 1)])
    sines = np.concatenate([-sines[::-1], [0.0], sines])  # index m + 2 N, odd in m
    friction = np.zeros((n_modes + 1, n_modes + 2))
    for i in range(1, n_modes + 1):
        friction[i, 0] = -2.0 * sines[2 * n_modes + i]
        for j in range(1, n_modes + 1):
            # 2 j pi cos(j pi x) sin(i pi x) = j pi (sin((i + j) pi x) + sin((i - j) pi x))
            friction[i, 1 + j] = j * np.pi * (sines[2 * n_modes + i + j] + sines[2 * n_modes + i - j])
    return friction


def _steady(flow: BaseFlow, test: Any) -> float:
    velocity: ngsolve.FESpace = flow.state.space.components[0]
    import ngsolve as ng

    work = flow.reaction[: velocity.ndof] @ trace(ng.GridFunction(velocity), test, flow.plate)
    return force_factor(flow) * float(work)
