"""Results on disk: one compressed NumPy archive that holds the whole discrete problem.

Files are not trusted: checksum, shapes, ranges and residuals of the equations are checked.
"""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy import sparse
from skfem.generic_utils import OrientedBoundary

from contact.body.anisotropic import Anisotropic
from contact.body.cut_body import CutBody
from contact.body.distributed_body import DistributedBody
from contact.body.elastic_body import ElasticBody
from contact.body.layers.layered_block import LayeredBlock
from contact.body.rigid_modes import rigid_field
from contact.body.several_bodies import Bodies
from contact.body.solid import Solid
from contact.body.thermal_strain import checked_thermal
from contact.errors import InputError, NotConverged
from contact.laws.adhesion import Adhesion
from contact.laws.iteration import Iteration
from contact.laws.options import default_tolerance
from contact.laws.pressure_overclosure import PressureOverclosure
from contact.laws.surface_law import SurfaceState
from contact.obstacles.rigid import ObstacleMotion
from contact.output.archive import (
    Kinds,
    from_arrays,
    head,
    loosened,
    named_archive,
    proving,
    to_arrays,
    unproved,
)
from contact.result.certify import as_lines, certify, strained_bodies, take_strains
from contact.result.contact_system import ContactState, ContactSystem
from contact.rows.contact_rows import ContactRows
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS
from skfem_adini.ground.archives import read_arrays, reading, words, write_arrays

Array = NDArray[np.float64]


class _Formats(NamedTuple):  # numbers of the formats of files
    one: int = 3  # of one body
    several: int = 4  # of several bodies; refused by versions for one body
    before_checksums: int = 2  # of version 0.1.0


FORMATS = _Formats()
_MESHES = Kinds(
    *(skfem.MeshTri1, skfem.MeshTri2, skfem.MeshQuad1, skfem.MeshQuad2),
    *(skfem.MeshTet1, skfem.MeshTet2, skfem.MeshHex1, skfem.MeshHex2),
)
_ELEMENTS = Kinds(
    *(ElementQuadAdini, ElementHexAdini, ElementQuadBFS),
    *(skfem.ElementTriP1, skfem.ElementTriP2, skfem.ElementQuad1, skfem.ElementQuad2),
    *(skfem.ElementTetP1, skfem.ElementTetP2, skfem.ElementHex1, skfem.ElementHex2),
)
_OF_STATE = {"u": "u", "mu": "mu", "t": "multiplier_t", "motion": "motion"}
OWN = "rows/own"  # in files of steps with their own rows
_UNIT = 1e-9  # rounding of unit vectors, and of rows that average a constant
logger = logging.getLogger(__name__)


def write(state: ContactState, path: str | Path) -> Path:
    """Write a result; see `ContactResult.save`."""
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
    rows = {"functional": system.rows.functional}
    arrays: dict[str, Any]
    about: dict[str, Any]
    if isinstance(system.body, Bodies):
        arrays, about = {}, {"format": FORMATS.several, "bodies": [], **rows}
        for k, body in enumerate(system.body.bodies):
            own, entry = _body_arrays(body, {})
            arrays |= to_arrays(own, _prefix(k))
            about["bodies"].append(entry)
    else:
        arrays, about = _body_arrays(system.body, rows)
        about = {"format": FORMATS.one, **about}
    return arrays | rows_arrays(system.body, system.rows) | {"about": words(about)}


def _prefix(k: int) -> str:
    """Prefix of the names of the arrays of body k."""
    return f"body/{k}/"


def _thermal_name(body: Solid, k: int) -> str:
    """Name of the array of the thermal strain of body k."""
    return (_prefix(k) if isinstance(body, Bodies) else "") + "thermal"


def rows_arrays(body: Any, rows: ContactRows) -> dict[str, Any]:
    """The arrays of contact rows, without the gap, which belongs to a state."""
    # Absent in files of versions without ties or several bodies.
    optional = ("bonded", "owner", "axes")
    parts = {n: part for n, part in vars(rows).items() if n not in optional or part.size}
    if isinstance(body, DistributedBody):  # the columns common to all processes
        n = body.trace.basis.N
        parts |= {"G": rows.G[:, :n], "T": rows.T[:, :n]}
    return to_arrays(parts | {"functional": None, "gap": None}, "rows/")


def _rows_from(arrays: dict[str, Any], functional: str) -> ContactRows:
    names = [field.name for field in fields(ContactRows)]
    return ContactRows(**from_arrays(arrays, names, "rows/"), functional=functional)


def _body_arrays(body: Any, rows: dict[str, str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Mesh, material and supports of a body, and the description of these and its rows."""
    if isinstance(body, DistributedBody):
        return _distributed_arrays(body, rows)
    named = {"name": body.name} if body.name else {}
    if isinstance(body, LayeredBlock):
        held = np.zeros(body.ndofs, dtype=bool)
        held[body.prescribed[0]] = True
        about = {"mesh": "LayeredBlock", "block": body.stored(), **rows, **named}
        return {"block/held": held}, about
    mesh, basis = body.mesh, body.basis
    element, kind = _ELEMENTS.name(body.element), _MESHES.name(mesh)
    again = skfem.Basis(mesh, basis.elem, quadrature=(basis.X, basis.W))
    for ours, default in ((basis.dx, again.dx), (basis.element_dofs, again.element_dofs)):
        if not np.array_equal(ours, default):
            raise InputError(
                "result: its basis has a mapping or a numbering of its own, which no file holds"
            )
    parts: dict[str, Any] = {"p": mesh.doflocs, "t": mesh.t, **_constants(body)}
    parts |= {"quadrature/X": basis.X, "quadrature/W": basis.W, "constraint": body.constraint[0]}
    boundaries, subdomains = mesh.boundaries or {}, mesh.subdomains or {}
    for i, facets in enumerate(boundaries.values()):
        parts[f"boundary/{i}"] = np.asarray(facets)
        parts[f"boundary/{i}/sides"] = getattr(facets, "ori", None)
    parts |= {f"subdomain/{i}": np.asarray(cells) for i, cells in enumerate(subdomains.values())}
    about = {
        "mesh": kind,
        "element": element,
        "plane": body.plane,
        "dilatation": body.dilatation,
        **rows,  # at this position, on which checksums of earlier histories depend
        "boundaries": list(boundaries),
        "subdomains": list(subdomains),
    }
    if isinstance(body, CutBody):
        parts |= {f"cut/{name}": array for name, array in body.stored().items()}
        about["threshold"] = body.threshold
    return to_arrays(parts), about | named


def _constants(body: Any) -> dict[str, Any]:
    """Constants of Hooke's law, each a scalar or one per cell."""
    if body.anisotropy is None:
        return {"E": body.E, "nu": body.nu}
    return {"C": body.anisotropy.C}


def _distributed_arrays(
    body: DistributedBody, rows: dict[str, str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Data that identify a distributed body, whose mesh is not stored."""
    law = body.local
    constants = {n: c for n, c in _constants(law).items() if np.ndim(c) == 0 or n == "C"}
    return constants, {
        "mesh": f"{type(body.trace.mesh).__name__} on many processes (see LoadStepper.resume)",
        "element": type(body.element).__name__,
        "dofs": body.space.N,
        "plane": body.plane,
        "dilatation": law.dilatation,
        "supports": [[*names, str(components)] for names, components in body._supports],
        **rows,
    }


def state_arrays(state: ContactState) -> dict[str, Any]:
    """Loads, prescribed displacements, gap and solution of one step."""
    system = state.system
    parts = {
        "load": system.load,
        "u0": system.body.constraint[1],
        "rows/gap": system.rows.gap,
        "friction": system.friction,
        "slip_from": system.slip_from,
        "moduli": system.moduli,
        **{name: getattr(state, field) for field, name in _OF_STATE.items()},
        **{_thermal_name(system.body, k): b.thermal for k, b in enumerate(system.body.bodies)},
    }
    if system.motion is None or state.motion is None:
        parts["motion"] = None
    else:
        parts |= {f"motion/{name}": value for name, value in vars(system.motion).items()}
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
    if state.jump:
        step["jump"] = state.jump
    if system.surface is not None:
        parts |= surface_arrays(system, np.maximum(state.mu, 0.0) / system.rows.weights)
    return to_arrays(parts | {"step": words(step)})


def surface_arrays(system: ContactSystem, p: Array) -> dict[str, Any]:
    """Arrays of adhesion, hardness and wear, of functions of the pressures p by their values."""
    surface = system.surface
    assert surface is not None
    parts = {f"surface/{name}": value for name, value in surface.stored(p).items()}
    glue = None if surface.adhesion is None else asdict(surface.adhesion)
    return to_arrays(parts | {"surface/adhesion": words({"law": glue})})


def _surface(arrays: dict[str, Any], rows: ContactRows) -> SurfaceState | None:
    if "surface/adhesion" not in arrays:
        return None
    names = [field.name for field in fields(SurfaceState)]
    parts = from_arrays(arrays, names, "surface/")
    glue, m = json.loads(str(parts.pop("adhesion")))["law"], rows.gap.size
    shapes = {"hardness": (m,), "wear": (2, m), "indented": (m,), "worn": (2, m), "volume": (2,)}
    shapes["ramps"] = (m,)
    for name, part in parts.items():
        _check_shape(f"surface/{name}", part, shapes.get(name, part.shape))
        if np.any(np.isnan(part)) or (name in shapes and np.any(part < 0)):
            raise InputError(f"surface/{name}: holds NaN or negative numbers")
    return SurfaceState(None if glue is None else Adhesion(**glue), **parts)


def read(path: str | Path) -> ContactState:
    """Read what `write` wrote; see `ContactResult.load`."""
    name = named_archive(path)
    arrays, checksum = read_arrays(name)
    return rebuild(name, arrays, checksum is not None)


def rebuild(
    path: Path, arrays: dict[str, Any], with_checksum: bool, near: ContactSystem | None = None
) -> ContactState:
    """The state in the arrays of problem and state together, certified again.
    Body and rows of `near` are reused if given; `with_checksum`: the checksum was correct."""
    with reading(path):
        state = _rebuild(arrays, with_checksum, near)
        _check_state(state)
    state = _certified(state, unproved(path))
    if not with_checksum:
        logger.warning(
            "%s has format %d, without a checksum: its residuals are right, but nothing shows "
            "whether names, weights or gaps of open points were changed; save it again",
            *(path, FORMATS.before_checksums),
        )
    return state


def _certified(state: ContactState, consequence: str) -> ContactState:
    """Certify a result again, if necessary with forces from strains."""
    tol = default_tolerance(state.method) if state.tol is None else state.tol
    limits = loosened(tol), 2 * state.slack
    with proving(consequence):
        try:
            kkt = certify(state, *limits)
        except NotConverged:  # as in the solve, on a copy of the caller's bodies
            body = state.system.body.snapshot()
            if not take_strains(body):
                raise
            state = replace(state, system=replace(state.system, body=body))
            kkt = certify(state, *limits)
    logger.info("%s", as_lines(kkt))
    return state


def _rebuild(
    arrays: dict[str, Any], with_checksum: bool, near: ContactSystem | None
) -> ContactState:
    formats = (FORMATS.one, FORMATS.several) if with_checksum else (FORMATS.before_checksums,)
    reads = "formats 3 and 4 with one and format 2, of version 0.1.0, without"
    about = head(arrays, None, formats, "with" if with_checksum else "without", reads)
    step = json.loads(str(arrays["step"]))
    body, rows = _rebuild_problem(arrays, about) if near is None else (near.body, near.rows)
    if near is not None and OWN in arrays:  # projected in the configuration of this step
        rows = _rows_from(arrays, about["functional"])
        _check_problem(body, rows)
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
        names = [field.name for field in fields(ObstacleMotion)]
        motion = ObstacleMotion(**from_arrays(arrays, names, "motion/"))
    laws = tuple(PressureOverclosure.from_stored(law) for law in step.get("overclosure", ()))
    since, surface = arrays.get("slip_from"), _surface(arrays, rows)
    system = ContactSystem(
        body, rows, arrays["load"], step["law"], arrays["friction"], since, motion, laws,
        moduli=arrays.get("moduli"), surface=surface,
    )  # fmt: skip
    # Format 2 did not store the slack of `fixed_point`, the only method with one.
    unknown = 1e-3 if step["method"] == "fixed_point" and not with_checksum else 0.0
    return ContactState(
        system,
        **{field: arrays[name] for field, name in _OF_STATE.items() if name in arrays},
        method=step["method"],
        history=tuple(Iteration(**line) for line in step["history"]),
        tol=step.get("tol"),
        slack=step.get("slack", unknown),
        jump=step.get("jump", ""),
    )


def _rebuild_problem(arrays: dict[str, Any], about: dict[str, Any]) -> tuple[Any, ContactRows]:
    body: Any
    if about["format"] == FORMATS.several:
        body = Bodies([_body_of(arrays, k, entry) for k, entry in enumerate(about["bodies"])])
    else:
        body = _rebuild_body(arrays, about)
    rows = _rows_from(arrays, about["functional"])
    _check_problem(body, rows)
    return body, rows


def _body_of(arrays: dict[str, Any], k: int, about: dict[str, Any]) -> Any:
    """Body k of several."""
    prefix = _prefix(k)
    own = {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}
    return _rebuild_body(own, about)


def _rebuild_body(arrays: dict[str, Any], about: dict[str, Any]) -> Any:
    """A body under no load, with displacements prescribed as zero."""
    rebuilt = _rebuild_block if about["mesh"] == "LayeredBlock" else _rebuild_meshed
    body = rebuilt(arrays, about)
    return body.named(about["name"]) if "name" in about else body


def _rebuild_block(arrays: dict[str, Any], about: dict[str, Any]) -> LayeredBlock:
    block = LayeredBlock.from_stored(about["block"], arrays["block/held"].size)
    if not np.array_equal(block.prescribed[0], np.flatnonzero(arrays["block/held"])):
        raise InputError("block: its supports hold other unknowns than when it was saved")
    return block


def _rebuild_meshed(arrays: dict[str, Any], about: dict[str, Any]) -> ElasticBody:
    kind = _MESHES.kind("mesh", about["mesh"])
    element = _ELEMENTS.kind("element", about["element"])
    _check_mesh(arrays["p"], arrays["t"], kind)
    mesh = kind(arrays["p"], arrays["t"], sort_t=False)
    if boundaries := _boundaries(arrays, about):
        mesh = mesh.with_boundaries(boundaries)
    if about.get("subdomains"):
        cells = {name: arrays[f"subdomain/{i}"] for i, name in enumerate(about["subdomains"])}
        mesh = mesh.with_subdomains(cells)
    material = arrays.get("E"), arrays.get("nu"), about["plane"]
    body: Any
    if "threshold" in about:
        cut = {k.removeprefix("cut/"): part for k, part in arrays.items() if k.startswith("cut/")}
        body = CutBody.from_stored(mesh, cut, *material, about["threshold"])
    else:
        rule = None
        if "quadrature/X" in arrays:
            rule = arrays["quadrature/X"], arrays["quadrature/W"]
        basis = skfem.Basis(mesh, skfem.ElementVector(element()), quadrature=rule)
        stiffness = Anisotropic(arrays["C"]) if "C" in arrays else None
        body = ElasticBody(basis, *material, about.get("dilatation", "pointwise"), stiffness)
    supports = from_arrays(arrays, ["constraint"])["constraint"]
    body.constraint = supports, np.zeros(body.basis.N)
    return body


def _boundaries(arrays: dict[str, Any], about: dict[str, Any]) -> dict[str, Any]:
    if "boundaries" not in about:  # format 2
        named = (name for name in arrays if name.startswith("boundary/"))
        return {name.removeprefix("boundary/"): arrays[name] for name in named}
    found = {}
    for i, name in enumerate(about["boundaries"]):
        facets, sides = arrays[f"boundary/{i}"], arrays.get(f"boundary/{i}/sides")
        found[name] = facets if sides is None else OrientedBoundary(facets, sides)
    return found


def _check_mesh(p: Array, t: NDArray[np.int64], kind: Any) -> None:
    """Vertices are finite, and cells refer to existing ones; scikit-fem checks neither."""
    dim, nodes = kind.elem.refdom.dim(), kind.elem.refdom.nnodes
    _finite("p", p, (dim, None))
    _whole("t", t, (nodes, None), p.shape[1])


def _check_problem(body: Solid, rows: ContactRows) -> None:
    """Check shapes and ranges of a problem, and that rows act along their frames."""
    for one in body.bodies:
        _check_body(one)
    dim, n, m = body.dim, body.f.size, rows.G.shape[0]
    for name, matrix, size in (("rows.G", rows.G, m), ("rows.T", rows.T, m * (dim - 1))):
        _finite(name, matrix.data, (None,))
        _check_shape(name, matrix, (size, n))
    shapes: tuple[tuple[str, tuple[int, ...]], ...] = (
        ("weights", (m,)),
        ("x", (dim, m)),
        ("x_nominal", (dim, m)),
        ("normals", (dim, m)),
        ("tangents", (dim, dim - 1, m)),
    )
    for name, expected in shapes:
        _finite(f"rows.{name}", getattr(rows, name), expected)
    _whole("rows.part", rows.part, (m,) if rows.part.size else (0,), m)
    _check_shape("rows.bonded", rows.bonded, (m,) if rows.bonded.size else (0,))
    if rows.bonded.dtype != bool:
        raise InputError("rows.bonded: expected a mask, True or False")
    if not np.all(np.isfinite(rows.gap[rows.ties])):
        raise InputError("rows.bonded: a bonded point needs a finite gap")
    if not np.all(rows.weights > 0):
        raise InputError("rows.weights: expected lengths or areas, positive")
    frame = np.concatenate((rows.normals[:, None], rows.tangents), axis=1)
    if np.abs(np.einsum("iam,ibm->abm", frame, frame) - np.eye(dim)[:, :, None]).max() > _UNIT:
        raise InputError("rows: normals and tangents are no orthonormal frames")
    if isinstance(body, Bodies):
        _check_axes(body, rows)
    elif rows.owner.size or rows.axes.size:
        raise InputError("rows.owner, rows.axes: there is one body only")
    else:
        _check_along(_means(body, rows), frame)


def _check_body(body: Any) -> None:
    if isinstance(body, LayeredBlock):  # rebuilt from its arguments, which it checks
        return
    mesh, n = body.mesh, body.basis.N
    P, u0 = body.constraint
    for name, facets in (mesh.boundaries or {}).items():
        _whole(f"boundary {name!r}", facets, (None,), mesh.nfacets)
    for name, cells in (mesh.subdomains or {}).items():
        _whole(f"subdomain {name!r}", cells, (None,), mesh.nelements)
    _finite("u0", u0, (n,))
    _finite("constraint", P.data, (None,))
    _check_shape("constraint", P, (n, None))
    held = body.picked.T @ P - sparse.eye_array(P.shape[1])  # orthonormal columns
    if np.abs(held.data).max(initial=0.0) > _UNIT:
        raise InputError("constraint: its columns are not orthonormal")


def _means(body: Any, rows: ContactRows, own: slice = slice(None)) -> Array:
    """Rows G and T applied to the translations of a body with dofs `own`, (m, dim, dim)."""
    m, dim = rows.G.shape[0], body.dim
    G, T = rows.G[:, own], rows.T[:, own]
    if isinstance(body, LayeredBlock):  # the rows are on its lowest cells
        n, body = body.trace.ndofs, body.trace
        if G[:, n:].nnz or T[:, n:].nnz:
            raise InputError("rows: G and T lie on more of a block than its lowest cells")
        G, T = G[:, :n], T[:, :n]
    modes = rigid_field(body, np.zeros(dim))[:, :dim]
    along = (T @ modes).reshape(m, dim - 1, dim)
    return np.concatenate(((G @ modes)[:, None], along), axis=1)


def _check_along(means: Array, frame: Array) -> None:
    """Check means of unit vectors, shape (m, dim, dim), against frames, (dim, dim, m)."""
    # Averages over rotated facets have nearly unit length and a positive component.
    share = np.einsum("mac,cam->ma", means, frame)
    if np.any(share <= 0) or np.any(np.linalg.norm(means, axis=2) > 2):
        raise InputError("rows: G and T do not measure displacements along the frames")


def _check_axes(bodies: Any, rows: ContactRows) -> None:
    """Check the body of each contact point, and the directions of its forces."""
    m, dim = rows.G.shape[0], bodies.dim
    _whole("rows.owner", rows.owner, (m,), len(bodies.bodies))
    _finite("rows.axes", rows.axes, (m, dim, dim))
    _check_along(rows.axes, np.concatenate((rows.normals[:, None], rows.tangents), axis=1))
    moved = np.array(
        [_means(one, rows, own) for one, own in zip(bodies.bodies, bodies.slices, strict=True)]
    )
    of_owner = moved[rows.owner, np.arange(m)]
    others = moved.sum(axis=0) - of_owner
    # The opposite side is another body, a rigid obstacle, or the owner itself; in the last case a
    # translation causes no relative displacement.
    turned = np.abs(of_owner - rows.axes).max(axis=(1, 2)) <= _UNIT
    still = np.abs(of_owner).max(axis=(1, 2)) <= _UNIT
    against = np.abs(others + rows.axes).max(axis=(1, 2)) <= _UNIT
    alone = np.abs(others).max(axis=(1, 2)) <= _UNIT
    if not np.all((turned & (against | alone)) | (still & alone)):
        raise InputError("rows: G and T do not measure displacements of the body that owns them")


def _check_state(state: ContactState) -> None:
    """Check the shapes of a state, finite numbers and nonnegative friction."""
    system = state.system
    body, gap = system.body, system.rows.gap
    n, (m, columns) = body.f.size, (system.rows.G.shape[0], body.dim - 1)
    for name, value, shape in (
        ("load", system.load, (n,)),
        ("u0", body.constraint[1], (n,)),
        ("u", state.u, (n,)),
        ("mu", state.mu, (m,)),
        ("multiplier_t", state.t, (m, columns)),
        ("friction", system.friction, (m,)),
        ("slip_from", system.slip_from, (m, columns)),
        ("moduli", system.moduli, (n,)),
    ):
        if value is not None:
            _finite(name, value, shape)
    _check_shape("gap", gap, (m,))
    if np.any(np.isnan(gap)) or np.any(np.isneginf(gap)):
        raise InputError("gap: holds NaN or minus infinity")
    if system.law not in ("coulomb", "tresca", None):
        raise InputError(f"law={system.law!r}: expected 'coulomb', 'tresca' or None")
    if len(system.overclosure) not in (0, system.rows.part.max(initial=0) + 1):
        raise InputError("overclosure: expected one law for each contact boundary")
    if np.any(system.friction < 0) or (system.law is None and np.any(system.friction > 0)):
        raise InputError(f"friction: negative, or given without a law (law={system.law!r})")
    if system.motion is not None and state.motion is not None:
        k = state.motion.size
        _finite("motion", state.motion, (k,))
        _finite("motion.normal", system.motion.normal, (m, k))
        _finite("motion.tangent", system.motion.tangent, (m * columns, k))
        free = system.motion.free
        _finite("motion.prescribed", system.motion.prescribed[~free], (k - int(free.sum()),))
        _finite("motion.force", system.motion.force[free], (int(free.sum()),))
        if system.motion.travel is not None:
            _finite("motion.travel", system.motion.travel, (m, columns))
        if np.any(state.motion[~free] != system.motion.prescribed[~free]):
            raise InputError("motion: differs from the prescribed one")


def _check_shape(name: str, array: Any, shape: tuple[int | None, ...]) -> None:
    found = array.shape
    if len(found) != len(shape) or any(
        s not in (None, f) for s, f in zip(shape, found, strict=True)
    ):
        raise InputError(f"{name}: expected shape {shape}, got {found}")


def _finite(name: str, array: Any, shape: tuple[int | None, ...]) -> None:
    _check_shape(name, array, shape)
    if array.dtype != np.float64 or not np.all(np.isfinite(array)):
        raise InputError(f"{name}: holds values that are not finite, or no floats")


def _whole(name: str, array: Any, shape: tuple[int | None, ...], count: int) -> None:
    """Check that the entries are integers from 0 to `count` - 1."""
    _check_shape(name, array, shape)
    if array.dtype.kind not in "iu" or (array.size and not 0 <= array.min() <= array.max() < count):
        raise InputError(f"{name}: expected numbers from 0 to {count - 1}")
