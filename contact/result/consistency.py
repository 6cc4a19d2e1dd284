"""Checks that the arrays of a problem and of a state, read from a file, fit each other.

A file may hold anything. These conditions are checked before the arrays are used, and in addition
to the residuals of the equations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.layers.layered_block import LayeredBlock
from contact.body.rigid_modes import rigid_field
from contact.body.several_bodies import Bodies
from contact.errors import InputError

if TYPE_CHECKING:
    from contact.body.solid import Solid
    from contact.result.contact_state import ContactState
    from contact.rows.contact_rows import ContactRows

Array = NDArray[np.float64]
# Of unit vectors and of rows that average a constant: rounding of a few dozen terms.
_UNIT = 1e-9


def check_mesh(p: Array, t: NDArray[np.int64], kind: Any) -> None:
    """Vertices are finite, and cells refer to existing ones; scikit-fem checks neither.

    Raises
    ------
    InputError
    """
    dim, nodes = kind.elem.refdom.dim(), kind.elem.refdom.nnodes
    _finite("p", p, (dim, None))
    _whole("t", t, (nodes, None), p.shape[1])


def check_problem(body: Solid, rows: ContactRows) -> None:
    """Shapes and ranges of a problem, and that rows measure displacements along their frames.

    Raises
    ------
    InputError
    """
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
    if isinstance(body, LayeredBlock):  # made anew from its arguments, which it has checked
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
    if isinstance(body, LayeredBlock):  # the rows are those of its lowest cells
        n, body = body.trace.ndofs, body.trace
        if G[:, n:].nnz or T[:, n:].nnz:
            raise InputError("rows: G and T lie on more of a block than its lowest cells")
        G, T = G[:, :n], T[:, :n]
    modes = rigid_field(body, np.zeros(dim))[:, :dim]
    along = (T @ modes).reshape(m, dim - 1, dim)
    return np.concatenate(((G @ modes)[:, None], along), axis=1)


def _check_along(means: Array, frame: Array) -> None:
    """Check means of unit vectors, shape (m, dim, dim), against frames, (dim, dim, m)."""
    # Averages over facets that turn are nearly of length one, and never point backwards.
    share = np.einsum("mac,cam->ma", means, frame)
    if np.any(share <= 0) or np.any(np.linalg.norm(means, axis=2) > 2):
        raise InputError("rows: G and T do not measure displacements along the frames")


def _check_axes(bodies: Any, rows: ContactRows) -> None:
    """Check which body has each contact point, and the directions in which its forces act."""
    m, dim = rows.G.shape[0], bodies.dim
    _whole("rows.owner", rows.owner, (m,), len(bodies.bodies))
    _finite("rows.axes", rows.axes, (m, dim, dim))
    _check_along(rows.axes, np.concatenate((rows.normals[:, None], rows.tangents), axis=1))
    moved = np.array(
        [_means(one, rows, own) for one, own in zip(bodies.bodies, bodies.slices, strict=True)]
    )
    of_owner = moved[rows.owner, np.arange(m)]
    others = moved.sum(axis=0) - of_owner
    # Opposite is another body, which moves against the owner; a rigid obstacle; or the owner
    # itself, and then a translation moves nothing.
    turned = np.abs(of_owner - rows.axes).max(axis=(1, 2)) <= _UNIT
    still = np.abs(of_owner).max(axis=(1, 2)) <= _UNIT
    against = np.abs(others + rows.axes).max(axis=(1, 2)) <= _UNIT
    alone = np.abs(others).max(axis=(1, 2)) <= _UNIT
    if not np.all((turned & (against | alone)) | (still & alone)):
        raise InputError("rows: G and T do not measure displacements of the body that owns them")


def check_state(state: ContactState) -> None:
    """Shapes of a state, finite numbers, friction that is not negative.

    Raises
    ------
    InputError
    """
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
