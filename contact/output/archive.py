"""Arrays in a NumPy archive with a checksum, which shows damage and changes."""

from __future__ import annotations

import errno
import hashlib
import math
import signal
import threading
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from contact.errors import InputError
from skfem_adini.output.complete_file import complete_file

# Meshes and solutions shrink by less than 50; an archive that grows further is no result.
_EXPANSION, _LARGE = 200, 1 << 26
_COMPRESSION = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_CHECKSUM = "checksum"
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


class DamagedFile(InputError):
    """The file is cut short, or its bits have changed: it cannot be read."""


def named_archive(path: str | Path) -> Path:
    """The name with its suffix .npz.

    Raises
    ------
    InputError
        No name, or another suffix.
    """
    try:
        path = Path(path)
    except TypeError:
        raise InputError(f"path={path!r}: expected the name of a file") from None
    suffix = path.suffix
    if suffix.lower() == ".npz":
        return path
    if suffix and not suffix[1:].isdecimal():  # "step.1" and "load_0.25" are names
        raise InputError(
            f"path: a result is an archive of NumPy, {path.with_suffix('.npz').name!r}; got "
            f"{path.name!r}. For ParaView: result.to_pyvista().save('name.vtu')"
        )
    return path.with_name(path.name + ".npz")


def checksum(arrays: Mapping[str, Any]) -> str:
    """SHA-256 of names, types, shapes and values.

    It detects damage and edits, not forgery: a newly written archive has a valid checksum.
    """
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        digest.update(f"{name!r} {array.dtype.str} {array.shape} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def write_arrays(
    path: Path, arrays: Mapping[str, Any], compress: bool = True, exclusive: bool = False
) -> Path:
    """Write an archive under another name and rename it, so that it is complete or absent.

    The archive contains its `checksum`.

    Parameters
    ----------
    path : Path
    arrays : mapping of str to array
    compress, exclusive : bool
        `exclusive`: leave an existing file and raise `FileExistsError`.
    """
    with complete_file(path, exclusive=exclusive) as file, uninterrupted():
        whole = {name: np.asarray(value) for name, value in arrays.items()}
        whole[_CHECKSUM] = np.array(checksum(whole))
        save: Any = np.savez_compressed if compress else np.savez
        save(file, **whole)
    return path


def read_arrays(path: Path) -> tuple[dict[str, Any], str | None]:
    """Read an archive and compare its arrays with its checksum.

    Returns
    -------
    arrays : dict of str to ndarray
    checksum : str or None
        None if the archive has none, as in formats 1 and 2.

    Raises
    ------
    DamagedFile
        The file is truncated or not an archive of arrays.
    InputError
        The file is missing, encrypted, implausibly large, or was changed after it was written.
    """
    if not path.is_file():
        raise InputError(f"result file {path} does not exist")
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            _check_sizes(path, archive)
            arrays = {i.filename.removesuffix(".npy"): _array(archive, i) for i in archive.filelist}
    except InputError:
        raise
    except Exception as error:  # zipfile and NumPy raise of every kind on what they cannot read
        if isinstance(error, OSError) and error.errno != errno.EINVAL:  # a seek to nowhere
            raise InputError(f"result file {path} cannot be read: {error}") from error
        raise DamagedFile(f"result file {path} cannot be read: {error}") from error
    given = arrays.pop(_CHECKSUM, None)
    found = checksum(arrays)
    if given is not None and str(given) != found:
        raise InputError(
            f"result file {path}: its arrays have another checksum than when they were written; "
            "it was changed since"
        )
    return arrays, None if given is None else found


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Re-raise errors from arrays that contradict each other as those of this package."""
    try:
        yield
    except InputError as error:
        raise InputError(f"result file {path}: {error}") from error
    except Exception as error:
        raise DamagedFile(f"result file {path} cannot be read: {error!r}") from error


def _check_sizes(path: Path, archive: zipfile.ZipFile) -> None:
    """Refuse archives that must not even be unpacked."""
    names = [info.filename for info in archive.filelist]
    if len(set(names)) < len(names):
        raise DamagedFile(f"result file {path} cannot be read: two of its arrays have one name")
    if any(info.flag_bits & 1 for info in archive.filelist):
        raise InputError(f"result file {path} is encrypted; unpack it and write it without")
    if any(info.compress_type not in _COMPRESSION for info in archive.filelist):
        raise InputError(f"result file {path} is packed in a way that NumPy does not write")
    total, size = sum(info.file_size for info in archive.filelist), path.stat().st_size
    if total > max(_LARGE, _EXPANSION * size):
        raise InputError(
            f"result file {path}: {size} bytes claim to unpack to {total}; no result does"
        )


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Any:
    with archive.open(info) as stream:
        version = np.lib.format.read_magic(stream)
        shape, fortran, dtype = _HEADERS[version](stream)
        # Before memory is asked for: the header must fit what the archive says, checked above.
        count = math.prod(shape) * dtype.itemsize
        if dtype.kind not in "biufU" or count != info.file_size - stream.tell():
            raise ValueError(f"{info.filename} is {dtype} of shape {shape}")
        data = bytearray(stream.read())
    return np.ndarray(shape, dtype, buffer=data, order="F" if fortran else "C")


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay an interruption (KeyboardInterrupt) until the block is left.

    zipfile can neither close nor discard an archive whose entry was interrupted, and its error
    would hide the interruption. Only the main thread is ever interrupted.
    """
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
