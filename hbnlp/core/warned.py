"""Where in the user's code a warning is said to come from."""

from __future__ import annotations

import sys

OWN = ("hbnlp", "contextlib")
"""The package, and what wraps its verbs."""


def users_level() -> int:
    """Return the ``stacklevel``, for a warning given by the caller, of the nearest line outside of the package."""
    frame, level = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] in OWN:
        frame, level = frame.f_back, level + 1
    return level
