r"""Discretisation of a contact boundary: its contact rows, and the rule that evaluates its gap.

Where straight facets of unequal size approximate a curve, `Leaning` corrects the normal rows.
The normal displacement of a contact point is :math:`\bar n \cdot u` at its vertex. Where facets
differ in length the mean normal is :math:`\bar n = n + \beta t`, which adds :math:`\beta u_t`, of
alternating sign, to the normal displacement: the pressure oscillates on any mesh.

Exactness for a uniform pressure requires the mean normals. Each facet therefore adds to the row of
its corner k :math:`\omega_k (n_k - \tfrac1\omega \sum_j \omega_j n_j)` times the displacement of
the point whose smooth normal is that of the facet, n_k being the smooth normals at corners. The sum
over corners is zero; the sum over the facets of a vertex turns :math:`\bar n` into n to second
order.

On triangles a straight edge ij in place of a parabola adds, by the divergence theorem,
:math:`\nu l \, (n_i - n_j) \cdot (x_i - x_j) / 36`, with the edge's outward normal :math:`\nu`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import FacetBasis

from contact.body.elastic_body import ElasticBody
from contact.body.supports import few_times, norms
from contact.errors import InputError
from contact.facet_basis import facet_basis
from contact.obstacles.shapes import ObstacleLike
from contact.rows.contact_rows import ContactRows
from contact.rows.frames import (
    along_supports,
    by_point,
    directed,
    tangent_frame,
    turned_tangents,
    within_supports,
)
from contact.rows.functionals import FacetFunctional, facet_functional
from contact.rows.gap_rule import GapRule
from contact.rows.numbering import along, first_occurrence, numbering
from contact.rows.outline import Outline
from contact.rows.shares import Shares, facet_functions, placed_on
from contact.rows.tool_rows import BoundaryPoints

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Direction = Callable[[Array], Array]


def contact_rows(
    body: ElasticBody, facets: NDArray[np.int64], obstacle: ObstacleLike, functional: str | None
) -> ContactRows:
    """Discretise a contact boundary; without an obstacle (None) the gap is infinite.
    Raises InputError for a gap that is NaN or of a wrong shape, or an unsuitable functional."""
    rows, rule = contact_boundary(body, facets, functional)
    return replace(rows, gap=rule(obstacle))


def contact_boundary(
    body: ElasticBody,
    facets: NDArray[np.int64],
    functional: str | None,
    direction: Direction | None = None,
) -> tuple[ContactRows, GapRule]:
    """Discretise a contact boundary without its obstacle: rows, and the rule for its gap.
    `direction` x -> n replaces the outward normals, see `ClosestPoint`."""
    outline = Outline(body, facets)
    form = _usable(outline, functional)
    number, count = numbering(outline, form)
    integrals = _facet_basis(body, facets, None)
    at_points = integrals if form.mean else _facet_basis(body, facets, form.points)
    shares = Shares.of(outline, form, number, integrals)
    trace = TraceRows.of(outline, at_points, shares, direction)
    x_nominal, offset = _nominal_places(trace, form, number, count)
    means, own, sharp = outline.mean_normals(form.nominal, number, shares.omega)
    if direction is None:
        G, normals, aside = _along_normals(trace, form, means, own, sharp)
    else:
        G, normals, aside = trace.normal(means, sharp), direction(x_nominal), None
    tangents = tangent_frame(normals)
    if body.dim == 3:
        tangents = along_supports(trace.supported, tangents, body.constraint[0])
    order, sides = along(outline, form, number, count), tangents.transpose(1, 0, 2)
    rule = GapRule(
        trace.x,
        trace.normals,
        shares,
        x_nominal,
        normals,
        np.linalg.norm(own, axis=0),
        sharp,
        order,
        body.extent,
        form.between,
        offset,
        outline.raised(trace.x, np.asarray(at_points.X)),
        aside,
        (outline, form),
    )
    rows = ContactRows(
        G[order],
        by_point([trace.tangential(normals, along, sharp)[order] for along in sides]),
        np.full(count, np.inf),
        shares.weights[order],
        _mean_places(outline, form, shares, integrals)[:, order],
        x_nominal[:, order],
        normals[:, order],
        tangents[:, :, order],
        form.name,
    )
    return rows, rule


def point_functions(rule: GapRule) -> tuple[FacetBasis, sparse.csr_array]:
    """Trace of the scalar element at Gauss points, and the functions N_k of the contact points
    there, (nfacets * npoints, m). Raises InputError for a functional whose N_k change sign."""
    assert rule.source is not None
    (outline, form), shares, count = rule.source, rule.shares, rule.order.size
    integrals = _facet_basis(outline.body, outline.facets, None)
    N = np.einsum("fst,ftq->fqs", shares.mix, facet_functions(outline, form, integrals)[0])
    if N.min() < -1e-9:  # rounding of polynomials that are not negative
        raise InputError(
            f"functional={form.name!r}: its contact points have no positive shares of the boundary "
            "to conduct heat by; leave functional out"
        )
    place = np.empty(count, dtype=np.int64)
    place[rule.order] = np.arange(count)
    column = np.broadcast_to(place[shares.number][:, None], N.shape).ravel()
    row = np.repeat(np.arange(N[..., 0].size), N.shape[2])
    shape = N[..., 0].size, count
    return integrals, sparse.csr_array(sparse.coo_array((N.ravel(), (row, column)), shape=shape))


def boundary_points(rule: GapRule) -> BoundaryPoints:
    """The points at which the rows read the trace; of ``centroid`` the contact points."""
    assert rule.source is not None
    (outline, form), shares, body = rule.source, rule.shares, rule.source[0].body
    if form.mean:
        mean = TraceRows.of(outline, _facet_basis(body, outline.facets, None), shares, None)
        x, normals = (v[:, rule.order] for v in (rule.x_nominal, rule.mean_normals))
        return BoundaryPoints(
            sparse.eye_array(x.shape[1], format="csr"), mean.scalar[rule.order], x, normals
        )
    basis, count = _facet_basis(body, outline.facets, form.points), form.points.shape[1]
    values = np.stack([np.asarray(field[0]) for field in basis.basis], axis=-1)
    dofs = np.asarray(basis.element_dofs.T, dtype=np.int64)
    on_facet = (dofs[:, None, :] == outline.scalar_dofs[..., None]).any(axis=1)
    values = values * on_facet[:, None]
    row = np.arange(outline.facets.size * count).reshape(-1, count)
    N = _collected(values, row[..., None], dofs[:, None], (row.size, body.scalar_dofs.N))
    number, shape = shares.number[..., None], (shares.weights.size, row.size)
    P = _collected(shares.C / shares.weights[number], number, row[:, None], shape)
    x, normals = (v.reshape(len(v), -1) for v in (rule.x, rule.normals))
    return BoundaryPoints(sparse.csr_array(P[rule.order]), N, x, normals)


def _collected(
    values: Array, rows: Index, columns: Index, shape: tuple[int, int]
) -> sparse.csr_array:
    """Sparse matrix of values at places that broadcast, without zeros."""
    i, k = (np.broadcast_to(v, values.shape).ravel() for v in (rows, columns))
    found = sparse.csr_array(sparse.coo_array((values.ravel(), (i, k)), shape=shape))
    found.eliminate_zeros()
    return found


def _usable(outline: Outline, functional: str | None) -> FacetFunctional:
    """The functional of that name; on a curve the default of the element replaces ``gauss``.
    Raises InputError for other functionals that require straight boundaries, and for ``gauss`` on a
    cubic trace of an axisymmetric body."""
    element = outline.body.element
    form = facet_functional(element, functional)
    if form.trace is not None and outline.body.is_ring:
        raise InputError(
            f"functional={form.name!r}: two Gauss points do not integrate a cubic trace times the "
            "radius, so that a uniform pressure of an axisymmetric body would be a fifth off at "
            "the axis; leave functional out, or take 'centroid'"
        )
    if not (form.straight and outline.curved.any()):
        return form
    if form.name != "gauss":
        raise InputError(
            f"functional={form.name!r}: cannot be trusted on a curved boundary; leave "
            "functional out there"
        )
    return facet_functional(element, None)


def _nominal_places(
    trace: TraceRows, form: FacetFunctional, number: Index, count: int
) -> tuple[Array, Array | None]:
    """Nominal position of each contact point, and its offset from the vertex for ``centroid``."""
    outline, (facet, slot) = trace.outline, first_occurrence(number, count)
    body = outline.body
    x = body.basis.mapping.G(form.nominal, find=outline.facets)[:, facet, slot]
    if not form.mean:
        return x, None
    derivatives = body.scalar_dofs.nodal_dofs[1 : 1 + body.dim, outline.corners[facet, slot]]
    offset = trace.scalar[np.arange(count)[None], derivatives].toarray()
    return x + offset, offset


def _mean_places(
    outline: Outline, form: FacetFunctional, shares: Shares, integrals: FacetBasis
) -> Array:
    """Centroid of the dual function of each contact point, shape (dim, m)."""
    if form.trace is None:
        return shares.x
    spline = Shares.of(outline, form.trace, numbering(outline, form.trace)[0], integrals)
    return placed_on(shares, spline, form.trace.basis(form.points))


def _along_normals(
    trace: TraceRows, form: FacetFunctional, means: Array, own: Array, sharp: NDArray[np.bool_]
) -> tuple[sparse.csr_array, Array, tuple[Array, Array]]:
    """Rows of the normal displacement, their normals, and `GapRule.aside`.
    `means`, `own` and `sharp` are the results of `Outline.mean_normals`."""
    outline, shares, P = trace.outline, trace.shares, trace.outline.body.constraint[0]
    G = trace.normal(means, sharp)
    normals = within_supports(trace.supported, means, P)
    leaning = Leaning.of(outline, form, shares)
    G = sparse.csr_array(G + leaning.rows(outline.body.scalar_dofs.nodal_dofs[0], G.shape))
    # At a plane of symmetry the mirrored facets cancel the component normal to it.
    read, turned = (
        within_supports(trace.supported, n / np.linalg.norm(n, axis=0), P)
        for n in (normals if form.mean else own, own + leaning.turn(means.shape[1]))
    )
    return G, normals, (read, turned)


def _facet_basis(body: ElasticBody, facets: NDArray[np.int64], points: Array | None) -> FacetBasis:
    """Scalar trace at given reference points, or at Gauss points exact for x times the trace."""
    rule = None if points is None else (points, np.ones(points.shape[1]))
    order = 2 * body.element.maxdeg + 2
    return facet_basis(
        body.mesh, body.element, facets, quadrature=rule, intorder=order, dofs=body.scalar_dofs
    )


@dataclass(frozen=True)
class TraceRows:
    """The trace of a body on its contact facets, at the points of the functional."""

    outline: Outline
    shares: Shares
    x: Array  # points of the functional, shape (dim, nfacets, npoints)
    normals: Array  # facet normals, along which contact acts, shape as x
    smooth: Array  # smooth normals, for the tangents, shape as x
    parts: Array  # maps functions to values, (nfacets, nvalues, npoints, nfunctions)
    dofs: NDArray[np.int64]  # scalar dofs of the functions, shape (nfacets, nfunctions)

    @classmethod
    def of(
        cls,
        outline: Outline,
        basis: FacetBasis,
        shares: Shares,
        direction: Callable[[Array], Array] | None,
    ) -> TraceRows:
        """Evaluate the trace with a scalar basis at the points of the functional.
        `direction` x -> n replaces the normals."""
        x, points = np.asarray(basis.global_coordinates()), np.asarray(basis.X)
        values = np.stack([np.asarray(field[0]) for field in basis.basis], axis=-1)
        dofs = np.asarray(basis.element_dofs.T, dtype=np.int64)
        if shares.mean:
            carried = outline.body.scalar_dofs.nodal_dofs[:, outline.corners]
            mine = (dofs[:, None, :] == carried[..., None]).any(axis=0)
            measure = np.asarray(basis.dx) * outline.body.depth(x)
            parts = (values * measure[..., None])[:, None] * mine[:, :, None]
        else:
            # All other functions vanish on the facet, up to rounding of the coordinates.
            on_facet = (dofs[:, None, :] == outline.scalar_dofs[..., None]).any(axis=1)
            parts = shares.C[..., None] * (values * on_facet[:, None])[:, None]
        normals = np.asarray(basis.normals) if direction is None else direction(x)
        smooth = outline.smooth(normals, points) if direction is None else normals
        return cls(outline, shares, x, normals, smooth, parts, dofs)

    @cached_property
    def scalar(self) -> sparse.csr_array:
        """Rows of a scalar trace, shape (m, scalar dofs)."""
        return self._rows(self.parts.sum(axis=2)[None], 1)

    @cached_property
    def supported(self) -> sparse.csr_array:
        """Rows of a scalar trace that decide whether supports fix a contact point.
        At a plane of symmetry the vertex decides: the mean over the modelled half may cross the
        plane, but the mean over both halves may not."""
        hub = self.shares.hub
        k, place = np.unique(self.shares.number[hub >= 0], return_index=True)
        value = self.outline.body.scalar_dofs.nodal_dofs[0, hub[hub >= 0][place]]
        vertex = sparse.csr_array((np.ones(k.size), (k, value)), shape=self.scalar.shape)
        rest = np.ones(self.scalar.shape[0])
        rest[k] = 0.0
        return sparse.csr_array(vertex + sparse.diags_array(rest) @ self.scalar)

    def normal(self, normals: Array, sharp: NDArray[np.bool_]) -> sparse.csr_array:
        """Rows of the normal displacement, (m, ndofs); along `normals` (dim, m) in `sharp` corners,
        elsewhere along the normals of the facets."""
        rows = self._rows(np.einsum("fspb,cfp->cfsb", self.parts, self.normals), self.dim)
        return _chosen(sharp, directed(self.scalar, normals), rows)

    def tangential(
        self, normals: Array, tangents: Array, sharp: NDArray[np.bool_]
    ) -> sparse.csr_array:
        """Rows of the displacement along one tangent (dim, m) per contact point, (m, ndofs).
        The tangents follow the smooth normals along the facets, except in corners and where
        supports fix a point in the direction of its tangent."""
        number = self.shares.number
        mean, along = (
            np.broadcast_to(v[:, number][..., None], (self.dim, *self.parts.shape[:3]))
            for v in (normals, tangents)
        )
        here = np.broadcast_to(self.smooth[:, :, None], mean.shape)
        turned = turned_tangents(along[:, None], mean, here)[:, 0]
        rows = self._rows(np.einsum("fspb,cfsp->cfsb", self.parts, turned), self.dim)
        rows = _chosen(sharp, directed(self.scalar, tangents), rows)
        # Supports fix this direction if the row vanishes, up to rounding, on the free unknowns.
        straight, P = directed(self.supported, tangents), self.outline.body.constraint[0]
        return _chosen(norms(few_times(straight, P)) <= 1e-9 * norms(straight), straight, rows)

    @property
    def dim(self) -> int:
        """Number of components."""
        return self.outline.body.dim

    def _rows(self, values: Array, components: int) -> sparse.csr_array:
        """Sum the parts (components, nfacets, nvalues, nfunctions) of all facets."""
        body, (_, facets, slots, functions) = self.outline.body, values.shape
        shape = components, facets, slots, functions
        number = np.broadcast_to(self.shares.number[None, :, :, None], shape)
        component = np.arange(components)[:, None, None, None]
        column = np.broadcast_to(components * self.dofs[None, :, None] + component, shape)
        size = self.shares.weights.size, components * body.scalar_dofs.N
        place = number.ravel(), column.ravel()
        result = sparse.csr_array(sparse.coo_array((values.ravel(), place), shape=size))
        result.data *= np.repeat(1.0 / self.shares.weights, np.diff(result.indptr))
        # Drop rounding: a direction along an axis has one component.
        length = body.lengths[0][body.dim * (result.indices // components)]
        result.data[np.abs(result.data) < 1e-11 * length] = 0.0
        result.eliminate_zeros()
        return result


def _chosen(
    where: NDArray[np.bool_], rows: sparse.csr_array, other: sparse.csr_array
) -> sparse.csr_array:
    """Rows of the first matrix where chosen, of the second elsewhere."""
    both = sparse.csr_array(sparse.vstack([rows, other], format="csr"))
    result = sparse.csr_array(both[np.arange(where.size) + np.where(where, 0, where.size)])
    result.eliminate_zeros()
    return result


@dataclass(frozen=True)
class Leaning:
    """Corrections of the normal rows by vertex displacements, where facets differ in length."""

    point: Index  # contact point of each term, shape (n,)
    vertex: Index  # mesh vertex of each term, shape (n,)
    part: Array  # coefficients of its displacement over the point's weight, shape (dim, n)

    @classmethod
    def of(cls, outline: Outline, form: FacetFunctional, shares: Shares) -> Leaning:
        """The terms of the facets of a boundary."""
        dim, slot = outline.body.dim, form.corners
        bent = np.flatnonzero(outline.bent & (slot.size > 0))
        if not bent.size:
            nowhere = np.zeros(0, dtype=np.int64)
            return cls(nowhere, nowhere, np.zeros((dim, 0)))
        corners, number = outline.corners[bent], shares.number[bent][:, slot]
        normal, omega = outline.turned[:, bent], shares.omega[bent][:, slot]
        mean = np.sum(omega * normal, axis=2) / omega.sum(axis=1)
        # ``centroid`` evaluates u a sixth of a facet from the vertex: two thirds remain.
        part = omega * (normal - mean[:, :, None]) * (2.0 / 3.0 if shares.mean else 1.0)
        count = corners.shape[1]
        shape = len(bent), count, count
        point = [np.broadcast_to(number[:, :, None], shape).ravel()]
        vertex = [np.broadcast_to(corners[:, None], shape).ravel()]
        share = _at_their_normals(normal, outline.at_corners[:, bent].mean(axis=2))
        parts = [(part[..., None] * share[:, None]).reshape(dim, -1)]
        if count == 3:
            for k, v, moved in _edges(outline, corners, number, normal):
                point.append(k)
                vertex.append(v)
                parts.append(moved)
        k = np.concatenate(point)
        return cls(k, np.concatenate(vertex), np.hstack(parts) / shares.weights[k])

    def turn(self, count: int) -> Array:
        """Change of the normals of the contact points, shape (dim, count)."""
        return np.array([np.bincount(self.point, part, count) for part in self.part])

    def rows(self, value: Index, shape: tuple[int, int]) -> sparse.csr_array:
        """The terms as a sparse matrix (m, ndofs), by the scalar dofs of the vertices' values."""
        dim = len(self.part)
        column = dim * value[self.vertex] + np.arange(dim)[:, None]
        place = np.broadcast_to(self.point, column.shape).ravel(), column.ravel()
        return sparse.coo_array((self.part.ravel(), place), shape=shape).tocsr()


def _at_their_normals(normal: Array, own: Array) -> Array:
    """Barycentric weights of the point whose smooth normal is the facet's, (nfacets, ncorners).
    Of several such points the one nearest to the middle is taken. A uniformly shrinking polygon has
    no tangential displacement there."""
    count = normal.shape[2]
    lean = normal - own[:, :, None]
    lean = lean - np.sum(lean * own[:, :, None], axis=0) * own[:, :, None]
    lean = lean.transpose(1, 0, 2)
    lean = lean / np.linalg.norm(lean, axis=(1, 2), keepdims=True)
    equations = np.concatenate((lean, np.full((len(lean), 1, count), 1.0)), axis=1)
    wrong = np.concatenate((-lean.mean(axis=2), np.zeros((len(lean), 1))), axis=1)
    # rcond drops directions with little curvature, which do not determine the point. A point far
    # outside the facet is replaced by the middle.
    off = np.einsum("fkc,fc->fk", np.linalg.pinv(equations, rcond=0.05), wrong)
    off = np.where(np.abs(off).max(axis=1, keepdims=True) < 1.0, off, 0.0)
    return np.asarray(off + 1.0 / count)


def _edges(
    outline: Outline, corners: Index, number: Index, normal: Array
) -> list[tuple[Index, Index, Array]]:
    """Terms of the corner opposite to each edge of a triangle, at the two ends of the edge."""
    x = outline.body.mesh.p[:, corners]
    across = np.cross(x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0], axis=0)
    across /= np.linalg.norm(across, axis=0)
    apex, i, j = np.arange(3), np.array([1, 2, 0]), np.array([2, 0, 1])
    edge, step = x[..., j] - x[..., i], normal[..., j] - normal[..., i]
    out = np.cross(edge, across[..., None], axis=0)  # l times nu
    size = np.sum(edge * step, axis=0) / 36.0
    ends = np.sort(np.stack((corners[:, i], corners[:, j])), axis=0).reshape(2, -1)
    _, which, met = np.unique(ends, axis=1, return_inverse=True, return_counts=True)
    which = which.ravel()
    order = np.argsort(which, kind="stable")
    one, two = order[met[which[order]] == 2].reshape(-1, 2).T
    out, size = out.reshape(3, -1), size.ravel()
    moved = 0.5 * (out[:, one] - out[:, two]) * 0.5 * (size[one] + size[two])
    point = number[:, apex].ravel()
    found = []
    for end in ends:
        found.append((point[one], end[one], -0.5 * moved))
        found.append((point[two], end[one], 0.5 * moved))
    return found
