"""Nested Cartesian grids: each level is twice as large and twice as coarse as the one inside it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hbnlp.core.checks import finite_array, interval, list_of, real_number, refused, whole_number
from hbnlp.core.types import Array

_MIN_CELLS = 16
_MOST_CELLS = 10_000
_MOST_LEVELS = 30
# The discrete plate is shorter than its nodes by this many cells at each end: the limit of small cells, in which the
# flow about an end is Stokes flow, from the Wiener-Hopf factor of the lattice (docs/dns.md; recomputed in the tests).
PLATE_OVERHANG = 0.2390729


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Nested grids around a body; streamfunction and vorticity live on the nodes.

    Level 0 is the fine box. Level ``l`` has the same number of cells, the spacing ``2**l * spacing`` and the same
    centre.

    Parameters
    ----------
    spacing : float
        Cell size h of the fine box, in chords (or diameters).
    shape : tuple of int
        Number of cells (nx, ny) of every level.
    corner : tuple of float
        Lower left corner (x0, y0) of the fine box.
    levels : int
        Number of nested levels.

    Raises
    ------
    ValueError
        If a value is not positive and finite, a level has fewer than 16 cells in a direction, or levels is below 1.

    References
    ----------
    Colonius and Taira (2008), doi:10.1016/j.cma.2007.08.014.
    """

    spacing: float
    shape: tuple[int, int]
    corner: tuple[float, float]
    levels: int = 5

    def __post_init__(self) -> None:
        real_number("spacing", self.spacing, above=0.0)
        list_of("shape", self.shape, int | np.integer, "the numbers of cells each way, (nx, ny)")
        if len(self.shape) != 2:
            raise refused(ValueError, "shape", self.shape, "the numbers of cells each way, (nx, ny)")
        for cells in self.shape:
            whole_number("shape", cells, least=_MIN_CELLS, most=_MOST_CELLS, advice=" cells each way")
        finite_array("corner", self.corner, (2,))
        whole_number("levels", self.levels, least=1, most=_MOST_LEVELS, advice=" (5 or 6 reach a far field)")

    @classmethod
    def box(
        cls,
        *,
        spacing: float = 0.02,
        x: tuple[float, float] = (-1.0, 2.0),
        y: tuple[float, float] = (-1.0, 1.0),
        levels: int = 6,
    ) -> Grid:
        """Grid whose fine box covers x and y, enlarged to whole cells.

        Parameters
        ----------
        spacing : float
            Fine cell size.
        x, y : tuple of float
            Extent of the fine box.
        levels : int
            Number of levels.
        """
        x, y = interval("x", x), interval("y", y)
        real_number("spacing", spacing, above=0.0)
        # whole cells up to round-off; even numbers keep a node at the centre
        nx, ny = (2 * math.ceil((upper - lower) / (2.0 * spacing) - 1e-9) for lower, upper in (x, y))
        if not _MIN_CELLS <= min(nx, ny) <= max(nx, ny) <= _MOST_CELLS:
            raise refused(ValueError, "spacing", spacing, f"one for {_MIN_CELLS} to {_MOST_CELLS} cells each way")
        centre = (0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]))
        return cls(
            spacing=spacing,
            shape=(nx, ny),
            corner=(centre[0] - 0.5 * nx * spacing, centre[1] - 0.5 * ny * spacing),
            levels=levels,
        )

    @classmethod
    def around_plate(
        cls, *, cells: int = 50, ahead: float = 1.0, behind: float = 1.0, above: float = 1.05, levels: int = 6
    ) -> Grid:
        """Grid for the sharp plate from (0, 0) to (1, 0), whose line lies midway between two rows of nodes.

        The first and the last of the ``cells + 1`` nodes on the plate lie 0.239 cells outside its ends, as the discrete
        plate acts like one that is shorter by as much.

        Parameters
        ----------
        cells : int
            Cells on the plate, h = 1 / (cells - 0.478).
        ahead, behind : float
            Fine box ahead of the leading and behind the trailing edge, in chords.
        above : float
            Half the height of the fine box, in chords.
        levels : int
            Number of levels; below six the low-frequency lift is off by a per cent or more.
        """
        whole_number("cells", cells, least=4, most=_MOST_CELLS, advice=" (25 for a coarse result)")
        real_number("ahead", ahead, least=0.0, most=1000.0)
        real_number("behind", behind, least=0.0, most=1000.0)
        real_number("above", above, above=0.0, most=1000.0)
        front, rear = round(ahead * cells), round(behind * cells)
        ny = 2 * round(above * cells - 0.5) + 1
        spacing = 1.0 / (cells - 2.0 * PLATE_OVERHANG)
        return cls(
            spacing=spacing,
            shape=(front + cells + rear, ny),
            corner=(-(front + PLATE_OVERHANG) * spacing, -0.5 * ny * spacing),
            levels=levels,
        )

    def plate_cells(self) -> int:
        """Cells on the sharp plate.

        Raises
        ------
        ValueError
            If the plate's ends and its line are not where `around_plate` has them (the constraints would be singular).
        """
        start = -self.corner[0] / self.spacing - PLATE_OVERHANG
        cells = 1.0 / self.spacing + 2.0 * PLATE_OVERHANG
        row = -self.corner[1] / self.spacing - 0.5
        for value, what in ((start, "leading edge"), (start + cells, "trailing edge"), (row, "line")):
            if abs(value - round(value)) > 1e-6:
                raise ValueError(
                    f"the plate's {what} is {value - math.floor(value):.3g} cells off its place on the grid "
                    f"(nodes {PLATE_OVERHANG:.3f} cells beyond the ends, line midway between rows of nodes): "
                    "use Grid.around_plate"
                )
        return round(cells)

    def cell(self, level: int) -> float:
        """Cell size of a level."""
        return self.spacing * float(2**level)

    def cells(self) -> Array:
        """Cell size of every level, shape (levels,)."""
        return np.asarray(self.spacing * 2.0 ** np.arange(self.levels), dtype=np.float64)

    def nodes(self, level: int = 0) -> tuple[Array, Array]:
        """Node coordinates of a level, shapes (nx + 1,) and (ny + 1,)."""
        h = self.cell(level)
        axes = []
        for cells, lower in zip(self.shape, self.corner, strict=True):
            centre = lower + 0.5 * cells * self.spacing
            axes.append(np.asarray(centre + h * (np.arange(cells + 1) - 0.5 * cells), dtype=np.float64))
        return axes[0], axes[1]

    def check_inside(self, points: Array, margin_cells: float, what: str) -> None:
        """Raise ValueError if a point of shape (n, 2) is closer than some cells to the edge of the fine box."""
        x, y = self.nodes()
        margin = margin_cells * self.spacing
        low, high = points.min(axis=0), points.max(axis=0)
        if low[0] < x[0] + margin or high[0] > x[-1] - margin or low[1] < y[0] + margin or high[1] > y[-1] - margin:
            raise ValueError(
                f"{what} spans x = {low[0]:.4g} .. {high[0]:.4g}, y = {low[1]:.4g} .. {high[1]:.4g}, but it must stay "
                f"{margin:.3g} inside the fine box x = {x[0]:.4g} .. {x[-1]:.4g}, y = {y[0]:.4g} .. {y[-1]:.4g}: "
                "enlarge the box or move the body"
            )
