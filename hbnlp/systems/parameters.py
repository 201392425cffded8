"""Physical parameters: names with values, and the namespace through which a user's functions see them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import as_float, finite_numbers, instance_of, position, refused, two_values, unknown_name
from hbnlp.core.types import Array

OMEGA = "omega"
"""The parameter that every system has: the angular frequency of its excitation."""
LARGEST_OMEGA = 1e30
"""Of a larger one the motion is lost beside the round-off of its mean, and the square may be no number."""


class Namespace(Mapping[str, Any]):
    """Read-only names, as attributes or items: ``p.omega`` is ``p["omega"]``."""

    _kind: str
    _entries: dict[str, Any]

    def __init__(self, kind: str, entries: Mapping[str, Any]) -> None:
        object.__setattr__(self, "_kind", kind)
        object.__setattr__(self, "_entries", dict(entries))

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{self._kind} {name!r} cannot be set to {value!r} here; values are given with at={{...}}")

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self._entries[name]
        except KeyError:
            raise AttributeError(unknown_name(self._kind, name, self._entries)) from None

    def __getitem__(self, name: str) -> Any:
        try:
            return self._entries[name]
        except KeyError:
            raise KeyError(unknown_name(self._kind, name, self._entries)) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __repr__(self) -> str:
        return f"<{self._kind}s: {', '.join(self._entries)}>"


class ParameterSet:
    """Ordered parameter names with default values; a value of ``nan`` is "to be given".

    Parameters
    ----------
    defaults : mapping of names to values
    least : mapping of names to values, optional
        Below which some of them have no meaning.
    """

    def __init__(self, defaults: Mapping[str, float], *, least: Mapping[str, float] | None = None) -> None:
        instance_of("parameters", defaults, Mapping, "a mapping of names to values, such as {'force': 1.0}")
        entries = dict(defaults)
        entries.setdefault(OMEGA, np.nan)
        self.defaults: dict[str, float] = {}
        for name, value in entries.items():
            if not isinstance(name, str) or not name.isidentifier():
                raise refused(ValueError, "a name of parameters", name, "a Python identifier, such as 'force'")
            number = as_float(value)
            if number is None or np.isinf(number):
                raise refused(ValueError, f"parameter {name!r}", value, "a finite number")
            self.defaults[name] = number
        self.names: tuple[str, ...] = tuple(entries)
        self.least = dict(least or {})

    def index(self, name: str) -> int:
        """Return the position of ``name``, or raise a KeyError with the nearest known name."""
        return position("parameter", name, self.names)

    def values(self, at: Mapping[str, float] | None = None, *, but: Iterable[str] = ()) -> Array:
        """Return all values in order, the defaults overridden by ``at``.

        Parameters named in ``but`` may be without a value (they are about to be varied, or not needed) and are then
        ``nan``; unless omega is one of them, it must be positive, so that there is a period.

        Raises
        ------
        KeyError
            For a name that is not known.
        ValueError
            For a value that is missing or no finite number (text, truth values and complex values are none), or an
            omega that is not positive.
        TypeError
            If ``at`` is no mapping.
        """
        merged = dict(self.defaults)
        if at is not None:
            instance_of("at", at, Mapping, "a mapping of parameter names to values, such as {'omega': 1.0}")
            for name, value in at.items():
                self.index(name)
                number = as_float(value)
                if number is None or not np.isfinite(number):
                    raise refused(ValueError, f"parameter {name!r}", value, "a finite number")
                self._check_least(name, number, f"parameter {name!r}", value)
                merged[name] = number
        free = set(but)
        for name in free:
            self.index(name)
        missing = [name for name, value in merged.items() if np.isnan(value) and name not in free]
        if missing:
            raise ValueError(
                f"parameter {missing[0]!r} has no value; give one, for instance at={{{missing[0]!r}: 1.0}}"
            )
        if OMEGA not in free:
            check_period(merged[OMEGA])
        return np.array([merged[name] for name in self.names])

    def series(self, name: str, values: ArrayLike, *, what: str = "values") -> Array:
        """Return values of one parameter, to be taken one after another, as an array (k,); omega's are positive.

        Raises
        ------
        KeyError
            For a name that is not known.
        ValueError
            For anything but a sequence of finite numbers, or an omega that is not positive.
        """
        self.index(name)
        numbers = finite_numbers(what, values)
        self._check_least(name, float(numbers.min()), what, values)
        if name == OMEGA:
            for omega in (numbers.min(), numbers.max()):
                check_period(float(omega), f"{what} of omega reach")
        return numbers

    def span(self, name: str, span: Any, *, what: str = "span") -> tuple[float, float]:
        """Return two different values of one parameter, as they come; a span of omega lies above zero.

        Raises
        ------
        KeyError
            For a name that is not known.
        ValueError
            For anything but two different finite numbers, or an omega that is not positive.
        """
        self.index(name)
        begin, end = two_values(what, span, f"values of {name}")
        self._check_least(name, min(begin, end), what, span)
        if name == OMEGA and min(begin, end) <= 0.0:
            raise refused(
                ValueError,
                what,
                span,
                "two values above omega = 0, where the period is infinite: from 1e-3 on",
            )
        if name == OMEGA:
            check_period(max(begin, end), f"{what} reaches omega =")
        return begin, end

    def _check_least(self, name: str, lowest: float, what: str, given: Any) -> None:
        """Raise a ValueError that names what was given if the lowest value in it has no meaning."""
        if lowest < self.least.get(name, -np.inf):
            raise refused(ValueError, what, given, f"values of {name} of at least {self.least[name]:g}")

    def ordered(self, mapping: Mapping[str, float]) -> Array:
        """Return the values of a mapping that has every parameter, in order, whatever the order of the mapping.

        Raises
        ------
        KeyError
            For a name that is not known, or a parameter that is missing; it tells the nearest name.
        """
        for name in mapping:
            self.index(name)
        for name in self.names:
            if name not in mapping:
                raise KeyError(f"parameter {name!r} is missing (given: {', '.join(mapping) or 'none'})")
        return np.array([mapping[name] for name in self.names], dtype=float)

    def of_start(self, its: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters of a solution that serves as a start; a ValueError if they are another system's."""
        others = [name for name in its if name not in self.names]
        if others:
            raise ValueError(
                f"start is a solution of another system: its parameters {others} are unknown here (known: "
                f"{list(self.names)}); give its motion alone, start=solution.coefficients, and values with at="
            )
        return dict(its)

    def as_dict(self, values: Iterable[float]) -> dict[str, float]:
        """Return the values as a dictionary by name."""
        return {name: float(value) for name, value in zip(self.names, values, strict=True)}


def check_period(omega: float, said: str = "omega =") -> None:
    """Raise a ValueError, which begins as said, unless the excitation has a period at this omega."""
    if not omega > 0.0:
        raise ValueError(f"{said} {omega:g}; the period of the excitation is 2 pi / omega: give omega > 0")
    if omega > LARGEST_OMEGA:
        raise ValueError(f"{said} {omega:g}; give one up to {LARGEST_OMEGA:g}, in other units")
