"""Convex polygons in the plane, many at once: cut by lines, cut out of each other, measured.

Polygons are padded arrays of corners, shape (n, k, 2), with the number of corners of each, (n,).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def anticlockwise(corners: Array) -> Array:
    """Polygons, shape (n, k, 2), with the interior on the left."""
    x, y = corners[..., 0], corners[..., 1]
    area = np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)
    return np.where((area < 0)[:, None, None], corners[:, ::-1], corners)


def clipped(polygon: Array, size: Index, a: Array, b: Array) -> tuple[Array, Index]:
    """The part of each polygon on the left of the line from a to b, shapes (n, 2).

    References
    ----------
    I. E. Sutherland and G. W. Hodgman, Reentrant polygon clipping, Comm. ACM 17 (1974).

    Examples
    --------
    >>> square = np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]])
    >>> left = clipped(square, np.array([4]), np.array([[0.25, 0.0]]), np.array([[0.25, 1.0]]))
    >>> measured(*left)[0].tolist()
    [0.25]
    """
    count, width = polygon.shape[:2]
    index = np.arange(width)
    real = index < size[:, None]
    after = np.where(index + 1 < size[:, None], index + 1, 0)
    following = np.take_along_axis(polygon, after[..., None], axis=1)
    way = b - a

    def height(p: Array) -> Array:
        off = p - a[:, None]
        return np.asarray(way[:, None, 0] * off[..., 1] - way[:, None, 1] * off[..., 0])

    here, there = height(polygon), height(following)
    crossing = real & ((here >= 0) != (there >= 0))
    share = here / np.where(crossing, here - there, 1.0)
    cut = polygon + share[..., None] * (following - polygon)
    # Each corner is followed by the place where its edge meets the line.
    points = np.stack((polygon, cut), axis=2).reshape(count, 2 * width, 2)
    keep = np.stack((real & (here >= 0), crossing), axis=2).reshape(count, 2 * width)
    order = np.argsort(~keep, axis=1, kind="stable")
    size = keep.sum(axis=1)
    width = max(3, int(size.max(initial=0)))
    return np.take_along_axis(points, order[..., None], axis=1)[:, :width], size


def edges(polygon: Array, size: Index, k: int) -> tuple[Array, Array]:
    """Ends of edge k of each polygon, shapes (n, 2); the last edge of those with fewer."""
    rows = np.arange(size.size)
    start = np.minimum(k, np.maximum(size, 1) - 1)
    end = np.where(start + 1 < size, start + 1, 0)
    return polygon[rows, start], polygon[rows, end]


def common(polygon: Array, size: Index, window: Array, sides: Index) -> tuple[Array, Index]:
    """The part of each polygon inside a window, which is one too."""
    for k in range(window.shape[1]):
        polygon, size = clipped(polygon, size, *edges(window, sides, k))
    return polygon, size


def outside(polygon: Array, size: Index, window: Array, sides: Index) -> list[tuple[Array, Index]]:
    """The part of each polygon outside a window, as convex pieces, one for every edge.

    A piece is beyond its edge and within the edges before.
    """
    pieces = []
    for k in range(window.shape[1]):
        a, b = edges(window, sides, k)
        beyond, corners = clipped(polygon, size, b, a)
        pieces.append((beyond, np.where(k < sides, corners, 0)))
        polygon, size = clipped(polygon, size, a, b)
    return pieces


def measured(polygon: Array, size: Index) -> tuple[Array, Array]:
    """Area and middle of the corners of each polygon, shapes (n,) and (n, 2)."""
    real = np.arange(polygon.shape[1]) < size[:, None]
    middle = np.sum(np.where(real[..., None], polygon, 0.0), axis=1) / np.maximum(size, 1)[:, None]
    return triangles(polygon, size, middle)[2].sum(axis=1), middle


def triangles(polygon: Array, size: Index, middle: Array) -> tuple[Array, Array, Array]:
    """Edges of the polygons from the middle, and areas of the triangles; zero where padded."""
    index = np.arange(polygon.shape[1])
    after = np.where(index + 1 < size[:, None], index + 1, 0)
    one = polygon - middle[:, None]
    two = np.take_along_axis(polygon, after[..., None], axis=1) - middle[:, None]
    area = 0.5 * (one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])
    return one, two, np.where(index < size[:, None], area, 0.0)


def padded(polygon: Array, width: int) -> Array:
    """Polygons with room for a given number of corners."""
    return np.pad(polygon, ((0, 0), (0, width - polygon.shape[1]), (0, 0)))
