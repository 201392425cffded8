"""The curves of periodic solutions: the balance with free scalars, and as many conditions as it takes.

All that is traced is ``R(a; p) = 0`` with some scalars free: solutions against a parameter, against the size of the
load, folds in two parameters. What is varied is the last unknown.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.assembly import Terms
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.continuation.curve import TINY, Parts
from hbnlp.core.types import Array
from hbnlp.fourier import resize
from hbnlp.solutions.conditions import At, AtEvent, Condition, NullVector
from hbnlp.solutions.events import Event
from hbnlp.solutions.sizes import sizes_at
from hbnlp.solutions.solution import Solution, make_solution
from hbnlp.solutions.unknowns import Free, Unknowns


class Equations:
    """A `Curve`: a harmonic balance with free scalars, and a condition for all of them but one.

    Parameters
    ----------
    problem : HarmonicBalance
    values : array
        All parameters in order; those that are free are ignored.
    free : tuple of Free
        The last one is continued in.
    floor : float
        Size of the coefficients below which their changes are not measured relative to them.
    condition : Condition, optional
        Needed where there are several free scalars.

    Attributes
    ----------
    size : int
        Number of equations, one less than that of the unknowns.
    unknowns : Unknowns
    terms : Terms
        Residual and slopes of the balance.
    parts : Parts or None
        None: the solutions have no symmetry that would leave parts.
    """

    def __init__(
        self,
        problem: HarmonicBalance,
        values: Array,
        free: tuple[Free, ...],
        *,
        floor: float = TINY,
        condition: Condition | None = None,
    ) -> None:
        self.problem, self.condition = problem, condition
        self.terms: Terms = problem.assembly
        self.parts: Parts | None = None
        n_added = condition.n_added(problem.size) if condition is not None else 0
        n_rows = condition.n_rows(problem.size) if condition is not None else 0
        self.unknowns = Unknowns(problem.size, n_added, free, floor)
        self.size = problem.size + n_rows
        if self.unknowns.size != self.size + 1:
            raise ValueError(f"{self.unknowns.size} unknowns and {self.size} equations; one unknown more is needed")
        index = problem.system.parameters.index
        self._indices = tuple(None if scalar.name is None else index(scalar.name) for scalar in free)
        self._values = values.copy()

    def on(self, problem: HarmonicBalance) -> Equations:
        """Return the same equations of another balance of the system: with more samples, or other harmonics."""
        unknowns, kind = self.unknowns, type(self)
        return kind(problem, self._values, unknowns.free, floor=unknowns.floor, condition=self.condition)

    def resampled(self, y: Array) -> Equations | None:
        """Return the same equations with twice the samples of the force where these do not suffice at a point."""
        suffice = self.problem.samples_suffice(self.unknowns.coefficients(y), self.values(y))
        return None if suffice else self.on(self.problem.oversampled())

    # -- the parts of a point ---------------------------------------------------------------------------------------

    @property
    def name(self) -> str:
        """The parameter that is continued in."""
        return self.unknowns.free[-1].name or "load"

    def values(self, y: Array) -> Array:
        """Return all parameters at a point."""
        values = self._values.copy()
        for index, value in zip(self._indices, self.unknowns.scalars(y), strict=True):
            if index is not None:
                values[index] = value
        return values

    def fixed_parameters(self) -> dict[str, float]:
        """Return all parameters by name; the values of those that are free mean nothing."""
        return self.problem.system.parameters.as_dict(self._values)

    def coefficients(self, y: Array) -> Array:
        """Return the coefficients (n_dof, 2H+1) at a point."""
        return self.unknowns.coefficients(y).reshape(self.problem.shape)

    def solution(self, y: Array, **statistics: float | str) -> Solution:
        """Return a point as a record, with what is to be said of how it was found."""
        return make_solution(self.problem, self.unknowns.coefficients(y), self.values(y), statistics=statistics)

    def point(self, coefficients: ArrayLike, last: float) -> Array:
        """Return the unknowns of a solution, coefficients of any number of harmonics, at a value of its free scalar."""
        assert self.condition is None
        return self.unknowns.joined(self.problem.vector(coefficients), [last])

    def carried_from(self, other: Equations, y: Array) -> Array:
        """Return a point or direction of other equations with these ones' harmonics: zeros added, or the rest cut."""
        x = resize(other.coefficients(y), self.problem.n_harmonics).ravel()
        added = other.unknowns.added(y)
        if self.condition is not None:
            added = self.condition.resized(added, other.problem.shape, self.problem.n_harmonics)
        return self.unknowns.joined(x, other.unknowns.scalars(y), added)

    # -- a Curve ----------------------------------------------------------------------------------------------------

    def residual(self, y: Array) -> Array:
        """Return R(y), (size,)."""
        at = self._at(y)
        balance = self.terms.residual(at.x, at.values, at.load)
        return balance if self.condition is None else np.concatenate([balance, self.condition.residual(at)])

    def jacobian(self, y: Array, out: Array) -> None:
        """Write dR/dy into an array (size, size + 1) of zeros."""
        at, n = self._at(y), self.problem.size
        at.assembly.jacobian(at.x, at.values, out[:n, :n])
        for column, index in enumerate(self._indices, start=y.size - len(self._indices)):
            out[:n, column] = by_scalar(self.terms, at, index)
        if self.condition is not None:
            by_x, by_added, by_scalars = np.split(out[n:], [n, n + self.unknowns.n_added], axis=1)
            self.condition.jacobian(at, out[:n, :n], by_x, by_added, by_scalars, self._indices)

    def scale(self, y: Array) -> Array:
        """Return the sizes (size + 1,) by which changes of y are measured."""
        return self.unknowns.scale(y)

    def term_size(self, y: Array) -> float:
        """Return the size of the terms whose sum is R."""
        at = self._at(y)
        size = self.terms.term_size(at.x, at.values)
        return size if self.condition is None else max(size, self.condition.term_size(at))

    def _at(self, y: Array) -> At:
        load = float(self.unknowns.scalars(y)[self._indices.index(None)]) if None in self._indices else 1.0
        x, added = self.unknowns.coefficients(y), self.unknowns.added(y)
        return At(self.problem.assembly, x, self.values(y), load, added, self.problem)


def by_scalar(terms: Terms, at: At, index: int | None) -> Array:
    """Return the derivative of a balance by a free scalar, a parameter or the factor on the excitation (None)."""
    if index is None:
        return terms.load_derivative(at.values)
    return terms.parameter_derivative(at.x, at.values, index, at.load)


def settled(curve: Equations, y: Array) -> Equations:
    """Return the same equations with as many samples of the force as suffice at a point."""
    return curve.on(curve.problem.with_enough_samples(curve.unknowns.coefficients(y), curve.values(y)))


def along_parameter(
    problem: HarmonicBalance,
    values: Array,
    name: str,
    *,
    span: tuple[float, float] | None = None,
    floor: float = TINY,
    kind: type[Equations] = Equations,
) -> Equations:
    """Return the solutions against a parameter; ``kind`` are their equations.

    Its changes are measured relative to itself, or to a hundredth of the span where it is smaller; without a span, to
    the value given.
    """
    here = float(values[problem.system.parameters.index(name)])
    least = 0.01 * abs(span[1] - span[0]) if span is not None else abs(here) or 1.0
    return kind(problem, values, (Free(name, least),), floor=floor)


def along_load(problem: HarmonicBalance, values: Array, *, floor: float = TINY) -> Equations:
    """Return the solutions at fixed parameters against a factor on the excitation: the way from rest to 1."""
    return Equations(problem, values, (Free(None, 0.1),), floor=floor)


def along_folds(
    problem: HarmonicBalance,
    x: Array,
    values: Array,
    first: str,
    second: str | None = None,
    *,
    spans: Sequence[tuple[float, float]] = (),
    kind: type[Equations] = Equations,
) -> Equations:
    """Return the folds in two parameters near (x, values), with their null vectors; ``kind`` are their equations.

    By default the second is the factor on the load. Changes of a parameter are measured relative to itself, or to a
    thousandth of the value given where it is smaller; of one whose value is zero, to a hundredth of its span.
    """
    free = _both_free(problem, values, [first] if second is None else [first, second], spans)
    if second is None:
        free.append(Free(None, 0.1))
    return kind(problem, values, tuple(free), condition=NullVector(*sizes_at(problem, x, values)))


def along_event(
    problem: HarmonicBalance,
    x: Array,
    values: Array,
    event: Event,
    names: tuple[str, str],
    *,
    spans: Sequence[tuple[float, float]],
) -> Equations:
    """Return the solutions in two parameters at which an event's function vanishes; measured as `along_folds` does."""
    length, force = sizes_at(problem, x, values)
    free = _both_free(problem, values, names, spans)
    here, index = event.at(problem, x, values), problem.system.parameters.index
    sizes = [max(abs(float(values[index(name)])), each.floor) for name, each in zip(names, free, strict=True)]
    by_scalars = [float(here.by_p[index(name)]) * size for name, size in zip(names, sizes, strict=True)]
    slope = float(np.linalg.norm([length * float(np.linalg.norm(here.by_x)), *by_scalars]))
    return Equations(problem, values, tuple(free), condition=AtEvent(event, slope or 1.0, force))


def _both_free(
    problem: HarmonicBalance, values: Array, names: Sequence[str], spans: Sequence[tuple[float, float]]
) -> list[Free]:
    index = problem.system.parameters.index
    widths = [0.01 * abs(high - low) for low, high in spans] or [1.0] * len(names)
    return [
        Free(name, 1e-3 * abs(float(values[index(name)])) or width) for name, width in zip(names, widths, strict=True)
    ]
