"""Conditions that rows added to the balance express, each with the unknowns that it brings along."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from hbnlp.balance.assembly import Assembly
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.types import Array
from hbnlp.fourier import resize
from hbnlp.solutions.events import Event


class At(NamedTuple):
    """Where equations are evaluated: numbers of the balance, its unknowns and parameters, the condition's unknowns."""

    assembly: Assembly
    x: Array
    values: Array
    load: float
    added: Array
    problem: HarmonicBalance


class Condition(Protocol):
    """Rows below the balance: as many as the unknowns that it adds, and one for each further free scalar."""

    def n_added(self, size: int) -> int:
        """Return how many unknowns it adds to a balance of ``size`` equations."""
        ...

    def n_rows(self, size: int) -> int:
        """Return how many rows it adds."""
        ...

    def residual(self, at: At) -> Array:
        """Return the rows (n_rows,)."""
        ...

    def jacobian(
        self,
        at: At,
        balance: Array,
        by_x: Array,
        by_added: Array,
        by_scalars: Array,
        parameters: tuple[int | None, ...],
    ) -> None:
        """Write their derivatives by coefficients, added unknowns and free scalars into views of zeros (n_rows, ...).

        ``balance`` is R_x, and ``parameters`` are the indices of the free scalars (None: the factor on the excitation).
        """
        ...

    def resized(self, added: Array, shape: tuple[int, int], n_harmonics: int) -> Array:
        """Return the added unknowns of a balance of ``shape`` for one of another number of harmonics."""
        ...

    def term_size(self, at: At) -> float:
        """Return the size of the terms whose sums the rows are."""
        ...


class NullVector:
    """The condition of a fold, ``R_x v = 0, v.v = 1``, with the null vector v among the unknowns.

    Its rows are written in the units of the balance, ``length R_x v`` and ``force (v.v - 1) / 2``: only what has one
    unit can be eliminated and judged together.

    Parameters
    ----------
    length, force : float
        Sizes of the coefficients and of the balance's terms.

    References
    ----------
    Moore, Spence (1980), SIAM J. Numer. Anal. 17, 567-576, doi:10.1137/0717048.
    """

    def __init__(self, length: float, force: float) -> None:
        self._length, self._force = length, force

    def n_added(self, size: int) -> int:
        """Return the size of v."""
        return size

    def n_rows(self, size: int) -> int:
        """Return that of ``R_x v``, and one."""
        return size + 1

    def residual(self, at: At) -> Array:
        """Return ``(R_x v, (v.v - 1) / 2)`` in the units of the balance."""
        v = at.added
        along = self._length * (at.assembly.jacobian(at.x, at.values) @ v)
        return np.append(along, 0.5 * self._force * (v @ v - 1.0))

    def jacobian(
        self,
        at: At,
        balance: Array,
        by_x: Array,
        by_added: Array,
        by_scalars: Array,
        parameters: tuple[int | None, ...],
    ) -> None:
        """Write ``R_xx v`` by x, R_x and v by v, ``R_xp v`` by the parameters; the excitation has no part in R_x."""
        v = at.added
        by_x[:-1] = self._length * at.assembly.jacobian_along(at.x, at.values, v)
        by_added[:-1], by_added[-1] = self._length * balance, self._force * v
        for column, index in enumerate(parameters):
            if index is not None:
                slope = at.assembly.jacobian_along(at.x, at.values, None, index)
                by_scalars[:-1, column] = self._length * (slope @ v)

    def resized(self, added: Array, shape: tuple[int, int], n_harmonics: int) -> Array:
        """Return the null vector with harmonics added or cut."""
        return resize(added.reshape(shape), n_harmonics).ravel()

    def term_size(self, at: At) -> float:
        """Return the largest sum of the moduli in its rows."""
        along = np.abs(at.assembly.jacobian(at.x, at.values)) @ np.abs(at.added)
        return max(self._length * float(along.max()), self._force)


class AtEvent:
    """The condition that a function of the solution vanishes, an event of the user.

    Its one row is written in the units of the balance: a change of the solution by its own size changes it by about the
    size of the balance's terms.

    Parameters
    ----------
    event : Event
    slope : float
        Size of the derivative of its function, per change of the unknowns relative to their size.
    force : float
        Size of the balance's terms.
    """

    def __init__(self, event: Event, slope: float, force: float) -> None:
        self._event, self._factor, self._force = event, force / slope, force

    def n_added(self, size: int) -> int:  # noqa: ARG002 - as all conditions take it
        """Return 0."""
        return 0

    def n_rows(self, size: int) -> int:  # noqa: ARG002 - as all conditions take it
        """Return 1."""
        return 1

    def residual(self, at: At) -> Array:
        """Return the function (1,) in the units of the balance."""
        return np.array([self._factor * self._event.at(at.problem, at.x, at.values).value])

    def jacobian(
        self,
        at: At,
        balance: Array,  # noqa: ARG002 - as all conditions take it
        by_x: Array,
        by_added: Array,  # noqa: ARG002 - as all conditions take it
        by_scalars: Array,
        parameters: tuple[int | None, ...],
    ) -> None:
        """Write its derivatives by the coefficients and the parameters."""
        here = self._event.at(at.problem, at.x, at.values)
        by_x[0] = self._factor * here.by_x
        for column, index in enumerate(parameters):
            if index is not None:
                by_scalars[0, column] = self._factor * here.by_p[index]

    def resized(self, added: Array, shape: tuple[int, int], n_harmonics: int) -> Array:  # noqa: ARG002 - likewise
        """Return the unknowns that it adds, which are none."""
        return added

    def term_size(self, at: At) -> float:  # noqa: ARG002 - as all conditions take it
        """Return the size of the balance's terms."""
        return self._force
