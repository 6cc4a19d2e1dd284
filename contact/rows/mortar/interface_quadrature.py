"""Integration points of the interface of two bodies, on segments or on polygons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class InterfaceQuadrature:
    r"""Integration points on the covered part of a non-mortar boundary, with their partners.
    The integral of a product is :math:`\sum_q w_q f(x_q) g(y_q)`, g given on the mortar side.
    M. A. Puso, A 3D mortar method for solid mechanics, Int. J. Numer. Meth. Engng 59 (2004)."""

    x: Array  # places on the non-mortar facets, shape (dim, n)
    y: Array  # where their normals meet the mortar facets, shape (dim, n)
    n: Array  # unit normals interpolated between averaged ones, shape (dim, n)
    w: Array  # lengths or areas on the non-mortar facets, shape (n,)
    facet: Index  # position of the non-mortar facet on its side, shape (n,)
    other: Index  # position of the mortar facet on its side, shape (n,)
    X: Array  # x on the reference facet, shape (dim - 1, n)
    Y: Array  # y on the reference facet, shape (dim - 1, n)

    @property
    def gap(self) -> Array:
        """Measured gap (y - x) . n at each point, negative where the bodies overlap, shape (n,)."""
        return np.asarray(np.sum((self.y - self.x) * self.n, axis=0))
