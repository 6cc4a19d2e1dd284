"""Results of contact on a grid on disk: one compressed NumPy archive with the whole problem."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import skfem
from numpy.typing import NDArray

from contact.errors import InputError
from contact.laws.iteration import Iteration
from contact.output.archive import named_archive, read_arrays, reading, write_arrays
from contact.spectral.grid_case import GridCase
from contact.spectral.half_space import HalfSpace
from contact.spectral.periodic_layers import PeriodicLayers
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from skfem_adini.ground.arguments import numbers

Array = NDArray[np.float64]
KIND, _FORMAT = "GridResult", 1
_ELEMENTS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (
        *(skfem.ElementQuad1, skfem.ElementHex1),
        *(ElementQuadAdini, ElementHexAdini, ElementQuadBFS),
    )
}


class GridState(NamedTuple):
    """A solution beside its problem.

    Attributes
    ----------
    case : GridCase
    forces : ndarray, shape (dim, nx[, ny])
        Multipliers, the normal ones first.
    a : ndarray, shape (dim,)
        Motions that were found.
    tol : float
        Of its certificate.
    history : tuple of Iteration
    """

    case: GridCase
    forces: Array
    a: Array
    tol: float
    history: tuple[Iteration, ...]


def write(state: GridState, path: str | Path) -> Path:
    """Write a result; the file appears under its name only once it is complete.

    Raises
    ------
    InputError
        See `contact.GridResult.save`.
    """
    file, case = named_archive(path), state.case
    about = {
        "kind": KIND,
        "format": _FORMAT,
        "compliance": _words(case.compliance),
        "law": case.law,
        "tol": float(state.tol),
        "history": [asdict(line) for line in state.history],
    }
    arrays: dict[str, Any] = {
        "gap": case.gap, "friction": case.friction, "motion": case.motion, "force": case.force,
        "forces": state.forces, "a": state.a, "about": np.array(json.dumps(about)),
    }  # fmt: skip
    for name in ("slip_from", "travel"):
        if getattr(case, name) is not None:
            arrays[name] = getattr(case, name)
    return write_arrays(file, arrays)


def read(path: str | Path, xp: Any) -> GridState:
    """Read what `write` wrote, without a certificate; see `contact.GridResult.load`."""
    file = named_archive(path)
    arrays, checksum = read_arrays(file)
    with reading(file):
        about = json.loads(str(arrays["about"])) if "about" in arrays else {}
        if about.get("kind") != KIND:
            raise InputError("it holds no GridResult; ContactResult.load reads those of bodies")
        if about["format"] != _FORMAT or checksum is None:
            raise InputError(
                f"it has format {about['format']}; this version reads format {_FORMAT}, with a "
                "checksum"
            )
        return _state(arrays, about, xp)


def _state(arrays: dict[str, Any], about: dict[str, Any], xp: Any) -> GridState:
    compliance = _compliance(about["compliance"], xp)
    shape, dim = compliance.shape, len(compliance.shape) + 1
    expected = {
        "gap": shape, "friction": shape, "motion": (dim,), "force": (dim,),
        "forces": (dim, *shape), "a": (dim,), "slip_from": (dim - 1, *shape),
        "travel": (dim,),
    }  # fmt: skip
    found = {name: numbers(name, arrays[name]) for name in expected if name in arrays}
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
    case = GridCase(
        compliance, found["gap"], found["friction"], about["law"], found["motion"], found["force"],
        found.get("slip_from"), found.get("travel"),
    )  # fmt: skip
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
    element = type(compliance.element)
    if _ELEMENTS.get(element.__name__) is not element:
        raise InputError(
            f"result: {element.__module__}.{element.__name__} cannot be saved; a file holds "
            f"{', '.join(_ELEMENTS)}"
        )
    words = {
        "class": "PeriodicLayers", "lengths": compliance.lengths, "cells": compliance.cells,
        "layers": [layer[:4] for layer in compliance.layers], "sides": compliance.sides,
        "element": element.__name__, "interfaces": compliance.interfaces,
    }  # fmt: skip
    if compliance.base is not None:
        return words | {"base": compliance.base}
    top = "".join("xyz"[i] for i in np.flatnonzero(compliance.held))
    return words | {"top": top, "motion": compliance.motion.tolist(), "plane": compliance.plane}


def _compliance(words: dict[str, Any], xp: Any) -> HalfSpace | PeriodicLayers:
    given = dict(words)
    kind = given.pop("class")
    if kind == "HalfSpace":
        return HalfSpace(**given, xp=xp)
    if kind != "PeriodicLayers":
        raise InputError(f"compliance {kind!r}: expected HalfSpace or PeriodicLayers")
    if given["element"] not in _ELEMENTS:
        raise InputError(f"element {given['element']!r} is none of {', '.join(_ELEMENTS)}")
    return PeriodicLayers(**given | {"element": _ELEMENTS[given["element"]]()}, xp=xp)
