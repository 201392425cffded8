"""Newton's method on a curve ``R(y) = 0`` with one more unknown than equations, closed by a plane.

Each corrector solves the bordered system::

    [ dR/dy ]        [ R(y)              ]
    [ row   ] d  = - [ row . (y - plane) ]

with LAPACK. The factors are kept for as long as the steps shrink well (Deuflhard 2004, section 2.1,
doi:10.1007/978-3-642-23899-4) and Broyden's updates make up for their age. The rate of such steps says little about the
error that they leave: it differs from one direction to another. They only approach a solution; factors made there then
take the error away and measure what remains. A point of a branch needs these anyway, for its tangent.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from hbnlp.continuation.curve import TINY, Bordered, Curve
from hbnlp.core.checks import real_number, whole_number
from hbnlp.core.types import Array

LARGEST_RESIDUAL = 1e-6
"""Steps may cease without a solution, far away or where the Jacobian is singular: the terms must balance to this."""
SLOW = 0.2
"""A larger ratio of successive steps calls for a new Jacobian."""
CLOSE = 1e-5
"""How close steps with old factors come, times the root of the tolerance: as close as the default tolerance itself.

A step with new factors squares the error, so that the point needs less; its tangent, which is made from the factors,
does not: beside a branch point one of a point that is 1e-8 away has a parameter component of the wrong sign.
"""
SINGULAR = "the Jacobian is singular or not finite"
SURELY = 1e-3
"""Below this part of the tolerance the first of these steps is not made either; otherwise it is there for nothing."""
NOISE = 1e-8
"""Steps that no longer shrink are round-off if they are this small: the point is as good as it can be."""
FEW = 3
"""Steps with the factors of a point itself that are allowed: one takes the error away, one measures what remains."""


@dataclass(frozen=True, kw_only=True)
class Newton:
    """Newton's method with a Jacobian that is kept while it serves.

    Parameters
    ----------
    tol : float
        Bound on the error that remains, relative to the size of the solution: measured by a step with the Jacobian at
        the solution itself. Beside singular points round-off may leave more, up to 1e-8.
    max_iterations : int
        Steps before it is given up, but for the last ones, with the Jacobian at the solution.
    """

    tol: float = 1e-10
    max_iterations: int = 20

    def __post_init__(self) -> None:
        real_number("tol", self.tol, above=0.0, below=1e-2)
        whole_number("max_iterations", self.max_iterations, least=1)


@dataclass(frozen=True, kw_only=True)
class Correction:
    """What Newton's method made of a guess."""

    y: Array
    converged: bool
    iterations: int
    factorisations: int
    error: float
    residual: float
    reason: str = ""


def closeness(options: Newton) -> float:
    """Return how close, relative to the size of the solution, `approach` means to come."""
    return float(max(CLOSE * options.tol**0.5, options.tol))


def correct(curve: Curve, guess: Array, row: Array, options: Newton) -> Correction:
    """Return the point of the curve on the plane ``row . (y - guess) = 0``.

    The result is not converged when the steps do not shrink, when something is not finite, or after the iterations
    allowed.

    Parameters
    ----------
    curve : Curve
    guess : array (size + 1,)
    row : array (size + 1,)
        Normal of the plane.
    options : Newton
    """
    found = approach(curve, guess, row, options)
    if not found.converged:
        return found
    factors = Bordered.at(curve, found.y, row)
    if factors.singular:
        return _failed(found.y, found.iterations, found.factorisations + 1, found.error, SINGULAR)
    found = dataclasses.replace(found, factorisations=found.factorisations + 1)
    return settle(curve, found, guess, row, options, factors)


# steps that grow without bound may overflow, or two in succession be equal: that is said as a reason
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def approach(
    curve: Curve,
    guess: Array,
    row: Array,
    options: Newton,
    *,
    near: tuple[Bordered, Array] | None = None,
) -> Correction:
    """Return where steps with factors that are kept lead, close enough for `settle` as far as the last two steps tell.

    Parameters
    ----------
    curve, guess, row, options
        As for `correct`.
    near : (Bordered, array), optional
        Factors at a neighbouring point of the curve, and the tangent there. They then serve throughout and are never
        made anew: between two legs of a curve the Jacobian is singular, and steps with that of one leg seldom converge
        to the other, which a new Jacobian on the way would let happen.
    """
    y = guess.copy()
    scale = curve.scale(y)
    inverse: _Inverse | None = _Inverse(near[0], row, scale, near[1]) if near is not None else None
    factorisations, last, error = 0, np.inf, np.inf
    roughly = closeness(options)
    right = np.zeros(y.size)
    for iteration in range(1, options.max_iterations + 1):
        right[:-1] = curve.residual(y)
        if not np.isfinite(right.sum()):
            return _failed(y, iteration, factorisations, error, "the residual is not finite")
        if inverse is None:
            factors = Bordered.at(curve, y, row)
            factorisations += 1
            if factors.singular:
                return _failed(y, iteration, factorisations, error, SINGULAR)
            inverse = _Inverse(factors, row, scale)
        step = inverse.step(right)
        y += step
        size = _length(step / scale)
        if size > 1.0:
            # a guess that was far off, or zero, says nothing about the size of the solution
            scale = curve.scale(y)
            size = _length(step / scale)
        rate = size / last
        if iteration > 1:
            error = size * rate / (1.0 - rate) if rate < 1.0 else np.inf
        if min(error, size) <= roughly:
            return Correction(
                y=y, converged=True, iterations=iteration, factorisations=factorisations, error=error, residual=np.inf
            )
        if not np.isfinite(size) or size > 1e8:
            return _failed(y, iteration, factorisations, error, "the steps of Newton's method grow without bound")
        if rate > SLOW and iteration > 1 and near is None:
            inverse = None
        last = size
    return _failed(
        y, options.max_iterations, factorisations, error, f"no convergence in {options.max_iterations} iterations"
    )


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def settle(
    curve: Curve,
    found: Correction,
    guess: Array,
    row: Array,
    options: Newton,
    at: Bordered,
    tangent: Array | None = None,
) -> Correction:
    """Return the point that `approach` came close to, its error measured by a step that is not made any more.

    Parameters
    ----------
    curve, guess, row, options
        As for `correct`.
    found : Correction
    at : Bordered
        Factors there, of [dR/dy; row].
    tangent : array (size + 1,), optional
        The tangent there, needed where the factors are those of another row.
    """
    y, scale = found.y.copy(), curve.scale(found.y)
    inverse, right, error = _Inverse(at, row, scale, tangent), np.zeros(y.size), np.inf
    for iteration in range(found.iterations + 1, found.iterations + FEW + 1):
        right[:-1] = curve.residual(y)
        step = inverse.step(right)
        before, error = error, _length(step / scale)
        moved = iteration > found.iterations + 1
        # beside a singular point round-off moves the solution by more than the tolerance: there steps cease to shrink
        is_noise = moved and 0.1 * before < error <= NOISE
        if error <= (options.tol if moved else SURELY * options.tol) or is_noise:
            terms = max(curve.term_size(y), curve.term_size(guess), TINY)
            settled = dataclasses.replace(found, y=y, iterations=iteration, error=error)
            return _balanced(settled, float(np.abs(right).max()) / terms)
        y += step
    return _failed(
        y, found.iterations, found.factorisations, error, f"no convergence to {options.tol:g}, {error:.1e} remain"
    )


def _balanced(found: Correction, residual: float) -> Correction:
    """Return what was found with its residual, which has to be small: steps may cease without a solution."""
    if residual <= LARGEST_RESIDUAL:
        return dataclasses.replace(found, residual=residual)
    reason = f"the steps cease where the residual is {residual:.1e} of its terms"
    return _failed(found.y, found.iterations, found.factorisations, found.error, reason)


class _Inverse:
    """Steps from factors that are not quite those of the present point, bettered by Broyden's updates.

    Every step lies in the plane: ``row . step = 0``. Factors with another last row serve as well, given the null
    vector t of their Jacobian: a multiple of t moves their solutions into the plane. The updates follow Kelley (1995),
    section 7.3, doi:10.1137/1.9781611970944: they need the past steps alone.
    """

    def __init__(self, factors: Bordered, row: Array, scale: Array, null: Array | None = None) -> None:
        self._factors = factors
        self._row = row
        self._weights = 1.0 / np.maximum(scale, 1e-150) ** 2
        self._null = null / float(row @ null) if null is not None else None
        self._steps: list[Array] = []
        self._squares: list[float] = []

    def step(self, residual: Array) -> Array:
        """Return the next step for the residual (its last entry, that of the plane, is zero)."""
        step = -self._factors.solve(residual)
        if self._null is not None:
            step -= self._null * float(self._row @ step)
        steps, squares = self._steps, self._squares
        for k in range(len(steps) - 1):
            step += steps[k + 1] * (float((self._weights * steps[k]) @ step) / squares[k])
        if steps:
            step /= 1.0 - float((self._weights * steps[-1]) @ step) / squares[-1]
        steps.append(step)
        squares.append(float((self._weights * step) @ step))
        return step


def _length(vector: Array) -> float:
    return float(np.sqrt(vector @ vector))


def _failed(y: Array, iterations: int, factorisations: int, error: float, reason: str) -> Correction:
    return Correction(
        y=y,
        converged=False,
        iterations=iterations,
        factorisations=factorisations,
        error=error,
        residual=np.inf,
        reason=reason,
    )
