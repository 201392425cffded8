"""Packages that only some work needs: imported where they are used, by an error that says what to install."""

from __future__ import annotations

import importlib
from typing import Any


def from_extra(package: str, extra: str, what: str) -> Any:
    """Return a package of one of the extras of hbnlp, imported.

    Parameters
    ----------
    package, extra : str
    what : str
        What it is needed for: the subject of the message.

    Raises
    ------
    ImportError
        If it is not installed.
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ImportError(
            f"{what} needs the package {package!r}, which is not installed: pip install 'hbnlp[{extra}]'"
        ) from error
