"""What is known of the last points of a trace, by the points themselves: looks into a step ask for them again."""

from __future__ import annotations

from typing import Generic, TypeVar

from hbnlp.continuation.point import Point

T = TypeVar("T")

KEPT = 24
"""Points that are kept: those of a step and of the looks into it."""


class Recent(Generic[T]):
    """Values of the last points, the latest last."""

    def __init__(self) -> None:
        self._known: list[tuple[Point, T]] = []

    @property
    def latest(self) -> T | None:
        """The value that was kept last; None where there is none."""
        return self._known[-1][1] if self._known else None

    def of(self, point: Point) -> T | None:
        """Return the value of a point; None if it is not known."""
        return next((value for known, value in self._known if known is point), None)

    def keep(self, point: Point, value: T) -> T:
        """Take a value as that of a point, and return it."""
        self._known = [*self._known[-KEPT:], (point, value)]
        return value
