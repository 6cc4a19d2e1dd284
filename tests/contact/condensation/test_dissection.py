"""Nested dissection: a permutation whose separators come last and keep the factor sparse."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from skfem import ElementTetP1, ElementTriP1, MeshTet, MeshTri

from contact.condensation.elimination_order import counted_order, nested_dissection


def grid(*counts):
    """Nearest-neighbour graph of a grid with its points."""
    axes = np.meshgrid(*(np.arange(float(n)) for n in counts), indexing="ij")
    points = np.array([a.ravel() for a in axes])
    pairs = []
    number = np.arange(points.shape[1]).reshape(counts)
    for axis in range(len(counts)):
        low = np.take(number, range(counts[axis] - 1), axis).ravel()
        high = np.take(number, range(1, counts[axis]), axis).ravel()
        pairs.append((low, high))
    head, tail = np.hstack(pairs)
    return points, np.array([head, tail])


def mesh_graph(mesh):
    return mesh.p, mesh.t


def adjacency(points, cells):
    """The graph whose edges join vertices of one cell."""
    rows = np.repeat(cells, cells.shape[0], axis=0).ravel()
    columns = np.tile(cells, (cells.shape[0], 1)).ravel()
    n = points.shape[1]
    return sparse.csr_array(sparse.coo_array((np.ones(rows.size), (rows, columns)), shape=(n, n)))


def unstructured():
    """Delaunay-like mesh: adaptively refined towards a corner, vertices shaken."""
    mesh = MeshTri().refined(3)
    for _ in range(4):
        middle = mesh.p[:, mesh.t].mean(axis=1)
        mesh = mesh.refined(np.flatnonzero(np.hypot(*middle) < 0.4))
    return mesh_graph(mesh)


def two_pieces():
    points, edges = grid(9, 7)
    other = points + np.array([[20.0], [0.0]])
    return np.hstack([points, other]), np.hstack([edges, edges + points.shape[1]])


GRAPHS = {
    "grid": lambda: grid(17, 13),
    "grid-3d": lambda: grid(6, 7, 5),
    "unstructured": unstructured,
    "tetrahedra": lambda: mesh_graph(MeshTet().refined(2)),
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
def test_is_a_permutation(name, leaf_size):
    points, cells = GRAPHS[name]()
    dissection = nested_dissection(points, cells, leaf_size)
    assert np.array_equal(np.sort(dissection.order), np.arange(points.shape[1]))
    for depth in range(1, dissection.levels + 2):
        order, block = dissection.breadth_first(depth)
        assert np.array_equal(np.sort(order), np.arange(points.shape[1]))
        assert np.all(np.diff(block[order]) >= 0)
        assert block.min() >= 0
        assert block.max() <= 2**depth - 2


@pytest.mark.parametrize("name", GRAPHS)
def test_blocks_touch_what_they_must_not_only_through_their_ancestors(name):
    """Neighbours lie in one block, or one in a separator of a set that holds the other."""
    points, cells = GRAPHS[name]()
    dissection = nested_dissection(points, cells, 2)
    graph = adjacency(points, cells).tocoo()
    for depth in range(1, dissection.levels + 2):
        block = dissection.breadth_first(depth)[1]
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


def halves(middles, cells):
    """A set of cells in two: along its longest coordinate, between different ones if there are."""
    if not cells.size:
        return cells, cells
    cells = np.sort(cells)
    places = middles[:, cells]
    along = places[np.argmax(np.ptp(places, axis=1))]
    cells, along = cells[np.argsort(along, kind="stable")], np.sort(along)
    half = cells.size // 2
    between = [k for k in range(1, cells.size) if along[k] > along[k - 1]]
    cut = min(between, key=lambda k: (abs(k - half), k), default=half)
    return cells[:cut], cells[cut:]


@pytest.mark.parametrize("name", GRAPHS)
@pytest.mark.parametrize("leaf_size", [1, 7])
def test_a_vertex_belongs_to_the_smallest_set_that_holds_its_cells(name, leaf_size):
    points, cells = GRAPHS[name]()
    dissection = nested_dissection(points, cells, leaf_size)
    middles = points[:, cells].mean(axis=1)
    if cells.size:  # in steps of a part of the size: rounding decides nothing
        middles = middles - middles.min(axis=1, keepdims=True)
        middles = np.rint(middles / (middles.max() or 1.0) * 2.0**26)
    sets = [np.arange(cells.shape[1])]
    level = [sets]
    for _ in range(dissection.levels):
        sets = [half for whole in sets for half in halves(middles, whole)]
        level.append(sets)
    of_level = [[set(one) for one in sets] for sets in level]
    for vertex in range(points.shape[1]):
        own = set(np.flatnonzero((cells == vertex).any(axis=0)))
        height, part = next(
            (height, part)
            for height, members in enumerate(reversed(of_level))
            for part, one in enumerate(members)
            if own <= one
        )
        assert dissection.height[vertex] == height
        assert dissection.part[vertex] == (part if own else 0)


@pytest.mark.parametrize("count", [1, 5, 1000])
def test_counted_order_is_a_stable_sort(count):
    keys = np.random.default_rng(1).integers(0, count, 3000)
    np.testing.assert_array_equal(counted_order(keys, count), np.argsort(keys, kind="stable"))


@pytest.mark.parametrize("k", [15, 31])
def test_first_separator_is_the_middle_line(k):
    points, edges = grid(k + 2, k)  # longest along the first coordinate
    order = nested_dissection(points, edges).order
    assert np.array_equal(np.unique(points[0, order[-k:]]), [(k + 1) / 2])


@pytest.mark.parametrize("name", ["grid", "grid-3d", "unstructured", "tetrahedra"])
def test_separators_separate(name):
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


def test_fill_on_a_grid():
    """Natural order fills the band, n^(3/2); nested dissection O(n log n)."""
    fill, natural = [], []
    sizes = (15, 31, 63)
    for k in sizes:
        points, cells = grid(k, k)
        graph = adjacency(points, cells)
        fill.append(factor_nnz(graph, nested_dissection(points, cells).order))
        natural.append(factor_nnz(graph, np.arange(k * k)))
    assert fill[-1] < 0.4 * natural[-1]
    order_of_growth = np.polyfit(np.log(np.square(sizes)), np.log(fill), 1)[0]
    # n log n on these sizes looks like n^1.2, the band like n^1.5.
    assert 1.0 < order_of_growth < 1.3
    assert np.polyfit(np.log(np.square(sizes)), np.log(natural), 1)[0] > 1.4


@pytest.mark.parametrize("name", ["grid", "unstructured", "tetrahedra", "two-pieces"])
def test_fill_beats_natural_and_random_order(name):
    points, cells = GRAPHS[name]()
    graph, n = adjacency(points, cells), points.shape[1]
    fill = factor_nnz(graph, nested_dissection(points, cells).order)
    assert fill < factor_nnz(graph, np.random.default_rng(0).permutation(n))
    assert fill < factor_nnz(graph, np.lexsort(points))


@pytest.mark.parametrize("element", [ElementTriP1, ElementTetP1])
def test_coordinates_only_choose_where_to_cut(element, make):
    """Scaling and shifting the points changes nothing."""
    ticks = np.linspace(0, 1, 5)
    points, cells = mesh_graph(make.box(element, *(ticks,) * element().dim))
    order = nested_dissection(points, cells, 1).order
    assert np.array_equal(nested_dissection(8.0 * points + 2.0, cells, 1).order, order)
