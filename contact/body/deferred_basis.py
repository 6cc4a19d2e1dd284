"""A Basis whose tables of shape functions are computed when they are first used."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import CellBasis, ElementVector
from skfem.assembly.basis.abstract_basis import AbstractBasis
from skfem.quadrature import get_quadrature

from contact.arrays.ranges import in_ranges
from contact.body.dof_numbers import DofNumbers
from contact.body.jacobians import is_straight, measures

_ORDER_OF_VOLUME = 3  # two Gauss points a direction: exact for the determinant of straight cells


class DeferredBasis(CellBasis):
    """A `skfem.CellBasis` of all cells that computes its tables of shape functions when first used.
    Those of a block of 64^3 bricks fill tens of gigabytes, while its stiffness needs one cell.
    Shape functions of one point are evaluated at once, so that elements refuse unfit cells here."""

    def __init__(self, mesh: Any, elem: Any, intorder: int) -> None:
        dofs = DofNumbers(mesh, elem)
        AbstractBasis.__init__(
            self, mesh, elem, None, intorder, None, mesh.refdom, dofs, disable_doflocs=True
        )
        self.tind = None
        self.nelems = mesh.nelements
        of_component = elem.elem if isinstance(elem, ElementVector) else elem
        of_component.gbasis(self.mapping, self.X[:, :1], 0)

    @cached_property
    def doflocs(self) -> NDArray[np.float64]:
        """Places of the dofs, shape (dim, ndofs); the components of a vector share one."""
        k = self.elem.dim if isinstance(self.elem, ElementVector) else 1
        found, at = np.zeros((self.mesh.dim(), self.N)), self.elem.doflocs[::k]
        nodal, corners = self.dofs.nodal_dofs, self.mesh.refdom.p.T
        done = nodal.shape[0] // k * len(corners)  # places in a cell, those of vertices first
        if np.array_equal(at[:done], np.repeat(corners, nodal.shape[0] // k, axis=0)):
            found[:, nodal] = self.mesh.p[:, None, : nodal.shape[1]]
        else:
            done = 0
        if done < len(at):
            places = self.mapping.F(at[done:].T)
            for i, dofs in enumerate(self.dofs.element_dofs[k * done :]):
                found[:, dofs] = places[..., i // k]
        return found

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
        mesh = self.mesh
        if not is_straight(mesh):
            return float(self.dx.sum())
        X, W = get_quadrature(mesh.refdom, 0 if mesh.affine else _ORDER_OF_VOLUME)

        def part(cells: slice) -> np.floating:
            return np.sum(np.abs(measures(mesh, cells, X)[0]) @ W)

        return float(sum(in_ranges(part, mesh.nelements)))

    def _measure(self, X: Any, W: Any) -> NDArray[np.float64]:
        return np.abs(self.mapping.detDF(X)) * np.broadcast_to(W, (self.nelems, W.size))
