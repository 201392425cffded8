"""What is drawn and where: results by the names of their types, which this room does not import, and axes."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import is_color_like

from hbnlp.core.checks import instance_of, refused, text


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
