"""A Basis whose tables of shape functions are computed when first used."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import CellBasis, ElementVector, Mesh
from skfem.assembly import Dofs
from skfem.assembly.basis.abstract_basis import AbstractBasis
from skfem.quadrature import get_quadrature

from contact.arrays.ranges import in_ranges
from contact.body.jacobians import is_straight, measures


class DofNumbers(Dofs):
    """A `skfem.assembly.Dofs` whose table is allocated once, not stacked row by row."""

    def __init__(self, topo: Any, element: Any) -> None:
        self.topo, self.element = topo, element
        cells, none = topo.t.shape[1], np.empty((0, 0), dtype=np.int32)
        self.edge_dofs = self.facet_dofs = none
        kinds: list[tuple[str, Any, int]] = [("nodal", topo.t, topo.nvertices)]
        if element.dim == 3 and element.edge_dofs > 0:
            kinds.append(("edge", topo.t2e, topo.nedges))
        if element.dim >= 2 and element.facet_dofs > 0:
            kinds.append(("facet", topo.t2f, topo.nfacets))
        kinds.append(("interior", np.arange(cells)[None], cells))
        of_each = [getattr(element, f"{name}_dofs") for name, *_ in kinds]
        rows = sum(
            count * len(of_cells) for count, (_, of_cells, _) in zip(of_each, kinds, strict=True)
        )
        self.element_dofs = np.empty((rows, cells), dtype=np.int32)
        first, row = 0, 0
        for count, (name, of_cells, entities) in zip(of_each, kinds, strict=True):
            numbers = np.arange(first, first + count * entities, dtype=np.int32)
            setattr(self, f"{name}_dofs", numbers.reshape(entities, count).T)
            for entity in of_cells:
                begin = entity.astype(np.int32) * count + first
                for k in range(count):
                    np.add(begin, k, out=self.element_dofs[row + k])
                row += count
            first += count * entities
        self.N = np.max(self.element_dofs) + 1


class DeferredBasis(CellBasis):
    """A `skfem.CellBasis` of all cells that computes its tables of shape functions when first used.
    Tables of 64^3 bricks fill tens of gigabytes, while their stiffness needs one cell.
    The constructor evaluates one point, so that elements refuse unsuitable cells."""

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
        """Coordinates of the dofs, shape (dim, ndofs), equal for the components of a vector."""
        k = self.elem.dim if isinstance(self.elem, ElementVector) else 1
        found, at = np.zeros((self.mesh.dim(), self.N)), self.elem.doflocs[::k]
        nodal, corners = self.dofs.nodal_dofs, self.mesh.refdom.p.T
        done = nodal.shape[0] // k * len(corners)  # dof locations in a cell, vertices first
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
        # Two Gauss points a direction are exact for the determinant of straight cells.
        X, W = get_quadrature(mesh.refdom, 0 if mesh.affine else 3)

        def part(cells: slice) -> np.floating:
            return np.sum(np.abs(measures(mesh, cells, X)[0]) @ W)

        return float(sum(in_ranges(part, mesh.nelements)))

    def _measure(self, X: Any, W: Any) -> NDArray[np.float64]:
        return np.abs(self.mapping.detDF(X)) * np.broadcast_to(W, (self.nelems, W.size))


Index = NDArray[np.int64]


def dofs_on_facets(basis: Any, facets: Index) -> Index:
    """``basis.get_dofs(facets).flatten()``: ascending dofs of vertices, edges and facets.
    scikit-fem numbers all edges of a mesh in space for it, even if they carry no dofs."""
    dofs, mesh = basis.dofs, basis.mesh
    if mesh.dim() == 3 and mesh.bndelem is None:
        return np.asarray(basis.get_dofs(facets).flatten(), dtype=np.int64)
    held = [dofs.nodal_dofs[:, np.unique(mesh.facets[:, facets])]]
    if len(dofs.facet_dofs):
        held.append(dofs.facet_dofs[:, facets])
    if mesh.dim() == 3 and len(dofs.edge_dofs):
        held.append(dofs.edge_dofs[:, np.unique(edges_of_facets(mesh, facets))])
    return np.unique(np.concatenate([part.ravel() for part in held])).astype(np.int64)


def edges_of_facets(mesh: Mesh, facets: Index) -> Index:
    """Edges of facets of a mesh in space, ascending, shape (edges of a facet, nfacets).
    They are those edges of a facet's cell with both ends in the facet."""
    corners, cells = mesh.facets[:, facets], mesh.f2t[0, facets]
    edges = mesh.t2e[:, cells]
    ends = mesh.edges[:, edges]  # (2, edges of a cell, nfacets)
    inside = (ends[:, :, None] == corners).any(axis=2).all(axis=0)
    count = len(corners)  # a ring has as many edges as corners
    return np.asarray(np.sort(np.where(inside, edges, mesh.nedges), axis=0)[:count], dtype=np.int64)
