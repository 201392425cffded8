"""One-file storage of arrays with JSON metadata: a NumPy archive without pickle, written atomically."""

from __future__ import annotations

import json
import os
import tokenize
import uuid
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbnlp.core.checks import file_name, refused
from hbnlp.core.errors import SaveError

_METADATA = "metadata.json"
FOREIGN = (".csv", ".txt", ".json", ".mat", ".h5")
"""Endings of other formats, which a NumPy archive is not to have."""
# what Python and NumPy raise in reading a file that is cut off, has a byte changed or is something else
_DAMAGES = (
    zipfile.BadZipFile, zlib.error, tokenize.TokenError, NotImplementedError, OSError, EOFError, ValueError, KeyError,
    AttributeError, TypeError,
)  # fmt: skip


def save_arrays(
    path: str | os.PathLike[str],
    kind: str,
    arrays: Mapping[str, NDArray[Any]],
    metadata: Mapping[str, Any],
) -> None:
    """Write arrays and JSON metadata to one ``.npz`` file, all of it or nothing.

    The file is written beside its final place and then moved there, so that a full disk or an
    interrupt leaves an older file of that name as it was.

    Parameters
    ----------
    path : path-like
        The file; its name is taken as given.
    kind : str
        What the file holds; `load_arrays` asks for the same word.
    arrays : mapping of str to ndarray
        Numeric, boolean or text arrays; arrays of objects are refused.
    metadata : mapping
        Anything that JSON can write; NaN and infinity are refused.

    Raises
    ------
    SaveError
        (An `OSError`.) If the file cannot be written; the message names the path, and the original error is the
        cause.
    TypeError, ValueError
        If an array holds objects or the metadata are not JSON.
    """
    file_name("path", path)
    target = Path(path)
    if target.suffix in FOREIGN:
        raise refused(ValueError, "path", path, "a name that ends in .npz: this writes a NumPy archive")
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise TypeError(f"array {name!r} holds Python objects; only numeric, boolean and text arrays are stored")
    text = json.dumps({"kind": kind, **metadata}, allow_nan=False)
    payload: dict[str, Any] = {_METADATA: np.frombuffer(text.encode(), dtype=np.uint8), **arrays}
    part = target.with_name(f"{target.name}.{uuid.uuid4().hex}.npz.part")
    try:
        with part.open("xb") as handle:
            np.savez_compressed(handle, **payload)
            handle.flush()
            os.fsync(handle.fileno())
        part.replace(target)
    except OSError as error:
        msg = (
            f"could not write {str(target)!r}: {error.strerror or error}; nothing was changed there, "
            "save again to a folder that exists, is writable and has space"
        )
        raise SaveError(error.errno, msg) from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


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
    ValueError
        If the file is damaged, is not from `save_arrays` or holds something else.
    """
    file_name("path", path)
    source = Path(path)
    with source.open("rb") as handle:
        try:
            with np.load(handle, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
            if plain and _METADATA not in arrays:
                return arrays, {}
            metadata = json.loads(arrays.pop(_METADATA).tobytes())
            found = metadata.pop("kind")
        except _DAMAGES as error:
            raise ValueError(
                f"{str(source)!r} is not a readable {kind} file of hbnlp ({error}); give a file that was saved as one"
            ) from error
    if found != kind:
        raise ValueError(f"{str(source)!r} holds a {found}, not a {kind}; load it as what it is")
    return arrays, metadata
