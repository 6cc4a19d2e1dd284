"""Files that appear under their name once they are complete, or not at all, and file locks."""

from __future__ import annotations

import errno
import importlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex
from typing import IO, Any

try:
    _fcntl: Any = importlib.import_module("fcntl")
except ImportError:  # not a POSIX system
    _fcntl = None


@contextmanager
def complete_file(path: Path, *, exclusive: bool = False) -> Iterator[IO[bytes]]:
    """Open a temporary file beside `path` and move it to `path` once all is on the disk. After
    an error an existing file is unchanged; with `exclusive` one raises `FileExistsError`. A killed
    process leaves the temporary file, of random name, for `remove_unfinished`."""
    if path.exists() and not (path.is_file() or path.is_dir()):  # to be replaced by a file
        raise OSError(errno.EINVAL, "a device or pipe, no file", str(path))
    temporary, descriptor = _beside(path), None
    try:  # begins before the file exists: an interruption may come between
        while (descriptor := _locked(temporary)) is None:
            temporary = _beside(path)
        with os.fdopen(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(descriptor)  # a full disk may be reported only here
            if os.name == "posix":  # the lock holds until the file has its name
                _move(temporary, path, exclusive)
        if os.name != "posix":  # an open file cannot be replaced there
            _move(temporary, path, exclusive)
    except BaseException as error:
        if descriptor is not None or not isinstance(error, OSError):  # else it was not created
            temporary.unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def write_text(path: Path, text: str) -> None:
    """Write a text (UTF-8) that appears as a `complete_file`."""
    with complete_file(path) as file:
        file.write(text.encode())


def remove_unfinished(folder: Path) -> None:
    """Remove temporary files of a `complete_file` that killed processes left in a folder.
    Files that are still being written are locked, and stay; without file locks all stay."""
    for path in folder.iterdir():
        if not re.fullmatch("tmp[0-9a-f]{32}", path.name):
            continue
        flags = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        try:
            descriptor = os.open(path, flags)
        except OSError:  # renamed meanwhile, or another user's
            continue
        try:
            if try_lock(descriptor):
                path.unlink(missing_ok=True)
        finally:
            os.close(descriptor)


def _beside(path: Path) -> Path:
    return path.parent / f"tmp{token_hex(16)}"


def _locked(path: Path) -> int | None:
    """Create and lock a new file; return its descriptor, or None if it is gone again."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(path, flags, 0o666)
    # Before it was locked, `remove_unfinished` may have removed it as that of a killed process.
    if try_lock(descriptor) is not False and path.exists():
        return descriptor
    os.close(descriptor)
    return None


def _move(temporary: Path, path: Path, exclusive: bool) -> None:
    if exclusive:
        try:
            os.link(temporary, path)
        except FileExistsError:
            raise
        except OSError:  # a file system without hard links: claim the name, then fill it
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        else:
            temporary.unlink()
            return
    os.replace(temporary, path)


def _sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk, where the system lets a folder be opened."""
    if os.name != "posix":
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        unable = errno.EINVAL, errno.ENOTSUP, errno.EACCES, errno.EPERM, errno.EBADF
        if error.errno not in unable:
            raise


def try_lock(descriptor: int) -> bool | None:
    """Lock a file opened for writing for this descriptor alone, until it or its process ends: True
    if it is locked now; False if another descriptor, of any process or container, has the lock;
    None if the system or the file system has no such locks."""
    if _fcntl is None:
        return None
    try:
        _fcntl.flock(descriptor, _fcntl.LOCK_EX | _fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True
