"""Contact rows: normal and tangential displacement of a boundary as sparse functionals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import FacetBasis

from contact.body.elastic_body import ElasticBody
from contact.errors import InputError
from contact.facet_basis import facet_basis
from contact.obstacles.shapes import ObstacleLike
from contact.rows.frames import along_supports, tangent_frame, within_supports
from contact.rows.functionals import facet_functional
from contact.rows.gap_rule import GapRule
from contact.rows.numbering import along, first_occurrence, numbering
from contact.rows.outline import Outline
from contact.rows.shares import Shares, placed_on
from contact.rows.trace_rows import TraceRows
from contact.rows.unequal_facets import Leaning

Array = NDArray[np.float64]
Direction = Callable[[Array], Array]


@dataclass(frozen=True, repr=False)
class ContactRows:
    """The contact boundary, discretised: m points, each with a normal and dim - 1 tangents.

    Attributes
    ----------
    G : csr_array, shape (m, ndofs)
        ``G u`` is the normal displacement u_n along the outward normal of the body.
    T : csr_array, shape (m * (dim - 1), ndofs)
        Tangential displacement; the rows of one point are consecutive.
    gap : ndarray, shape (m,)
        The gap d under the same functional; ``inf`` where there is no obstacle.
    weights : ndarray, shape (m,)
        Length or area of each point: a multiplier (a force) over its weight is a pressure.
    x : ndarray, shape (dim, m)
        Mean place of the functional's dual function: where the pressure is reported.
    x_nominal : ndarray, shape (dim, m)
    normals : ndarray, shape (dim, m)
    tangents : ndarray, shape (dim, dim - 1, m)
    functional : str
    part : ndarray of int, shape (m,)
        Number of the contact boundary of each point; empty where there is one only.
    """

    G: sparse.csr_array
    T: sparse.csr_array
    gap: Array
    weights: Array
    x: Array
    x_nominal: Array
    normals: Array
    tangents: Array
    functional: str
    part: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


def contact_rows(
    body: ElasticBody, facets: NDArray[np.int64], obstacle: ObstacleLike, functional: str | None
) -> ContactRows:
    """Discretise a contact boundary.

    Parameters
    ----------
    body : ElasticBody
    facets : ndarray of int
    obstacle : obstacle, number, callable, array or None
        See `contact.obstacles.shapes`; None means friction without a contact law, a gap of ``inf``.
    functional : str or None
        See `contact.rows.functionals`.

    Raises
    ------
    InputError
        The gap holds NaN or has a wrong shape; the element offers no such functional, or none that
        can be trusted on a curve.
    """
    rows, rule = contact_boundary(body, facets, functional)
    return replace(rows, gap=rule(obstacle))


def contact_boundary(
    body: ElasticBody,
    facets: NDArray[np.int64],
    functional: str | None,
    direction: Direction | None = None,
) -> tuple[ContactRows, GapRule]:
    """Discretise a contact boundary whose obstacle comes later: rows, and how to read a gap.

    Parameters
    ----------
    body, facets, functional
        As for `contact_rows`.
    direction : callable x -> n, optional
        Unit vectors that take the place of the outward normals, see `ClosestPoint`.
    """
    form = facet_functional(body.element, functional)
    outline = Outline(body, facets)
    if form.straight and outline.curved.any():
        if form.name != "gauss":
            raise InputError(
                f"functional={form.name!r}: cannot be trusted on a curved boundary; leave "
                "functional out there"
            )
        form = facet_functional(body.element, None)
    number, count = numbering(outline, form)
    facet, slot = first_occurrence(number, count)
    x_nominal = body.basis.mapping.G(form.nominal, find=facets)[:, facet, slot]

    integrals = _facet_basis(body, facets, None)
    at_points = integrals if form.mean else _facet_basis(body, facets, form.points)
    shares = Shares.of(outline, form, number, integrals)
    x = shares.x
    if form.trace is not None:
        spline = Shares.of(outline, form.trace, numbering(outline, form.trace)[0], integrals)
        x = placed_on(shares, spline, form.trace.basis(form.points))
    trace = TraceRows.of(outline, at_points, shares, direction)
    offset = None
    if form.mean:
        derivatives = body.scalar_dofs.nodal_dofs[1 : 1 + body.dim, outline.corners[facet, slot]]
        offset = trace.scalar[np.arange(count)[None], derivatives].toarray()
        x_nominal = x_nominal + offset
    normals, own, sharp = outline.mean_normals(form.nominal, number, shares.omega)
    slant = np.linalg.norm(own, axis=0)
    G, aside = trace.normal(normals, sharp), None
    if direction is not None:
        normals = direction(x_nominal)
    else:
        normals = within_supports(trace.supported, normals, body.constraint[0])
        leaning = Leaning.of(outline, form, shares)
        G = sparse.csr_array(G + leaning.rows(body.scalar_dofs.nodal_dofs[0], G.shape))
        # At a plane of symmetry the facets beyond it turn the normal back.
        read, turned = (
            within_supports(trace.supported, n / np.linalg.norm(n, axis=0), body.constraint[0])
            for n in (normals if form.mean else own, own + leaning.turn(count))
        )
        aside = read, turned
    tangents = tangent_frame(normals)
    if body.dim == 3:
        tangents = along_supports(trace.supported, tangents, body.constraint[0])

    order = along(outline, form, number, count)
    raised = outline.raised(trace.x, np.asarray(at_points.X))
    rule = GapRule(
        trace.x,
        trace.normals,
        shares,
        x_nominal,
        normals,
        slant,
        sharp,
        order,
        offset,
        raised,
        aside,
    )
    T = [trace.tangential(normals, tangents[:, j], sharp)[order] for j in range(body.dim - 1)]
    interleaved = np.arange(count * (body.dim - 1)).reshape(body.dim - 1, count).T.ravel()
    rows = ContactRows(
        G[order],
        sparse.csr_array(sparse.vstack(T))[interleaved],
        np.full(count, np.inf),
        shares.weights[order],
        x[:, order],
        x_nominal[:, order],
        normals[:, order],
        tangents[:, :, order],
        form.name,
    )
    return rows, rule


def _facet_basis(body: ElasticBody, facets: NDArray[np.int64], points: Array | None) -> FacetBasis:
    """Scalar trace at given reference points, or at Gauss points that integrate x * trace."""
    rule = None if points is None else (points, np.ones(points.shape[1]))
    order = 2 * body.element.maxdeg + 2
    return facet_basis(
        body.mesh, body.element, facets, quadrature=rule, intorder=order, dofs=body.scalar_dofs
    )
