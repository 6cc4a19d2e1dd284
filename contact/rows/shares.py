r"""Contributions of each facet to the contact points: functionals, weights and centroids.

On a facet e the trace is :math:`\sum_k c_k^e(v) N_k`, with polynomials N_k that sum to one. A value
k shared by facets is the mean of their values, weighted by the integrals of N_k,

.. math::
    P_k v = \frac1{w_k} \sum_e \omega_k^e \, c_k^e(v), \qquad
    \omega_k^e = \int_e N_k, \qquad w_k = \sum_e \omega_k^e, \qquad x_k = \frac1{w_k} \int N_k x .

On straight facets these are the dual multipliers :math:`N M_e^{-1} \omega^e` (B. Wohlmuth, SIAM J.
Numer. Anal. 38, 2000). :math:`\sum_k w_k P_k v` is the integral of v on every facet, so that a
uniform pressure is exact on any outline; in an axisymmetric body integrals are over the ring.

Between two facets f and g on a straight line the value of a cubic C1 trace at the vertex depends on
the adjacent values: :math:`(l_g c_f + l_f c_g) / (l_f + l_g)`. So f has, besides :math:`c_f`, the
value :math:`c_g = ((l_f + l_g) c_v - l_g c_f) / l_f` of its neighbour. A separate value at the
vertex would make rows nearly dependent at small angles.

On straight facets along a curve, conditions at vertices and between them differ by the gradient
times the sagitta. There the N_k are the hats of the vertices, and c_k^e is the projection of v onto
them, so that all conditions contain the same sagitta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from skfem import FacetBasis

from contact.errors import InputError
from contact.rows.functionals import FacetFunctional
from contact.rows.outline import Outline, hats

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Shares:
    """The contributions of all facets to the values at the contact points of a boundary."""

    number: Index  # contact point; if `lent`, the neighbour's, shape (nfacets, nvalues)
    lent: NDArray[np.bool_]  # values whose contact point is on the neighbour, (nfacets, nvalues)
    C: Array  # omega_k^e c_k^e, shape (nfacets, nvalues, npoints)
    omega: Array  # omega_k^e, shape (nfacets, nvalues)
    weights: Array  # w_k, lengths or areas, shape (m,)
    x: Array  # centroids of the N_k, shape (dim, m)
    mean: bool  # whether values are shares of the mean (centroid)
    hub: Index  # vertex of each value, -1 for others, shape (nfacets, nvalues)
    mix: Array  # maps facet polynomials to the N_k, shape (nfacets, nvalues, nvalues)

    @classmethod
    def of(
        cls,
        outline: Outline,
        form: FacetFunctional,
        number: Index,
        integrals: FacetBasis,
    ) -> Shares:
        """Contributions of the facets, `number` (nfacets, nvalues) as by `numbering`.
        Raises InputError if a weight is not positive, as on strongly distorted facets."""
        length = np.asarray(integrals.dx).sum(axis=1)
        at = np.asarray(integrals.global_coordinates())
        dx = np.asarray(integrals.dx) * outline.body.depth(at)
        N, C = facet_functions(outline, form, integrals)
        omega = np.einsum("fsq,fq->fs", N, dx)
        moments = np.einsum("fsq,cfq->cfs", N, at * dx)
        C = omega[:, :, None] * C
        lent, number = number < 0, number.copy()
        count = int(number.max()) + 1
        mix = np.repeat(np.eye(len(form.C))[None], len(number), axis=0)
        own, nothing = number.copy(), lent & outline.curved[:, None]
        number[nothing] = np.broadcast_to(number[:, :1], number.shape)[nothing]
        if form.smooth:
            beyond, corner = outline.beyond
            for end, (outer, inner) in enumerate(((0, 1), (-1, -2))):
                f = np.flatnonzero(lent[:, outer])
                g = beyond[f, end]
                number[f, outer] = own[g, np.where(corner[f, end] == 0, 1, -2)]
                part = (length[g] / (length[f] + length[g]))[:, None]  # weight of c_f in c_v
                mix[f, inner, outer], mix[f, outer, outer] = part[:, 0], 1.0 - part[:, 0]
                C[f, outer] = omega[f, outer, None] * (form.C[outer] - part * form.C[inner])
                C[f, inner] += part * omega[f, outer, None] * form.C[inner]
        omega, *moments = (np.einsum("fst,ft->fs", mix, part) for part in (omega, *moments))
        weights, *places = (
            np.bincount(number.ravel(), part.ravel(), count).astype(np.float64)
            for part in (omega, *moments)
        )
        check_weights(weights, float(dx.sum()), form.name)
        x = np.array(places) / weights
        hub = np.full(number.shape, -1)
        if form.corners.size:
            hub[:, form.corners] = np.where(lent[:, form.corners], -1, outline.corners)
        return cls(number, lent, C, omega, weights, x, form.mean, hub, mix)


def placed_on(shares: Shares, spline: Shares, values: Array) -> Array:
    """Centroids if there are fewer point values than dofs of the trace, shape (dim, m).
    They fit the spline's load w_j x_j of a linear pressure by least squares with weights w_j;
    `values` (nvalues, npoints) are the spline's polynomials at the points."""
    N = spline.mix @ values
    j = np.broadcast_to(spline.number[:, :, None], N.shape)
    k = np.broadcast_to(shares.number[:, None, :], N.shape)
    shape = spline.weights.size, shares.weights.size
    A = sparse.csr_array(sparse.coo_array((N.ravel(), (j.ravel(), k.ravel())), shape=shape))
    A = sparse.csr_array(sparse.diags_array(1.0 / np.sqrt(spline.weights)) @ A)
    load = np.sqrt(spline.weights) * spline.x
    found = splu(sparse.csc_array(A.T @ A)).solve(np.ascontiguousarray(A.T @ load.T))
    return np.asarray(found.T / shares.weights)


def facet_functions(
    outline: Outline, form: FacetFunctional, integrals: FacetBasis
) -> tuple[Array, Array]:
    """The N_k at quadrature points, (nfacets, nvalues, nq), and C of every facet."""
    count, points = outline.facets.size, np.asarray(integrals.X)
    if form.mean:
        value = outline.body.scalar_dofs.nodal_dofs[0, outline.corners]
        N = np.zeros((*value.shape, points.shape[1]))
        for field, dofs in zip(integrals.basis, integrals.element_dofs, strict=True):
            N += (dofs[:, None] == value)[..., None] * np.asarray(field[0])[:, None]
    else:
        N = np.repeat(form.basis(points)[None], count, axis=0)
    C = np.repeat(form.C[None], count, axis=0)
    if form.reduced and outline.curved.any():
        corner = form.corners
        hat = np.zeros((len(form.C), points.shape[1]))
        hat[corner] = hats(points, corner.size)
        weighted = hat[corner] * np.asarray(integrals.W)
        projection = np.zeros_like(form.C)
        projection[corner] = np.linalg.solve(
            weighted @ hat[corner].T, weighted @ (form.C.T @ form.basis(points)).T
        )
        N[outline.curved], C[outline.curved] = hat, projection
    return N, C


def check_weights(weights: Array, measure: float, name: str) -> None:
    """Raise unless the weights are positive and sum to the boundary's length or area."""
    if np.any(weights <= 0):
        raise InputError(f"functional {name!r}: a weight is not positive on this boundary")
    if not abs(weights.sum() - measure) <= 1e-12 * measure:  # rounding of two sums
        raise AssertionError(f"functional {name!r}: the weights do not sum to the boundary")
