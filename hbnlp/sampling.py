"""How many samples a period a force needs, so that products of harmonics do not fold back onto the retained ones."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbnlp.system import System

HIGHEST_DEGREE = 9
MOST_SAMPLES = 8192


def polynomial_degree(system: System) -> int | None:
    """Return the degree of the force as a polynomial in (q, q'), or None if it is no polynomial or depends on tau.

    The force is evaluated along random lines at two scales and expanded in Chebyshev polynomials: what is smooth but no
    polynomial has coefficients beyond the highest degree tried (9), and so has what is not smooth.
    """
    if not system.is_nonlinear:
        return 1
    if ca.depends_on(system.force, system.tau):
        return None
    rng = np.random.default_rng(20080)
    n_nodes = 4 * HIGHEST_DEGREE
    nodes = np.cos(np.pi * (np.arange(n_nodes) + 0.5) / n_nodes)
    defaults = np.array(list(system.parameters.defaults.values()))
    unset = ~np.isfinite(defaults) | (defaults == 0.0)
    force = ca.Function("force", [system.q, system.v, system.p], [ca.densify(system.force)])
    degree = 0
    for scale in (1.0, 30.0):
        values = np.where(unset, 1.0, defaults) * rng.uniform(0.8, 1.2, defaults.size)
        q, v, q0, v0 = rng.uniform(-1.0, 1.0, (4, system.n_dof, 1))
        samples = np.array(force(scale * (q0 + q * nodes), scale * (v0 + v * nodes), np.tile(values[:, None], n_nodes)))
        if not np.all(np.isfinite(samples)):
            return None
        expansion = np.polynomial.chebyshev.chebfit(nodes, samples.T, n_nodes - 1)
        size = np.abs(expansion).max(axis=1)
        degree = max(degree, int(np.flatnonzero(size > 1e-11 * size.max()).max(initial=0)))
    return degree if degree <= HIGHEST_DEGREE else None


def sufficient_samples(n_harmonics: int, degree: int | None) -> int:
    """Return the samples that are exact for a polynomial force, (d + 1) H + 1, or a start for doubling (d = 7)."""
    return ((7 if degree is None else max(degree, 1)) + 1) * n_harmonics + 1
