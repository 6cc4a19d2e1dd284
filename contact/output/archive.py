"""Files of results: a NumPy archive of arrays with a JSON head and a format.

`to_arrays` and `from_arrays` convert the stored fields; `head` checks kind and format;
`skfem_adini.ground.archives` writes and reads them.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from contact.errors import InputError, NotConverged

_SPARSE = ("data", "indices", "indptr", "shape")


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
