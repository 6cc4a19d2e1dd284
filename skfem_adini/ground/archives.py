"""NumPy archives with a checksum, which detects damage and changes; complete or not at all."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import signal
import threading
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from skfem_adini.ground.errors import InputError
from skfem_adini.ground.files import complete_file

_DAMAGED = "it is cut short, or its bits have changed"


def _damaged(path: Path, what: object) -> InputError:
    error = InputError(f"result file {path} cannot be read: {what}")
    error.add_note(_DAMAGED)
    return error


def is_damaged(error: InputError) -> bool:
    """Whether an error means that a file is truncated or corrupted."""
    return _DAMAGED in getattr(error, "__notes__", ())


def words(value: Mapping[str, Any]) -> Any:
    """JSON as an array."""
    return np.array(json.dumps(value))


def checksum(arrays: Mapping[str, Any]) -> str:
    """SHA-256 of names, types, shapes and values: it detects damage and edits, not forgery."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        digest.update(f"{name!r} {array.dtype.str} {array.shape} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def write_arrays(
    path: Path, arrays: Mapping[str, Any], compress: bool = True, exclusive: bool = False
) -> Path:
    """Write an archive with its `checksum` atomically; `exclusive`: overwrite no existing file."""
    with complete_file(path, exclusive=exclusive) as file, uninterrupted():
        whole = {name: np.asarray(value) for name, value in arrays.items()}
        whole["checksum"] = np.array(checksum(whole))
        save: Any = np.savez_compressed if compress else np.savez
        save(file, **whole)
    return path


def read_arrays(path: Path) -> tuple[dict[str, Any], str | None]:
    """The arrays of an archive, and their checksum, which formats 1 and 2 lack; or an `InputError`,
    for truncated files one that `is_damaged` recognises."""
    if not path.is_file():
        raise InputError(f"result file {path} does not exist")
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            _check_sizes(path, archive)
            arrays = {i.filename.removesuffix(".npy"): _array(archive, i) for i in archive.filelist}
    except InputError:
        raise
    except Exception as error:  # zipfile and NumPy raise errors of any type
        if isinstance(error, OSError) and error.errno != errno.EINVAL:  # a seek out of range
            raise InputError(f"result file {path} cannot be read: {error}") from error
        raise _damaged(path, error) from error
    given = arrays.pop("checksum", None)
    found = checksum(arrays)
    if given is not None and str(given) != found:
        raise InputError(
            f"result file {path}: its arrays have another checksum than when they were written; "
            "it was changed since"
        )
    return arrays, None if given is None else found


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Re-raise errors due to inconsistent arrays as an `InputError`."""
    try:
        yield
    except InputError as error:
        raise InputError(f"result file {path}: {error}") from error
    except Exception as error:
        raise _damaged(path, repr(error)) from error


def _check_sizes(path: Path, archive: zipfile.ZipFile) -> None:
    """Refuse archives with suspicious sizes before unpacking."""
    names = [info.filename for info in archive.filelist]
    if len(set(names)) < len(names):
        raise _damaged(path, "two of its arrays have one name")
    if any(info.flag_bits & 1 for info in archive.filelist):
        raise InputError(f"result file {path} is encrypted; unpack it and write it without")
    written = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    if any(info.compress_type not in written for info in archive.filelist):
        raise InputError(f"result file {path} is packed in a way that NumPy does not write")
    total, size = sum(info.file_size for info in archive.filelist), path.stat().st_size
    # Meshes and solutions compress by less than a factor 50.
    if total > max(1 << 26, 200 * size):
        raise InputError(
            f"result file {path}: {size} bytes claim to unpack to {total}; no result does"
        )


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Any:
    with archive.open(info) as stream:
        version = np.lib.format.read_magic(stream)
        header = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, fortran, dtype = header(stream)
        # Before allocation: the header must match the archive's sizes checked above.
        count = math.prod(shape) * dtype.itemsize
        if dtype.kind not in "biufU" or count != info.file_size - stream.tell():
            raise ValueError(f"{info.filename} is {dtype} of shape {shape}")
        data = bytearray(stream.read())
    return np.ndarray(shape, dtype, buffer=data, order="F" if fortran else "C")


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay an interruption (KeyboardInterrupt) until the block is left.
    zipfile can neither close nor discard an archive whose entry was interrupted."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    came: list[Any] = []
    signal.signal(signal.SIGINT, lambda *event: came.append(event))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            before(*came[0])
