"""Nested dissection: a permutation whose separators come last and keep the factor sparse."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from skfem import MeshTet, MeshTri

from contact.condensation.elimination_order import nested_dissection


def grid(*counts):
    """Nearest-neighbour graph of a grid with its points."""
    axes = np.meshgrid(*(np.arange(float(n)) for n in counts), indexing="ij")
    number = np.arange(axes[0].size).reshape(counts)
    pairs = [
        np.array([np.delete(number, end, axis).ravel() for end in (-1, 0)])
        for axis in range(len(counts))
    ]
    return np.array([a.ravel() for a in axes]), np.hstack(pairs)


def adjacency(points, cells):
    """The graph whose edges join vertices of one cell."""
    rows = np.repeat(cells, cells.shape[0], axis=0).ravel()
    columns = np.tile(cells, (cells.shape[0], 1)).ravel()
    n = points.shape[1]
    return sparse.csr_array(sparse.coo_array((np.ones(rows.size), (rows, columns)), shape=(n, n)))


def unstructured():
    """Adaptively refined towards a corner."""
    mesh = MeshTri().refined(3)
    for _ in range(4):
        middle = mesh.p[:, mesh.t].mean(axis=1)
        mesh = mesh.refined(np.flatnonzero(np.hypot(*middle) < 0.4))
    return mesh.p, mesh.t


def tetrahedra():
    mesh = MeshTet().refined(2)
    return mesh.p, mesh.t


def two_pieces():
    points, edges = grid(9, 7)
    other = points + np.array([[20.0], [0.0]])
    return np.hstack([points, other]), np.hstack([edges, edges + points.shape[1]])


GRAPHS = {
    "grid": lambda: grid(17, 13),
    "grid-3d": lambda: grid(6, 7, 5),
    "unstructured": unstructured,
    "tetrahedra": tetrahedra,
    "two-pieces": two_pieces,
    "no-edges": lambda: (np.random.default_rng(0).random((2, 30)), np.empty((2, 0), dtype=int)),
    "all-at-one-point": lambda: (np.zeros((2, 25)), grid(5, 5)[1]),
    "on-a-line": lambda: grid(40),
    "single-vertex": lambda: (np.zeros((2, 1)), np.empty((2, 0), dtype=int)),
    "two-vertices": lambda: grid(2, 1),
}


def factor_nnz(graph, order):
    """Entries of the Cholesky factor of the graph's Laplacian plus one in the given order."""
    A = -sparse.csr_array(abs(graph))
    A.setdiag(0.0)
    A.setdiag(1.0 - np.asarray(A.sum(axis=1)).ravel())
    permuted = sparse.csc_matrix(A[order][:, order])
    options = {"SymmetricMode": True}
    return splu(permuted, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options).L.nnz


@pytest.mark.parametrize("name", GRAPHS)
@pytest.mark.parametrize("leaf_size", [1, 6, 50])
def test_blocks_touch_only_through_their_ancestors(name, leaf_size):
    """A permutation; neighbours lie in one block, or one in a separator of a set with the other."""
    points, cells = GRAPHS[name]()
    dissection = nested_dissection(points, cells, leaf_size)
    numbers = np.arange(points.shape[1])
    assert np.array_equal(np.sort(dissection.order), numbers)
    graph = adjacency(points, cells).tocoo()
    for depth in range(1, dissection.levels + 2):
        order, block = dissection.breadth_first(depth)
        assert np.array_equal(np.sort(order), numbers)
        assert np.all(np.diff(block[order]) >= 0)
        assert block.min() >= 0
        assert block.max() <= 2**depth - 2
        level, place = [], []
        for b in block:  # leaves first: level depth - 1, then each level above
            l = depth - 1
            while b >= 1 << l:
                b, l = b - (1 << l), l - 1
            level.append(l)
            place.append(b)
        for i, j in zip(graph.row, graph.col, strict=True):
            up, down = (i, j) if level[i] <= level[j] else (j, i)
            assert place[down] >> (level[down] - level[up]) == place[up]


@pytest.mark.parametrize("name", ["grid", "grid-3d", "unstructured", "tetrahedra"])
def test_separators_are_small_and_fill_is_less_than_of_other_orders(name):
    """Without a small share of the last vertices, no connected piece is larger than 60 %."""
    points, cells = GRAPHS[name]()
    graph = adjacency(points, cells)
    order, n = nested_dissection(points, cells).order, points.shape[1]
    for last in range(n):
        rest = order[: n - last]
        _, piece = connected_components(graph[rest][:, rest], directed=False)
        if np.bincount(piece).max() <= 0.6 * n:
            break
    # A side of the square has n^(1/2) vertices, a face of the cube n^(2/3); unstructured meshes
    # cross the cut a few times more often.
    dim = points.shape[0]
    assert last <= 2.5 * n ** (1 - 1 / dim)
    fill = factor_nnz(graph, order)
    assert fill < factor_nnz(graph, np.random.default_rng(0).permutation(n))
    assert fill < factor_nnz(graph, np.lexsort(points))
    # Coordinates only choose where to cut.
    assert np.array_equal(nested_dissection(8.0 * points + 2.0, cells).order, order)
