"""Surfaces of facets from files and as VTK data."""

from __future__ import annotations

from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError, MissingDependency

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FORMATS = (".stl", ".ply", ".obj", ".vtp")


def read_surface(path: str | PathLike[str]) -> tuple[Array, Index]:
    """Points (dim, npoints) and facets (dim, nfacets) of a file.

    Raises
    ------
    InputError
        No such file, another format, no facets in it.
    MissingDependency
        pyvista is not installed.
    """
    try:
        place = Path(fspath(path))
    except TypeError as error:
        raise InputError(f"path={path!r}: expected the name of a file ({error})") from None
    if place.suffix.lower() not in FORMATS:
        raise InputError(f"path={path!r}: surfaces are read from {', '.join(FORMATS)} files")
    if not place.is_file():
        raise InputError(f"path={path!r}: there is no such file")
    try:
        found = _import_pyvista().read(place)
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"path={path!r}: not readable as {place.suffix} ({error})") from error
    if np.asarray(found.faces).size:
        solid = found if found.is_all_triangles else found.triangulate()
        return np.asarray(solid.points, dtype=float).T, np.asarray(solid.regular_faces, int).T
    ends = _segments(np.asarray(found.lines, dtype=np.int64))
    points = np.asarray(found.points, dtype=float).T
    if not ends.size:
        raise InputError(f"path={path!r}: holds no faces and no lines")
    if np.ptp(points[2]) > 1e-7 * np.ptp(points[:2]):
        raise InputError(f"path={path!r}: its lines do not lie in a plane of constant z")
    return points[:2], ends


def polydata(points: Array, facets: Index, normals: Array) -> Any:
    """Facets as a pyvista.PolyData with the cell data ``normal``."""
    pyvista = _import_pyvista()
    dim, count = facets.shape
    places, upright = np.zeros((points.shape[1], 3)), np.zeros((count, 3))
    places[:, :dim], upright[:, :dim] = points.T, normals.T
    cells = np.column_stack((np.full(count, dim), facets.T)).ravel()
    surface = pyvista.PolyData(places, **{"faces" if dim == 3 else "lines": cells})
    surface.cell_data["normal"] = upright
    return surface


def _segments(lines: Index) -> Index:
    """Ends (2, nsegments) of polylines in VTK's order: length, points, length, ..."""
    ends = [np.zeros((2, 0), dtype=np.int64)]
    while lines.size:
        one, lines = lines[1 : lines[0] + 1], lines[lines[0] + 1 :]
        ends.append(np.stack((one[:-1], one[1:])))
    return np.concatenate(ends, axis=1)


def _import_pyvista() -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise MissingDependency(
            "surfaces in files need pyvista: pip install 'pyvista>=0.47'"
        ) from error
    return pyvista
