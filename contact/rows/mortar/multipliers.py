r"""Multiplier functions psi_k of an interface, at its integration points.

==============  ===================================================================================
``"dual"``      :math:`\psi = D_e M_e^{-1} N` on each facet e, with functions N_k of a basis,
                :math:`M_e = \int_e N N^T` and :math:`D_e = \mathrm{diag} \int_e N` over its covered
                part: :math:`\int \psi_k N_l = 0` for :math:`k \ne l`, and their sum is one
``"standard"``  :math:`\psi_k = N_k`
``"hat"``       dual to the hats of the vertices, whatever the element
==============  ===================================================================================

All of them sum to one, so that the patch test is passed, and :math:`w_k = \int \psi_k = \int N_k`
is positive. Dual functions serve contact: each condition then contains one coefficient of the
non-mortar side only. Standard ones serve ties.

The condition of M_e grows as :math:`h^{-2p}` where an interval of relative length h is covered, so
M_e is never formed. With the polynomials b of the covered interval, :math:`N = A b`, the dual
functions are :math:`D_e A^{-T} (\int b b^T)^{-1} b`, where A has the closed form of
`_of_whole_facet` and the matrix that remains is that of a whole facet.

B. I. Wohlmuth, SIAM J. Numer. Anal. 38 (2000); A. Popp, B. I. Wohlmuth, M. W. Gee and W. A. Wall,
SIAM J. Sci. Comput. 34 (2012), for positive functions and covered parts.

In the plane the N_k are a positive basis of the trace. On a facet of degree p they are the
Bernstein polynomials of its coordinate s,

.. math:: b_i(s) = \binom p i s^i (1 - s)^{p - i}, \qquad i = 0, ..., p .

Facets that meet at a vertex share its coefficient. Between two facets f and g on a straight line
the trace of Adini and BFS is C1 in arc length, so that this coefficient is the mean

.. math:: c_v = \frac{p_f l_g c_f + p_g l_f c_g}{p_f l_g + p_g l_f}

of its two neighbours: facet f has the share of :math:`c_f` in :math:`b_v` added to the polynomial
of :math:`c_f`, and the share of :math:`c_g` as a function of a contact point of facet g. Facets
that approximate a curve have degree one, see `contact.rows.shares`.

A tie has one degree less on the last facet where a support fixes the end of the boundary, because
the displacement has less freedom there: :math:`c_0 = c_1`, :math:`c_0 = 2 c_1 - c_2`,
:math:`c_0 = 3 c_1 - 3 c_2 + c_3` for p = 1, 2, 3 (C. Bernardi, Y. Maday and A. T. Patera, in
Nonlinear Partial Differential Equations and Their Applications, Longman 1994).

In space the N_k are hats of the vertices on curved facets, for linear and bilinear traces and for
the Adini brick; else Bernstein polynomials of second order, whose integrals are positive where
those of Lagrange polynomials are not. Where the covered part is so small that M_e is singular by
rounding, psi_k is N_k itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.functionals import FacetFunctional
from contact.rows.mortar.facet_trace import InterfaceQuadrature
from contact.rows.numbering import first_occurrence, in_order, numbering
from contact.rows.outline import Outline, hats

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SLOTS = 4  # coefficients of a plane facet of the highest degree, three
LEAST_WEIGHT = 1e-6  # over the largest: with smaller weights a pressure has at most three digits


@dataclass(frozen=True)
class Multipliers:
    """Multiplier functions of the covered contact points, at the integration points."""

    psi: sparse.csr_array  # multiplier functions, shape (n, m)
    N: sparse.csr_array  # positive functions N_k, shape (n, m)
    weights: Array  # integrals of psi_k and N_k, shape (m,)
    point: Index  # number of each contact point in the basis, shape (m,)

    @classmethod
    def of(
        cls,
        basis: PositiveBasis | FaceBasis,
        quadrature: InterfaceQuadrature,
        dual: bool,
        measures: Array | None = None,
    ) -> Multipliers:
        """Evaluate the functions; contact points that are not covered have none.
        `measures`, (n,), replace the quadrature weights in deciding which points are merged: near
        the axis of a ring areas are small for any facet length."""
        facet, w = quadrature.facet, quadrature.w
        size, number = w if measures is None else measures, basis.number[facet]
        N, psi = basis.functions(quadrature, dual)
        used = number >= 0
        joined, point = joined_points(
            basis.number, _sums(number[used], (size[:, None] * N)[used], basis.size)
        )
        place, column = np.nonzero(used)[0], joined[number[used]]
        covered = column >= 0
        at, shape = (place[covered], column[covered]), (facet.size, point.size)
        psi_k, N_k = (
            sparse.csr_array(sparse.coo_array((v[used][covered], at), shape=shape))
            for v in (psi, N)
        )
        return cls(psi_k, N_k, np.asarray(N_k.T @ w), point)


def joined_points(number: Index, weights: Array) -> tuple[Index, Index]:
    """New number of every contact point, -1 if not covered, and the points that are kept.
    A point of too small a weight is merged with the one of largest weight on its facets."""
    # Weights increase strictly along every merge, so that there are no cycles.
    rank = np.empty(weights.size, dtype=np.int64)
    rank[np.argsort(weights, kind="stable")] = np.arange(weights.size)
    largest = np.where(number >= 0, rank[number], -1).max(axis=1)
    best = np.arange(weights.size)
    reached = rank.copy()
    np.maximum.at(reached, number[number >= 0], np.repeat(largest, (number >= 0).sum(axis=1)))
    small = weights < LEAST_WEIGHT * weights.max()
    best[small] = np.argsort(rank)[reached[small]]
    while np.any(best != best[best]):
        best = best[best]
    kept = np.flatnonzero((weights > 0) & (best == np.arange(weights.size)))
    new = np.full(weights.size, -1, dtype=np.int64)
    new[kept] = np.arange(kept.size)
    return np.where(weights > 0, new[best], -1), kept


def _sums(at: Index, v: Array, count: int) -> Array:
    return np.bincount(at, v, count).astype(np.float64)


@dataclass(frozen=True)
class PositiveBasis:
    """The basis N_k of the trace of a boundary in the plane, facet by facet."""

    degree: Index  # of each facet, shape (nfacets,)
    number: Index  # contact point of each coefficient, -1 for none, shape (nfacets, 4)
    mix: Array  # maps Bernstein polynomials to the N_k, shape (nfacets, 4, 4)
    nominal: tuple[Index, Array]  # facet and coordinate of each point, shapes (m,) and (1, m)
    hub: Index  # vertex of the mesh that a contact point belongs to, or -1, shape (m,)

    @classmethod
    def of(cls, outline: Outline, form: FacetFunctional, hat: bool, tied: bool) -> PositiveBasis:
        """The basis of a boundary: vertex hats if `hat`, of lower degree at fixed ends if `tied`.
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
        # With the lower degree the coefficient at a fixed end is not the value there.
        hub[np.isin(hub, outline.corners[held])] = -1
        order = in_order(outline, place, number, hub.size)
        rank = np.empty(hub.size, dtype=np.int64)
        rank[order] = np.arange(hub.size)
        number, hub = np.where(number >= 0, rank[number], -1), hub[order]
        facet, at = np.nonzero(number >= 0)
        first = np.unique(number[facet, at], return_index=True)[1]
        nominal = facet[first], place[facet, at][first][None]
        return cls(degree, *_lent(outline, degree, number, inline), nominal, hub)

    @property
    def size(self) -> int:
        """Number of contact points, covered or not."""
        return int(self.hub.size)

    @property
    def at_place(self) -> NDArray[np.bool_]:
        """Whether a contact point is fixed by supports if its position is, shape (m,)."""
        return self.hub >= 0

    def functions(self, quadrature: InterfaceQuadrature, dual: bool) -> tuple[Array, Array]:
        """The N_k and psi_k at the integration points, shapes (n, 4)."""
        facet, s, w = quadrature.facet, quadrature.X[0], quadrature.w
        N, psi = np.zeros((facet.size, SLOTS)), np.zeros((facet.size, SLOTS))
        for degree in np.unique(self.degree[facet]):
            q, used = np.flatnonzero(self.degree[facet] == degree), slice(degree + 1)
            here = self.values(facet[q], s[q], degree)
            N[q, used] = here.T
            psi[q, used] = _dual(self, facet[q], s[q], w[q], here).T if dual and degree else here.T
        return N, psi

    def values(self, facet: Index, s: Array, degree: int) -> Array:
        """The N_k at points s of facets of one degree, shape (degree + 1, n)."""
        used = slice(degree + 1)
        return np.einsum("qij,jq->iq", self.mix[facet, used, used], bernstein(degree, s))


def bernstein(degree: int, s: Array) -> Array:
    """Bernstein polynomials at points s, shape (degree + 1, n)."""
    return np.array([comb(degree, i) * s**i * (1 - s) ** (degree - i) for i in range(degree + 1)])


def _held_ends(outline: Outline) -> NDArray[np.bool_]:
    """Ends of the boundary at which a support fixes a component, shape (nfacets, 2)."""
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
    # A constant takes the coefficient of the free end.
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


def _dual(basis: PositiveBasis, facet: Index, s: Array, w: Array, N: Array) -> Array:
    """Dual functions on facets of one degree at the places s, shape (degree + 1, n)."""
    degree, (facets, at) = len(N) - 1, np.unique(facet, return_inverse=True)
    low, high = np.ones(facets.size), np.zeros(facets.size)
    np.minimum.at(low, at, s)
    np.maximum.at(high, at, s)
    b = bernstein(degree, (s - low[at]) / (high - low)[at])

    mass = np.array([[_sums(at, w * p * q, facets.size) for q in b] for p in b]).transpose(2, 0, 1)
    D = np.array([_sums(at, w * p, facets.size) for p in N]).T
    used = slice(degree + 1)
    mixed = np.linalg.inv(basis.mix[facets, used, used])
    whole = _of_whole_facet(degree, low, high)
    # psi = D mix^-T A^-T mass^-1 b with A^-1 = whole.
    factor = D[:, :, None] * np.transpose(np.linalg.solve(mass, whole @ mixed), (0, 2, 1))
    return np.einsum("qij,jq->iq", factor[at], b)


def _of_whole_facet(degree: int, low: Array, high: Array) -> Array:
    """Bernstein polynomials of intervals [low, high] in those of [0, 1], (n, p + 1, p + 1).
    Entry (i, j) is the polar form of the interval's polynomial i at p - j zeros and j ones (G.
    Farin, Curves and Surfaces for CAGD, 5th ed., Morgan Kaufmann 2002, chapter 4)."""
    zero, one = -low / (high - low), (1.0 - low) / (high - low)
    entry = np.zeros((low.size, degree + 1, degree + 1))
    for i in range(degree + 1):
        for j in range(degree + 1):
            for r in range(max(0, i + j - degree), min(i, j) + 1):
                entry[:, i, j] += (
                    comb(degree - j, i - r)
                    * comb(j, r)
                    * zero ** (i - r)
                    * (1.0 - zero) ** (degree - j - i + r)
                    * one**r
                    * (1.0 - one) ** (j - r)
                )
    return entry


@dataclass(frozen=True)
class FaceBasis:
    """The positive functions N_k of a boundary in space."""

    outline: Outline
    form: FacetFunctional  # its polynomials span the trace on a facet
    hat: bool  # hats of the vertices, whatever the element
    number: Index  # contact point of each function, -1 for none; shape (nfacets, nvalues)
    size: int  # number of contact points, covered or not

    @classmethod
    def of(cls, outline: Outline, form: FacetFunctional, hat: bool) -> FaceBasis:
        """The functions of a boundary."""
        hat = hat or form.mean
        if hat:
            vertex, number = np.unique(outline.corners, return_inverse=True)
            return cls(outline, form, True, number.reshape(outline.corners.shape), vertex.size)
        number, size = numbering(outline, form)
        return cls(outline, form, False, number, size)

    @property
    def nominal(self) -> tuple[Index, Array]:
        """A facet of each contact point, and its reference point, shapes (m,) and (2, m)."""
        facet, slot = first_occurrence(self.number, self.size)
        return facet, self.form.nominal[:, slot]

    @property
    def at_place(self) -> NDArray[np.bool_]:
        """Whether a contact point is fixed by supports if its position is: always, shape (m,)."""
        return np.ones(self.size, dtype=bool)

    def functions(self, quadrature: InterfaceQuadrature, dual: bool) -> tuple[Array, Array]:
        """The N_k and psi_k at the integration points, shapes (n, nvalues)."""
        facet = quadrature.facet
        N, used = self.values(facet, quadrature.X), self.number[facet] >= 0
        return N, _face_dual(facet, quadrature.w, N, used) if dual else N

    def values(self, facet: Index, X: Array) -> Array:
        """The N_k of facets at places X (2, n), shape (n, nvalues)."""
        X = np.clip(X, 0.0, 1.0)  # rounding would make small weights negative
        hat = np.maximum(hats(X, self.outline.corners.shape[1]), 0.0)
        if self.hat or not self.form.reduced:
            return np.asarray((hat / hat.sum(axis=0)).T)
        N = _bernstein_of_face(self.form.nominal, X)
        low = self.outline.curved[facet]
        N[:, low] = 0.0
        N[self.form.corners[:, None], np.flatnonzero(low)] = hat[:, low]
        return np.asarray((N / N.sum(axis=0)).T)


def _bernstein_of_face(nominal: Array, X: Array) -> Array:
    """Bernstein polynomials of second order with given nominal places, shape (6 or 9, n).
    Formed as products, so that small values on a narrow part keep their digits."""
    i, j = np.rint(2 * nominal).astype(np.int64)
    x, y = X
    if i.size == 9:
        u, v = (np.array([(1 - s) ** 2, 2 * s * (1 - s), s**2]) for s in (x, y))
        return np.asarray(u[i] * v[j])
    k = 2 - i - j
    last = np.maximum(1 - x - y, 0.0)
    several = np.where(np.maximum(np.maximum(i, j), k) == 2, 1.0, 2.0)[:, None]
    return np.asarray(several * x ** i[:, None] * y ** j[:, None] * last ** k[:, None])


def _face_dual(facet: Index, w: Array, N: Array, used: NDArray[np.bool_]) -> Array:
    """Dual functions at all points, shape (n, nvalues), by ``sqrt(w) N = Q R`` on each facet.
    M_e = R^T R is not formed, which would square its condition."""
    order = np.argsort(facet, kind="stable")
    _, start, count = np.unique(facet[order], return_index=True, return_counts=True)
    place = np.arange(facet.size) - np.repeat(start, count)
    row = np.repeat(np.arange(start.size), count)
    slots, root = N.shape[1], np.sqrt(w[order])
    # Functions that a facet lacks are replaced by extra points at the end.
    rows = np.zeros((start.size, int(count.max()) + slots, slots))
    rows[row, place] = root[:, None] * np.where(used[order], N[order], 0.0)
    here = used[order][start]
    size = np.linalg.norm(rows, axis=1)
    size = np.where(here & (size > 0), size, 1.0)
    rows /= size[:, None]
    lacking = np.eye(slots) * ~(here & np.any(rows != 0, axis=1))[:, None, :]
    rows[:, -slots:] = lacking
    Q, R = np.linalg.qr(rows)
    singular = np.linalg.svd(R, compute_uv=False)
    good = singular[:, -1] > 1e-4 * singular[:, 0]  # scaled functions, on a covered part
    R[~good] = np.eye(slots)
    D = np.zeros((start.size, slots))
    np.add.at(D, row, w[order][:, None] * N[order])
    factor = np.linalg.solve(R, np.eye(slots)).transpose(0, 2, 1) * (D / size)[:, None]
    found = np.einsum("nj,nji->ni", Q[row, place] / root[:, None], factor[row])
    psi = np.empty_like(N)
    psi[order] = np.where(good[row][:, None] & used[order], found, N[order])
    # Correct the rounding on narrow parts, so that a uniform pressure is exact.
    return np.asarray(psi + N * (1.0 - psi.sum(axis=1))[:, None])
