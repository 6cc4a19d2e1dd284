"""Weights of contact points, and the places where their pressures are reported."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from skfem import FacetBasis

from contact.body import ElasticBody
from contact.errors import InputError
from contact.functionals import FacetFunctional

Array = NDArray[np.float64]


def weights_and_places(
    basis: FacetBasis,
    form: FacetFunctional,
    B: sparse.csr_array,
    number: NDArray[np.int64],
    length: Array,
    x_nominal: Array,
) -> tuple[Array, Array]:
    """Weights w and mean places x: B^T w and B^T (w x) are the loads of 1 and of x.

    Where the functional has fewer numbers than the trace has dofs (Gauss points) the equations
    are met in the least-squares sense, with dofs scaled by their boundary mass.
    """
    if form.weights is not None:
        share = length[:, None] * form.weights
        shares = np.bincount(number.ravel(), share.ravel(), B.shape[0]).astype(np.float64)
        return shares, x_nominal
    loads, mass = _loads(basis), np.zeros(basis.N)
    for i in range(basis.Nbfun):
        square = np.asarray(basis.basis[i][0]) ** 2 * basis.dx
        np.add.at(mass, basis.element_dofs[i], square.sum(axis=1))
    used = np.unique(B.indices)
    scaled = B[:, used] @ sparse.diags_array(1.0 / np.sqrt(mass[used]))
    rhs = scaled @ (loads[:, used] / np.sqrt(mass[used])).T
    moments = splu(sparse.csc_matrix(scaled @ scaled.T)).solve(rhs)
    weights = moments[:, 0]
    if np.any(weights <= 0):
        raise InputError(f"functional {form.name!r}: a weight is not positive on this boundary")
    return weights, (moments[:, 1:] / weights[:, None]).T


def mean_shares(
    body: ElasticBody, basis: FacetBasis, vertex: NDArray[np.int64]
) -> tuple[sparse.csr_array, Array, Array, Array]:
    """Rows of ``centroid`` at the given vertices, the ways to their centroids, weights, places."""
    dofs, count = body.scalar_dofs.nodal_dofs[:, vertex], vertex.size
    load, *moments = _loads(basis)
    share = load[dofs] / load[dofs[0]]
    share[np.abs(share) < 1e-11 * body.lengths[0][body.dim * dofs]] = 0.0
    rows = np.tile(np.arange(count), dofs.shape[0])
    B = sparse.coo_array(
        (share.ravel(), (rows, dofs.ravel())), shape=(count, body.scalar_dofs.N)
    ).tocsr()
    B.eliminate_zeros()
    places = np.array(moments)[:, dofs[0]] / load[dofs[0]]
    return B, share[1 : 1 + body.dim], load[dofs[0]], places  # derivatives follow the value


def _loads(basis: FacetBasis) -> Array:
    """Loads of 1 and of every coordinate, shape (1 + dim, ndofs)."""
    x = np.asarray(basis.global_coordinates())
    loads = np.zeros((1 + x.shape[0], basis.N))
    for i in range(basis.Nbfun):
        phi = np.asarray(basis.basis[i][0]) * basis.dx
        np.add.at(loads[0], basis.element_dofs[i], phi.sum(axis=1))
        for a in range(x.shape[0]):
            np.add.at(loads[1 + a], basis.element_dofs[i], (phi * x[a]).sum(axis=1))
    return loads
