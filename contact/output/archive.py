"""Files of results: a NumPy archive of arrays with a JSON head, a format and a checksum.

`to_arrays` and `from_arrays` convert the stored fields; `head` checks kind and format;
`write_arrays` and `read_arrays` add and compare the checksum, which detects damage and changes.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import signal
import threading
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from contact.errors import InputError, NotConverged
from skfem_adini.ground.files import complete_file

_SPARSE = ("data", "indices", "indptr", "shape")


_DAMAGED = "it is cut short, or its bits have changed"


def _damaged(path: Path, what: object) -> InputError:
    error = InputError(f"result file {path} cannot be read: {what}")
    error.add_note(_DAMAGED)
    return error


def is_damaged(error: InputError) -> bool:
    """Whether an error means that a file is truncated or corrupted."""
    return _DAMAGED in getattr(error, "__notes__", ())


class Kinds(dict[str, Any]):
    """Classes of stored objects, by their names."""

    def __init__(self, *kinds: Any) -> None:
        super().__init__({kind.__name__: kind for kind in kinds})

    def name(self, value: Any) -> str:
        """The name of an object's class; `InputError` for other classes, even derived ones."""
        kind = type(value)
        if self.get(kind.__name__) is not kind:
            raise InputError(
                f"result: {kind.__module__}.{kind.__name__} cannot be saved; a file holds "
                f"{', '.join(self)}"
            )
        return kind.__name__

    def kind(self, what: str, name: Any) -> Any:
        """The class of this name in a file."""
        if name not in self:
            raise InputError(f"{what} {name!r} is none of {', '.join(self)}")
        return self[name]


def to_arrays(parts: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Arrays of fields by name: None is omitted, a sparse matrix becomes its four parts."""
    arrays: dict[str, Any] = {}
    for name, value in parts.items():
        if sparse.issparse(value):
            arrays |= {f"{prefix}{name}/{of}": np.asarray(getattr(value, of)) for of in _SPARSE}
        elif value is not None:
            arrays[prefix + name] = value
    return arrays


def from_arrays(
    arrays: Mapping[str, Any], names: Iterable[str], prefix: str = ""
) -> dict[str, Any]:
    """The inverse of `to_arrays`, without omitted fields."""
    found: dict[str, Any] = {}
    for name in names:
        own = prefix + name
        if f"{own}/indptr" in arrays:
            *parts, shape = (arrays[f"{own}/{of}"] for of in _SPARSE)
            found[name] = sparse.csr_array(tuple(parts), shape=tuple(shape.tolist()))
            found[name].check_format(full_check=True)  # matrix products do not check indices
        elif own in arrays:
            found[name] = arrays[own]
    return found


def words(value: Mapping[str, Any]) -> Any:
    """JSON as an array."""
    return np.array(json.dumps(value))


def head(
    arrays: Mapping[str, Any], kind: str | None, formats: tuple[int, ...], beside: str, reads: str
) -> dict[str, Any]:
    """The JSON head of a file; `InputError` for another kind or format, which it names.
    Results of bodies have no kind; `beside` and `reads` are parts of the error message."""
    about: dict[str, Any] = json.loads(str(arrays["about"])) if "about" in arrays else {}
    held = about.get("kind")
    if held != kind:
        raise InputError(
            f"it holds a {held}; {held}.load reads it"
            if held
            else f"it holds no {kind}; ContactResult.load reads those of bodies"
        )
    if about["format"] not in formats:
        raise InputError(
            f"it has format {about['format']}, {beside} a checksum; this version reads {reads}"
        )
    return about


def named_archive(path: str | Path) -> Path:
    """The name with suffix .npz; `InputError` for no name or another suffix."""
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
    """The arrays of an archive, and their checksum, which formats 1 and 2 lack.

    Raises an `InputError`, for truncated files one that `is_damaged` recognises.
    """
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


@contextmanager
def proving(consequence: str) -> Iterator[None]:
    """Re-raise a failed certificate as an `InputError` that begins with its consequence."""
    try:
        yield
    except NotConverged as error:
        raise InputError(f"{consequence}: {error}") from error


def unproved(path: str | Path) -> str:
    """Message for a file whose recomputed certificate fails."""
    return f"result file {path}: its solution does not solve the problem beside it"


def loosened(tol: float) -> float:
    """The tolerance on reading: another processor may round residuals above their limit."""
    return max(2 * tol, 1e-12)


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
