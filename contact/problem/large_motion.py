"""Checks for loaded points that have moved along the obstacle to a different gap.

With a tangential displacement v relative to the obstacle the gap is :math:`d(x + v)`, not d(x) as
in the linearised law. The difference is compared with the penetration that contact removes, taken
as the largest deformation of the body; between two bodies it is found by a new projection. Inverted
cells indicate normal motions that are too large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray
from skfem.refdom import RefHex, RefQuad, RefTet, RefTri

from contact.body.elastic_body import ElasticBody
from contact.body.jacobians import middle_determinants
from contact.errors import CHANGED, InputError, LargeMotionWarning, warn
from contact.laws.status import Status
from contact.laws.surface_checks import jump_between, warn_of_coarse, warn_of_jump, warn_of_wear
from contact.rows.contact_boundaries import ContactBoundaries
from contact.rows.interfaces import Interfaces, facet_lengths

if TYPE_CHECKING:
    from contact.result.contact_result import ContactResult

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Motion:
    """Points that have moved by more than the distance of contact points."""

    points: NDArray[np.int64]  # shape (k,)
    moves: Array  # tangential displacements relative to the obstacle, shape (dim, k)
    spacing: Array  # distance to the next contact point, shape (k,)
    loaded: NDArray[np.bool_]  # under pressure, shape (k,)


def check_motion(
    result: ContactResult,
    boundaries: ContactBoundaries | Interfaces,
    obstacle: Any,
    following: NDArray[np.bool_] | None = None,
) -> None:
    """Warn of, or refuse, a result whose loaded points have moved to a different gap.
    LargeMotionWarning from a quarter of the penetration, for points past a facet and inverted
    cells; InputError beyond the penetration. Points `following` (m,) were projected again."""
    _check_cells(result, boundaries)
    motion = _large(result, boundaries, following)
    if not motion.points.size:
        return
    if isinstance(boundaries, Interfaces):
        opposites = obstacle or [pair.opposite for pair in boundaries.pairs]
        change, elastic = _of_pairs(result, boundaries, opposites, motion)
    else:
        change = boundaries.change_of_gap(obstacle, motion.points, motion.moves)
        elastic = np.zeros(motion.points.size, dtype=bool)
    overlap = -np.minimum(result.gap[motion.points], 0.0).min()  # overclosure of compliant surfaces
    depth = max(result.system.body.deformation(result.u), float(overlap))
    # An open point counts if it would have penetrated.
    off = np.where(motion.loaded, np.abs(change), -(result.gap[motion.points] + change))
    worst = int(off.argmax())
    far = np.linalg.norm(motion.moves, axis=0)
    warned = elastic | (off > CHANGED * depth)
    # With less penetration the body has only been moved into contact.
    if not warned.any() or depth <= 1e-9 * far.max():
        return
    k = worst if off[worst] > CHANGED * depth else int(np.where(elastic, far, 0.0).argmax())
    where = tuple(float(f"{c:.4g}") for c in result.x_nominal[:, motion.points[k]])
    moved = (
        f"the contact point at {where} has moved by {far[k]:.3g} along the obstacle, past "
        f"contact points {motion.spacing[k]:.3g} away"
    )
    remedy = (
        "; let bodies slide and rigid shapes move with LoadStepper(..., sliding='finite'), place a "
        "rigid obstacle where it has moved to (LoadStepper.obstacle), or measure its gap by "
        "ClosestPoint"
    )
    if off[worst] <= depth:
        found = f", and its gap changes by {change[k]:+.3g}" if off[k] > 0 else ""
        warn(f"{moved}{found}: contact is linearised at rest{remedy}", LargeMotionWarning)
        return
    there = (
        "where nothing lies opposite"
        if np.isinf(off[worst])
        else f"where the gap is {change[worst]:+.3g} off the linearised one, more than the "
        f"penetration of about {depth:.3g}"
    )
    raise InputError(f"displacement: {moved}, {there}{remedy}")


def _check_cells(result: ContactResult, boundaries: ContactBoundaries | Interfaces) -> None:
    """Warn if more cells are inverted than at a stress singularity."""
    kept = boundaries.bodies.bodies if isinstance(boundaries, Interfaces) else [boundaries.body]
    for body, own, of_all_steps in zip(result.solid.bodies, result.solid.slices, kept, strict=True):
        if not isinstance(body, ElasticBody):
            continue
        # Twice the largest value bounds the differences of each component.
        if np.sqrt(body.dim) * np.abs(result.u[own]).max() < of_all_steps.turning_move:
            continue
        mesh, dofs = body.mesh, body.scalar_dofs.nodal_dofs[0]
        moves = np.array([result.u[own][body.dim * dofs + c] for c in range(body.dim)])
        if 0.5 * np.linalg.norm(np.ptp(moves, axis=1)) < of_all_steps.turning_move:
            continue
        place = mesh.p[:, : dofs.size]  # without the nodes of curved cells
        rest, now = (middle_determinants(mesh, p) for p in (place, place + moves))
        zone = np.linalg.norm(np.ptp(result.zone, axis=1))
        size = float(zone) if zone > 0 else result.solid.extent
        volumes = {RefTri: 1 / 2, RefQuad: 1.0, RefTet: 1 / 6, RefHex: 1.0}  # of reference cells
        turned = np.abs(rest[rest * now <= 0]).sum() * volumes[mesh.elem.refdom]
        if turned > 0.1 * size**body.dim:
            warn(
                f"cells of the volume {turned:.3g} are turned inside out by the displacements, "
                "in a theory of small ones: the obstacle presses too deep, or the loads are "
                "too large for E",
                LargeMotionWarning,
            )


def _large(
    result: ContactResult,
    boundaries: ContactBoundaries | Interfaces,
    following: NDArray[np.bool_] | None,
) -> _Motion:
    """Points, not bonded, that have moved further than to the next contact point."""
    rows = result.system.rows
    slip = result.slip
    given = result.system.motion
    if given is not None and given.travel is not None:  # the gap is that of the current shape
        slip = slip + given.travel
    far = np.linalg.norm(slip, axis=1)
    loaded = result.mu > 1e-3 * result.mu.max(initial=0.0)
    of_all_steps = boundaries.rows
    spacing = (of_all_steps if of_all_steps.x_nominal is rows.x_nominal else rows).spacing
    stay = ~rows.ties if following is None else ~(rows.ties | following)
    points = np.flatnonzero((far > spacing) & stay & np.isfinite(rows.gap))
    spacing = spacing[points]
    moves = np.einsum("cjm,mj->cm", rows.tangents[:, :, points], slip[points])
    return _Motion(points, moves, spacing, loaded[points])


def _of_pairs(
    result: ContactResult,
    interfaces: Interfaces,
    opposites: Sequence[Any],
    motion: _Motion,
) -> tuple[Array, NDArray[np.bool_]]:
    """Change of the gap at the points, 0 if unknown, and which have moved past a facet."""
    change = np.zeros(motion.points.size)
    elastic = np.zeros(motion.points.size, dtype=bool)
    first = np.searchsorted(result.part, np.arange(len(interfaces.pairs)))
    meshed = all(isinstance(body, ElasticBody) for body in interfaces.bodies.bodies)
    for k, (opposite, side) in enumerate(zip(opposites, interfaces.sides, strict=True)):
        here = np.flatnonzero(result.part[motion.points] == k)
        if not here.size:
            continue
        if isinstance(side, ContactBoundaries):
            own = motion.points[here] - first[k]
            change[here] = side.change_of_gap(opposite, own, motion.moves[:, here])
        else:
            outline, x = side.first, result.x_nominal[:, motion.points[here]]
            middle = outline.body.mesh.p[:, outline.corners].mean(axis=2)
            nearest = scipy.spatial.KDTree(middle.T).query(x.T)[1]
            far = np.linalg.norm(motion.moves[:, here], axis=0)
            elastic[here] = motion.loaded[here] & (far > facet_lengths(outline)[nearest])
            here = here[motion.loaded[here]]
            if here.size and meshed and side.first.body is not side.second.body:
                change[here] = _projected(result, interfaces, k, motion.points[here])
    return change, elastic


def _projected(
    result: ContactResult, interfaces: Interfaces, k: int, points: NDArray[np.int64]
) -> Array:
    """Gaps of a displaced pair of bodies minus the linearised ones, ``inf`` if there is none."""
    try:
        now = interfaces.displaced(result.u).rows
    except InputError:  # no facet of a pair faces another one
        return np.full(points.size, np.inf)
    rows, bodies = result.system.rows, interfaces.bodies
    of_owner = np.zeros(result.u.size)  # displacement of the body that has the points
    own = bodies.slices[rows.owner[points[0]]]
    of_owner[own] = result.u[own]
    n, t = (rows.G @ of_owner)[points], (rows.T @ of_owner).reshape(rows.gap.size, -1)[points]
    moved = rows.normals[:, points] * n + np.einsum("cjm,mj->cm", rows.tangents[:, :, points], t)
    there = np.flatnonzero(now.boundary == k)
    tree = scipy.spatial.KDTree(now.x_nominal[:, there].T)
    near = scipy.spatial.KDTree(rows.x_nominal.T[result.part == k])
    size = np.asarray(near.query(rows.x_nominal[:, points].T, 2)[0])[:, 1]
    distance, nearest = tree.query((rows.x_nominal[:, points] + moved).T)
    left = (now.gap - now.G @ result.u)[there[nearest]] - result.gap[points]
    return np.where(distance <= 0.5 * size, left, np.inf)


def with_jump(result: Any, last: Any, far: bool = False) -> Any:
    """The result with its `jump` since the last step; warns of it, and of deep wear.
    Where obstacles move `far`, points in contact change, and a jump is that of all."""
    surface = result.system.surface
    if surface is None:
        return result
    warn_of_wear(result.worn, _spacing(result.system))
    if surface.adhesion is not None:
        warn_of_coarse(surface.ramps, result.gap, surface.adhesion)
    if surface.adhesion is None or last is None or last.mu.size != result.mu.size:
        return result
    touched, touches = (
        (one.status != Status.OPEN) & ~one.system.rows.ties for one in (last, result)
    )
    gap, was = (np.maximum(one.gap, 0.0) for one in (result, last))
    if far and touched.any() == touches.any():
        return result
    jump = jump_between(touched, was, touches, gap, surface.adhesion.range)
    warn_of_jump(jump)
    return replace(result, jump=jump)


def _spacing(system: Any) -> float:
    """The median distance of contact points, from their areas."""
    weights, dim = system.rows.weights, system.body.dim
    if system.body.is_ring:
        weights = weights / (2 * np.pi * np.maximum(system.rows.x[0], 1e-300))
    return float(np.median(weights)) ** (1.0 if dim == 2 else 0.5)
