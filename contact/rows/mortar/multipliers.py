r"""Multiplier functions psi_k of an interface, at its integration points.

==============  ===================================================================================
``"dual"``      :math:`\psi = D_e M_e^{-1} N` on each facet e, with the N_k of `positive_basis`,
                :math:`M_e = \int_e N N^T` and :math:`D_e = \mathrm{diag} \int_e N` over its covered
                part: :math:`\int \psi_k N_l = 0` for :math:`k \ne l`, and their sum is one
``"standard"``  :math:`\psi_k = N_k`
``"hat"``       dual to the hats of the vertices, whatever the element
==============  ===================================================================================

All of them sum to one, so that patch tests are passed, and :math:`w_k = \int \psi_k = \int N_k` is
positive. Dual functions serve contact: each condition then contains one coefficient of the
non-mortar side only. Standard ones serve ties.

The condition of M_e grows as :math:`h^{-2p}` where an interval of relative length h is covered, so
M_e is never formed. With the polynomials b of the covered interval, :math:`N = A b`, the dual
functions are :math:`D_e A^{-T} (\int b b^T)^{-1} b`, where A has the closed form of
`_of_whole_facet` and the matrix that remains is that of a whole facet.

B. I. Wohlmuth, SIAM J. Numer. Anal. 38 (2000); A. Popp, B. I. Wohlmuth, M. W. Gee and W. A. Wall,
SIAM J. Sci. Comput. 34 (2012), for positive functions and covered parts."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.mortar.interface_quadrature import InterfaceQuadrature
from contact.rows.mortar.positive_basis import SLOTS, PositiveBasis, bernstein

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Relative to the largest weight; with a smaller one the pressure would have three digits or fewer.
LEAST_WEIGHT = 1e-6


@dataclass(frozen=True)
class Multipliers:
    """Multiplier functions of the covered contact points, at the integration points."""

    psi: sparse.csr_array  # multiplier functions, shape (n, m)
    N: sparse.csr_array  # positive functions that they belong to, shape (n, m)
    weights: Array  # integrals of either, shape (m,)
    point: Index  # number of each contact point in the `PositiveBasis`, shape (m,)

    @classmethod
    def of(
        cls,
        basis: PositiveBasis,
        quadrature: InterfaceQuadrature,
        dual: bool,
        lengths: Array | None = None,
    ) -> Multipliers:
        """Evaluate the functions; contact points that are not covered have none.
        `lengths`, (n,), replace the weights of the quadrature in deciding which points join a
        neighbour: near the axis of a ring areas are small however long a facet is."""
        facet, s, w = quadrature.facet, quadrature.X[0], quadrature.w
        shape = facet.size, SLOTS
        N, psi, number = np.zeros(shape), np.zeros(shape), basis.number[facet]
        for degree in np.unique(basis.degree[facet]):
            q, used = np.flatnonzero(basis.degree[facet] == degree), slice(degree + 1)
            here = basis.values(facet[q], s[q], degree)
            N[q, used] = here.T
            psi[q, used] = _dual(basis, facet[q], s[q], w[q], here).T if dual and degree else here.T
        size = w if lengths is None else lengths
        weights = _sums(number.ravel() + 1, (size[:, None] * N).ravel(), basis.size + 1)[1:]
        joined, point = joined_points(basis.number, weights)
        place = np.repeat(np.arange(facet.size), SLOTS)[number.ravel() >= 0]
        column = joined[number[number >= 0]]
        covered = column >= 0
        covers = facet.size, point.size
        psi_k, N_k = (
            sparse.csr_array(
                sparse.coo_array(
                    (v[number >= 0][covered], (place[covered], column[covered])), shape=covers
                )
            )
            for v in (psi, N)
        )
        return cls(psi_k, N_k, np.asarray(N_k.T @ w), point)


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


def _sums(at: Index, v: Array, count: int) -> Array:
    return np.bincount(at, v, count).astype(np.float64)


def _of_whole_facet(degree: int, low: Array, high: Array) -> Array:
    """Bernstein polynomials of intervals [low, high] in those of [0, 1], (n, p + 1, p + 1).
    Entry (i, j): polar form of polynomial i of the interval at p - j zeros and j ones
    (G. Farin, Curves and Surfaces for CAGD, 5th ed., Morgan Kaufmann 2002, chapter 4)."""
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


def joined_points(number: Index, weights: Array) -> tuple[Index, Index]:
    """New number of every contact point, -1 if not covered, and the points that are kept.
    A point of too small a weight joins the one of largest weight on a facet of its own."""
    # Strictly growing along every step, so that no two points can become each other.
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
