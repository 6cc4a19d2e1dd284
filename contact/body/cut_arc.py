"""The curved boundary of a cut body: its quadrature points and the trace on them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.arc_length import Curve, curves
from contact.body.elastic_body import ElasticBody

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CutArc:
    """Part of the curved boundary of a `CutBody`, by its n quadrature points."""

    body: ElasticBody  # the `CutBody` itself
    index: NDArray[np.int64]  # numbers among all points of the boundary, to tell arcs that overlap
    x: Array  # points, shape (2, n)
    normals: Array  # outward unit normals, shape (2, n)
    weights: Array
    size: Array  # extent of the cell along the arc, shape (n,)
    part: NDArray[np.int64]  # leaf of the level set, or side of the polygon
    trace: sparse.csr_array  # scalar functions at the points, (n, scalar dofs)
    spacing: float  # between neighbouring multipliers, in cell sizes

    def __repr__(self) -> str:
        return f"CutArc({self.index.size} points)"

    @cached_property
    def curves(self) -> list[Curve]:
        """The connected smooth curves that the arc consists of."""
        return curves(self.x, self.normals, self.weights, self.size, self.part)

    def integral(self, density: Array) -> Array:
        """Load vector of all dofs of a traction at the points, shape (2, n)."""
        load = np.zeros(2 * self.trace.shape[1])
        for c in range(2):
            load[c::2] = self.trace.T @ (self.weights * density[c])
        return load
