"""A file is written whole or not at all, where its name points, however many write it at once and whoever is killed.

All that hbnlp writes goes through `written_whole`: into a part beside the file's place, then moved there in one step. A
part is locked as long as its writer lives; one without a lock is what a killed process left, and the next save to
the same name clears it away.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import sys
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from hbnlp.core.errors import SaveError

if sys.platform != "win32":
    import fcntl

_LONGEST = (
    200  # bytes of a file's name that its parts begin with: with what is added, names of 255 bytes can be written
)
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a file for writing that takes its place when the block is left, and leaves no trace if that is by an error.

    Links are followed, and a file that is replaced hands on its permissions.

    Raises
    ------
    SaveError
        (An `OSError`.) If it cannot be written, or what has this name is no file; an older file is as it was.
    """
    target = _target(path)
    _clear_parts(target)
    part: Path | None = None
    try:
        handle, part = _new_part(target)
        with handle:
            yield handle
            handle.flush()
            os.fsync(handle.fileno())
            if target.exists():
                part.chmod(stat.S_IMODE(target.stat().st_mode))
            if sys.platform == "win32":
                handle.close()  # what is open cannot be moved there
            part.replace(target)
    except SaveError:
        raise
    except OSError as error:
        msg = (
            f"could not write {os.fspath(path)!r}: {error.strerror or error}; nothing was changed there, "
            "save again to a folder that exists, is writable and has space"
        )
        raise SaveError(error.errno, msg) from error
    finally:
        if part is not None:
            with suppress(OSError):
                part.unlink(missing_ok=True)


@contextmanager
def written_by_name(path: str | os.PathLike[str], name: str) -> Iterator[Path]:
    """Give a place of this name to what opens files by name only; what it wrote there is copied whole to ``path``.

    Raises
    ------
    SaveError
        As `written_whole` does.
    """
    with written_whole(path) as handle, tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / name
        yield made
        with made.open("rb") as source:
            shutil.copyfileobj(source, handle)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text in UTF-8, whole or not at all; see `written_whole`."""
    with written_whole(path) as handle:
        handle.write(text.encode())


def kind_of_irregular(mode: int) -> str | None:
    """Return what the mode of a file says that it is, "a folder", or None if it is a file like any other."""
    return None if stat.S_ISREG(mode) else _KINDS.get(stat.S_IFMT(mode), "no regular file")


def _target(path: str | os.PathLike[str]) -> Path:
    """Return where a name points, or raise the SaveError that says why nothing can be written there."""
    target, number = Path(os.path.realpath(path)), errno.EINVAL
    try:
        kind = kind_of_irregular(target.stat().st_mode)
        reason = None if kind is None else f"that is {kind}"
        if kind is None and not os.access(target, os.W_OK):
            number, reason = errno.EACCES, "the file there is protected from writing"
    except FileNotFoundError:
        return target
    except OSError as error:
        number, reason = error.errno or number, error.strerror or str(error)
    if reason is not None:
        raise SaveError(number, f"could not write {os.fspath(path)!r}: {reason}; give the name of a file, new or old")
    return target


def _stem(target: Path) -> str:
    return os.fsdecode(os.fsencode(target.name)[:_LONGEST])


def _new_part(target: Path) -> tuple[BinaryIO, Path]:
    """Return a new part of a file, open and locked, and its path."""
    while True:
        part = target.with_name(f"{_stem(target)}.{uuid.uuid4().hex}.part")
        handle = part.open("xb")
        try:
            _lock(handle)
            if part.exists():
                return handle, part
        except BlockingIOError:
            pass
        handle.close()  # another process took it, before it had its lock, for one that was left


def _clear_parts(target: Path) -> None:
    """Remove the parts of a file that have no writer any more."""
    ours = re.compile(re.escape(_stem(target)) + r"\.[0-9a-f]{32}(\.npz)?\.part")
    with suppress(OSError), os.scandir(target.parent) as entries:
        for entry in entries:
            if ours.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                with suppress(OSError), Path(entry.path).open("r+b") as handle:
                    if _lock(handle):
                        Path(entry.path).unlink()


def _lock(handle: BinaryIO) -> bool:
    """Lock a file until it is closed; False where there are no locks.

    Raises
    ------
    BlockingIOError
        If another has it.
    """
    if sys.platform == "win32":
        return True  # a file that is open cannot be removed there
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # some network's file systems have none
        return False
    return True
