"""Results on disk: one compressed NumPy archive that holds the whole discrete problem."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from skfem.generic_utils import OrientedBoundary

from contact.body.anisotropic import Anisotropic
from contact.body.cut_body import CutBody
from contact.body.distributed_body import DistributedBody
from contact.body.elastic_body import ElasticBody
from contact.body.layers.layered_block import LayeredBlock
from contact.body.several_bodies import Bodies
from contact.body.solid import Solid
from contact.body.thermal_strain import checked_thermal
from contact.errors import InputError, NotConverged
from contact.laws.iteration import Iteration
from contact.laws.options import default_tolerance
from contact.laws.pressure_overclosure import PressureOverclosure
from contact.obstacles.rigid import ObstacleMotion
from contact.output.archive import named_archive, read_arrays, reading, write_arrays
from contact.result.certify import as_lines, certify, strained_bodies, take_strains
from contact.result.consistency import check_mesh, check_problem, check_state
from contact.result.contact_state import ContactState
from contact.result.contact_system import ContactSystem
from contact.result.stored_pieces import words_of_distributed
from contact.result.stored_rows import OWN, pack, rows_arrays, rows_from, unpack
from contact.rows.contact_rows import ContactRows
from contact.spectral.stored_grid import KIND
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

# Several bodies have a format of their own: versions that know one body only refuse it.
_FORMAT, _BEFORE_CHECKSUMS, _SEVERAL = 3, 2, 4
_MESHES: dict[str, Any] = {
    kind.__name__: kind
    for kind in (
        *(skfem.MeshTri1, skfem.MeshTri2, skfem.MeshQuad1, skfem.MeshQuad2),
        *(skfem.MeshTet1, skfem.MeshTet2, skfem.MeshHex1, skfem.MeshHex2),
    )
}
_ELEMENTS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (
        *(ElementQuadAdini, ElementHexAdini, ElementQuadBFS),
        *(skfem.ElementTriP1, skfem.ElementTriP2, skfem.ElementQuad1, skfem.ElementQuad2),
        *(skfem.ElementTetP1, skfem.ElementTetP2, skfem.ElementHex1, skfem.ElementHex2),
    )
}
logger = logging.getLogger(__name__)


def write(state: ContactState, path: str | Path) -> Path:
    """Write a result; the file appears under its name only once it is complete.

    Raises
    ------
    InputError
        See `ContactResult.save`.
    """
    path = named_archive(path)
    if isinstance(state.system.body, DistributedBody):
        raise InputError(
            "result: that of a DistributedBody is not in one file; write "
            "LoadStepper(problem).run([1.0], path=folder) and resume it, or contact.save_pvtu"
        )
    arrays = problem_arrays(state.system) | state_arrays(state)
    _certified(state, "result: it would be refused when it is read")
    write_arrays(path, arrays)
    return path


def problem_arrays(system: ContactSystem) -> dict[str, Any]:
    """Arrays that all steps of a load history share: bodies, supports, contact rows."""
    arrays: dict[str, Any]
    about: dict[str, Any]
    rows = {"functional": system.rows.functional}
    if isinstance(system.body, Bodies):
        arrays, about = {}, {"format": _SEVERAL, "bodies": [], **rows}
        for k, body in enumerate(system.body.bodies):
            own, words = _body_arrays(body, {})
            arrays |= {f"{_prefix(k)}{name}": array for name, array in own.items()}
            about["bodies"].append(words)
    else:
        arrays, about = _body_arrays(system.body, rows)
        about = {"format": _FORMAT, **about}
    arrays |= rows_arrays(system.body, system.rows)
    return arrays | {"about": np.array(json.dumps(about))}


def _prefix(k: int) -> str:
    """What the names of the arrays of body k begin with."""
    return f"body/{k}/"


def _thermal_name(body: Solid, k: int) -> str:
    """Name of the array of the thermal strain of body k."""
    return (_prefix(k) if isinstance(body, Bodies) else "") + "thermal"


def _body_arrays(body: Any, rows: dict[str, str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Mesh, material and supports of a body, and what describes them and its rows in words."""
    if isinstance(body, DistributedBody):
        return words_of_distributed(body, rows)
    if isinstance(body, LayeredBlock):
        named = {"name": body.name} if body.name else {}
        held = np.zeros(body.ndofs, dtype=bool)
        held[body.prescribed[0]] = True
        return {"block/held": held}, {
            "mesh": "LayeredBlock",
            "block": body.stored(),
            **rows,
            **named,
        }
    mesh, basis = body.mesh, body.basis
    for what, known in ((body.element, _ELEMENTS), (mesh, _MESHES)):
        name = type(what).__name__
        if known.get(name) is not type(what):
            raise InputError(
                f"result: {type(what).__module__}.{name} cannot be saved; a file holds "
                f"{', '.join(known)}"
            )
    again = skfem.Basis(mesh, basis.elem, quadrature=(basis.X, basis.W))
    for ours, default in ((basis.dx, again.dx), (basis.element_dofs, again.element_dofs)):
        if not np.array_equal(ours, default):
            raise InputError(
                "result: its basis has a mapping or a numbering of its own, which no file holds"
            )
    arrays: dict[str, Any] = {"p": mesh.doflocs, "t": mesh.t}
    if body.anisotropy is None:
        arrays |= {"E": body.E, "nu": body.nu}
    else:
        arrays["C"] = body.anisotropy.C
    arrays |= {"quadrature/X": basis.X, "quadrature/W": basis.W}
    boundaries, subdomains = mesh.boundaries or {}, mesh.subdomains or {}
    for i, facets in enumerate(boundaries.values()):
        arrays[f"boundary/{i}"] = np.asarray(facets)
        if isinstance(facets, OrientedBoundary):
            arrays[f"boundary/{i}/sides"] = facets.ori
    arrays |= {f"subdomain/{i}": np.asarray(cells) for i, cells in enumerate(subdomains.values())}
    pack(arrays, "constraint", body.constraint[0])
    about = {
        "mesh": type(mesh).__name__,
        "element": type(body.element).__name__,
        "plane": body.plane,
        "dilatation": body.dilatation,
        **rows,  # here, because checksums of earlier load histories depend on the order
        "boundaries": list(boundaries),
        "subdomains": list(subdomains),
    }
    if isinstance(body, CutBody):
        arrays |= {f"cut/{name}": array for name, array in body.stored().items()}
        about["threshold"] = body.threshold
    return arrays, about | ({"name": body.name} if body.name else {})


def state_arrays(state: ContactState) -> dict[str, Any]:
    """Loads, prescribed displacements, gap and solution of one step."""
    system = state.system
    arrays: dict[str, Any] = {
        "load": system.load,
        "u0": system.body.constraint[1],
        "rows/gap": system.rows.gap,
        "friction": system.friction,
        "u": state.u,
        "mu": state.mu,
        "multiplier_t": state.t,
    }
    for k, body in enumerate(system.body.bodies):
        if body.thermal is not None:
            arrays[_thermal_name(system.body, k)] = body.thermal
    if system.slip_from is not None:
        arrays["slip_from"] = system.slip_from
    if system.motion is not None and state.motion is not None:
        for name, value in vars(system.motion).items():
            if value is not None:
                arrays[f"motion/{name}"] = value
        arrays["motion"] = state.motion
    step: dict[str, Any] = {
        "law": system.law,
        "method": state.method,
        "tol": state.tol,
        "slack": state.slack,
        "history": [asdict(line) for line in state.history],
    }
    if system.overclosure:
        laws = [None if law is None else law.stored() for law in system.overclosure]
        step["overclosure"] = laws
    if strained := strained_bodies(system.body):
        step["strains"] = strained
    return arrays | {"step": np.array(json.dumps(step))}


def read(path: str | Path) -> ContactState:
    """Read what `write` wrote; see `ContactResult.load`."""
    name = named_archive(path)
    arrays, checksum = read_arrays(name)
    return rebuild(name, arrays, checksum is not None)


def rebuild(
    path: Path, arrays: dict[str, Any], with_checksum: bool, near: ContactSystem | None = None
) -> ContactState:
    """The state stored in the arrays of a file, certified again.

    Parameters
    ----------
    path : Path
        For the messages.
    arrays : dict
        Those of `problem_arrays` and `state_arrays` together.
    with_checksum : bool
        Whether the file had a checksum, which was correct.
    near : ContactSystem, optional
        Its body and rows are used instead of new ones.

    Raises
    ------
    InputError
    """
    with reading(path):
        state = _rebuild(arrays, with_checksum, near)
        check_state(state)
    refused = f"result file {path}: its solution does not solve the problem beside it"
    state = _certified(state, refused)
    if not with_checksum:
        logger.warning(
            "%s has format %d, without a checksum: its residuals are right, but nothing shows "
            "whether names, weights or gaps of open points were changed; save it again",
            *(path, _BEFORE_CHECKSUMS),
        )
    return state


def _certified(state: ContactState, consequence: str) -> ContactState:
    """Certify a result again; on another processor residuals near their limit may round up.

    Returns
    -------
    ContactState
        The same, or, if it has the digits only so, one whose bodies compute forces from strains.
    """
    tol = default_tolerance(state.method) if state.tol is None else state.tol
    limits = max(2 * tol, 1e-12), 2 * state.slack
    try:
        try:
            kkt = certify(state, *limits)
        except NotConverged:  # as when it was solved, on a copy: the caller's bodies stay
            body = state.system.body.snapshot()
            if not take_strains(body):
                raise
            state = replace(state, system=replace(state.system, body=body))
            kkt = certify(state, *limits)
    except NotConverged as error:
        raise InputError(f"{consequence}: {error}") from error
    logger.info("%s", as_lines(kkt))
    return state


def _rebuild(
    arrays: dict[str, Any], with_checksum: bool, near: ContactSystem | None
) -> ContactState:
    about = json.loads(str(arrays["about"]))
    if about.get("kind") == KIND:
        raise InputError("it holds a GridResult; GridResult.load reads it")
    if about["format"] not in ((_FORMAT, _SEVERAL) if with_checksum else (_BEFORE_CHECKSUMS,)):
        beside = "with" if with_checksum else "without"
        raise InputError(
            f"it has format {about['format']}, {beside} a checksum; this version reads formats "
            f"{_FORMAT} and {_SEVERAL} with one and format {_BEFORE_CHECKSUMS}, of version 0.1.0, "
            "without"
        )
    step = json.loads(str(arrays["step"]))
    body, rows = _rebuild_problem(arrays, about) if near is None else (near.body, near.rows)
    if near is not None and OWN in arrays:  # projected where the bodies were in this step
        rows = rows_from(arrays, about["functional"])
        check_problem(body, rows)
    for name in ("load", "u0"):
        if arrays[name].shape != body.f.shape:
            raise InputError(f"{name}: expected shape {body.f.shape}, got {arrays[name].shape}")
    body = body.under(arrays["load"], arrays["u0"])
    take_strains(body, step.get("strains", ()))
    for k, one in enumerate(body.bodies):
        one.thermal = checked_thermal(one, arrays.get(_thermal_name(body, k)))
    rows = replace(rows, gap=arrays["rows/gap"])
    motion = None
    if "motion" in arrays:
        names = {field.name: f"motion/{field.name}" for field in fields(ObstacleMotion)}
        parts = {name: arrays[key] for name, key in names.items() if key in arrays}
        if missing := {"normal", "tangent", "prescribed", "force"} - set(parts):
            raise KeyError(f"motion/{min(missing)}")
        motion = ObstacleMotion(**parts)
    laws = tuple(PressureOverclosure.from_stored(law) for law in step.get("overclosure", ()))
    since = arrays.get("slip_from")
    system = ContactSystem(
        body, rows, arrays["load"], step["law"], arrays["friction"], since, motion, laws
    )
    # Format 2 did not keep the slack of `fixed_point`, the only method that has one.
    unknown = 1e-3 if step["method"] == "fixed_point" and not with_checksum else 0.0
    return ContactState(
        system,
        arrays["u"],
        arrays["mu"],
        arrays["multiplier_t"],
        step["method"],
        tuple(Iteration(**line) for line in step["history"]),
        arrays.get("motion"),
        step.get("tol"),
        step.get("slack", unknown),
    )


def _rebuild_problem(arrays: dict[str, Any], about: dict[str, Any]) -> tuple[Any, ContactRows]:
    body: Any
    if about["format"] == _SEVERAL:
        body = Bodies([_body_of(arrays, k, words) for k, words in enumerate(about["bodies"])])
    else:
        body = _rebuild_body(arrays, about)
    rows = rows_from(arrays, about["functional"])
    check_problem(body, rows)
    return body, rows


def _body_of(arrays: dict[str, Any], k: int, about: dict[str, Any]) -> Any:
    """Body k of several."""
    prefix = _prefix(k)
    own = {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}
    return _rebuild_body(own, about)


def _rebuild_body(arrays: dict[str, Any], about: dict[str, Any]) -> Any:
    """A body under no load, with displacements prescribed as zero."""
    if about["mesh"] == "LayeredBlock":
        block = LayeredBlock.from_stored(about["block"], arrays["block/held"].size)
        if not np.array_equal(block.prescribed[0], np.flatnonzero(arrays["block/held"])):
            raise InputError("block: its supports hold other unknowns than when it was saved")
        return block.named(about["name"]) if "name" in about else block
    for kind, known in (("mesh", _MESHES), ("element", _ELEMENTS)):
        if about[kind] not in known:
            raise InputError(f"{kind} {about[kind]!r} is none of {', '.join(known)}")
    check_mesh(arrays["p"], arrays["t"], _MESHES[about["mesh"]])
    mesh = _MESHES[about["mesh"]](arrays["p"], arrays["t"], sort_t=False)
    boundaries = _boundaries(arrays, about)
    if boundaries:
        mesh = mesh.with_boundaries(boundaries)
    if about.get("subdomains"):
        cells = {name: arrays[f"subdomain/{i}"] for i, name in enumerate(about["subdomains"])}
        mesh = mesh.with_subdomains(cells)
    if "threshold" in about:
        return _rebuild_cut_body(mesh, arrays, about)
    element = skfem.ElementVector(_ELEMENTS[about["element"]]())
    rule = (arrays["quadrature/X"], arrays["quadrature/W"]) if "quadrature/X" in arrays else None
    body = ElasticBody(
        skfem.Basis(mesh, element, quadrature=rule),
        arrays.get("E"),
        arrays.get("nu"),
        about["plane"],
        about.get("dilatation", "pointwise"),
        Anisotropic(arrays["C"]) if "C" in arrays else None,
    )
    body.constraint = unpack(arrays, "constraint"), np.zeros(body.basis.N)
    return body.named(about["name"]) if "name" in about else body


def _rebuild_cut_body(mesh: Any, arrays: dict[str, Any], about: dict[str, Any]) -> CutBody:
    cut = {k.removeprefix("cut/"): value for k, value in arrays.items() if k.startswith("cut/")}
    material = arrays.get("E"), arrays.get("nu"), about["plane"]
    body = CutBody.from_stored(mesh, cut, *material, about["threshold"])
    body.constraint = unpack(arrays, "constraint"), np.zeros(body.basis.N)
    return body.named(about["name"]) if "name" in about else body


def _boundaries(arrays: dict[str, Any], about: dict[str, Any]) -> dict[str, Any]:
    if "boundaries" not in about:  # format 2
        named = (name for name in arrays if name.startswith("boundary/"))
        return {name.removeprefix("boundary/"): arrays[name] for name in named}
    found = {}
    for i, name in enumerate(about["boundaries"]):
        facets, sides = arrays[f"boundary/{i}"], arrays.get(f"boundary/{i}/sides")
        found[name] = facets if sides is None else OrientedBoundary(facets, sides)
    return found
