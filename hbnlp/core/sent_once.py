"""A function that is called many times by workers, and sent to each of them once.

A call is sent by the hash of the function alone. A worker that does not know it says so, and the call is sent to it
again with the function, which it keeps: whatever the executor is, and however many workers it has.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import pickle
import socket
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from hbnlp.core.errors import HbnlpError
from hbnlp.core.kept import Kept


@dataclass(frozen=True)
class Call:
    """One call, as it is sent.

    Attributes
    ----------
    token : bytes
        The hash of the function.
    function : bytes or None
        The function, pickled; None for a worker that knows it.
    argument : object
    ticket : str
        Which of all calls it is, today and ever. Dask takes calls that are equal for one, and may know the answer.
    """

    token: bytes
    function: bytes | None
    argument: Any
    ticket: str


@dataclass(frozen=True)
class Answer:
    """What comes back: the value, or that the function is not known there."""

    worker: tuple[str, int]
    value: Any = None
    unknown: bool = False


class UnreadableTaskError(HbnlpError):
    """A function cannot be unpickled by a worker: a module of its lacks there, or is another version."""


def packed(function: Callable[[Any], Any]) -> tuple[bytes, bytes]:
    """Return the hash of a function and the function itself, pickled; with cloudpickle if that is there.

    cloudpickle, which comes with Dask, sends what a script or a notebook defines, and lambdas, with all that they are.

    Raises
    ------
    TypeError
        If it cannot be pickled.
    """
    dumps: Any = pickle.dumps
    if importlib.util.find_spec("cloudpickle") is not None:
        dumps = importlib.import_module("cloudpickle").dumps
    try:
        content: bytes = dumps(function)
    except Exception as error:
        raise TypeError(
            f"{function!r} cannot be sent to other processes ({error}); give a function that a module defines by its "
            "name, with arguments that can be pickled (docs/sending.md), or a ThreadPoolExecutor"
        ) from error
    return hashlib.sha256(content).digest(), content


_ARRIVED: Kept[Callable[[Any], Any]] = Kept(8)


def answered(call: Call) -> Answer:
    """Return the answer to a call; this is what a worker is given to do."""
    worker = (socket.gethostname(), os.getpid())
    try:
        function = _ARRIVED.get(call.token, partial(_unpacked, call.function))
    except _UnknownError:
        return Answer(worker, unknown=True)
    return Answer(worker, function(call.argument))


class _UnknownError(Exception):
    """A function was not sent along and has not come before."""


def _unpacked(content: bytes | None) -> Callable[[Any], Any]:
    if content is None:
        raise _UnknownError
    try:
        function: Callable[[Any], Any] = pickle.loads(content)  # noqa: S301 (what our own process sent)
    except Exception as error:
        raise UnreadableTaskError(
            f"the task cannot be read by a worker on {socket.gethostname()} ({type(error).__name__}: {error}); "
            "install there what it imports, in the same versions, or put the function into a module that is there"
        ) from error
    return function
