"""Results on disk: one compressed NumPy archive that holds the whole discrete problem."""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
import zlib
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import skfem
from scipy import sparse

from contact.body import ElasticBody
from contact.errors import InputError
from contact.newton import Iteration
from contact.rows import ContactRows
from contact.system import ContactSystem
from skfem_adini import ElementQuadAdini

if TYPE_CHECKING:
    from contact.result import ContactResult

_FORMAT = 1
_SPARSE = ("G", "T")


def write(result: ContactResult, path: Path) -> Path:
    """Write a result; the file appears under its name only once it is complete.

    Raises
    ------
    InputError
        The element is not one that `read` could build again.
    """
    system, body = result.system, result.system.body
    _element(type(body.element).__name__)
    arrays: dict[str, Any] = {
        "p": body.mesh.doflocs,
        "t": body.mesh.t,
        "E": body.E,
        "nu": body.nu,
        "load": system.load,
        "friction": system.friction,
        "u": result.u,
        "mu": result.mu,
        "multiplier_t": result.t,
    }
    for name, facets in (body.mesh.boundaries or {}).items():
        arrays[f"boundary/{name}"] = np.asarray(facets)
    T, u0 = body.constraint
    _pack(arrays, "constraint", T)
    arrays["u0"] = u0
    for field in fields(ContactRows):
        value = getattr(system.rows, field.name)
        if field.name in _SPARSE:
            _pack(arrays, f"rows/{field.name}", value)
        elif field.name != "functional":
            arrays[f"rows/{field.name}"] = value
    about = {
        "format": _FORMAT,
        "mesh": type(body.mesh).__name__,
        "element": type(body.element).__name__,
        "plane": body.plane,
        "law": system.law,
        "method": result.method,
        "functional": system.rows.functional,
        "history": [asdict(line) for line in result.history],
    }
    arrays["about"] = np.array(json.dumps(about))
    path = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
    handle, temporary = tempfile.mkstemp(suffix=".npz", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez_compressed(file, **arrays)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path


def read(path: Path) -> ContactResult:
    """Read a result written by `write`.

    Raises
    ------
    InputError
        The file is missing, truncated, or not one of ours.
    """
    if not path.is_file():
        raise InputError(f"result file {path} does not exist")
    try:
        # NumPy leaves a file open that it opened itself and could not read.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        about = json.loads(str(arrays["about"]))
        if about["format"] == _FORMAT:
            return _rebuild(arrays, about)
    except (
        *(zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError),
        *(ValueError, KeyError, TypeError, AttributeError, IndexError),
    ) as error:
        raise InputError(f"result file {path} cannot be read: {error}") from error
    raise InputError(f"result file {path} has format {about['format']}, not {_FORMAT}")


def _rebuild(arrays: dict[str, Any], about: dict[str, Any]) -> ContactResult:
    """The result from the arrays of its file."""
    from contact.result import ContactResult

    boundaries = {
        name.removeprefix("boundary/"): value
        for name, value in arrays.items()
        if name.startswith("boundary/")
    }
    mesh = getattr(skfem, about["mesh"])(arrays["p"], arrays["t"], sort_t=False)
    if boundaries:
        mesh = mesh.with_boundaries(boundaries)
    body = ElasticBody.from_mesh(
        mesh, _element(about["element"]), E=arrays["E"], nu=arrays["nu"], plane=about["plane"]
    )
    body.f = arrays["load"]
    body.constraint = _unpack(arrays, "constraint"), arrays["u0"]
    parts: dict[str, Any] = {
        field.name: _unpack(arrays, f"rows/{field.name}")
        if field.name in _SPARSE
        else arrays[f"rows/{field.name}"]
        for field in fields(ContactRows)
        if field.name != "functional"
    }
    rows = ContactRows(**parts, functional=about["functional"])
    system = ContactSystem(body, rows, arrays["load"], about["law"], arrays["friction"])
    history = tuple(Iteration(**line) for line in about["history"])
    return ContactResult(
        system, arrays["u"], arrays["mu"], arrays["multiplier_t"], about["method"], history
    )


def _element(name: str) -> Any:
    known = {"ElementQuadAdini": ElementQuadAdini}
    element = known.get(name) or getattr(skfem, name, None)
    if element is None:
        raise InputError(f"element {name} is neither ours nor scikit-fem's: it cannot be saved")
    return element()


def _pack(arrays: dict[str, Any], name: str, matrix: sparse.csr_array) -> None:
    arrays |= {
        f"{name}/data": matrix.data,
        f"{name}/indices": matrix.indices,
        f"{name}/indptr": matrix.indptr,
        f"{name}/shape": np.array(matrix.shape),
    }


def _unpack(arrays: dict[str, Any], name: str) -> sparse.csr_array:
    parts = tuple(arrays[f"{name}/{part}"] for part in ("data", "indices", "indptr"))
    return sparse.csr_array(parts, shape=tuple(arrays[f"{name}/shape"]))
