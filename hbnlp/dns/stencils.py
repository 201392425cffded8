"""Finite-difference operators of the streamfunction-vorticity form on a staggered grid.

Nodes (i, j) carry streamfunction and vorticity; u sits at (i, j + 1/2), v at (i + 1/2, j). All arrays may carry leading
level axes, with the cell size h broadcast against them. ``rot`` is the transpose of ``curl``, so that
``rot(curl(psi))`` is minus the five-point Laplacian.

References
----------
Colonius and Taira (2008), doi:10.1016/j.cma.2007.08.014.
"""

from __future__ import annotations

from hbnlp.core.types import Array


def curl(psi: Array, h: float | Array) -> tuple[Array, Array]:
    """Velocities of a streamfunction: u of shape (..., nx + 1, ny), v of shape (..., nx, ny + 1)."""
    u = (psi[..., :, 1:] - psi[..., :, :-1]) / h
    v = (psi[..., :-1, :] - psi[..., 1:, :]) / h
    return u, v


def rot(u: Array, v: Array, h: float | Array) -> Array:
    """Vorticity v_x - u_y at the interior nodes, shape (..., nx - 1, ny - 1)."""
    circulation: Array = v[..., 1:, 1:-1] - v[..., :-1, 1:-1] - u[..., 1:-1, 1:] + u[..., 1:-1, :-1]
    return circulation / h


def laplacian(field: Array, h: float | Array) -> Array:
    """Five-point Laplacian at the interior nodes, shape (..., nx - 1, ny - 1)."""
    out: Array = field[..., 2:, 1:-1] + field[..., :-2, 1:-1]
    out += field[..., 1:-1, 2:]
    out += field[..., 1:-1, :-2]
    out -= 4.0 * field[..., 1:-1, 1:-1]
    out /= h * h
    return out


def node_velocity(psi: Array, h: float | Array) -> tuple[Array, Array]:
    """Velocities on the nodes: u of shape (..., nx + 1, ny - 1), v of shape (..., nx - 1, ny + 1)."""
    u = psi[..., :, 2:] - psi[..., :, :-2]
    v = psi[..., :-2, :] - psi[..., 2:, :]
    u /= 2.0 * h
    v /= 2.0 * h
    return u, v


def advection(u: Array, v: Array, omega: Array, h: float | Array) -> Array:
    """Convection -div(u omega) at the interior nodes, conserving the sums of omega and of omega squared.

    Parameters
    ----------
    u, v : ndarray
        Node velocities as `node_velocity` returns them.
    omega : ndarray of shape (..., nx + 1, ny + 1)
        Vorticity.
    h : float or ndarray
        Cell size.
    """
    inner = omega[..., :, 1:-1]
    flux = u[..., 1:, :] + u[..., :-1, :]
    flux *= inner[..., 1:, :] + inner[..., :-1, :]
    out: Array = flux[..., :-1, :] - flux[..., 1:, :]
    inner = omega[..., 1:-1, :]
    flux = v[..., :, 1:] + v[..., :, :-1]
    flux *= inner[..., :, 1:] + inner[..., :, :-1]
    out += flux[..., :, :-1]
    out -= flux[..., :, 1:]
    out /= 4.0 * h
    return out
