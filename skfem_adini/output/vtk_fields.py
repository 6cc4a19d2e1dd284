"""Finite element fields as VTK data, exact where a VTK cell can represent them."""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.assembly import CellBasis
from skfem.assembly.basis.abstract_basis import AbstractBasis
from skfem.element import ElementComposite, ElementVector

from skfem_adini.errors import InputError, MissingDependency
from skfem_adini.output.vtk_cells import (
    LINEAR_ELEMENT,
    CellPattern,
    exact_degree,
    lagrange_pattern,
    linear_pattern,
)
from skfem_adini.output.vtk_files import write_grid, write_series

Array = NDArray[np.float64]
Indices = NDArray[np.integer]
Fields = Array | Mapping[str, Array]
Step = tuple[float, Fields] | tuple[float, Fields, Mapping[str, Any]]

_DEFAULT_SUBDIVISION = 4  # linear parts of a side: 1/16 of the error of one chord


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
    pyvista = _import_pyvista()
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

    return write_series(path, grids())


def _checked_steps(basis: Any, fields: Any) -> list[Any]:
    """Return the steps of a series, all of them checked before the first file is written."""
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


def _import_pyvista() -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise MissingDependency("VTK output needs pyvista: pip install 'pyvista>=0.47'") from error
    return pyvista


def _pattern(basis: Any, subdivide: int | None) -> tuple[CellPattern, bool]:
    """Choose the VTK cells, and say whether neighbours share points."""
    mesh, elem = basis.mesh, basis.elem
    degree = exact_degree(elem.elem if isinstance(elem, ElementVector) else elem)
    geometry = exact_degree(mesh.elem())
    continuous = degree is not None and geometry is not None
    if subdivide is None and degree is not None and geometry is not None:
        exact = lagrange_pattern(mesh.refdom, max(degree, geometry))
        if exact is not None:
            return exact, True
    steps = _DEFAULT_SUBDIVISION if subdivide is None else subdivide
    return linear_pattern(mesh.refdom, steps), continuous


def _oriented(basis: Any, pattern: CellPattern, tind: Indices) -> Array:
    """Return reference points (dim, cells, points), mirrored in cells of negative volume."""
    X = np.repeat(pattern.points[:, None], len(tind), axis=1)
    mirrored = basis.mapping.detDF(X, tind=tind)[:, 0] < 0
    X[:2, mirrored] = X[1::-1, mirrored]
    return X


def _vertex_weights(basis: Any, X: Array) -> Array:
    """Return the (multi)linear vertex functions at X, (vertices of a cell, cells, points)."""
    linear = LINEAR_ELEMENT[basis.mesh.refdom]()
    return np.array([linear.lbasis(X, k)[0] for k in range(basis.mesh.refdom.nnodes)])


def _number_points(
    pattern: CellPattern, cells: Indices, weights: Array, continuous: bool
) -> tuple[Indices, Indices]:
    """Return kept positions in the flattened (cells, points), and every point's number.
    If `continuous`, points of two cells are one when they have the same weights on the same
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
    try:
        values = np.asarray(array)
    except ValueError as error:
        raise InputError(f"{argument}[{key!r}]: no array of numbers: {error}") from error
    allowed = (1,) if argument == "x" else (1, 2, 3)
    tensor = values.ndim < 3 or max(values.shape[:2]) <= 3
    shaped = values.ndim in allowed and values.shape[-1] == length and tensor
    if not shaped or values.dtype.kind not in "biuf":
        raise InputError(
            f"{argument}[{key!r}]: expected real numbers, last axis of length {length}, got "
            f"{values.dtype} of shape {values.shape}"
        )
    bad = ~np.isfinite(values)
    if bad.any():
        place = tuple(np.argwhere(bad)[0].tolist())
        raise InputError(
            f"{argument}[{key!r}]: {bad.sum()} of {values.size} entries are NaN or infinite "
            f"(first: {values[place]} at {place}); nothing is written, mend the field or put zeros"
        )
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
