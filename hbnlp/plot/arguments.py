"""What is drawn and where: results by the names of their types, which this room does not import, and axes' words."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import is_color_like

from hbnlp.core.checks import instance_of, refused, text
from hbnlp.core.quantities import quantities_of


def result(name: str, value: Any, *kinds: str) -> None:
    """Raise a TypeError that names ``value`` unless it is of one of the types of these names."""
    if not {each.__name__ for each in type(value).__mro__} & {*kinds}:
        raise refused(TypeError, name, value, f"a {' or a '.join(kinds)}")


def axes(ax: Axes | None, *, figsize: tuple[float, float] = (6.4, 4.2)) -> Axes:
    """Return the axes to draw on, those of a new figure where none are given."""
    instance_of("ax", ax, Axes | None, "matplotlib's Axes, or None for a new figure")
    return plt.subplots(figsize=figsize, layout="constrained")[1] if ax is None else ax


def check_label(label: Any) -> None:
    """Raise a TypeError that names what was given unless it is text or None."""
    if label is not None:
        text("label", label)


def check_color(color: Any, more: str = "") -> None:
    """Raise a ValueError that names what was given unless matplotlib draws in it; None is its own choice."""
    if color is not None and not is_color_like(color):
        raise refused(ValueError, "color", color, f"a colour of matplotlib, such as 'tab:red'{more}")


def axis(record: Any, name: str) -> str:
    """Return what stands beside an axis for a parameter or output: its label, and its unit."""
    known = quantities_of(record)
    unit = known.unit(name)
    return f"{known.label(name)} ({unit})" if unit else known.label(name)


def modulus(label: str) -> str:
    """Return a label between bars, within the dollars of matplotlib's mathematics if it is all mathematics."""
    is_mathematics = label.startswith("$") and label.endswith("$") and label.count("$") == 2
    return f"$|{label[1:-1]}|$" if is_mathematics else f"|{label}|"
