"""Derivatives of the mapping of cells, by a compiled kernel."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Mesh, MeshHex, MeshQuad

from skfem_adini.jit import compiled

Array = NDArray[np.float64]


def jacobians(mesh: Mesh, cells: NDArray[np.integer], places: Array) -> Array:
    """d x_i / d X_k of some cells at places of the reference cell, shape (cells, n, i, k).

    scikit-fem sums over the nodes for each place and derivative anew.

    Parameters
    ----------
    mesh : Mesh
    cells : ndarray of int, shape (ncells,)
    places : ndarray, shape (dim, n)
    """
    return np.asarray(_kernel()(*_arguments(mesh, places), cells)[0])


def measures(mesh: Mesh, cells: slice, places: Array) -> tuple[Array, Array]:
    """Determinants of the derivatives, and Frobenius norms of these times those of their cofactors.

    Parameters
    ----------
    mesh : Mesh
    cells : slice
    places : ndarray, shape (dim, n)

    Returns
    -------
    det, norms : ndarray, shape (ncells, n)
    """
    some = np.arange(cells.start, cells.stop)
    _, det, norms = _kernel()(*_arguments(mesh, places), some)
    return det, norms


def is_straight(mesh: Mesh) -> bool:
    """Whether the vertices alone determine the cells: simplices or Q1 cells of first order."""
    return bool(mesh.affine) or type(mesh) in (MeshQuad, MeshHex)


def _arguments(mesh: Mesh, places: Array) -> tuple[Array, NDArray[np.integer], Array]:
    """Places of nodes, nodes of cells, derivatives of the functions of nodes (nodes, dim, n)."""
    nodes = np.ascontiguousarray(mesh.t if is_straight(mesh) else mesh.dofs.element_dofs)
    element, slopes = mesh.elem(), np.empty((len(nodes), *places.shape))
    for v in range(len(nodes)):
        slopes[v] = np.asarray(element.lbasis(places, v)[1]).reshape(places.shape)
    return np.ascontiguousarray(mesh.doflocs), nodes, slopes


@cache
def _kernel() -> Callable[..., Any]:
    return compiled(_derivatives)


def _derivatives(x: Any, nodes: Any, slopes: Any, cells: Any) -> Any:
    """Return the derivatives, their determinants and their norms, for numba.

    In corners of straight cells sums of products with 0 and +-1: differences, rounded once.
    """
    (dim, _), n, half = x.shape, slopes.shape[2], x.shape[0] - 1
    J = np.empty((cells.size, n, dim, dim))
    det, norms = np.empty((cells.size, n)), np.empty((cells.size, n))
    for c in range(cells.size):
        for q in range(n):
            here, squares, cofactors, product = J[c, q], 0.0, 0.0, 0.0
            for i in range(dim):
                for k in range(dim):
                    total = 0.0
                    for v in range(nodes.shape[0]):
                        total += x[i, nodes[v, cells[c]]] * slopes[v, k, q]
                    here[i, k] = total
                    squares += total * total
            if half == 1:
                product = here[0, 0] * here[1, 1] - here[0, 1] * here[1, 0]
                cofactors = squares
            else:
                for i in range(3):
                    for k in range(3):
                        a, b, c1, c2 = (i + 1) % 3, (i + 2) % 3, (k + 1) % 3, (k + 2) % 3
                        minor = here[a, c1] * here[b, c2] - here[a, c2] * here[b, c1]
                        cofactors += minor * minor
                        if i == 0:
                            product += here[0, k] * minor
            det[c, q], norms[c, q] = product, np.sqrt(squares) * np.sqrt(cofactors)
    return J, det, norms
