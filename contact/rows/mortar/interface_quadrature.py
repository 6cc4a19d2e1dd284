"""Integration points of the interface of two bodies, whatever the pieces that they come from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class InterfaceQuadrature:
    r"""Integration points on the covered part of a non-mortar boundary, with their partners.

    Each pair of facets that face each other has a piece in common: an interval in 2-D, a convex
    polygon in 3-D. With quadrature points q on the pieces, an integral over the covered part of the
    non-mortar boundary, of functions that live on either side, is
    :math:`\sum_q w_q \, f(x_q) \, g(y_q)`.

    Attributes
    ----------
    x, y : ndarray, shape (dim, n)
        Places on the non-mortar facet and, in the direction of the normal, on the mortar facet.
    n : ndarray, shape (dim, n)
        Unit normals, outward of the non-mortar body: those of its vertices, averaged over the
        facets that meet there, interpolated linearly along the facet and scaled to unit length.
    w : ndarray, shape (n,)
        Weights: lengths (2-D) or areas (3-D) on the non-mortar facets.
    facet, other : ndarray of int, shape (n,)
        Position of the non-mortar and of the mortar facet in the arrays of facets of either side.
    X, Y : ndarray, shape (dim - 1, n)
        Coordinates of x and y on the reference facet.

    References
    ----------
    M. A. Puso, A 3D mortar method for solid mechanics, Int. J. Numer. Meth. Engng 59 (2004).
    """

    x: Array
    y: Array
    n: Array
    w: Array
    facet: Index
    other: Index
    X: Array
    Y: Array

    @property
    def gap(self) -> Array:
        """Measured gap (y - x) . n at each point, negative where the bodies overlap, shape (n,)."""
        return np.asarray(np.sum((self.y - self.x) * self.n, axis=0))
