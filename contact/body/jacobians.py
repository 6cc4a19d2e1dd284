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
    """d x_i / d X_k of some cells at places (dim, n) of the reference cell, shape (cells, n, i, k).
    scikit-fem sums over the nodes for each place and derivative anew."""
    x, nodes, slopes = _arguments(mesh, places)
    return np.einsum("ivc,vkq->cqik", x[:, nodes[:, cells]], slopes)


def measures(mesh: Mesh, cells: slice, places: Array) -> tuple[Array, Array, Array]:
    """Determinants, norms (Frobenius, times the cofactors'), both (ncells, n), and sizes of cells.
    The size of a cell is the largest extent of its vertices along a coordinate, shape (ncells,)."""
    arguments = *_arguments(mesh, places), cells.start, cells.stop, len(mesh.t)
    det, norms, size = _kernel()(*arguments)
    return det, norms, size


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
    return compiled(_measures)


def _measures(x: Any, nodes: Any, slopes: Any, start: Any, stop: Any, corners: Any) -> Any:
    """Return determinants, norms and sizes, for numba.
    In corners of straight cells the sums of products with 0 and +-1 are differences, rounded
    once."""
    dim, n, J = x.shape[0], slopes.shape[2], np.empty((3, 3))
    here = np.empty((dim, nodes.shape[0]))
    det, norms, size = (
        np.empty((stop - start, n)),
        np.empty((stop - start, n)),
        np.zeros(stop - start),
    )
    for c in range(start, stop):
        for i in range(dim):
            for v in range(nodes.shape[0]):
                here[i, v] = x[i, nodes[v, c]]
            low = high = here[i, 0]
            for v in range(1, corners):
                low, high = min(low, here[i, v]), max(high, here[i, v])
            size[c - start] = max(size[c - start], high - low)
        for q in range(n):
            squares, cofactors, product = 0.0, 0.0, 0.0
            for i in range(dim):
                for k in range(dim):
                    total = 0.0
                    for v in range(nodes.shape[0]):
                        total += here[i, v] * slopes[v, k, q]
                    J[i, k] = total
                    squares += total * total
            if dim == 2:
                product = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
                cofactors = squares
            else:
                for i in range(3):
                    for k in range(3):
                        a, b, one, two = (i + 1) % 3, (i + 2) % 3, (k + 1) % 3, (k + 2) % 3
                        minor = J[a, one] * J[b, two] - J[a, two] * J[b, one]
                        cofactors += minor * minor
                        if i == 0:
                            product += J[0, k] * minor
            det[c - start, q] = product
            norms[c - start, q] = np.sqrt(squares) * np.sqrt(cofactors)
    return det, norms, size
