"""VTK cells that represent one finite element cell, and their reference points."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.element import (
    Element,
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementQuadS2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
)
from skfem.element import ElementQuadBFS as ScikitFemBFS
from skfem.mesh import MeshTet1, MeshTri1
from skfem.refdom import RefHex, RefQuad, RefTet, RefTri

from skfem_adini.elements.element_hex_adini import ElementHexAdini
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.element_quad_bfs import ElementQuadBFS
from skfem_adini.errors import InputError

Array = NDArray[np.float64]

# Degree of the Lagrange cell that contains the functions of an element.
_DEGREE: dict[type[Element], int] = {
    ElementTriP1: 1,
    ElementTriP2: 2,
    ElementQuad1: 1,
    ElementQuad2: 2,
    ElementQuadS2: 2,
    ElementTetP1: 1,
    ElementTetP2: 2,
    ElementHex1: 1,
    ElementHex2: 2,
    ElementHexAdini: 3,
    ElementQuadAdini: 3,
    ElementQuadBFS: 3,
    ScikitFemBFS: 3,
}

LINEAR_ELEMENT: dict[Any, type[Element]] = {
    RefTri: ElementTriP1,
    RefQuad: ElementQuad1,
    RefTet: ElementTetP1,
    RefHex: ElementHex1,
}

# Numbers of the VTK cell types by reference cell and degree (vtkCellType.h).
_VTK_TYPE: dict[Any, int] = {
    (RefTri, 1): 5,
    (RefTri, 2): 22,
    (RefQuad, 1): 9,
    (RefQuad, 2): 28,
    (RefQuad, 3): 70,
    (RefTet, 1): 10,
    (RefTet, 2): 24,
    (RefHex, 1): 12,
    (RefHex, 2): 29,
    (RefHex, 3): 72,
}


@dataclass(frozen=True)
class CellPattern:
    """VTK cells inside one reference cell."""

    vtk_type: int  # number of the VTK cell type
    points: Array  # reference points, multiples of 1/steps, shape (dim, points)
    cells: NDArray[np.integer]  # points of each VTK cell, shape (cells, points of a cell)
    steps: int  # intervals along an edge


def exact_degree(elem: Element) -> int | None:
    """Return the degree of the Lagrange cell that contains a continuous element, else None."""
    return _DEGREE.get(type(elem))


def lagrange_pattern(refdom: Any, degree: int) -> CellPattern | None:
    """Return one Lagrange cell of the given degree, None if no VTK type is listed for it here."""
    if (refdom, degree) not in _VTK_TYPE:
        return None
    if refdom is RefQuad:
        lattice = _quad_lattice(degree)
    elif refdom is RefHex and degree > 2:
        lattice = _hex_lattice(degree)
    else:
        corners = _cyclic_corners(refdom)
        lattice = corners if degree == 1 else np.vstack([corners, *_midpoints(refdom, corners)])
    cells = np.arange(len(lattice))[None]
    return CellPattern(_VTK_TYPE[refdom, degree], lattice.T, cells, degree)


def linear_pattern(refdom: Any, steps: int) -> CellPattern:
    """Return linear cells that divide each edge into `steps` intervals, a power of two for
    simplices."""
    if not isinstance(steps, int | np.integer) or isinstance(steps, bool) or steps < 1:
        raise InputError(f"subdivide: expected a positive whole number, got {steps!r}")
    steps = int(steps)
    if refdom in (RefTri, RefTet):
        if steps & (steps - 1):
            raise InputError(f"subdivide: simplices need a power of two, got {steps}")
        mesh = (MeshTri1 if refdom is RefTri else MeshTet1).init_refdom()
        mesh = mesh.refined(steps.bit_length() - 1)
        points, cells = mesh.p, _positive(mesh.p, mesh.t.T)
    elif refdom in (RefQuad, RefHex):
        dim = refdom.dim()
        lattice = np.array(list(product(range(steps + 1), repeat=dim)))
        stride = (steps + 1) ** np.arange(dim)[::-1]
        lowest = lattice[(lattice < steps).all(axis=1)]
        corners = _cyclic_corners(refdom).astype(int)
        points, cells = lattice.T / steps, (lowest[:, None] + corners) @ stride
    else:
        raise InputError(f"basis: cannot write cells of type {refdom.name}")
    return CellPattern(_VTK_TYPE[refdom, 1], points, cells, steps)


def _cyclic_corners(refdom: Any) -> Array:
    """Return the corners in VTK order, hexahedra bottom face first."""
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    if refdom is RefQuad:
        return square
    if refdom is RefHex:
        return np.vstack([np.c_[square, np.full(4, z)] for z in (0.0, 1.0)])
    return np.vstack([np.zeros(refdom.dim()), np.eye(refdom.dim())])


def _midpoints(refdom: Any, corners: Array) -> list[Array]:
    """Return the midpoints of edges (for hexahedra also of faces and cell) in VTK order."""
    edges = {
        RefTri: [(0, 1), (1, 2), (2, 0)],
        RefTet: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
        RefHex: [
            *((0, 1), (1, 2), (2, 3), (3, 0)),
            *((4, 5), (5, 6), (6, 7), (7, 4)),
            *((0, 4), (1, 5), (2, 6), (3, 7)),
        ],
    }[refdom]
    middle = [corners[list(edge)].mean(axis=0) for edge in edges]
    if refdom is RefHex:
        for axis, end in product(range(3), (0.0, 1.0)):
            face = np.full(3, 0.5)
            face[axis] = end
            middle.append(face)
        middle.append(np.full(3, 0.5))
    return middle


def _quad_lattice(degree: int) -> Array:
    """Return the points of a Lagrange quadrilateral: corners, edges, inside row by row."""
    inner = np.arange(1, degree) / degree
    edges = [(inner, 0 * inner), (0 * inner + 1, inner), (inner, 0 * inner + 1), (0 * inner, inner)]
    inside = [(x, y) for y in inner for x in inner]
    return np.vstack(
        [_cyclic_corners(RefQuad), *(np.c_[edge] for edge in edges), np.reshape(inside, (-1, 2))]
    )


def _hex_lattice(degree: int) -> Array:
    """Return the points of a Lagrange hexahedron: corners, edges, faces, inside, with x fastest.
    Edges go in the direction of their axis: around the bottom, around the top, then upwards.
    Faces come in pairs normal to x, y, z."""
    inner = np.arange(1, degree) / degree
    corners = _cyclic_corners(RefHex)
    around = [(0, 1), (1, 2), (3, 2), (0, 3)]
    edges = [*around, *((a + 4, b + 4) for a, b in around), *((k, k + 4) for k in range(4))]
    points = [*corners]
    for a, b in edges:
        points += [corners[a] + s * (corners[b] - corners[a]) for s in inner]
    for axis, end in product(range(3), (0.0, 1.0)):
        points += [np.insert([u, v], axis, end) for v in inner for u in inner]
    points += [np.array([x, y, z]) for z in inner for y in inner for x in inner]
    return np.array(points)


def _positive(points: Array, cells: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return simplices with their vertices ordered for positive volume."""
    first = points[:, cells[:, 0]]
    sides = np.array([points[:, cells[:, k]] - first for k in range(1, cells.shape[1])])
    cells = cells.copy()
    negative = np.linalg.det(sides.transpose(2, 0, 1)) < 0
    cells[np.ix_(negative, [0, 1])] = cells[np.ix_(negative, [1, 0])]
    return cells
