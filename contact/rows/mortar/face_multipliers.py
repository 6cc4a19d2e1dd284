r"""Multiplier functions of an interface in space.

As in the plane (`contact.rows.mortar.multipliers`) they belong to positive functions N_k that sum
to one: hats of the vertices on curved facets, for linear and bilinear traces and for the Adini
brick; else Bernstein polynomials of second order, whose integrals are positive where those of
Lagrange polynomials are not. Dual functions are :math:`\psi = D_e M_e^{-1} N` over the covered part
of a facet, or N_k itself where that part is so small that M_e is singular by rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.rows.functionals import FacetFunctional
from contact.rows.mortar.interface_quadrature import InterfaceQuadrature
from contact.rows.mortar.multipliers import Multipliers, joined_points
from contact.rows.numbering import first_occurrence, numbering
from contact.rows.outline import Outline, hats

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_SINGULAR = 1e-4  # least ratio of singular values of scaled functions on a covered part


@dataclass(frozen=True)
class FaceBasis:
    """The positive functions N_k of a boundary in space."""

    outline: Outline
    form: FacetFunctional  # its polynomials span the functions of a facet
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
        """A facet of each contact point, and its place there, shapes (m,) and (2, m)."""
        facet, slot = first_occurrence(self.number, self.size)
        return facet, self.form.nominal[:, slot]

    def values(self, facet: Index, X: Array) -> Array:
        """The N_k of facets at places X (2, n), shape (n, nvalues)."""
        X = np.clip(X, 0.0, 1.0)  # off by rounding, which would make small weights negative
        hat = np.maximum(hats(X, self.outline.corners.shape[1]), 0.0)
        if self.hat or not self.form.reduced:
            return np.asarray((hat / hat.sum(axis=0)).T)
        N = _bernstein(self.form.nominal, X)
        low = self.outline.curved[facet]
        N[:, low] = 0.0
        N[self.form.corners[:, None], np.flatnonzero(low)] = hat[:, low]
        return np.asarray((N / N.sum(axis=0)).T)


def _bernstein(nominal: Array, X: Array) -> Array:
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


def face_multipliers(basis: FaceBasis, quadrature: InterfaceQuadrature, dual: bool) -> Multipliers:
    """Evaluate the functions at the integration points; uncovered contact points have none."""
    facet, w = quadrature.facet, quadrature.w
    N = basis.values(facet, quadrature.X)
    number = basis.number[facet]
    psi = _dual(facet, w, N, number >= 0) if dual else N
    used = number >= 0
    weights = np.bincount(number[used], (w[:, None] * N)[used], basis.size).astype(np.float64)
    joined, point = joined_points(basis.number, weights)
    place, slot = np.nonzero(used)
    column = joined[number[place, slot]]
    covered = column >= 0
    size = facet.size, point.size
    psi_k, N_k = (
        sparse.csr_array(
            sparse.coo_array(
                (v[place, slot][covered], (place[covered], column[covered])), shape=size
            )
        )
        for v in (psi, N)
    )
    return Multipliers(psi_k, N_k, np.asarray(N_k.T @ w), point)


def _dual(facet: Index, w: Array, N: Array, used: NDArray[np.bool_]) -> Array:
    """Dual functions at all points, shape (n, nvalues), by ``sqrt(w) N = Q R`` on each facet.
    M_e = R^T R is not formed, which would square its condition."""
    order = np.argsort(facet, kind="stable")
    _, start, count = np.unique(facet[order], return_index=True, return_counts=True)
    place = np.arange(facet.size) - np.repeat(start, count)
    row = np.repeat(np.arange(start.size), count)
    slots, root = N.shape[1], np.sqrt(w[order])
    # Functions that a facet lacks are replaced by points of their own, at the end.
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
    good = singular[:, -1] > _SINGULAR * singular[:, 0]
    R[~good] = np.eye(slots)
    D = np.zeros((start.size, slots))
    np.add.at(D, row, w[order][:, None] * N[order])
    factor = np.linalg.solve(R, np.eye(slots)).transpose(0, 2, 1) * (D / size)[:, None]
    found = np.einsum("nj,nji->ni", Q[row, place] / root[:, None], factor[row])
    psi = np.empty_like(N)
    psi[order] = np.where(good[row][:, None] & used[order], found, N[order])
    # What rounding leaves on narrow parts would be missing from a uniform pressure.
    return np.asarray(psi + N * (1.0 - psi.sum(axis=1))[:, None])
