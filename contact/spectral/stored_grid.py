"""Results of contact on a grid on disk: one compressed NumPy archive with the whole problem."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import skfem
from numpy.typing import NDArray

from contact.errors import InputError
from contact.laws.iteration import Iteration
from contact.output.archive import (
    Kinds,
    from_arrays,
    head,
    named_archive,
    read_arrays,
    reading,
    to_arrays,
    words,
    write_arrays,
)
from contact.spectral.grid_case import GridCase
from contact.spectral.half_space import HalfSpace
from contact.spectral.periodic_layers import PeriodicLayers
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from skfem_adini.ground.arguments import numbers

Array = NDArray[np.float64]
_KIND, _FORMAT = "GridResult", 1
_OF_CASE = ("gap", "friction", "motion", "force", "slip_from", "travel")
_ELEMENTS = Kinds(
    *(skfem.ElementQuad1, skfem.ElementHex1, ElementQuadAdini, ElementHexAdini, ElementQuadBFS)
)


class GridState(NamedTuple):
    """A solution beside its problem: multipliers, motions found, tolerance of the certificate."""

    case: GridCase
    forces: Array  # (dim, nx[, ny]), the normal ones first
    a: Array  # (dim,)
    tol: float
    history: tuple[Iteration, ...]


def write(state: GridState, path: str | Path) -> Path:
    """Write a result; see `contact.GridResult.save`."""
    file, case = named_archive(path), state.case
    about = {
        "kind": _KIND,
        "format": _FORMAT,
        "compliance": _words(case.compliance),
        "law": case.law,
        "tol": float(state.tol),
        "history": [asdict(line) for line in state.history],
    }
    parts = {name: getattr(case, name) for name in _OF_CASE}
    parts |= {"forces": state.forces, "a": state.a, "about": words(about)}
    return write_arrays(file, to_arrays(parts))


def read(path: str | Path, xp: Any) -> GridState:
    """Read what `write` wrote, without a certificate; see `contact.GridResult.load`."""
    file = named_archive(path)
    arrays, checksum = read_arrays(file)
    with reading(file):
        formats, beside = ((), "without") if checksum is None else ((_FORMAT,), "with")
        about = head(arrays, _KIND, formats, beside, f"format {_FORMAT}, with one")
        return _state(arrays, about, xp)


def _state(arrays: dict[str, Any], about: dict[str, Any], xp: Any) -> GridState:
    compliance = _compliance(about["compliance"], xp)
    shape, dim = compliance.shape, len(compliance.shape) + 1
    expected = {
        "gap": shape, "friction": shape, "motion": (dim,), "force": (dim,),
        "forces": (dim, *shape), "a": (dim,), "slip_from": (dim - 1, *shape),
        "travel": (dim,),
    }  # fmt: skip
    found = {name: numbers(name, part) for name, part in from_arrays(arrays, expected).items()}
    for name, value in found.items():
        if value.shape != expected[name]:
            raise InputError(f"{name}: expected shape {expected[name]}, got {value.shape}")
    for name in ("forces", "a", "friction", "slip_from", "travel"):
        if not np.all(np.isfinite(found.get(name, 0.0))):
            raise InputError(f"{name}: holds numbers that are not finite")
    if np.any(np.isnan(found["gap"])) or np.any(found["friction"] < 0):
        raise InputError("gap, friction: hold NaN, or a negative coefficient")
    if not np.all(np.isnan(found["motion"]) != np.isnan(found["force"])):
        raise InputError("motion, force: for each component one of the two must be NaN")
    if about["law"] not in ("coulomb", "tresca") or not 0 < about["tol"] < 1:
        raise InputError(f"law {about['law']!r} or tolerance {about['tol']!r} out of range")
    given: dict[str, Any] = {name: found.get(name) for name in _OF_CASE}
    case = GridCase(compliance=compliance, law=about["law"], **given)
    lines = tuple(Iteration(**line) for line in about["history"])
    return GridState(case, found["forces"], found["a"], about["tol"], lines)


def _words(compliance: Any) -> dict[str, Any]:
    """The arguments that a compliance is built from."""
    if type(compliance) is HalfSpace:
        return {
            "class": "HalfSpace", "lengths": compliance.lengths, "shape": compliance.shape,
            "E": compliance.E, "nu": compliance.nu, "normal": compliance.normal.tolist(),
        }  # fmt: skip
    if type(compliance) is not PeriodicLayers:
        raise InputError(
            f"result: a compliance of {type(compliance).__name__} cannot be saved; a file holds "
            "HalfSpace and PeriodicLayers. Save the fields with numpy.savez, and solve again"
        )
    given = {
        "class": "PeriodicLayers", "lengths": compliance.lengths, "cells": compliance.cells,
        "layers": [layer[:4] for layer in compliance.layers], "sides": compliance.sides,
        "element": _ELEMENTS.name(compliance.element), "interfaces": compliance.interfaces,
    }  # fmt: skip
    if compliance.base is not None:
        return given | {"base": compliance.base}
    top = "".join("xyz"[i] for i in np.flatnonzero(compliance.held))
    return given | {"top": top, "motion": compliance.motion.tolist(), "plane": compliance.plane}


def _compliance(given: dict[str, Any], xp: Any) -> HalfSpace | PeriodicLayers:
    given = dict(given)
    kind = given.pop("class")
    if kind == "HalfSpace":
        return HalfSpace(**given, xp=xp)
    if kind != "PeriodicLayers":
        raise InputError(f"compliance {kind!r}: expected HalfSpace or PeriodicLayers")
    element = _ELEMENTS.kind("element", given["element"])()
    return PeriodicLayers(**given | {"element": element}, xp=xp)
