r"""Positive bases N_k of the trace on a boundary in the plane.

On a facet of degree p they are the Bernstein polynomials of its coordinate s,

.. math:: b_i(s) = \binom p i s^i (1 - s)^{p - i}, \qquad i = 0, ..., p .

Facets that meet at a vertex share its coefficient. Between two facets f and g on a straight line
the trace of Adini and BFS is C1 in arc length, so that this coefficient is the mean

.. math:: c_v = \frac{p_f l_g c_f + p_g l_f c_g}{p_f l_g + p_g l_f}

of its two neighbours: facet f has the share of :math:`c_f` in :math:`b_v` added to the polynomial
of :math:`c_f`, and the share of :math:`c_g` as a function of a contact point of facet g. Facets
that approximate a curve have degree one, see `contact.rows.shares`.

A tie has one degree less on the last facet where a support holds the end of the boundary, because
the displacement has less freedom there: :math:`c_0 = c_1`, :math:`c_0 = 2 c_1 - c_2`,
:math:`c_0 = 3 c_1 - 3 c_2 + c_3` for p = 1, 2, 3 (C. Bernardi, Y. Maday and A. T. Patera, in
Nonlinear Partial Differential Equations and Their Applications, Longman 1994)."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from contact.rows.functionals import FacetFunctional
from contact.rows.numbering import in_order
from contact.rows.outline import Outline

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Coefficients of a facet of the highest degree, three.
SLOTS = 4


@dataclass(frozen=True)
class PositiveBasis:
    """The basis N_k of the trace of a boundary, facet by facet."""

    degree: Index  # of each facet, shape (nfacets,)
    number: Index  # contact point of each coefficient, -1 for none, shape (nfacets, 4)
    mix: Array  # from Bernstein polynomials to the N_k, shape (nfacets, 4, 4)
    nominal: tuple[Index, Array]  # facet and coordinate of each point, shapes (m,)
    hub: Index  # vertex of the mesh that a contact point belongs to, or -1, shape (m,)

    @classmethod
    def of(cls, outline: Outline, form: FacetFunctional, hat: bool, tied: bool) -> PositiveBasis:
        """The basis of a boundary: hats of the vertices if `hat`, lower at held ends if `tied`.
        `form` is the default functional of the element, whose values are those of the trace."""
        low = outline.curved if form.reduced else np.zeros(outline.facets.size, dtype=bool)
        full = np.where(low | hat, 1, len(form.C) - 1)
        held = _held_ends(outline) if tied else np.zeros(outline.corners.shape, dtype=bool)
        degree = np.maximum(full - held.sum(axis=1), 0)
        inline = np.zeros(held.shape, dtype=bool)
        if form.smooth and not hat:
            inline = outline.continued & ~low[:, None] & ~low[outline.beyond[0]]
        number, hub = _numbers(outline.corners, degree, inline, held)
        slot = np.arange(SLOTS)
        place = np.where(degree[:, None] > 0, slot / np.maximum(degree, 1)[:, None], 0.5)
        # With the lower degree there is a coefficient left at a held end, which is not its value.
        hub[np.isin(hub, outline.corners[held])] = -1
        order = in_order(outline, place, number, hub.size)
        rank = np.empty(hub.size, dtype=np.int64)
        rank[order] = np.arange(hub.size)
        number, hub = np.where(number >= 0, rank[number], -1), hub[order]
        facet, at = np.nonzero(number >= 0)
        first = np.unique(number[facet, at], return_index=True)[1]
        nominal = facet[first], place[facet, at][first]
        return cls(degree, *_lent(outline, degree, number, inline), nominal, hub)

    @property
    def size(self) -> int:
        """Number of contact points, covered or not."""
        return int(self.hub.size)

    def values(self, facet: Index, s: Array, degree: int) -> Array:
        """The N_k at places s of facets of one degree, shape (degree + 1, n)."""
        used = slice(degree + 1)
        return np.einsum("qij,jq->iq", self.mix[facet, used, used], bernstein(degree, s))


def bernstein(degree: int, s: Array) -> Array:
    """Bernstein polynomials at places s, shape (degree + 1, n)."""
    return np.array([comb(degree, i) * s**i * (1 - s) ** (degree - i) for i in range(degree + 1)])


def _held_ends(outline: Outline) -> NDArray[np.bool_]:
    """Ends of the boundary at which a support holds a component, shape (nfacets, 2)."""
    body, corners = outline.body, outline.corners
    met = np.bincount(corners.ravel(), minlength=body.mesh.nvertices)
    dofs = body.dim * body.scalar_dofs.nodal_dofs[0, corners][..., None] + np.arange(body.dim)
    fixed = np.diff(body.constraint[0].indptr)[dofs] == 0
    return np.asarray((met[corners] == 1) & fixed.any(axis=2))


def _numbers(
    corners: Index, degree: Index, inline: NDArray[np.bool_], held: NDArray[np.bool_]
) -> tuple[Index, Index]:
    """Contact point of each coefficient, -1 where there is none, and the vertex of each point."""
    facets = np.arange(degree.size)
    number = np.full((degree.size, SLOTS), -1, dtype=np.int64)
    carrier = np.full((degree.size, SLOTS), -1, dtype=np.int64)
    carrier[:, 0] = np.where(inline[:, 0], -1, corners[:, 0])
    carrier[facets, degree] = np.where(inline[:, 1], -1, corners[:, 1])
    # A constant takes the coefficient of the end that is not held.
    constant = degree == 0
    free = np.where(held[:, 0], corners[:, 1], corners[:, 0])
    carrier[constant, 0] = np.where(held.all(axis=1), -1, free)[constant]
    vertex, inverse = np.unique(carrier[carrier >= 0], return_inverse=True)
    number[carrier >= 0] = inverse
    slot = np.arange(SLOTS)
    own = (slot > 0) & (slot < degree[:, None])
    own[constant, 0] = carrier[constant, 0] < 0
    number[own] = vertex.size + np.arange(own.sum())
    return number, np.concatenate((vertex, np.full(own.sum(), -1)))


def _lent(
    outline: Outline, degree: Index, number: Index, inline: NDArray[np.bool_]
) -> tuple[Index, Array]:
    """Numbers and matrices of facets whose coefficients at vertices are means of neighbours."""
    mix = np.repeat(np.eye(SLOTS)[None], degree.size, axis=0)
    own, number = number, number.copy()
    place = outline.body.mesh.p[:, outline.corners]
    length = np.linalg.norm(place[:, :, 1] - place[:, :, 0], axis=0)
    beyond, corner = outline.beyond
    for end in (0, 1):
        f = np.flatnonzero(inline[:, end])
        g = beyond[f, end]
        outer, inner = (0 * f, 0 * f + 1) if end == 0 else (degree[f], degree[f] - 1)
        number[f, outer] = own[g, np.where(corner[f, end] == 0, 1, degree[g] - 1)]
        one, two = degree[f] * length[g], degree[g] * length[f]
        mix[f, inner, outer], mix[f, outer, outer] = one / (one + two), two / (one + two)
    return number, mix
