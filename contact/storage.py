"""Results on disk: one compressed NumPy archive that holds the whole discrete problem."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import skfem
from scipy import sparse

from contact.body import ElasticBody
from contact.cut_body import CutBody
from contact.errors import InputError
from contact.newton import Iteration
from contact.rigid import ObstacleMotion
from contact.rows import ContactRows
from contact.system import ContactSystem
from contact.uninterrupted import uninterrupted
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from skfem_adini.complete_file import complete_file

if TYPE_CHECKING:
    from contact.result import ContactResult

_FORMAT = 2
_SPARSE = ("G", "T")


def write(result: ContactResult, path: Path) -> Path:
    """Write a result; the file appears under its name only once it is complete.

    Raises
    ------
    InputError
        The element is not one that `read` could build again, or the body is a `CutBody`.
    """
    path = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
    return write_arrays(path, problem_arrays(result.system) | state_arrays(result))


def problem_arrays(system: ContactSystem) -> dict[str, Any]:
    """What all steps of a load history share: body, supports, contact rows."""
    body = system.body
    if isinstance(body, CutBody):
        raise InputError(
            "result: a CutBody holds a level set, a function, and cannot be saved; save u, mu and "
            "t with numpy.savez, build the problem again from its script, and make "
            "ContactResult(problem.system_of(body), u, mu, t, method, ()); its kkt is computed anew"
        )
    _element(type(body.element).__name__)
    arrays: dict[str, Any] = {
        "p": body.mesh.doflocs,
        "t": body.mesh.t,
        "E": body.E,
        "nu": body.nu,
    }
    for name, facets in (body.mesh.boundaries or {}).items():
        arrays[f"boundary/{name}"] = np.asarray(facets)
    _pack(arrays, "constraint", body.constraint[0])
    for field in fields(ContactRows):
        value = getattr(system.rows, field.name)
        if field.name in _SPARSE:
            _pack(arrays, f"rows/{field.name}", value)
        elif field.name not in ("functional", "gap"):
            arrays[f"rows/{field.name}"] = value
    about = {
        "format": _FORMAT,
        "mesh": type(body.mesh).__name__,
        "element": type(body.element).__name__,
        "plane": body.plane,
        "dilatation": body.dilatation,
        "functional": system.rows.functional,
    }
    return arrays | {"about": np.array(json.dumps(about))}


def state_arrays(result: ContactResult) -> dict[str, Any]:
    """Loads, prescribed displacements, gap and solution of one step."""
    system = result.system
    arrays: dict[str, Any] = {
        "load": system.load,
        "u0": system.body.constraint[1],
        "rows/gap": system.rows.gap,
        "friction": system.friction,
        "u": result.u,
        "mu": result.mu,
        "multiplier_t": result.t,
    }
    if system.slip_from is not None:
        arrays["slip_from"] = system.slip_from
    if system.motion is not None and result.motion is not None:
        for field in fields(ObstacleMotion):
            arrays[f"motion/{field.name}"] = getattr(system.motion, field.name)
        arrays["motion"] = result.motion
    step = {
        "law": system.law,
        "method": result.method,
        "history": [asdict(line) for line in result.history],
    }
    return arrays | {"step": np.array(json.dumps(step))}


def write_arrays(path: Path, arrays: dict[str, Any], compress: bool = True) -> Path:
    """Write an archive beside its place and move it there, complete or not at all."""
    with complete_file(path) as file, uninterrupted():
        (np.savez_compressed if compress else np.savez)(file, **arrays)
    return path


def read(path: Path) -> ContactResult:
    """Read a result written by `write`.

    Raises
    ------
    InputError
        The file is missing, truncated, or not one of ours.
    """
    return read_step(path, {})


def read_step(
    path: Path, shared: dict[str, Any], near: ContactSystem | None = None
) -> ContactResult:
    """Read one step of a history; the system of another lends its body and rows.

    Parameters
    ----------
    path : Path
    shared : dict
        The `problem_arrays` where they lie in a file of their own.
    near : ContactSystem, optional
    """
    arrays = shared | read_arrays(path)
    with _damage(path):
        return _rebuild(arrays, near)


def read_arrays(path: Path) -> dict[str, Any]:
    """The arrays of an archive; `InputError` when it is missing, truncated or not one."""
    if not path.is_file():
        raise InputError(f"result file {path} does not exist")
    # NumPy leaves a file open that it opened itself and could not read.
    with _damage(path), path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Tell what a damaged file does to NumPy, zipfile and us as an `InputError`."""
    try:
        yield
    except InputError:
        raise
    except (
        *(zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError),
        *(ValueError, KeyError, TypeError, AttributeError, IndexError),
    ) as error:
        raise InputError(f"result file {path} cannot be read: {error}") from error


def _rebuild(arrays: dict[str, Any], near: ContactSystem | None) -> ContactResult:
    from contact.result import ContactResult

    about = json.loads(str(arrays["about"]))
    if about["format"] != _FORMAT:
        raise ValueError(f"it has format {about['format']}, not {_FORMAT}")
    step = json.loads(str(arrays["step"]))
    if near is None:
        body, rows = _rebuild_problem(arrays, about)
        body.f = arrays["load"]
    else:
        body, rows = near.body.under(arrays["load"], arrays["u0"]), near.rows
    rows = replace(rows, gap=arrays["rows/gap"])
    motion = None
    if "motion" in arrays:
        parts = {field.name: arrays[f"motion/{field.name}"] for field in fields(ObstacleMotion)}
        motion = ObstacleMotion(**parts)
    system = ContactSystem(
        body, rows, arrays["load"], step["law"], arrays["friction"], arrays.get("slip_from"), motion
    )
    history = tuple(Iteration(**line) for line in step["history"])
    return ContactResult(
        system,
        arrays["u"],
        arrays["mu"],
        arrays["multiplier_t"],
        step["method"],
        history,
        arrays.get("motion"),
    )


def _rebuild_problem(
    arrays: dict[str, Any], about: dict[str, Any]
) -> tuple[ElasticBody, ContactRows]:
    boundaries = {
        name.removeprefix("boundary/"): value
        for name, value in arrays.items()
        if name.startswith("boundary/")
    }
    mesh = getattr(skfem, about["mesh"])(arrays["p"], arrays["t"], sort_t=False)
    if boundaries:
        mesh = mesh.with_boundaries(boundaries)
    body = ElasticBody.from_mesh(
        mesh,
        _element(about["element"]),
        E=arrays["E"],
        nu=arrays["nu"],
        plane=about["plane"],
        dilatation=about.get("dilatation", "pointwise"),
    )
    body.constraint = _unpack(arrays, "constraint"), arrays["u0"]
    parts: dict[str, Any] = {
        field.name: _unpack(arrays, f"rows/{field.name}")
        if field.name in _SPARSE
        else arrays[f"rows/{field.name}"]
        for field in fields(ContactRows)
        if field.name != "functional"
    }
    return body, ContactRows(**parts, functional=about["functional"])


def _element(name: str) -> Any:
    ours = (ElementQuadAdini, ElementHexAdini, ElementQuadBFS)
    known = {element.__name__: element for element in ours}
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
