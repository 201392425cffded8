"""A folder of results, one file a point, of one study: ``study.json`` says of which, and no file is a pickle."""

from __future__ import annotations

import functools
import hashlib
import json
import logging
import os
import pickle
import re
import sys
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.rom import AeroROM
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.fold_curves import FoldBranch
from hbnlp.core.checks import refused
from hbnlp.core.errors import LoadError, SaveError
from hbnlp.core.files import write_text
from hbnlp.core.storage import as_text, refuse_irregular, refused_as_unreadable
from hbnlp.diagrams.diagram import Diagram
from hbnlp.integration.response import TimeResponse
from hbnlp.solutions.solution import Solution
from hbnlp.solutions.solution_set import SolutionSet
from hbnlp.studies.outcomes import Failure
from hbnlp.studies.points import Points
from hbnlp.studies.values import load_values, save_values
from hbnlp.sweeps.records import Sweep, TimeSweep

logger = logging.getLogger(__name__)

FORMAT = 1
_STUDY = "study.json"
_FILE = re.compile(r"(?P<number>\d{6,})\.(?P<kind>\w+)\.(npz|json)")
_VALUES, _ERROR = "values", "error"
_OF_PROBLEM = (Branch, Diagram, FoldBranch, Solution, SolutionSet, Sweep)
"""Records whose files are loaded with the problem that they are of."""
_RECORDS: dict[str, Any] = {
    record.__name__: record for record in (*_OF_PROBLEM, AeroROM, FrequencyResponse, TimeResponse, TimeSweep)
}


UNKNOWN = "known by its name alone"
"""What is said of a part of a task that can be another one under the same name."""


def described(task: Callable[..., Any]) -> dict[str, Any]:
    """Return a task as text, by which a folder knows it: its name, and what a `functools.partial` fixes.

    What is not a number or a text is known by a hash of all that it is, an object that is called, or whose method is,
    among it. What a function does inside is not looked at.
    """
    if isinstance(task, functools.partial):
        inner = described(task.func)
        arguments = [*enumerate(task.args), *sorted(task.keywords.items())]
        more = {str(name): _described(value) for name, value in arguments}
        return {"function": inner["function"], "arguments": {**inner["arguments"], **more}}
    its = getattr(task, "__self__", None if hasattr(task, "__qualname__") else task)
    named = task if hasattr(task, "__qualname__") else type(task)
    place, name = str(named.__module__), str(named.__qualname__)
    package = __name__.partition(".")[0]
    if getattr(sys.modules[package], name, None) is named:  # hbnlp.trace, wherever it is defined
        place = package
    return {"function": f"{place}.{name}", "arguments": {} if its is None else {"self": _described(its)}}


def check_known(task: Callable[..., Any], about: Mapping[str, Any]) -> None:
    """Raise a ValueError if a task, as `described`, can be another one under the same name: a folder would mix them."""
    unknown = [name for name, said in about["arguments"].items() if UNKNOWN in said]
    if about["function"].endswith("<lambda>") or unknown:
        what = f"its argument {unknown[0]!r}" if unknown else "a lambda"
        raise refused(
            ValueError,
            "task",
            task,
            f"with a folder one that can be told from others: {what} is {UNKNOWN}. Use functions that a module defines "
            "by def, and arguments that can be pickled",
        )


def _described(value: Any) -> str:
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    kind = type(value).__name__
    if isinstance(value, Mapping | list | tuple | set | frozenset):  # equal ones may be pickled differently
        items = (f"{name!r}: {_described(each)}" for name, each in value.items()) if isinstance(value, Mapping) else ()
        parts = [*items] if isinstance(value, Mapping) else [_described(each) for each in value]
        ordered = parts if isinstance(value, list | tuple) else sorted(parts)
        return f"{kind}({', '.join(ordered)})"
    try:
        return f"{kind} {hashlib.sha256(pickle.dumps(value)).hexdigest()[:16]}"
    except Exception:  # noqa: BLE001 - of whatever class it is; it stays in this process
        return f"{kind}, {UNKNOWN}"


class Folder:
    """The results of one study.

    Parameters
    ----------
    path : path-like
        Made with the first result.
    task : mapping
        See `described`.
    points : Points

    Raises
    ------
    ValueError
        If the folder belongs to another study; it is not touched.
    LoadError
        If it does not say, or no longer, to which one.
    """

    def __init__(self, path: str | os.PathLike[str], task: Mapping[str, Any], points: Points) -> None:
        self._path, self._is_there = Path(path), False
        over = points.grid if points.grid is not None else list(points.all)
        self._about = {"task": task, "over": over}
        if self._path.exists() and (not self._path.is_dir() or any(self._path.iterdir())):
            self._check(_read_study(self._path))
            self._is_there = True

    def found(self, problem: HarmonicBalance | None) -> dict[int, Any]:
        """Return the results and Failures that there are, by their numbers; what is damaged is not there."""
        return read_results(self._path, problem) if self._is_there else {}

    def keep(self, number: int, outcome: Any) -> None:
        """Write what came of a point, whole or not at all.

        Raises
        ------
        TypeError
            If it is no record and nothing that a file without pickle can hold.
        SaveError
            If it cannot be written.
        """
        self._make()
        start = self._path / f"{number:06d}"
        error = start.with_name(f"{start.name}.{_ERROR}.json")
        if isinstance(outcome, Failure):
            write_text(error, json.dumps(vars(outcome), indent=1))
            return
        kind = type(outcome).__name__
        if _RECORDS.get(kind) is type(outcome):
            outcome.save(start.with_name(f"{start.name}.{kind}.npz"))
        else:
            save_values(outcome, start.with_name(f"{start.name}.{_VALUES}.npz"))
        error.unlink(missing_ok=True)

    def _make(self) -> None:
        if self._is_there:
            return
        try:
            self._path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            msg = f"could not make the folder {str(self._path)!r} for a study: {error.strerror or error}"
            raise SaveError(error.errno, msg) from error
        about = {"kind": "study", "format": FORMAT, "hbnlp_version": version("hbnlp"), **self._about}
        write_text(self._path / _STUDY, as_text(about))
        self._is_there = True

    def _check(self, found: Mapping[str, Any]) -> None:
        ours = json.loads(as_text(self._about))
        differs = [name for name in ours if json.dumps(ours[name]) != json.dumps(found[name])]  # a grid in its order
        if not differs:
            return
        what = "other points"
        if "task" in differs:
            there, here = found["task"], ours["task"]
            arguments = {*there["arguments"].items()} ^ {*here["arguments"].items()}
            what = f"the task {there['function']}, not {here['function']}"
            if there["function"] == here["function"]:
                what = f"other arguments of {here['function']}: {', '.join(sorted({name for name, _ in arguments}))}"
        raise ValueError(
            f"the folder {str(self._path)!r} belongs to another study, with {what}; give another folder, or remove it"
        )


def read_study(path: str | os.PathLike[str]) -> tuple[dict[str, Any], Points]:
    """Return the task of a folder, see `described`, and its points.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    LoadError
        If it is no folder of a study, or does not say so any more.
    """
    found = _read_study(Path(path))
    with refused_as_unreadable(path, "study"):
        return found["task"], Points.of(found["over"])


def read_results(path: str | os.PathLike[str], problem: HarmonicBalance | None) -> dict[int, Any]:
    """Return the results and Failures in a folder by their numbers; a damaged file is logged, and counts as not there.

    Records are given their problem where it is that, and are without one otherwise.
    """
    found: dict[int, Any] = {}
    for file in sorted(Path(path).iterdir()):
        match = _FILE.fullmatch(file.name)
        if match is None:
            continue
        number = int(match["number"])
        try:
            outcome = _read(file, match["kind"], problem)
        except LoadError as error:
            logger.warning("a damaged file of a study counts as not there: %s", error)
            continue
        if not (isinstance(outcome, Failure) and number in found):
            found[number] = outcome
    return found


def _read(file: Path, kind: str, problem: HarmonicBalance | None) -> Any:
    if kind == _ERROR:
        with refused_as_unreadable(file, "error of a study"):
            return Failure(**json.loads(file.read_text(encoding="utf-8")))
    if kind == _VALUES:
        return load_values(file)
    if kind not in _RECORDS:
        raise LoadError(f"{str(file)!r} says to be a {kind}, which no result is")
    record = _RECORDS[kind].load(file)
    if problem is None or not isinstance(record, _OF_PROBLEM):
        return record
    try:
        return _RECORDS[kind].load(file, problem=problem)
    except ValueError:  # the task made its own from that problem
        return record


def _read_study(path: Path) -> dict[str, Any]:
    file = path / _STUDY
    path.stat()  # raises a FileNotFoundError, as loading a record does
    if not file.is_file():
        raise LoadError(
            f"{str(path)!r} is not the folder of a study: it has no {_STUDY}; give one that is new or empty"
        )
    with refused_as_unreadable(file, "study"):
        refuse_irregular(file)
        found = json.loads(file.read_text(encoding="utf-8"))
        if found["kind"] != "study" or found["format"] > FORMAT:
            raise LoadError(
                f"{str(file)!r} is of kind {found['kind']!r} and format {found['format']!r}; "
                f"this version of hbnlp reads studies up to format {FORMAT}"
            )
        if not {"task", "over"} <= found.keys():
            raise ValueError("it lacks its task or its points")
        return dict(found)
