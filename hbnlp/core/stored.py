"""Results of long runs, and tables, that examples read: beside the package in a checkout, within an installed one."""

from __future__ import annotations

from pathlib import Path

from hbnlp.core.checks import file_name, refused

_PACKAGE = Path(__file__).parents[1]
_BESIDE = ("benchmarks/validation/results", "examples/wing/data")
_PLACES = (_PACKAGE / "results", *(_PACKAGE.parent / folder for folder in _BESIDE))


def stored_result(name: str) -> Path:
    """Return the path of a stored result or table by its name, "march_up_50.json".

    Raises
    ------
    FileNotFoundError
        If there is none: the message says where it was looked for.
    """
    file_name("name", name)
    for place in _PLACES:
        if (place / name).is_file():
            return place / name
    raise refused(FileNotFoundError, "name", name, f"a file that is in {' or '.join(map(str, _PLACES))}")
