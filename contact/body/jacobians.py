"""Derivatives of the mapping of cells, for all cells of a mesh by one product of matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skfem import Mesh, MeshHex, MeshQuad

Array = NDArray[np.float64]


def jacobians(mesh: Mesh, cells: slice, places: Array) -> Array:
    """d x_i / d X_k of some cells at places of the reference cell, shape (i, k, cells, n).

    scikit-fem sums over the nodes for each place and derivative anew.

    Parameters
    ----------
    mesh : Mesh
    cells : slice
    places : ndarray, shape (dim, n)
    """
    nodes = mesh.t if is_straight(mesh) else mesh.dofs.element_dofs
    element, x = mesh.elem(), mesh.doflocs[:, nodes[:, cells]]
    dim, n = places.shape
    slopes = np.empty((len(nodes), dim, n))
    for v in range(len(nodes)):
        slope = np.asarray(element.lbasis(places, v)[1])
        slopes[v] = slope.reshape(dim, -1)
    # In corners of straight cells sums of products with 0 and +-1: differences, rounded once.
    flat = np.ascontiguousarray(x.swapaxes(1, 2)) @ slopes.reshape(len(nodes), -1)
    return np.asarray(flat.reshape(len(x), -1, dim, n).swapaxes(1, 2))


def determinants(J: Array) -> Array:
    """Determinants of matrices (i, k, ...), without the copies of `numpy.linalg.det`."""
    if len(J) == 2:
        return np.asarray(J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0])
    return np.asarray(sum(J[0, k] * _minor(J[1], J[2], k) for k in range(3)))


def cofactors(J: Array) -> Array:
    """Cofactors of matrices (i, k, ...): det J times the transpose of the inverse."""
    if len(J) == 2:
        return np.array([[J[1, 1], -J[1, 0]], [-J[0, 1], J[0, 0]]])
    return np.array(
        [[_minor(J[(i + 1) % 3], J[(i + 2) % 3], k) for k in range(3)] for i in range(3)]
    )


def _minor(one: Array, other: Array, k: int) -> Array:
    """Component k of the cross product of two rows."""
    m, n = (k + 1) % 3, (k + 2) % 3
    return np.asarray(one[m] * other[n] - one[n] * other[m])


def is_straight(mesh: Mesh) -> bool:
    """Whether the vertices alone determine the cells: simplices or Q1 cells of first order."""
    return bool(mesh.affine) or type(mesh) in (MeshQuad, MeshHex)
