"""Meshes from files, with the names that the file gives to its boundaries."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
from skfem import Mesh

from contact.errors import InputError

# Boundary cells of second order; scikit-fem names facets by their corners.
_FIRST_ORDER = {"line3": ("line", 2), "triangle6": ("triangle", 3), "quad9": ("quad", 4)}
_DIMENSION = {"triangle": 2, "quad": 2, "tetra": 3, "hexahedron": 3, "wedge": 3, "pyramid": 3}
_CORNERS = {"triangle6": 3, "quad9": 4, "tetra10": 4, "hexahedron27": 8}


def read_mesh(path: str | Path) -> Mesh:
    """Read a mesh by meshio; physical groups of Gmsh become named boundaries and subdomains.

    Cells of first and second order; boundary cells of second order keep their names, too.

    Parameters
    ----------
    path : str or Path
        .msh, .vtu, .xdmf, ...

    Returns
    -------
    Mesh

    Raises
    ------
    InputError
        The file is missing, truncated, holds no mesh of dimension 2 or 3, or cells of several
        kinds.
    """
    import meshio
    from skfem.io.meshio import from_meshio

    path = Path(path)
    if not path.is_file():
        raise InputError(f"mesh file {path} does not exist")
    try:
        quiet = io.StringIO()  # its Gmsh reader prints empty lines, and errors besides raising
        with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
            file = meshio.read(path)
        mesh = from_meshio(_named(file), ignore_orientation=True)
    except (Exception, SystemExit) as error:  # meshio raises whatever its readers meet
        raise InputError(f"mesh file {path} cannot be read: {error or 'bad format'}") from error
    if mesh.dim() not in (2, 3):
        raise InputError(f"mesh file {path}: expected a mesh of dimension 2 or 3")
    if not np.all(np.isfinite(mesh.doflocs)):
        raise InputError(f"mesh file {path}: holds coordinates that are not finite")
    height = np.ptp(file.points[:, mesh.dim() :], axis=0).max(initial=0.0)
    if height > 1e-9 * np.ptp(mesh.p, axis=1).max():
        raise InputError(f"mesh file {path}: a surface in space, not in the plane of x and y")
    return mesh


def _named(file: Any) -> Any:
    """The same mesh in scikit-fem's order: boundary cells by their corners, corners numbered first.

    scikit-fem numbers the vertices of a mesh of second order anew, and looks boundary cells up by
    the new numbers: they must be the old ones.
    """
    import meshio

    kinds = [block.type for block in file.cells]
    dimension = {kind: _DIMENSION.get(kind.rstrip("0123456789"), 0) for kind in kinds}
    body = max(dimension.values(), default=0)
    of_body = sorted(kind for kind in dimension if body and dimension[kind] == body)
    if len(of_body) > 1:
        raise InputError(
            f"its body consists of {' and '.join(of_body)} cells, of which scikit-fem would read "
            "one kind only; mesh it with cells of one kind"
        )
    cells = []
    for block in file.cells:
        kind, corners = _FIRST_ORDER.get(block.type, (block.type, None))
        on_boundary = _DIMENSION.get(kind, 1) < body
        if on_boundary and corners:
            cells.append((kind, block.data[:, :corners]))
        else:
            cells.append((block.type, block.data))
    corners_of = [data[:, : _CORNERS[kind]].ravel() for kind, data in cells if kind in _CORNERS]
    points = file.points
    if corners_of:
        vertices = np.unique(np.concatenate(corners_of))
        order = np.concatenate((vertices, np.setdiff1d(np.arange(len(points)), vertices)))
        place = np.empty_like(order)
        place[order] = np.arange(order.size)
        points, cells = points[order], [(kind, place[data]) for kind, data in cells]
    return meshio.Mesh(
        points,
        cells,
        cell_data=file.cell_data,
        field_data=file.field_data,
        cell_sets=file.cell_sets,
    )
