"""What parameters and outputs are called where they are drawn and told, and in which unit they are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from hbnlp.core.checks import instance_of, position, text

OF_NO_UNIT = "1"
"""The unit of a pure number, in tables; none is written on an axis."""


@dataclass(frozen=True)
class Quantities:
    """Labels and units by the names of parameters and outputs, as far as a system has them.

    Parameters
    ----------
    labels : mapping of names to texts
        In the place of a name on an axis; between two ``$`` as matplotlib writes mathematics.
    units : mapping of names to texts
        "1" for a pure number.
    """

    labels: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    def label(self, name: str) -> str:
        """Return what a parameter or output is called on an axis, without its unit."""
        return self.labels.get(name, r"$\omega$" if name == "omega" else name)

    def unit(self, name: str) -> str:
        """Return the unit that is written on an axis, empty for none."""
        unit = self.units.get(name, "")
        return "" if unit == OF_NO_UNIT else unit

    def attributes(self, name: str) -> dict[str, str]:
        """Return label and unit as attributes of netCDF, those that are known."""
        found = {"long_name": self.labels.get(name), "units": self.units.get(name)}
        return {key: value for key, value in found.items() if value is not None}


def quantities(labels: Mapping[str, str] | None, units: Mapping[str, str] | None, names: Iterable[str]) -> Quantities:
    """Return the labels and units that a user gives for some of these names.

    Raises
    ------
    TypeError
        If one of them is no mapping of names to texts.
    KeyError
        For a name that is no parameter or output.
    """
    known = tuple(dict.fromkeys(names))
    for what, given, example in (("labels", labels, "{'x': 'deflection'}"), ("units", units, "{'omega': 'rad/s'}")):
        instance_of(what, given, Mapping | None, f"a mapping of parameters and outputs to texts, such as {example}")
        for name, word in (given or {}).items():
            position("parameter or output", name, known)
            text(f"{what}[{name!r}]", word)
    return Quantities(dict(labels or {}), dict(units or {}))


def quantities_of(record: Any) -> Quantities:
    """Return the labels and units that the system of a record has; one from a file, without its problem, has none."""
    system = getattr(getattr(record, "problem", record), "system", None)
    return getattr(system, "quantities", Quantities())
