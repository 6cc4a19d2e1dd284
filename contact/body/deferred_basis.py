"""A Basis whose tables of shape functions are computed when they are first used."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import CellBasis, MeshHex, MeshQuad
from skfem.assembly.basis.abstract_basis import AbstractBasis
from skfem.quadrature import get_quadrature

# Of Gauss' rule with two points in each direction, exact for the determinant of straight cells.
_ORDER_OF_VOLUME = 3


class DeferredBasis(CellBasis):
    """A `skfem.CellBasis` of all cells that waits with its tables.

    Those of a block of 64^3 bricks fill tens of gigabytes, while its stiffness needs one cell.
    Shape functions of one point are evaluated at once, so that elements refuse unfit cells here.

    Parameters
    ----------
    mesh : Mesh
    elem : Element
    intorder : int
    """

    def __init__(self, mesh: Any, elem: Any, intorder: int) -> None:
        AbstractBasis.__init__(self, mesh, elem, None, intorder, None, mesh.refdom)
        self.tind = None
        self.nelems = mesh.nelements
        self.elem.gbasis(self.mapping, self.X[:, :1], 0)

    @cached_property
    def basis(self) -> list[Any]:
        """Shape functions in the quadrature points."""
        return [self.elem.gbasis(self.mapping, self.X, j) for j in range(self.Nbfun)]

    @cached_property
    def dx(self) -> NDArray[np.float64]:
        """Weights of the quadrature points, shape (cells, points)."""
        return self._measure(self.X, self.W)

    @cached_property
    def volume(self) -> float:
        """Area or volume of the mesh."""
        if type(self.mesh) in (MeshQuad, MeshHex):
            X, W = get_quadrature(self.mesh.refdom, _ORDER_OF_VOLUME)
            return float(self._measure(X, W).sum())
        return float(self.dx.sum())

    def _measure(self, X: Any, W: Any) -> NDArray[np.float64]:
        return np.abs(self.mapping.detDF(X)) * np.broadcast_to(W, (self.nelems, W.size))
