"""Derivatives of the mapping of cells, by a compiled kernel."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementTetP1,
    ElementTriP1,
    Mesh,
    MeshHex,
    MeshQuad,
)
from skfem.refdom import RefHex, RefQuad, RefTet, RefTri

from skfem_adini.ground.jit import compiled_later

Array = NDArray[np.float64]


def jacobians(mesh: Mesh, cells: NDArray[np.integer], places: Array) -> Array:
    """d x_i / d X_k of some cells at places (dim, n) of the reference cell, shape (cells, n, i, k).
    scikit-fem repeats the sum over nodes for each point and derivative."""
    x, nodes, slopes = _arguments(mesh, places)
    return np.einsum("ivc,vkq->cqik", x[:, nodes[:, cells]], slopes)


def measures(mesh: Mesh, cells: slice, places: Array) -> tuple[Array, Array, Array]:
    """Determinants, norms (Frobenius, times the cofactors'), both (ncells, n), and sizes of cells.
    The size of a cell is the largest extent of its vertices along a coordinate, shape (ncells,)."""
    arguments = *_arguments(mesh, places), cells.start, cells.stop, len(mesh.t)
    det, norms, size = _kernel()(*arguments)
    return det, norms, size


def middle_determinants(mesh: Mesh, p: Array) -> Array:
    """Determinants at the middle of cells whose corners are at p, shape (cells,)."""
    return _in_the_middle(mesh, p)[0]


def turning_move(mesh: Mesh) -> float:
    r"""Corner displacement, apart from a translation, below which no cell inverts.

    With :math:`u = \sum_v u_v \phi_v` and the derivative J of the mapping, I + grad u is regular if
    :math:`\max |u_v| \sum_v |\phi_v'| < \sigma_{\min}(J)`, where
    :math:`\sigma_{\min}(J) \ge |\det J| / |\mathrm{cof} J|`.
    """
    det, norms, slopes = _in_the_middle(mesh, mesh.p)
    cofactors = norms ** (1 - 1 / mesh.dim())  # an upper bound in space
    return float((np.abs(det) / cofactors).min() / np.linalg.norm(slopes, axis=1).sum())


def _in_the_middle(mesh: Mesh, p: Array) -> tuple[Array, Array, Array]:
    """Determinants and norms as in `measures`, and shape derivatives (corners, dim, 1)."""
    refdom = mesh.elem.refdom
    p1 = {RefTri: ElementTriP1, RefQuad: ElementQuad1, RefTet: ElementTetP1, RefHex: ElementHex1}
    element, middle = p1[refdom](), refdom.p.mean(axis=1)[:, None]
    slopes = np.array([element.lbasis(middle, v)[1] for v in range(len(mesh.t))])
    slopes = np.ascontiguousarray(slopes.reshape(len(mesh.t), mesh.dim(), 1))
    x, t = np.ascontiguousarray(p), np.ascontiguousarray(mesh.t)
    det, norms, _ = _kernel()(x, t, slopes, 0, mesh.nelements, len(mesh.t))
    return det[:, 0], norms[:, 0], slopes


def is_straight(mesh: Mesh) -> bool:
    """Whether the vertices alone determine the cells: simplices or Q1 cells of first order."""
    return bool(mesh.affine) or type(mesh) in (MeshQuad, MeshHex)


def _arguments(mesh: Mesh, places: Array) -> tuple[Array, NDArray[np.integer], Array]:
    """Node coordinates, nodes of each cell, and shape derivatives (nodes, dim, n)."""
    nodes = np.ascontiguousarray(mesh.t if is_straight(mesh) else mesh.dofs.element_dofs)
    element, slopes = mesh.elem(), np.empty((len(nodes), *places.shape))
    for v in range(len(nodes)):
        slopes[v] = np.asarray(element.lbasis(places, v)[1]).reshape(places.shape)
    return np.ascontiguousarray(mesh.doflocs), nodes, slopes


@cache
def _kernel() -> Callable[..., Any]:
    return compiled_later(_measures)


def _measures(x: Any, nodes: Any, slopes: Any, start: Any, stop: Any, corners: Any) -> Any:
    """Return determinants, norms and sizes, for numba.
    At corners of straight cells the derivatives are differences of vertices, rounded once."""
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
