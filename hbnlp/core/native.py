"""Compiled CasADi functions on numpy memory, without copies; memory that is written belongs to one thread."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import casadi as ca

from hbnlp.core.errors import in_users_words
from hbnlp.core.interrupts import check_interrupts
from hbnlp.core.types import Array

T = TypeVar("T")


def bound(function: ca.Function, arguments: Sequence[Array], results: Sequence[Array]) -> Callable[[], None]:
    """Return what evaluates a CasADi function from and to these arrays.

    Parameters
    ----------
    function : casadi.Function
    arguments, results : sequences of arrays
        One for each input and output, C-contiguous and of as many entries as that has nonzeros. CasADi's matrices are
        column-major: an array (n_columns, n_rows) is one.

    Raises
    ------
    ValueError
        If an array has another size or layout: the compiled code would read or write beyond it.
    """
    buffer, trigger = function.buffer()
    for kind, given, sizes, set_memory in (
        ("argument", arguments, [function.nnz_in(i) for i in range(function.n_in())], buffer.set_arg),
        ("result", results, [function.nnz_out(i) for i in range(function.n_out())], buffer.set_res),
    ):
        if len(given) != len(sizes):
            raise ValueError(f"{function.name()} has {len(sizes)} {kind}s; {len(given)} arrays were given")
        for i, (array, size) in enumerate(zip(given, sizes, strict=True)):
            if array.size != size or array.dtype != float or not array.flags.c_contiguous:
                raise ValueError(
                    f"{kind} {i} of {function.name()} is an array of shape {array.shape} and type {array.dtype}; "
                    f"{size} floats side by side are needed"
                )
            if size:
                set_memory(i, array.data)

    # CasADi keeps bare pointers: buffer, function and arrays must live as long as the trigger.
    def evaluate(_kept: tuple[Any, ...] = (buffer, function, [*arguments], [*results])) -> None:
        try:
            trigger()
        except RuntimeError as error:
            raise in_users_words(error)  # noqa: B904 - its cause is set
        check_interrupts()

    return evaluate


class PerThread(Generic[T]):
    """An object of each thread's own, built when the thread first asks: what is written to must not be shared."""

    def __init__(self, build: Callable[[], T]) -> None:
        self._build = build
        self._local = threading.local()

    def __call__(self) -> T:
        """Return the calling thread's object."""
        try:
            mine: T = self._local.mine
        except AttributeError:
            mine = self._local.mine = self._build()
        return mine
