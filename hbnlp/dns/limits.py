"""What the explicit terms of a time step allow, and the words for when it is exceeded."""

from __future__ import annotations

import math

import numpy as np

from hbnlp.core.types import Array
from hbnlp.dns.errors import FlowError

# Adams-Bashforth with central differences, measured: a cylinder at cell Reynolds number 8 is stable at 0.75 and not at
# 0.93.
CFL_LIMIT = 0.8
# Adams-Bashforth on the metric's part of diffusion: stable for (stretch - 1) * 8 nu dt / h^2 < 1.
_METRIC_DIFFUSION_LIMIT = 1.0
# the advised step leaves room for a flow that still accelerates
_MARGIN = 0.75


def check_courant(courant: float, dt: float, time: float) -> None:
    """Raise FlowError if the Courant number (|u| + |v|) dt / h is too large or not a number."""
    if not math.isfinite(courant):
        raise FlowError(
            f"the flow is no longer finite at t = {time:.6g}: restart from a saved state with dt below {dt:.3g}"
        )
    if courant > CFL_LIMIT:
        # rounded down, so that following the advice is enough
        digits = 10.0 ** (math.floor(math.log10(dt)) - 2)
        advice = math.floor(dt * _MARGIN * CFL_LIMIT / courant / digits) * digits
        raise FlowError(
            f"at t = {time:.6g} the Courant number (|u| + |v|) dt / h is {courant:.3g}, above the limit {CFL_LIMIT}: "
            f"dt = {advice:.3g} would do (dt is {dt:.4g})"
        )


def courant_number(u: Array, v: Array, dt: float, h: float) -> float:
    """Largest (|u| + |v|) dt / h of node velocities as `stencils.node_velocity` returns them."""
    speed = np.abs(u[1:-1, :])
    speed += np.abs(v[:, 1:-1])
    return float(speed.max()) * dt / h


def check_metric_diffusion(stretch: float, dt: float, diffusivity: float, h: float, time: float) -> None:
    """Raise FlowError if the explicit part of diffusion on a deflected plate's metric is unstable."""
    number = (stretch - 1.0) * 8.0 * diffusivity * dt / h**2
    if number > _METRIC_DIFFUSION_LIMIT:
        raise FlowError(
            f"at t = {time:.6g} the explicit diffusion on the deflected plate's metric has the number {number:.3g}, "
            f"above the limit {_METRIC_DIFFUSION_LIMIT}: dt = {_MARGIN * dt / number:.2g} would do (dt is {dt:.4g})"
        )
