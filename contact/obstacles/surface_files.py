"""Surfaces of facets from files and as VTK data.

PLY and OBJ are read here, because VTK's readers may crash on damaged files.
"""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError
from contact.obstacles.arguments import reading
from skfem_adini.ground.errors import optional

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def read_surface(path: str | PathLike[str]) -> tuple[Array, Index]:
    """Points (dim, npoints) and facets (dim, nfacets) of a file."""
    pyvista = _pyvista()
    with reading(path, (".stl", ".ply", ".obj", ".vtp"), "surfaces") as place:
        if place.suffix.lower() == ".vtp":
            _check_claims(place.read_bytes())
        found = {".obj": _obj, ".ply": _ply}.get(place.suffix.lower(), pyvista.read)(place)
        points, polygons, lines = found if isinstance(found, _Facets) else _facets(found)
        _check(len(points), polygons, lines)
        if polygons.length.size:
            faces = np.insert(polygons.vertices, polygons.starts, polygons.length)
            solid = pyvista.PolyData(points, faces=faces).triangulate()
            return np.asarray(solid.points, dtype=float).T, np.asarray(solid.regular_faces, int).T
    first = np.ones(lines.vertices.size, dtype=bool)
    first[lines.starts + lines.length - 1] = False
    begin = np.flatnonzero(first)
    ends, points = lines.vertices[np.stack((begin, begin + 1))], points.T
    if not ends.size:
        raise InputError(f"path={path!r}: holds no faces and no lines")
    if np.ptp(points[2]) > 1e-7 * np.ptp(points[:2]):
        raise InputError(f"path={path!r}: its lines do not lie in a plane of constant z")
    return points[:2], ends


def polydata(points: Array, facets: Index, normals: Array) -> Any:
    """Facets as a pyvista.PolyData with the cell data ``normal``."""
    pyvista = _pyvista()
    dim, count = facets.shape
    places, upright = np.zeros((points.shape[1], 3)), np.zeros((count, 3))
    places[:, :dim], upright[:, :dim] = points.T, normals.T
    cells = np.column_stack((np.full(count, dim), facets.T)).ravel()
    surface = pyvista.PolyData(places, **{"faces" if dim == 3 else "lines": cells})
    surface.cell_data["normal"] = upright
    return surface


class _Cells(NamedTuple):
    """Lengths of polygons or lines, and their concatenated vertex numbers."""

    length: Index
    vertices: Index

    @property
    def starts(self) -> Index:
        """Index of the first vertex of each."""
        return np.cumsum(self.length) - self.length


class _Facets(NamedTuple):
    points: Array  # (npoints, 3)
    polygons: _Cells
    lines: _Cells


def _check(count: int, polygons: _Cells, lines: _Cells) -> None:
    """Refuse indices out of range, which VTK would not check."""
    for what, least, cells in (("face", 3, polygons), ("line", 2, lines)):
        length, named = cells
        fewest = int(length.min(initial=least))
        if length.sum() != named.size or fewest < least:
            raise ValueError(f"a {what} of {fewest} points; expected {least} or more")
        wrong = named[(named < 0) | (named >= count)]
        if wrong.size:
            raise ValueError(f"a {what} names point {wrong[0]} of {count}, counted from 0")


def _check_claims(data: bytes) -> None:
    """Refuse counts of a VTP file that exceed its bytes: VTK would crash.
    Zlib compresses by at most a factor 1032 (zlib.net/zlib_tech.html)."""
    claims = re.findall(rb"NumberOf(\w+)\s*=\s*[\"']\s*(-?\d+)", data)
    wide, many = (
        max((int(n) for of, n in claims if (of == b"Components") == inner), default=1)
        for inner in (True, False)
    )
    least = min((int(n) for _, n in claims), default=0)
    if least < 0 or wide * many > 1100 * len(data):
        claim = f"{least} rows or numbers" if least < 0 else f"{many} rows of {wide} numbers"
        raise ValueError(f"{claim} in a file of {len(data)} bytes")


def _facets(found: Any) -> _Facets:
    """Facets of a pyvista.PolyData, read by NumPy with bounds checks."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    cells = []
    for own in (found.GetPolys(), found.GetLines()):
        starts = vtk_to_numpy(own.GetOffsetsArray()).astype(np.int64)
        cells.append(_Cells(np.diff(starts), vtk_to_numpy(own.GetConnectivityArray()).astype(int)))
    return _Facets(np.asarray(found.points, dtype=float), *cells)


def _obj(place: Path) -> _Facets:
    """The lines v, f and l of a Wavefront file; vertices count from 1, or from the last as -1."""
    points: list[list[float]] = []
    facets: dict[str, list[Index]] = {"f": [], "l": []}
    for line in place.read_text(errors="replace").replace("\\\n", " ").splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            x, y, z = map(float, words[:3])
            points.append([x, y, z])
        elif kind in facets:
            named = np.array([int(word.partition("/")[0]) for word in words], dtype=np.int64)
            if np.any(named == 0):
                raise ValueError("a facet names point 0; the first is 1")
            facets[kind].append(np.where(named < 0, len(points) + named, named - 1))
    return _Facets(np.array(points).reshape(-1, 3), _joined(facets["f"]), _joined(facets["l"]))


def _joined(cells: list[Index]) -> _Cells:
    empty = np.zeros(0, dtype=np.int64)
    return _Cells(np.array([c.size for c in cells], dtype=int), np.concatenate([empty, *cells]))


def _ply(place: Path) -> _Facets:
    """Vertices and faces of a PLY file (Turk 1994), as text or binary of either order of bytes."""
    head, mark, data = place.read_bytes().partition(b"end_header")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines() if line.strip()]
    if not mark or lines[0] != ["ply"]:
        raise ValueError("its header is none of PLY")
    data = data[data.index(b"\n") + 1 :]
    order, elements = "", list[tuple[str, int, list[list[str]]]]()
    for kind, *words in lines[1:]:
        if kind == "format":
            order = {"ascii": "text", "binary_little_endian": "<", "binary_big_endian": ">"}[
                words[0]
            ]
        elif kind == "element":
            elements.append((words[0], int(words[1]), []))
        elif kind == "property":
            elements[-1][2].append(words)
    types = {
        name: code
        for code, names in {
            "i1": "char int8", "u1": "uchar uint8", "i2": "short int16", "u2": "ushort uint16",
            "i4": "int int32", "u4": "uint uint32", "f4": "float float32", "f8": "double float64",
        }.items()
        for name in names.split()
    }  # fmt: skip
    if order == "text":  # text is converted to binary numbers of one type
        data, code = np.array(data.split(), dtype="<f8").tobytes(), dict.fromkeys(types, "<f8")
    else:
        code = {name: order + kind for name, kind in types.items()}
    at, points, faces = 0, np.zeros((0, 3)), []
    for name, count, properties in elements:
        runs, at = _ply_records(data, at, name, count, properties, code)
        if name == "vertex" and runs:
            rows = np.concatenate(runs)
            points = np.column_stack([rows[axis] for axis in "xyz"]).astype(float)
        elif name == "face":
            lists = [words[-1] for words in properties if words[0] == "list"]
            if not {"vertex_indices", "vertex_index"} & set(lists[:1]):
                raise ValueError("its faces have no list vertex_indices")
            faces = [rows[lists[0]].astype(np.int64) for rows in runs]
    polygons = _joined([rows.ravel() for rows in faces])
    length = np.repeat([rows.shape[1] for rows in faces], [len(rows) for rows in faces])
    return _Facets(points, _Cells(length.astype(int), polygons.vertices), _joined([]))


def _ply_records(
    data: bytes, at: int, name: str, count: int, properties: list[list[str]], code: dict[str, str]
) -> tuple[list[Any], int]:
    """Records of one element, in runs with equal list lengths, and the position after them."""
    runs, done, most = [], 0, count
    while done < count and properties:
        kind, length = _ply_record(data, at, properties, code)
        room = (len(data) - at) // kind.itemsize
        if not room:
            raise ValueError(f"element {name}: {count} announced, the file ends after {done}")
        rows = np.frombuffer(data, kind, min(room, most, count - done), at)
        same = np.ones(rows.size, dtype=bool)
        for of, value in length.items():
            same &= rows[of] == value
        rows = rows[: same.size if same.all() else int(np.argmin(same))]
        most = 2 * rows.size  # limits wasted reads if list lengths vary
        runs.append(rows)
        done, at = done + rows.size, at + rows.nbytes
    return runs, at


def _ply_record(
    data: bytes, at: int, properties: list[list[str]], code: dict[str, str]
) -> tuple[np.dtype[Any], dict[str, float]]:
    """Type of the record at a byte position, and the lengths of its lists by name."""
    fields: list[Any] = []
    length: dict[str, float] = {}
    for kind, *words in properties:
        if kind != "list":
            fields.append((words[0], code[kind]))
            continue
        of, item, name = words
        place = at + np.dtype(fields).itemsize
        number = np.frombuffer(data, code[of], 1, place)[0]
        if not 0 <= number <= len(data) or number % 1:
            raise ValueError(f"a list of {number:.0f} entries")
        length[f"length of {name}"] = float(number)
        fields += [(f"length of {name}", code[of]), (name, code[item], (int(number),))]
    return np.dtype(fields), length


def _pyvista() -> Any:
    return optional("pyvista", "surfaces in files need pyvista: pip install 'pyvista>=0.47'")
