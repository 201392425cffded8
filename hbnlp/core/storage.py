"""One-file storage of arrays with JSON metadata: a NumPy archive without pickle, whole or refused."""

from __future__ import annotations

import json
import math
import os
import textwrap
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from hbnlp.core.checks import file_name, refused
from hbnlp.core.errors import LoadError
from hbnlp.core.files import kind_of_irregular, written_whole

FORMAT = 1
"""Number of the format, in every file. Files of format 0 do not say one, nor the names of their arrays."""

FOREIGN = (".csv", ".txt", ".json", ".mat", ".h5")
"""Endings of other formats, which a NumPy archive is not to have."""

GONE = {
    "resolved branch": "of an earlier version: trace it anew with HarmonicBalance(system, tolerance=...), "
    "or read its arrays with numpy.load"
}
"""Kinds of files that no record is read from any more, and what to do with them."""

_METADATA = "metadata.json"
_MEMBER = ".npy"
# What is larger in memory than _ALWAYS bytes must not be more than _RATIO times its file: numbers that were computed
# compress by far less, and a small file is not to fill the memory.
_ALWAYS, _RATIO = 2**30, 100


def save_arrays(
    path: str | os.PathLike[str],
    kind: str,
    arrays: Mapping[str, NDArray[Any]],
    metadata: Mapping[str, Any],
) -> None:
    """Write arrays and JSON metadata to one ``.npz`` file, all of it or nothing; see `written_whole`.

    Parameters
    ----------
    path : path-like
        The file; its name is taken as given.
    kind : str
        What the file holds; `load_arrays` asks for the same word.
    arrays : mapping of str to ndarray
        Numeric, boolean or text arrays; arrays of objects are refused.
    metadata : mapping
        Anything that JSON can write, and numbers of NumPy; those that are not finite are NaN and Infinity, as Python
        writes them.

    Raises
    ------
    SaveError
        (An `OSError`.) If the file cannot be written; the message names the path, and the original error is the
        cause.
    TypeError
        If an array holds objects or the metadata are not JSON.
    """
    archive_name("path", path)
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise TypeError(f"array {name!r} holds Python objects; only numeric, boolean and text arrays are stored")
    about = as_text({"kind": kind, "format": FORMAT, "arrays": sorted(arrays), **metadata})
    payload: dict[str, Any] = {_METADATA: np.frombuffer(about.encode(), dtype=np.uint8), **arrays}
    with written_whole(path) as handle:
        np.savez_compressed(handle, **payload)


def archive_name(name: str, path: Any) -> None:
    """Raise an error that names ``path`` unless it can be the name of a NumPy archive."""
    file_name(name, path)
    if Path(path).suffix in FOREIGN:
        raise refused(ValueError, name, path, "a name that ends in .npz: this writes a NumPy archive")


def load_arrays(
    path: str | os.PathLike[str], kind: str, *, plain: bool = False
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read a file that `save_arrays` wrote.

    Parameters
    ----------
    path : path-like
        The file.
    kind : str
        What the file must hold.
    plain : bool
        Whether an ``.npz`` file of arrays alone, which says neither its kind nor anything else, will do: the caller
        then knows by the names of the arrays whether it is his.

    Returns
    -------
    arrays : dict of str to ndarray
    metadata : dict

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    LoadError
        (A `ValueError`.) If the file is damaged, is not from `save_arrays`, holds something else, is of a later format,
        or would be much larger in memory than a file of its size can be.
    """
    file_name("path", path)
    source = Path(path)
    with refused_as_unreadable(source, kind):
        refuse_irregular(source)
        with source.open("rb") as handle, zipfile.ZipFile(handle) as archive:
            arrays = _read(archive, source.stat().st_size)
        if plain and _METADATA not in arrays:
            return arrays, {}
        if _METADATA not in arrays:
            raise ValueError("it does not say what it holds")
        metadata = json.loads(arrays.pop(_METADATA).tobytes())
        found, version = metadata.pop("kind"), metadata.pop("format", 0)
        listed = metadata.pop("arrays", sorted(arrays))
    if found != kind:
        also = f", {GONE[str(found)]}" if str(found) in GONE else f", not a {kind}; load it as what it is"
        raise LoadError(f"{str(source)!r} holds a {found}{also}")
    if not isinstance(version, int) or not 0 <= version <= FORMAT:
        raise LoadError(
            f"{str(source)!r} is of format {version!r}, this version of hbnlp reads formats up to {FORMAT}; "
            "load it with the version that wrote it, or a later one"
        )
    if listed != sorted(arrays):
        raise LoadError(f"{str(source)!r} holds the arrays {sorted(arrays)}, but should hold {listed}; it is damaged")
    return arrays, metadata


def refuse_irregular(source: Path) -> None:
    """Raise a ValueError if a name is that of a folder, a device or a pipe, of which reading might never end."""
    irregular = kind_of_irregular(source.stat().st_mode)
    if irregular is not None:
        raise ValueError(f"that is {irregular}")


@contextmanager
def refused_as_unreadable(path: str | os.PathLike[str], kind: str) -> Iterator[None]:
    """Raise whatever goes wrong in the block, but that there is no file or no memory, as a LoadError that names it.

    Damaged bytes make Python's and NumPy's readers raise nearly anything: zlib, tokenizer, recursion errors.
    """
    try:
        yield
    except (LoadError, FileNotFoundError, MemoryError):
        raise
    except Exception as error:
        reason = str(error) or type(error).__name__
        if isinstance(error, KeyError):
            reason = f"{reason} is missing"
        raise LoadError(
            f"{os.fspath(path)!r} is not a readable {kind} file of hbnlp ({reason}); "
            "give a file that was saved as one and is whole"
        ) from error


def _read(archive: zipfile.ZipFile, size: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of an archive of so many bytes, once all their sizes are known to be what they say."""
    members = archive.infolist()
    names = [member.filename.removesuffix(_MEMBER) for member in members]
    if len({*names}) < len(names):
        raise ValueError("it holds an array twice")
    whole = sum(member.file_size for member in members)
    if whole > max(_ALWAYS, _RATIO * size):
        raise ValueError(f"a file of {size} bytes that says to hold {whole}, more than {_RATIO} times as many")
    for member in members:
        with archive.open(member) as stream:
            _check_size(stream, member)
    arrays = {}
    for name, member in zip(names, members, strict=True):
        with archive.open(member) as stream:
            arrays[name] = npy.read_array(stream, allow_pickle=False)
            stream.read()  # at its end the checksum is compared
    return arrays


def _check_size(stream: IO[bytes], member: zipfile.ZipInfo) -> None:
    """Raise a ValueError unless an array has as many bytes as its shape says: before there is memory for it."""
    version = npy.read_magic(stream)
    if version not in {(1, 0), (2, 0)}:
        raise ValueError(f"{member.filename} is an array of format {version}, which hbnlp does not write")
    read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read_header(stream)
    if dtype.hasobject:
        raise ValueError(f"{member.filename} holds Python objects")
    needed = math.prod(shape) * dtype.itemsize + stream.tell()
    if any(length < 0 for length in shape) or needed != member.file_size:
        raise ValueError(f"{member.filename} has {member.file_size} bytes, an array {shape} of {dtype} has {needed}")


def as_text(metadata: Mapping[str, Any]) -> str:
    """Return metadata as the JSON that is written, or raise the TypeError that names the entry that cannot be."""
    try:
        return json.dumps(metadata, default=_number)
    except (TypeError, ValueError, RecursionError) as error:  # the latter two of what holds itself
        for name, value in metadata.items():
            try:
                json.dumps(value, default=_number)
            except (TypeError, ValueError, RecursionError):
                raise TypeError(f"{name} is not what JSON can write: {error}; give numbers, texts and lists") from error
        raise


def _number(value: Any) -> Any:
    """Return a number of NumPy as one that JSON can write."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{textwrap.shorten(repr(value), 80)} is neither number, text, list nor mapping")
