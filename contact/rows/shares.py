r"""What each facet contributes to the contact points: functionals, weights and centroids.

On a facet e the trace is :math:`\sum_k c_k^e(v) N_k`, with polynomials N_k that sum to one. Where
several facets share the value k, it is the mean of their values, weighted by their integrals of
N_k,

.. math::
    P_k v = \frac1{w_k} \sum_e \omega_k^e \, c_k^e(v), \qquad
    \omega_k^e = \int_e N_k, \qquad w_k = \sum_e \omega_k^e, \qquad x_k = \frac1{w_k} \int N_k x .

On straight facets :math:`w_k P_k v` is the integral of v with the dual multipliers
:math:`N M_e^{-1} \omega^e` (B. Wohlmuth, SIAM J. Numer. Anal. 38, 2000). The weights sum to the
length or area of the boundary, and :math:`\sum_k w_k P_k v` is the integral of v on every facet: a
uniform pressure is exact on any outline. Of an axisymmetric body the integrals are those over the
whole ring, and weights are areas: at a vertex on the axis a small one, but positive.

Between two facets f and g on a straight line a cubic trace has no value of its own at the vertex:
as a C1 spline in arc length it is :math:`(l_g c_f + l_f c_g) / (l_f + l_g)` there, with c_f and c_g
next to it on either side. So on f, besides its own :math:`c_f`, the value of its neighbour is
:math:`c_g = ((l_f + l_g) c_v - l_g c_f) / l_f`, which on a straight line is the value on g. At a
small angle the two differ slightly. If the value at the vertex were kept as well, the rows would be
nearly dependent, because they would differ only by the small angle.

Where straight facets approximate a curve (their angles exceed noise), conditions at vertices and
between them contradict each other: for a displacement that is smooth on the curve they differ by
its gradient times the sagitta of the facet, and a pressure that enforces both is wrong by the angle
of a facet. There the N_k are the hats of the vertices, and c_k^e is the projection of v onto them,
so that all conditions contain the same sagitta.
"""

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
    """The contributions of all facets to the values at the contact points of a boundary.

    Attributes
    ----------
    number : ndarray of int, shape (nfacets, nvalues)
        Contact point of each value of a facet; where `lent`, one of the neighbouring facet.
    lent : ndarray of bool, shape (nfacets, nvalues)
        Values for which the facet has no contact point of its own.
    C : ndarray, shape (nfacets, nvalues, npoints)
        ``omega_k^e c_k^e`` of the values at the functional's points.
    omega : ndarray, shape (nfacets, nvalues)
        The integrals omega_k^e.
    weights : ndarray, shape (m,)
        The weights w_k, lengths or areas.
    x : ndarray, shape (dim, m)
        Centroids of the N_k.
    mean : bool
        The values are the vertices' shares of the mean instead (``centroid``).
    hub : ndarray of int, shape (nfacets, nvalues)
        Vertex that each value belongs to, -1 for other values.
    mix : ndarray, shape (nfacets, nvalues, nvalues)
        Matrix from the polynomials of one facet to the N_k.
    """

    number: Index
    lent: NDArray[np.bool_]
    C: Array
    omega: Array
    weights: Array
    x: Array
    mean: bool
    hub: Index
    mix: Array

    @classmethod
    def of(
        cls,
        outline: Outline,
        form: FacetFunctional,
        number: Index,
        integrals: FacetBasis,
    ) -> Shares:
        """Compute the contributions of the facets of a boundary.

        Parameters
        ----------
        outline : Outline
        form : FacetFunctional
        number : ndarray of int, shape (nfacets, nvalues)
            Contact point of each value, -1 for one that others determine.
        integrals : FacetBasis
            Quadrature on the facets.

        Raises
        ------
        InputError
            A weight is not positive, as on facets that are far too distorted.
        """
        length = np.asarray(integrals.dx).sum(axis=1)
        at = np.asarray(integrals.global_coordinates())
        dx = np.asarray(integrals.dx) * outline.body.depth(at)
        N, C = _basis(outline, form, integrals)
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
    """Centroids for point values that are fewer than the dofs of the trace, shape (dim, m).

    A pressure that is linear in x loads the dofs of the spline by ``w_j x_j``. The centroids x_k
    are those for which forces ``w_k x_k`` at the points are closest to this load, in a
    least-squares sense with the weights of the spline.

    Parameters
    ----------
    shares, spline : Shares
        Those of the point values, and those of the spline that spans the trace.
    values : ndarray, shape (nvalues, npoints)
        Values at the points of the polynomials that make up the spline on a facet.
    """
    N = spline.mix @ values
    j = np.broadcast_to(spline.number[:, :, None], N.shape)
    k = np.broadcast_to(shares.number[:, None, :], N.shape)
    shape = spline.weights.size, shares.weights.size
    A = sparse.csr_array(sparse.coo_array((N.ravel(), (j.ravel(), k.ravel())), shape=shape))
    A = sparse.csr_array(sparse.diags_array(1.0 / np.sqrt(spline.weights)) @ A)
    load = np.sqrt(spline.weights) * spline.x
    found = splu(sparse.csc_array(A.T @ A)).solve(np.ascontiguousarray(A.T @ load.T))
    return np.asarray(found.T / shares.weights)


def _basis(outline: Outline, form: FacetFunctional, integrals: FacetBasis) -> tuple[Array, Array]:
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
