"""A converged point of a curve with its tangent, and how one is made: at a start, or from a neighbour."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hbnlp.continuation.along import tangent_at
from hbnlp.continuation.branch_points import BranchPoint
from hbnlp.continuation.curve import Bordered, Curve, relative_residual
from hbnlp.continuation.newton import Newton, approach, closeness, settle
from hbnlp.core.renamed import renamed_name
from hbnlp.core.types import Array

MISSED = 10.0
"""How far, in units of what was meant, a corrector may be off before new factors are made for the tangent."""


@dataclass(frozen=True, kw_only=True)
class Point:
    """A converged point of a curve, with its unit tangent in the metric ``scale`` and what the factors tell.

    ``iterations`` are the steps with factors of the point before: they tell whether the predictor was good. ``across``
    are sign and logarithm of the determinant across, of which ``orientation`` and ``log_determinant`` hold the part.
    """

    y: Array
    tangent: Array
    scale: Array
    orientation: float
    log_determinant: float
    residual: float
    iterations: int = 0
    factorisations: int = 0
    arclength: float = 0.0
    branch_point: BranchPoint | None = None
    across: tuple[float, float] = (1.0, 0.0)
    factors: Bordered | None = field(default=None, repr=False, compare=False)

    @property
    def value(self) -> float:
        """Value of the continuation parameter."""
        return float(self.y[-1])

    def __getattr__(self, name: str) -> Any:
        raise renamed_name("Point", name, {"parameter": "value"})


def start_point(curve: Curve, y: Array, toward: Array) -> Point:
    """Return a converged y as a point whose tangent makes an acute angle with ``toward``."""
    scale = curve.scale(y)
    tangent = tangent_at(curve, y, scale)
    along = float((tangent / scale) @ (toward / scale))
    tangent *= (np.sign(along) or 1.0) / np.linalg.norm(tangent / scale)
    factors = Bordered.at(curve, y, tangent / scale**2)
    orientation, log_determinant = factors.determinant()
    return Point(
        y=y,
        tangent=tangent,
        scale=scale,
        orientation=orientation,
        log_determinant=log_determinant,
        residual=relative_residual(curve, y),
        across=factors.across,
        factors=factors,
    )


def carried(point: Point, curve: Curve, other: Curve) -> Point:
    """Return a point of a curve as another curve sees it, with its own unknowns; it need not lie on that one."""
    y, tangent = (other.carried_from(curve, v) for v in (point.y, point.tangent))
    scale = other.scale(y)
    tangent = tangent / np.linalg.norm(tangent / scale)
    factors = point.factors if y.size == point.y.size else None
    return dataclasses.replace(point, y=y, tangent=tangent, scale=scale, factors=factors)


def corrected(point: Point, curve: Curve, other: Curve, options: Newton, *, fixed: bool = False) -> Point | None:
    """Return the point of another curve nearest to one of a curve, at the same arclength; None if there is none.

    It is sought in the plane normal to the tangent, or where the parameter is the same if that is to be ``fixed``.
    """
    base = carried(point, curve, other)
    row = base.tangent / base.scale**2
    if fixed:
        row = np.zeros(row.size)
        row[-1] = 1.0 / base.scale[-1]
    again = finish(other, base.y, row, base, options)
    if again is None and base.factors is not None:
        again = finish(other, base.y, row, dataclasses.replace(base, factors=None), options)
    if again is None:
        return None
    if fixed:
        again.y[-1] = base.y[-1]  # exactly
    return dataclasses.replace(again, arclength=base.arclength)


def finish(curve: Curve, guess: Array, row: Array, base: Point, options: Newton) -> Point | None:
    """Return the corrected point with its tangent, turned the way of ``base``, or None if Newton's method failed."""
    near = (base.factors, base.tangent) if base.factors is not None else None
    rough = approach(curve, guess, row, options, near=near)
    if not rough.converged:
        return None
    factors = Bordered.at(curve, rough.y, base.tangent / base.scale**2)
    if factors.singular:
        return None
    unit = np.zeros(guess.size)
    unit[-1] = 1.0
    tangent = factors.solve(unit)
    correction = settle(curve, rough, guess, row, options, factors, tangent)
    if not correction.converged:
        return None
    y, factorisations = correction.y, correction.factorisations + 1
    scale = curve.scale(y)
    if np.linalg.norm((y - rough.y) / scale) > MISSED * closeness(options):
        # farther off than it seemed, as beside a singular point: these factors do not give the tangent of the point
        factors = Bordered.at(curve, y, base.tangent / base.scale**2)
        if factors.singular:
            return None
        tangent, factorisations = factors.solve(unit), factorisations + 1
    length = float(np.linalg.norm(tangent / scale))
    sign, log_determinant = factors.determinant()
    # det [J; t^T/s^2] from det [J; border]: both rows see the null vector t of J, t.t/s^2 = 1 and border . t = 1 /
    # length
    return Point(
        y=y,
        tangent=tangent / length,
        scale=scale,
        orientation=sign,
        log_determinant=log_determinant + float(np.log(length)),
        residual=correction.residual,
        iterations=rough.iterations,
        factorisations=factorisations,
        across=factors.across,
        factors=factors,
    )
