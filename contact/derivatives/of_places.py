r"""Derivatives by the vertices of what a body's mesh determines beside its stiffness.

Contact rows, gaps, weights, loads and supports follow from the mesh in many steps (mean normals,
segments of two meshes, closest points). With solution and adjoint fixed, the Lagrangian is a
sum of terms of points and dofs, each of which depends on few vertices. They are differentiated by
central differences of the rules themselves: vertices without a common term move at once (A. R.
Curtis, M. J. D. Powell and J. K. Reid, J. Inst. Maths Applics 13 (1974), 117-119). Their error is
about 1e-9 of the terms. A last difference along random moves checks the sum.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.deferred_basis import DeferredBasis
from contact.body.elastic_body import ElasticBody
from contact.body.several_bodies import Bodies
from contact.body.solid import Surface
from contact.body.vector_element import GRADIENT_DOFS
from contact.derivatives.adjoint import axes_of
from contact.derivatives.of_cells import by_vertices
from contact.derivatives.of_pairs import boolean, coloured, rates
from contact.errors import ContactWarning, InputError, NotConverged
from contact.obstacles.rigid import plain
from contact.obstacles.rigid_motion import matrix_of
from contact.rows.contact_boundaries import ContactBoundaries
from contact.rows.gap_rule import GapRule
from contact.rows.interfaces import Interfaces

Array = NDArray[np.float64]
Terms = Callable[[list[Array]], Array]


class _Limits(NamedTuple):
    step: float = 1e-6  # of the size of a cell; rows of two bodies have kinks in their slopes
    missed: float = 1e-5  # of the check along random moves


LIMITS = _Limits()


def by_places(steps: Sequence[Any], problem: Any) -> list[Array]:
    """Derivatives by nodes, summed over gradients of steps (`ContactGradient`) that share their
    meshes: a list with the shape of the doflocs of each body."""
    first = steps[0].result
    bodies, bent = first.system.body.bodies, _bent(problem)
    total = [np.zeros(body.mesh.doflocs.shape) for body in bodies]

    def of_points(places: list[Array]) -> Array:
        meshes = [moved(body, p) for body, p in zip(bodies, places, strict=True)]
        for body, mask in zip(meshes, bent, strict=True):
            vars(body)["_bent"] = mask
        return np.asarray(sum(_points(problem, meshes, steps)))

    def of_dofs(places: list[Array]) -> Array:
        meshes = [moved(body, p) for body, p in zip(bodies, places, strict=True)]
        known: dict[Any, Array] = {}
        return np.asarray(sum(_dofs(step, meshes, known) for step in steps))

    loaded = [[step.result.system.body.bodies[k] for step in steps] for k in range(len(bodies))]
    for terms, pattern in ((of_points, _near_points(first)), (of_dofs, _near_dofs(loaded))):
        if pattern is not None:
            for part, more in zip(total, _differences(bodies, terms, pattern), strict=True):
                part += more
    slices = first.system.body.slices
    for step in steps:
        for part, body, own in zip(total, bodies, slices, strict=True):
            part += by_vertices(body, step.result.u[own], step.load[own])
    return total


def _points(problem: Any, bodies: list[Any], steps: Sequence[Any]) -> Iterator[Array]:
    """The Lagrangian's terms of contact points, (m,), of each step on moved meshes."""
    body: Any = bodies[0]
    obstacle = steps[0].result.system.obstacle
    if problem.pairs:
        body, pairs = _moved_pairs(problem, bodies)
        sides: Any = Interfaces.of(body, pairs)
    else:
        sides = ContactBoundaries.of(body, problem.boundary, obstacle, problem.functional)
    rows, axes = sides.rows, axes_of(body, sides.rows)
    if rows.gap.size != steps[0].result.mu.size:
        raise InputError("vjp: other contact points appear as vertices move; no derivative exists")
    friction = sides.friction(problem.given_friction)
    if problem.law == "tresca":
        friction = friction * rows.weights
    for step in steps:
        yield _of_points(step, sides, axes, friction)


def _of_points(step: Any, sides: Any, axes: Array, friction: Array) -> Array:
    result, given, found, rows = step.result, step.cotangents, step.adjoint, sides.rows
    system, (m, slips) = result.system, result.t.shape
    motion, free = sides.motion(system.obstacle), ~rows.ties
    # A cotangent of contact forces acts where they are no forces of ties.
    normal = free * (rows.G @ given.forces) - rows.G @ found.load
    tangent = free.repeat(slips) * (rows.T @ given.forces) - rows.T @ found.load
    along = axes @ given.resultant * free[:, None]
    normal, tangent = normal - along[:, 0], tangent.reshape(m, slips) - along[:, 1:]
    u_n, u_t = rows.G @ result.u, (rows.T @ result.u).reshape(m, slips)
    if motion is not None:
        w_n, w_t = motion.displacement(result.motion)
        u_n, u_t = u_n - w_n, u_t - w_t
        normal = normal + motion.normal @ found.force
        tangent = tangent + (motion.tangent @ found.force).reshape(m, slips)
    by_area = given.pressure * result.mu - np.sum(given.shear * result.t, axis=1)
    surface, weights = system.compliance(np.ones(m)), system.rows.weights
    if surface is not None:  # of u_n - d = h(mu / weight)
        closed = system.relative(result.u, result.motion)[0] - system.rows.gap
        slope = surface.at(result.mu, closed, np.zeros(m)).slope
        by_area = by_area - found.normal * slope * weights * result.mu
    gap = np.where(found.normal != 0.0, sides.gap(system.obstacle), 0.0)
    return np.asarray(
        result.mu * normal
        + np.sum(result.t * tangent, axis=1)
        + found.normal * (u_n - gap)
        + np.sum((found.tangent + given.slip) * u_t, axis=1)
        + found.friction * friction
        + by_area / rows.weights
    )


def _bent(problem: Any) -> list[NDArray[np.bool_]]:
    """`Outline.bent` of all facets of each body. On a flat boundary any move would change it, and
    rows with it by terms that are not linear: what is a curve there stays decided."""
    bodies, sides = problem.body.bodies, problem.boundaries
    found = [np.zeros(body.mesh.nfacets, dtype=bool) for body in bodies]
    for side in sides.sides if isinstance(sides, Interfaces) else [sides]:
        for outline in side.outlines:
            k = next(k for k, body in enumerate(bodies) if body.trace is outline.body)
            found[k][outline.facets[outline.bent]] = True
    return found


def _moved_pairs(problem: Any, bodies: list[Any]) -> tuple[Bodies, list[Any]]:
    together, number = Bodies(bodies), problem.body.number_of
    pairs = []
    for pair in problem.pairs:
        other = pair.opposite
        if isinstance(other, Surface):
            other = Surface(bodies[number(other.body)], other.facets, other.clearance)
        pairs.append(replace(pair, body=bodies[number(pair.body)], opposite=other,
                             other=None, clearance=None))  # fmt: skip
    return together, pairs


def _dofs(step: Any, meshes: list[Any], known: dict[Any, Array]) -> Array:
    """The Lagrangian's terms of loads and supports, (ndofs,), on moved meshes; vectors of tractions
    and motions are `known` from one step to the next."""
    result, found, parts = step.result, step.adjoint, []
    solid, reactions = result.system.body, result.reactions
    for body, own, here in zip(solid.bodies, solid.slices, meshes, strict=True):
        down = found.load[own]
        P, u0 = here.constraint
        if P.shape != body.constraint[0].shape:
            raise InputError(
                "vjp: as vertices move along a support, dofs of its derivatives change from free "
                "to prescribed, and no derivative exists; take smooth=True of ElasticBody.fix"
            )
        loads = np.zeros(body.ndofs)
        for name, arguments, factor in body._applied:
            key = id(here), name, id(arguments)
            if key not in known:
                known[key] = vector_of(here, name, arguments)
            if name == "support_motion":
                u0 = u0 + factor * known[key]
            else:
                loads += factor * known[key]
        work = found.support[own] * u0 + down * loads
        if isinstance(body.element, GRADIENT_DOFS):  # derivatives along edges turn with these
            # Only the range of P is defined, so that base vectors are projected onto it.
            free, of_adjoint = (
                P @ (here.picked.T @ v) for v in (result.u[own] - body.constraint[1], down)
            )
            work = work + found.support[own] * free - reactions[own] * of_adjoint
        parts.append(work)
    return np.concatenate(parts)


def vector_of(body: ElasticBody, name: str, arguments: tuple[Any, ...]) -> Array:
    """Load vector of a traction or volume force, or the motion of a support, (ndofs,)."""
    if name == "support_motion":
        return body.support_motion(*arguments)
    body.f = np.zeros(body.ndofs)
    getattr(body, name)(*arguments)
    return body.f


def moved(body: ElasticBody, places: Array) -> ElasticBody:
    """The body on a mesh whose nodes are at other places, with the same supports and no loads."""
    mesh, basis = replace(body.mesh, doflocs=places), body.basis
    object.__setattr__(mesh, "part_of", body.mesh)  # messages about its cells are not repeated
    new = DeferredBasis(mesh, basis.elem, 2)
    new.X, new.W = basis.X, basis.W
    other = ElasticBody(new, body.E, body.nu, body.plane, body.dilatation, body.anisotropy)
    other._supports = body._supports
    return other


def _differences(bodies: tuple[Any, ...], terms: Terms, pattern: sparse.csr_array) -> list[Array]:
    """Gradients of the sum of terms by the nodes of all bodies, from central differences.
    `pattern` (terms, nodes) has entries where a term may depend on a node."""
    places = [body.mesh.doflocs for body in bodies]
    ends = np.cumsum([p.shape[1] for p in places])[:-1]
    size = np.concatenate([_sizes(body.mesh) for body in bodies])
    at, dim = np.hstack(places), places[0].shape[0]
    held = _on_axis(bodies)

    def difference(moves: Array) -> Array:
        ahead, back = (terms(list(np.hsplit(at + sign * moves, ends))) for sign in (1.0, -1.0))
        return np.asarray(ahead - back)

    found, colour = np.zeros(at.shape), coloured(pattern)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ContactWarning)
        for c, way in enumerate(np.eye(dim)[:, :, None]):
            steps = LIMITS.step * size * ~(held & (c == 0))
            of_moves = partial(lambda way, moves: difference(way * moves), way)
            found[c] = rates(of_moves, pattern, colour, steps).sum(axis=0)
        moves = LIMITS.step * size * np.random.default_rng(0).uniform(-1.0, 1.0, at.shape)
        moves[0, held] = 0.0
        change, expected = difference(moves), 2.0 * found * moves
    missed = abs(change.sum() - expected.sum())
    noise = 1e-13 * np.abs(terms(places)).sum()
    if not missed <= LIMITS.missed * max(np.abs(change).sum(), np.abs(expected).sum()) + noise:
        raise NotConverged(
            "vjp: differences by vertices do not add up, because contact rows change by jumps as "
            "vertices move, or depend on distant ones; no derivative is returned"
        )
    return np.hsplit(found, ends)


def _sizes(mesh: Any) -> Array:
    """Diameter of the smallest cell at each node."""
    corners = mesh.p[:, mesh.t]
    size = np.ptp(corners, axis=1).max(axis=0)
    nodes, found = mesh.dofs.element_dofs, np.full(mesh.doflocs.shape[1], np.inf)
    for own in nodes:
        np.minimum.at(found, own, size)
    return found


def _on_axis(bodies: tuple[Any, ...]) -> NDArray[np.bool_]:
    """Nodes on the axis of a ring, which cannot leave it."""
    near = [
        np.abs(body.mesh.doflocs[0]) <= 1e-10 * body.extent
        if body.is_ring
        else np.zeros(body.mesh.doflocs.shape[1], dtype=bool)
        for body in bodies
    ]
    return np.concatenate(near)


def _near_points(result: Any) -> sparse.csr_array:
    """Nodes of the boundary near the dofs of each contact point, (m, nodes)."""
    rows, bodies = result.system.rows, result.system.body.bodies
    m = rows.gap.size
    T = rows.T.copy()
    along = sparse.csr_array(
        (np.ones(T.shape[0]), (np.repeat(np.arange(m), T.shape[0] // m), np.arange(T.shape[0])))
    )
    touched = boolean(abs(rows.G) + along @ abs(T))
    parts = []
    for body, own in zip(bodies, result.system.body.slices, strict=True):
        mesh = body.mesh
        boundary = mesh.boundary_facets()
        cells = np.unique(mesh.f2t[0, boundary])
        on_boundary = np.zeros(mesh.doflocs.shape[1])
        on_boundary[mesh.dofs.get_facet_dofs(boundary).flatten()] = 1.0
        of_dofs = _incidence(body.basis.element_dofs[:, cells], body.ndofs)
        of_nodes = _incidence(mesh.dofs.element_dofs[:, cells], on_boundary.size)
        of_nodes = sparse.csr_array(of_nodes @ sparse.diags_array(on_boundary))
        near = touched[:, own] @ of_dofs.T @ of_nodes
        parts.append(near @ of_nodes.T @ of_nodes)
    return boolean(sparse.csr_array(sparse.hstack(parts, format="csr")))


def _near_dofs(loaded: list[list[Any]]) -> sparse.csr_array | None:
    """Nodes of the cells of each dof that a load or a support varies with, in some step; None if
    there are none. `loaded` has for each body its states in all steps."""
    parts, some = [], False
    for states in loaded:
        body, mesh = states[0], states[0].mesh
        depends = np.zeros(body.ndofs, dtype=bool)
        here = moved(body, mesh.doflocs)
        for name, given in {id(c[1]): c[:2] for state in states for c in state._applied}.values():
            depends |= vector_of(here, name, given) != 0.0
        for state in states:
            depends |= state.constraint[1] != 0.0
        if isinstance(body.element, GRADIENT_DOFS):
            depends |= np.diff(body.constraint[0].indptr) == 0
        some |= bool(depends.any())
        of_dofs = _incidence(body.basis.element_dofs, body.ndofs)
        # A dof beside a loaded one may carry a load as soon as a vertex moves.
        depends = of_dofs.T @ (of_dofs @ depends.astype(float)) > 0
        of_nodes = _incidence(mesh.dofs.element_dofs, mesh.doflocs.shape[1])
        parts.append(sparse.diags_array(depends.astype(float)) @ of_dofs.T @ of_nodes)
    return boolean(sparse.csr_array(sparse.block_diag(parts, format="csr"))) if some else None


def _incidence(numbers: NDArray[Any], count: int) -> sparse.csr_array:
    """Cells by what is in them, (cells, count), from numbers (per cell, cells)."""
    per, cells = numbers.shape
    place = np.tile(np.arange(cells), per), numbers.ravel()
    return sparse.csr_array((np.ones(numbers.size), place), shape=(cells, count))


def by_pose(sides: Any, obstacle: Any, normal: Array, centre: Array) -> Array:
    """Derivatives by a translation, then a rotation about `centre`, of the shape of each boundary,
    shape (nboundaries, dim (dim + 1) / 2); zero opposite elastic bodies. `normal` (m,) is the
    gradient by the gap."""
    several = isinstance(sides, Interfaces)
    each = sides.sides if several else sides.alone
    part = sides.rows.part if sides.rows.part.size else np.zeros(normal.size, dtype=np.int64)
    obstacles = obstacle if several or sides.several else [obstacle]
    found = np.zeros((len(each), centre.size * (centre.size + 1) // 2))
    for k, (side, one) in enumerate(zip(each, obstacles, strict=True)):
        own = normal[part == k]
        if isinstance(side, ContactBoundaries) and np.any(own):
            _of_shape(side.rules[0], plain(one), own, centre, found[k])
    return found


def _of_shape(rule: Any, shape: Any, normal: Array, centre: Array, moves: Array) -> None:
    if not hasattr(shape, "distance") and not hasattr(shape, "motion_from"):
        raise InputError(
            f"pose: a gap given as a {type(shape).__name__} is no shape that moves; chain `gap` "
            "with its own derivatives"
        )
    if not isinstance(rule, GapRule):
        raise InputError("pose: the gap of a CutArc has no derivatives")
    for k in range(moves.size):
        step = LIMITS.step * (rule.size if k < centre.size else 1.0)
        ahead, back = (_seen(rule, shape, k, sign * step, centre) for sign in (1.0, -1.0))
        known = np.isfinite(ahead) & np.isfinite(back)
        change = np.where(known, ahead, 0.0) - np.where(known, back, 0.0)
        moves[k] = normal @ change / (2.0 * step)


def _seen(rule: GapRule, shape: Any, k: int, step: float, centre: Array) -> Array:
    """The gap to a shape that made one small motion: that of the boundary moved back."""
    dim = centre.size
    shift, turn = np.zeros(dim), np.zeros(dim * (dim - 1) // 2)
    (shift if k < dim else turn)[k if k < dim else k - dim] = -step
    Q = matrix_of(turn)

    def place(x: Array) -> Array:
        middle = (...,) + (None,) * (x.ndim - 1)
        return np.tensordot(Q, x - centre[middle], 1) + (centre + shift)[middle]

    def turned(n: Array) -> Array:
        return np.tensordot(Q, n, 1)

    gone = replace(
        rule,
        x=place(rule.x),
        normals=turned(rule.normals),
        x_nominal=place(rule.x_nominal),
        mean_normals=turned(rule.mean_normals),
        offset=None if rule.offset is None else turned(rule.offset),
        aside=None if rule.aside is None else (turned(rule.aside[0]), turned(rule.aside[1])),
    )
    return gone(shape)
