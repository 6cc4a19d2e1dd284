"""Discretisation of a contact boundary: its contact rows, and the rule that evaluates its gap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import FacetBasis

from contact.body.elastic_body import ElasticBody
from contact.errors import InputError
from contact.facet_basis import facet_basis
from contact.obstacles.shapes import ObstacleLike
from contact.rows.contact_rows import ContactRows
from contact.rows.frames import along_supports, tangent_frame, within_supports
from contact.rows.functionals import FacetFunctional, facet_functional
from contact.rows.gap_rule import GapRule
from contact.rows.numbering import along, first_occurrence, numbering
from contact.rows.outline import Outline
from contact.rows.shares import Shares, placed_on
from contact.rows.trace_rows import TraceRows
from contact.rows.unequal_facets import Leaning

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Direction = Callable[[Array], Array]


def contact_rows(
    body: ElasticBody, facets: NDArray[np.int64], obstacle: ObstacleLike, functional: str | None
) -> ContactRows:
    """Discretise a contact boundary; without an obstacle (None) the gap is infinite.
    Raises InputError for a gap that is NaN or of a wrong shape, or a functional that the element
    does not have or that is not accurate on a curve."""
    rows, rule = contact_boundary(body, facets, functional)
    return replace(rows, gap=rule(obstacle))


def contact_boundary(
    body: ElasticBody,
    facets: NDArray[np.int64],
    functional: str | None,
    direction: Direction | None = None,
) -> tuple[ContactRows, GapRule]:
    """Discretise a contact boundary without its obstacle: rows, and the rule for its gap.
    `direction` x -> n gives unit vectors in place of the outward normals, see `ClosestPoint`."""
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
    order = along(outline, form, number, count)
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
    )
    rows = ContactRows(
        G[order],
        _along_tangents(trace, normals, tangents, sharp, order),
        np.full(count, np.inf),
        shares.weights[order],
        _mean_places(outline, form, shares, integrals)[:, order],
        x_nominal[:, order],
        normals[:, order],
        tangents[:, :, order],
        form.name,
    )
    return rows, rule


def _usable(outline: Outline, functional: str | None) -> FacetFunctional:
    """The functional of that name; on a curve the default of the element replaces ``gauss``.
    Raises InputError for another functional of straight boundaries on a curve, and for ``gauss`` on
    a cubic trace of an axisymmetric body."""
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
    """Nominal place of each contact point, and its offset from the vertex for ``centroid``."""
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
    """Mean place of the dual function of each contact point, shape (dim, m)."""
    if form.trace is None:
        return shares.x
    spline = Shares.of(outline, form.trace, numbering(outline, form.trace)[0], integrals)
    return placed_on(shares, spline, form.trace.basis(form.points))


def _along_normals(
    trace: TraceRows, form: FacetFunctional, means: Array, own: Array, sharp: NDArray[np.bool_]
) -> tuple[sparse.csr_array, Array, tuple[Array, Array]]:
    """Rows of the normal displacement, their normals, and the two arrays of `GapRule.aside`.
    `means`, `own` and `sharp` are the results of `Outline.mean_normals`."""
    outline, shares, P = trace.outline, trace.shares, trace.outline.body.constraint[0]
    G = trace.normal(means, sharp)
    normals = within_supports(trace.supported, means, P)
    leaning = Leaning.of(outline, form, shares)
    G = sparse.csr_array(G + leaning.rows(outline.body.scalar_dofs.nodal_dofs[0], G.shape))
    # At a plane of symmetry the mirror images of the facets cancel the component normal to it.
    read, turned = (
        within_supports(trace.supported, n / np.linalg.norm(n, axis=0), P)
        for n in (normals if form.mean else own, own + leaning.turn(means.shape[1]))
    )
    return G, normals, (read, turned)


def _along_tangents(
    trace: TraceRows, normals: Array, tangents: Array, sharp: NDArray[np.bool_], order: Index
) -> sparse.csr_array:
    """Rows of the tangential displacement, sorted, those of one contact point together."""
    count, columns = order.size, tangents.shape[1]
    T = [trace.tangential(normals, tangents[:, j], sharp)[order] for j in range(columns)]
    together = np.arange(count * columns).reshape(columns, count).T.ravel()
    return sparse.csr_array(sparse.vstack(T))[together]


def _facet_basis(body: ElasticBody, facets: NDArray[np.int64], points: Array | None) -> FacetBasis:
    """Scalar trace at given reference points, or at Gauss points exact for x times the trace."""
    rule = None if points is None else (points, np.ones(points.shape[1]))
    order = 2 * body.element.maxdeg + 2
    return facet_basis(
        body.mesh, body.element, facets, quadrature=rule, intorder=order, dofs=body.scalar_dofs
    )
