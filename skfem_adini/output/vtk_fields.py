"""Finite element fields as VTK data, exact where a VTK cell can represent them."""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.assembly import CellBasis
from skfem.assembly.basis.abstract_basis import AbstractBasis
from skfem.element import (
    Element,
    ElementComposite,
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementQuadS2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    ElementVector,
)
from skfem.element import ElementQuadBFS as ScikitFemBFS
from skfem.mesh import MeshTet1, MeshTri1
from skfem.refdom import RefHex, RefQuad, RefTet, RefTri

from skfem_adini.elements.element_hex_adini import ElementHexAdini
from skfem_adini.elements.element_quad_adini import ElementQuadAdini
from skfem_adini.elements.element_quad_bfs import ElementQuadBFS
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of, finite_numbers, integer
from skfem_adini.ground.errors import optional
from skfem_adini.ground.vtk_files import write_grid, write_series

Array = NDArray[np.float64]
Indices = NDArray[np.integer]
Fields = Array | Mapping[str, Array]
Step = tuple[float, Fields] | tuple[float, Fields, Mapping[str, Any]]


def to_pyvista(
    basis: Any,
    x: Fields,
    name: str = "u",
    subdivide: int | None = None,
    point_data: Mapping[str, Any] | None = None,
    cell_data: Mapping[str, Any] | None = None,
) -> Any:
    """Return finite element fields as a `pyvista.UnstructuredGrid`.

    An Adini or BFS cell becomes one 16-node Lagrange quadrilateral (VTK cell type 70), an Adini
    brick one 64-node Lagrange hexahedron (type 72); both hold the element's functions exactly.
    Linear and quadratic elements become linear and quadratic VTK cells. These cells share the
    points on their common edges. Any other element is written as linear sub-cells that share no
    points, so that jumps between cells stay visible.

    Parameters
    ----------
    basis
        A scikit-fem cell basis of a scalar element or `ElementVector`, on any mesh of triangles,
        quadrilaterals, tetrahedra or hexahedra.
    x
        Dofs (basis.N,), or a mapping from names to such vectors.
    name
        Name of the field when `x` is one vector.
    subdivide
        Write linear cells, this many along each edge (a power of two for simplices), instead of
        exact ones; 4 by default for elements that no VTK cell represents.
    point_data
        Further data at the mesh vertices, name to array (vertices,), (components, vertices) or for
        tensors (rows, columns, vertices); (multi)linear inside the cells. `nodal_gradient` and
        `nodal_stress` give such arrays.
    cell_data
        Further data in the mesh cells, name to array (cells,), (components, cells) or for tensors
        (rows, columns, cells).

    Returns
    -------
    pyvista.UnstructuredGrid
        Points with z = 0 in 2-D; vector fields with three components, tensors with nine (row by
        row). Sample it with a small `tolerance`: by default VTK may take a point near an edge from
        the neighbouring cell.

    Raises
    ------
    InputError
        Not a cell basis, a field of the wrong length, not real or not finite (nothing is written
        then), or `subdivide` out of range.
    MissingDependency
        pyvista is not installed.

    Examples
    --------
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad().refined(1), ElementQuadAdini())
    >>> grid = to_pyvista(basis, basis.project(lambda x: x[0] ** 3))
    >>> grid.n_cells, grid.n_points, int(grid.celltypes[0])
    (4, 49, 70)
    """
    pyvista = optional("pyvista", "VTK output needs pyvista: pip install 'pyvista>=0.47'")
    _refuse_other_bases(basis)
    fields = _named("x", x if isinstance(x, Mapping) else {name: x})
    pattern, continuous = _pattern(basis, subdivide)
    dofs = {key: _checked("x", key, vector, basis.N) for key, vector in fields.items()}
    tind = np.arange(basis.nelems) if basis.tind is None else basis.tind
    X = _oriented(basis, pattern, tind)
    vertices = basis.mesh.t[:, tind]
    weights = _vertex_weights(basis, X)
    keep, number = _number_points(pattern, vertices, weights, continuous)

    points = basis.mapping.F(X, tind=tind)
    cells = number[:, pattern.cells].reshape(-1, pattern.cells.shape[1])
    layout = np.hstack([np.full((len(cells), 1), cells.shape[1]), cells])
    types = np.full(len(cells), pattern.vtk_type, dtype=np.uint8)
    grid = pyvista.UnstructuredGrid(layout.ravel(), types, _rows(points, keep))

    for key, values in _evaluate(basis, dofs, X, tind).items():
        grid.point_data[key] = _rows(values, keep)
    for key, array in _named("point_data", point_data).items():
        nodal = _checked("point_data", key, array, basis.mesh.nvertices)
        values = np.einsum("...vc,vcp->...cp", nodal[..., vertices], weights)
        grid.point_data[key] = _rows(values, keep)
    for key, array in _named("cell_data", cell_data).items():
        values = _checked("cell_data", key, array, basis.mesh.nelements)
        values = np.repeat(values[..., tind], len(pattern.cells), axis=-1)
        grid.cell_data[key] = _components(values)
    return grid


def save(
    path: str | Path,
    basis: Any,
    fields: Fields | Sequence[Step],
    subdivide: int | None = None,
    point_data: Mapping[str, Any] | None = None,
    cell_data: Mapping[str, Any] | None = None,
) -> Path:
    """Write finite element fields to a VTK file, or a time series to a `.pvd` collection.

    Parameters
    ----------
    path
        A name ending in `.vtu` or `.vtk`, or in `.pvd` for a series: the steps then lie beside
        it as `name_0000.vtu`, `name_0001.vtu` and so on. Missing folders are made.
    basis, subdivide, point_data, cell_data
        As in :func:`to_pyvista`.
    fields
        A mapping from names to dof vectors (or one vector, named u); for a series a sequence of
        pairs (time, fields), or of triples (time, fields, point_data) where the point data change
        as well.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    InputError
        Another suffix, an empty series, or what :func:`to_pyvista` refuses.
    MissingDependency
        pyvista is not installed.
    OSError
        No space left, or no right to write. Files of this name stay as they were.

    Notes
    -----
    meshio reads these files, except `.vtu` with 64-node hexahedra: VTK marks them as version 2.3,
    which stands for their node order. Write bricks as `.vtk` for meshio.

    Examples
    --------
    >>> import tempfile
    >>> from skfem import Basis, MeshQuad
    >>> from skfem_adini import ElementQuadAdini
    >>> basis = Basis(MeshQuad(), ElementQuadAdini())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(f"{folder}/field.vtu", basis, {"u": basis.ones()}).name
    'field.vtu'
    """
    if not isinstance(path, str | Path):
        raise InputError(f"path: expected a file name, got {path!r}")
    path = Path(path)
    options: dict[str, Any] = {
        "subdivide": subdivide,
        "point_data": point_data,
        "cell_data": cell_data,
    }
    if path.suffix not in (".vtu", ".vtk", ".pvd"):
        raise InputError(f"path: expected a name ending in .vtu, .vtk or .pvd, got {path.name!r}")
    if path.suffix != ".pvd":
        if not isinstance(fields, Mapping | np.ndarray):
            raise InputError("fields: expected a mapping of names to vectors; a series needs .pvd")
        write_grid(path, to_pyvista(basis, fields, **options))
        return path

    steps = _checked_steps(basis, fields)

    def grids() -> Iterator[tuple[float, Any]]:
        for time, step, *data in steps:
            of_step = {**options, "point_data": dict(point_data or {}) | dict(*data)}
            yield time, to_pyvista(basis, step, **of_step)

    return write_series(path, grids())[0]


def _checked_steps(basis: Any, fields: Any) -> list[Any]:
    """Return the steps of a series, all checked before the first file is written."""
    listed = isinstance(fields, Sequence) and not isinstance(fields, str)
    steps = list(fields) if listed else []
    if not steps or not all(
        isinstance(step, tuple | list)
        and len(step) in (2, 3)
        and isinstance(step[0], numbers.Real)
        and math.isfinite(step[0])
        and isinstance(step[1], Mapping | np.ndarray)
        for step in steps
    ):
        raise InputError(
            "fields: a .pvd series takes a non-empty list of pairs (time, fields) or triples "
            "(time, fields, point_data) with finite times"
        )
    _refuse_other_bases(basis)
    for _, step, *data in steps:
        named = step if isinstance(step, Mapping) else {"u": step}
        for key, vector in _named("x", named).items():
            _checked("x", key, vector, basis.N)
        for key, array in _named("point_data", *data or [None]).items():
            _checked("point_data", key, array, basis.mesh.nvertices)
    return steps


def _refuse_other_bases(basis: Any) -> None:
    if not isinstance(basis, CellBasis) or isinstance(basis.elem, ElementComposite):
        got = type(basis).__name__
        of = f" of {type(basis.elem).__name__}" if isinstance(basis, AbstractBasis) else ""
        raise InputError(
            f"basis: expected a cell basis of a scalar or vector element, got {got}{of}"
        )


def _pattern(basis: Any, subdivide: int | None) -> tuple[CellPattern, bool]:
    """Return the VTK cells, and whether neighbours share points."""
    mesh, elem = basis.mesh, basis.elem
    degree = exact_degree(elem.elem if isinstance(elem, ElementVector) else elem)
    geometry = exact_degree(mesh.elem())
    continuous = degree is not None and geometry is not None
    if subdivide is None and degree is not None and geometry is not None:
        exact = lagrange_pattern(mesh.refdom, max(degree, geometry))
        if exact is not None:
            return exact, True
    steps = 4 if subdivide is None else subdivide  # 1/16 of the error of one chord
    return linear_pattern(mesh.refdom, steps), continuous


def _oriented(basis: Any, pattern: CellPattern, tind: Indices) -> Array:
    """Return reference points (dim, cells, points), mirrored in cells of negative volume."""
    X = np.repeat(pattern.points[:, None], len(tind), axis=1)
    mirrored = basis.mapping.detDF(X, tind=tind)[:, 0] < 0
    X[:2, mirrored] = X[1::-1, mirrored]
    return X


def _vertex_weights(basis: Any, X: Array) -> Array:
    """Return the (multi)linear vertex functions at X, (vertices of a cell, cells, points)."""
    linear = {
        RefTri: ElementTriP1, RefQuad: ElementQuad1, RefTet: ElementTetP1, RefHex: ElementHex1
    }[basis.mesh.refdom]()  # fmt: skip
    return np.array([linear.lbasis(X, k)[0] for k in range(basis.mesh.refdom.nnodes)])


def _number_points(
    pattern: CellPattern, cells: Indices, weights: Array, continuous: bool
) -> tuple[Indices, Indices]:
    """Return the positions in the flattened (cells, points) that are kept, and every point's
    number. If `continuous`, points of two cells are one when they have the same weights on the same
    vertices, by the sum of weight times a random 64-bit number of the vertex."""
    shape = weights.shape[1:]
    if not continuous:
        everything = np.arange(shape[0] * shape[1])
        return everything, everything.reshape(shape)
    label = np.random.default_rng(0).integers(2**64, size=cells.max() + 1, dtype=np.uint64)
    multiples = np.rint(weights * pattern.steps ** len(pattern.points)).astype(np.uint64)
    key = (multiples * label[cells][:, :, None]).sum(axis=0).ravel()
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return first[order], np.argsort(order)[number].reshape(shape)


def _evaluate(basis: Any, dofs: Mapping[str, Array], X: Array, tind: Indices) -> dict[str, Array]:
    """Return every field at X, as (cells, points) or (components, cells, points)."""
    values: dict[str, Any] = dict.fromkeys(dofs, 0.0)
    for j, local in enumerate(basis.element_dofs):
        (shape,) = basis.elem.gbasis(basis.mapping, X, j, tind=tind)
        for key, vector in dofs.items():
            values[key] = values[key] + vector[local][:, None] * shape
    return values


def _named(argument: str, data: Any) -> dict[str, Any]:
    """Return a mapping from names, empty for None."""
    if data is None:
        return {}
    if not isinstance(data, Mapping) or not all(isinstance(k, str) and k for k in data):
        raise InputError(f"{argument}: expected a mapping from names to arrays, got {data!r}")
    return dict(data)


def _checked(argument: str, key: str, array: Any, length: int) -> Array:
    """Return a real and finite array whose last axis has the given length."""
    name = f"{argument}[{key!r}]"
    values = array_of(name, array)
    allowed = (1,) if argument == "x" else (1, 2, 3)
    tensor = values.ndim < 3 or max(values.shape[:2]) <= 3
    shaped = values.ndim in allowed and values.shape[-1] == length and tensor
    if not shaped or values.dtype.kind not in "biuf":
        raise InputError(
            f"{name}: expected real numbers, last axis of length {length}, got {values.dtype} of "
            f"shape {values.shape}"
        )
    if values.dtype.kind == "f":
        finite_numbers(name, values, values.shape)
    return values


def _rows(values: Array, keep: Indices) -> Array:
    """Return the kept points as rows."""
    return _components(values.reshape(*values.shape[:-2], -1)[..., keep])


def _components(values: Array) -> Array:
    """Return fields (..., n) as (n,) or (n, components): vectors with 3, tensors with 9."""
    if values.ndim == 3:
        tensor = np.zeros((3, 3, values.shape[-1]))
        tensor[: values.shape[0], : values.shape[1]] = values
        values = tensor.reshape(9, -1)
    if len(values) == 2 and values.ndim == 2:
        values = np.concatenate([values, np.zeros((1, values.shape[-1]))])
    return values.T


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
    families = (  # of degree 1, 2 and 3
        (ElementTriP1, ElementQuad1, ElementTetP1, ElementHex1),
        (ElementTriP2, ElementQuad2, ElementQuadS2, ElementTetP2, ElementHex2),
        (ElementHexAdini, ElementQuadAdini, ElementQuadBFS, ScikitFemBFS),
    )
    return next((k for k, family in enumerate(families, 1) if type(elem) in family), None)


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
    steps = integer("subdivide", steps, 1)
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
