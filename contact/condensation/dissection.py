"""Fill-reducing elimination order: nested dissection by coordinate bisection."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse


def nested_dissection(
    graph: sparse.csr_array, points: NDArray[np.float64], leaf_size: int = 6
) -> NDArray[np.int64]:
    """Order the vertices of a mesh graph so that its Cholesky factor stays sparse.

    Each set of vertices is cut at the median of its longest coordinate; the vertices on one side
    that touch the other form the separator and are eliminated after both halves. All sets of one
    level are cut together, so the cost is O(log n) passes over the edges.

    Parameters
    ----------
    graph : csr_array, shape (n, n)
        Symmetric adjacency; values are ignored.
    points : ndarray, shape (dim, n)
        Coordinates of the vertices.
    leaf_size : int
        Sets of at most this many vertices are not cut any more.

    Returns
    -------
    ndarray, shape (n,)
        ``order[k]`` is the vertex eliminated at step k.

    References
    ----------
    A. George, Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10 (1973).

    Examples
    --------
    A path of seven vertices: the middle one is eliminated last.

    >>> import numpy as np
    >>> from scipy import sparse
    >>> path = sparse.csr_array(np.eye(7, k=1) + np.eye(7, k=-1))
    >>> int(nested_dissection(path, np.arange(7.0)[None], leaf_size=3)[-1])
    3
    """
    n = graph.shape[0]
    depth = max(0, int(np.ceil(np.log2(max(n, 1) / leaf_size)))) + 2
    coo = graph.tocoo()
    upper = coo.row < coo.col
    head, tail = coo.row[upper], coo.col[upper]

    path = np.zeros(n, dtype=np.int64)  # which set of the current level holds the vertex
    end = np.zeros(n, dtype=np.int64)  # where that set's interval ends on the deepest level
    level = np.full(n, depth, dtype=np.int64)
    alive = np.arange(n)
    for depth_now in range(depth):
        if alive.size == 0:
            break
        right, small = _bisect(path[alive], points[:, alive], leaf_size)
        done = alive[small]
        level[done], end[done] = depth_now, (path[done] + 1) << (depth - depth_now)
        side = np.full(n, -1, dtype=np.int8)
        side[alive[~small]] = right[~small]

        keep = (side[head] >= 0) & (side[tail] >= 0) & (path[head] == path[tail])
        head, tail = head[keep], tail[keep]
        crossing = side[head] != side[tail]
        separator = np.unique(np.where(side[head[crossing]] == 0, head[crossing], tail[crossing]))
        level[separator], end[separator] = depth_now, (path[separator] + 1) << (depth - depth_now)
        side[separator] = -1
        alive = alive[side[alive] >= 0]
        path[alive] = 2 * path[alive] + side[alive]
    level[alive], end[alive] = depth, path[alive] + 1
    return np.lexsort((*points, -level, end)).astype(np.int64)


def _bisect(
    path: NDArray[np.int64], points: NDArray[np.float64], leaf_size: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Split every set at the median of its longest side: (goes right, set is a leaf)."""
    _, start, inverse, count = np.unique(
        path, return_index=True, return_inverse=True, return_counts=True
    )
    by_set = np.argsort(inverse, kind="stable")
    start = np.concatenate(([0], np.cumsum(count)[:-1]))
    low = np.minimum.reduceat(points[:, by_set], start, axis=1)
    high = np.maximum.reduceat(points[:, by_set], start, axis=1)
    axis = np.argmax(high - low, axis=0)
    x = points[axis[inverse], np.arange(path.size)]

    ranked = np.lexsort((x, inverse))
    median = x[ranked[start + (count - 1) // 2]]
    top = high[axis, np.arange(count.size)]
    bottom = low[axis, np.arange(count.size)]
    # On a grid many vertices share the median: the whole line becomes the separator. If the
    # median is also the maximum, cut below it instead.
    right = np.where((median < top)[inverse], x > median[inverse], x >= median[inverse])
    flat = (bottom == top)[inverse]
    rank = np.empty(path.size, dtype=np.int64)
    rank[ranked] = np.arange(path.size) - start[inverse[ranked]]
    right = np.where(flat, 2 * rank >= count[inverse], right)
    return right, (count <= leaf_size)[inverse]


def cell_graph(cells: NDArray[np.int64], count: int) -> sparse.csr_array:
    """Graph of mesh entities that share a cell.

    Parameters
    ----------
    cells : ndarray, shape (nentities a cell, ncells)
    count : int
        Number of entities.

    Returns
    -------
    csr_array, shape (count, count)
    """
    rows = np.repeat(cells, cells.shape[0], axis=0).ravel()
    columns = np.tile(cells, (cells.shape[0], 1)).ravel()
    ones = np.ones(rows.size, dtype=np.int8)
    return sparse.coo_array((ones, (rows, columns)), shape=(count, count)).tocsr()
