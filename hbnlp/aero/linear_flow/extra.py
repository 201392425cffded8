"""The optional library of this package."""

from __future__ import annotations

import importlib.util


def require_ngsolve() -> None:
    """Raise the ImportError that names the extra if NGSolve is not installed."""
    if importlib.util.find_spec("ngsolve") is None:
        raise ImportError("hbnlp.aero.linear_flow needs NGSolve, which is not installed: pip install 'hbnlp[flow]'")
