"""What a campaign has finished, in a folder: the case, the facts of the run, and a file for each frequency.

A part that is damaged counts as not there yet, and is computed again. Only what says to what case the folder belongs
cannot be.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from hbnlp.core.checks import finite_array
from hbnlp.core.errors import LoadError, SaveError
from hbnlp.core.files import write_text
from hbnlp.core.layout import Column, Layout, mapping, number
from hbnlp.core.records import loaded, save_columns
from hbnlp.core.storage import refuse_irregular, refused_as_unreadable
from hbnlp.core.types import ComplexArray

logger = logging.getLogger(__name__)
T = TypeVar("T")

_PART = Layout(
    kind="finished frequency of a campaign", columns={"transfer": Column("N+1 N+2", complex)}, entries={"omega": number}
)


class Parts:
    """The finished parts of a campaign of one case.

    Parameters
    ----------
    folder : Path
        Made when the first part is kept.
    case : mapping
        The settings, of what JSON can write.
    n_modes : int
        Number N of sine modes.

    Raises
    ------
    ValueError
        If the folder belongs to another case.
    LoadError
        (A `ValueError`.) If it does not say, or no longer, to which one.
    """

    def __init__(self, folder: Path, case: Mapping[str, Any], *, n_modes: int) -> None:
        self._folder, self._case, self._n_modes = folder, json.dumps(case), n_modes
        file = folder / "case.json"
        try:
            found = _read_json(file)
        except (FileNotFoundError, LoadError) as error:
            if isinstance(error, FileNotFoundError) and not any(folder.glob("omega_*")):
                return
            raise LoadError(
                f"{str(file)!r} is damaged or missing, and says no more to what case the files beside it belong; put "
                "it back, write to another file, or remove the folder to compute all anew"
            ) from error
        if found != json.loads(self._case):
            raise ValueError(
                f"{str(folder)!r} belongs to another case, {json.dumps(found)}; "
                "resume that one, write to another file, or remove the folder"
            )

    def facts(self) -> dict[str, Any] | None:
        """Return the facts of the run, ``base_load`` among them; None if they are not there."""
        return _unless_damaged(self._read_facts, self._folder / "facts.json")

    def transfer(self, omega: float) -> ComplexArray | None:
        """Return the matrix at a frequency, (N+1, N+2); None if it is not there."""
        return _unless_damaged(lambda file: self._read_transfer(file, omega), self._file(omega))

    def keep_facts(self, facts: Mapping[str, Any]) -> None:
        """Write the facts of the run, and before them to what case they belong."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            msg = f"could not make the folder {str(self._folder)!r} for what is finished: {error.strerror or error}"
            raise SaveError(error.errno, msg) from error
        write_text(self._folder / "case.json", self._case)
        write_text(self._folder / "facts.json", json.dumps(facts))

    def keep(self, omega: float, transfer: ComplexArray) -> None:
        """Write the matrix at a frequency."""
        save_columns(self._file(omega), _PART, {"transfer": transfer}, {"omega": omega})

    def _file(self, omega: float) -> Path:
        return self._folder / f"omega_{omega:.9e}.npz"

    def _read_transfer(self, file: Path, omega: float) -> ComplexArray:
        with loaded(file, _PART) as part:
            transfer: ComplexArray = part["transfer"]
            shape = (self._n_modes + 1, self._n_modes + 2)
            same = math.isclose(part["omega"], omega, rel_tol=1e-9)  # as many digits as the file's name has
            if not same or transfer.shape != shape:
                raise ValueError(f"it holds omega = {part['omega']} and {transfer.shape}, not {omega} and {shape}")
            return transfer

    def _read_facts(self, file: Path) -> dict[str, Any]:
        facts = _read_json(file)
        with refused_as_unreadable(file, "campaign's JSON"):
            finite_array("base_load", facts["base_load"], (self._n_modes + 1,))
            return facts


def _unless_damaged(read: Callable[[Path], T], file: Path) -> T | None:
    """Return what is read from a file; None if it is missing, or damaged, which is logged."""
    try:
        return read(file)
    except FileNotFoundError:
        return None
    except LoadError as error:
        logger.warning("what is in a damaged file of the campaign is computed again: %s", error)
        return None


def _read_json(file: Path) -> dict[str, Any]:
    with refused_as_unreadable(file, "campaign's JSON"):
        refuse_irregular(file)
        return mapping(json.loads(file.read_text(encoding="utf-8")))
