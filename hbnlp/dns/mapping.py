"""A coordinate map that keeps a deflected plate on its grid line.

Physical ordinate y = Y + eta(X, Y, t), eta = w(X, t) taper(X) taper(Y), with X = x: the plate y = w is always Y = 0.
With J = 1 + eta_Y the contravariant fluxes U = psi_Y = J u, V = -psi_X = v - u eta_X are the discrete curl of psi, and
the circulation per cell gamma = J omega is the discrete rotation of the covariant velocities,

    u_1 = (1 + eta_X^2) / J  U + eta_X V,      u_2 = J V + eta_X U,     gamma = rot(u_1, u_2)

The metric has determinant one. Because no-slip is imposed on (U, V) and the force is covariant, the body matrix of the
undeformed plate serves unchanged; what the metric adds to the plain operators is the source

    m(psi) = rot((I - metric) curl psi),      - Lap psi = gamma + m(psi).

Derivation in docs/dns.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hbnlp.core.types import Array
from hbnlp.dns.errors import FlowError
from hbnlp.dns.grid import Grid
from hbnlp.dns.stencils import curl, rot

_MIN_ROOM = 0.25
_MIN_JACOBIAN = 0.2
# The two passes of the flow solver over m(psi) converge in time for stretches up to 1 + 1 in theory; measured stable up
# to 2.26 (trace 2.7).
_MAX_STRETCH = 2.2


def _bump(r: Array) -> tuple[Array, Array]:
    """Taper (1 - r^2)^4 and its derivative: one and flat at r = 0, smooth to zero at |r| = 1."""
    inside = np.maximum(1.0 - r**2, 0.0)
    return inside**4, -8.0 * r * inside**3


def _smoothstep(r: Array) -> tuple[Array, Array]:
    """Step from 0 at r <= 0 to 1 at r >= 1 with three continuous derivatives, and its derivative."""
    r = np.clip(r, 0.0, 1.0)
    return r**4 * (35.0 - 84.0 * r + 70.0 * r**2 - 20.0 * r**3), 140.0 * r**3 * (1.0 - r) ** 3


@dataclass(frozen=True)
class Metric:
    """Metric of one deflection, on the part of level 0 where the map acts.

    ``stretch`` (1 + eta_X^2) / J on u-points, ``squeeze`` J on v-points, ``slope`` eta_X at cell middles, ``jacobian``
    J on nodes, ``eta`` and ``eta_rate`` on nodes. ``stretch_max`` is the larger eigenvalue of the metric, the largest
    over the plane; the other is its inverse.
    """

    stretch: Array
    squeeze: Array
    slope: Array
    jacobian: Array
    eta: Array
    eta_rate: Array
    spacing: float
    stretch_max: float

    def lower(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Covariant components of contravariant fluxes: u of shape (nx + 1, ny), v of shape (nx, ny + 1).

        The cross terms are taken at cell middles, so that the operator is symmetric; they leave out the outermost
        cells, where eta = 0.
        """
        u_lower = self.stretch * u
        v_lower = self.squeeze * v
        cross = self.slope * (v[:, 1:] + v[:, :-1])
        u_lower[1:-1, :] += 0.25 * (cross[1:, :] + cross[:-1, :])
        cross = self.slope * (u[1:, :] + u[:-1, :])
        v_lower[:, 1:-1] += 0.25 * (cross[:, 1:] + cross[:, :-1])
        return u_lower, v_lower

    def source(self, psi: Array) -> Array:
        """m(psi) at the interior nodes of the window."""
        u, v = curl(psi, self.spacing)
        u_lower, v_lower = self.lower(u, v)
        return rot(u - u_lower, v - v_lower, self.spacing)

    def rotation(self, psi: Array) -> Array:
        """rot(metric curl psi), minus the mapped Laplacian, at the interior nodes of the window."""
        return rot(*self.lower(*curl(psi, self.spacing)), self.spacing)


class PlateMap:
    """The map for a plate from (0, 0) to (1, 0) with deflection w = sum_k W_k sin(k pi x).

    Parameters
    ----------
    grid : Grid
        The grids; the map acts within the fine box only.
    n_modes : int
        Number of sine modes.

    Raises
    ------
    ValueError
        If the fine box leaves less than a quarter chord around the plate, or the grid has fewer than 2.5 cells to the
        shortest half wave.
    """

    def __init__(self, grid: Grid, n_modes: int) -> None:
        x, y = grid.nodes()
        h = grid.spacing
        cells = grid.plate_cells()
        if not 1 <= n_modes <= 2 * cells // 5:
            raise ValueError(
                f"{n_modes} sine modes on a plate of {cells} cells: between 1 and {2 * cells // 5} "
                "(2.5 cells a half wave) are accepted"
            )
        # the map ends two cells before the border, where the coarser level takes over
        room = [-x[0] - 3 * h, x[-1] - 1.0 - 3 * h, min(-y[0], y[-1]) - 3 * h]
        if min(room) < _MIN_ROOM:
            raise ValueError(
                f"the fine box leaves {min(room):.3g} chords around the plate for the coordinate map; "
                f"at least {_MIN_ROOM} are needed: enlarge the box (Grid.around_plate(ahead=, behind=, above=))"
            )
        ahead, behind, height = (min(value, 1.0) for value in room)
        i0, i1 = np.searchsorted(x, [-ahead - 1.5 * h, 1.0 + behind + 1.5 * h])
        j0, j1 = np.searchsorted(y, [-height - 1.5 * h, height + 1.5 * h])
        self.window = slice(int(i0), int(i1)), slice(int(j0), int(j1))
        self.spacing = h
        self.n_modes = n_modes
        self.x, self.y = x[self.window[0]], y[self.window[1]]
        self._shapes = [_tapered_modes(self._points(self.x, half), n_modes, ahead, behind) for half in (False, True)]
        self._tapers = [
            tuple(part / height**n for n, part in enumerate(_bump(self._points(self.y, half) / height)))
            for half in (False, True)
        ]

    @staticmethod
    def _points(axis: Array, half: bool) -> Array:
        return 0.5 * (axis[1:] + axis[:-1]) if half else axis

    def metric(self, deflection: Array, rate: Array) -> Metric:
        """Metric of modal deflections W and rates W', each of shape (n_modes,).

        Raises
        ------
        FlowError
            If the map is too steep: slopes of the membrane above about 0.8, or a deflection too large for the height of
            the fine box.
        """
        (modes, slopes), (modes_half, slopes_half) = self._shapes
        (taper, taper_slope), (taper_half, taper_slope_half) = self._tapers
        shape = deflection @ modes
        jacobian = 1.0 + np.outer(shape, taper_slope)
        jacobian_u = 1.0 + np.outer(shape, taper_slope_half)
        if min(jacobian.min(), jacobian_u.min()) < _MIN_JACOBIAN:
            raise FlowError(_steep(f"Jacobian {jacobian.min():.2g}, accepted from {_MIN_JACOBIAN}", shape))
        stretch = (1.0 + np.outer(deflection @ slopes, taper_half) ** 2) / jacobian_u
        # eigenvalues of a symmetric matrix with determinant one
        trace = float((stretch + jacobian_u).max())
        largest = 0.5 * (trace + math.sqrt(max(trace**2 - 4.0, 0.0)))
        if largest > _MAX_STRETCH:
            raise FlowError(_steep(f"it stretches by {largest:.2f}, accepted up to {_MAX_STRETCH}", shape))
        return Metric(
            stretch=stretch,
            squeeze=1.0 + np.outer(deflection @ modes_half, taper_slope),
            slope=np.outer(deflection @ slopes_half, taper_half),
            jacobian=jacobian,
            eta=np.outer(deflection @ modes, taper),
            eta_rate=np.outer(rate @ modes, taper),
            spacing=self.spacing,
            stretch_max=largest,
        )

    def interior(self) -> tuple[slice, slice]:
        """Slices of the inner nodes of the window in an array of interior nodes of level 0."""
        (sx, sy) = self.window
        return slice(sx.start, sx.stop - 2), slice(sy.start, sy.stop - 2)


def _steep(what: str, shape: Array) -> str:
    return (
        f"the map that carries the deflected plate is too steep ({what}; max |w| = {np.abs(shape).max():.3g}): "
        "use a larger fine box (Grid.around_plate(above=, ahead=, behind=)) or a smaller deflection"
    )


def _tapered_modes(x: Array, n_modes: int, ahead: float, behind: float) -> tuple[Array, Array]:
    """Sine modes continued beyond the plate and tapered to zero, and their slopes, each of shape (n_modes, points)."""
    left, left_slope = _smoothstep(1.0 + x / ahead)
    right, right_slope = _smoothstep(1.0 - (x - 1.0) / behind)
    taper = left * right
    taper_slope = left_slope / ahead * right - left * right_slope / behind
    k = np.pi * np.arange(1, n_modes + 1)[:, None]
    sine, cosine = np.sin(k * x), k * np.cos(k * x)
    return taper * sine, taper * cosine + taper_slope * sine
