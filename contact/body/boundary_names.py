"""Facets of named boundaries, components by name, and meshes from files with such names."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import Mesh

from contact.errors import InputError
from skfem_adini.ground.arguments import array_of


def select_facets(
    mesh: Mesh, boundary: str | Sequence[str] | ArrayLike, inside: bool = False
) -> NDArray[np.int64]:
    """Facet numbers of a named boundary, of several, or of an array of facet numbers.
    `inside` allows facets inside the body."""
    names = [boundary] if isinstance(boundary, str) else boundary
    if isinstance(names, (list, tuple)) and all(isinstance(name, str) for name in names):
        known = mesh.boundaries or {}
        for name in names:
            if name not in known:
                raise InputError(
                    f"boundary {name!r} is unknown; the mesh names {sorted(known) or 'none'} "
                    "(mesh.with_boundaries or mesh.with_defaults adds names)"
                )
        found = [np.asarray(known[name], dtype=np.int64) for name in names]
        facets = np.unique(np.concatenate(found)) if found else np.zeros(0, dtype=np.int64)
    else:
        numbers = array_of("boundary", boundary)
        if numbers.size and numbers.dtype.kind not in "iu":
            raise InputError(
                f"boundary={boundary!r}: expected a name, names, or whole facet numbers"
            )
        facets = np.unique(numbers.astype(np.int64))
        if facets.size and not (facets[0] >= 0 and facets[-1] < mesh.nfacets):
            raise InputError(f"boundary: facet numbers must lie in 0..{mesh.nfacets - 1}")
    if facets.size == 0:
        raise InputError(f"boundary {boundary!r} has no facets")
    if not inside and np.any(mesh.f2t[1, facets] != -1):
        raise InputError(f"boundary {boundary!r} holds facets inside the body")
    return facets


def select_components(dim: int, components: str | int | Sequence[int] | None) -> list[int]:
    """Component numbers of "x", "xy", 1, (0, 2) or None (all)."""
    if components is None:
        return list(range(dim))
    if isinstance(components, str):
        numbers = ["xyz".find(letter) for letter in components]
    else:
        given = np.atleast_1d(array_of("components", components))
        numbers = [int(c) for c in given] if given.dtype.kind in "iu" else []
    if not numbers or any(c < 0 or c >= dim for c in numbers):
        raise InputError(
            f"components={components!r}: expected letters of {'xyz'[:dim]!r} or numbers below {dim}"
        )
    if len(set(numbers)) < len(numbers):
        raise InputError(
            f"components={components!r}: names one twice; the displacement is the next argument"
        )
    return sorted(numbers)


def read_mesh(path: str | Path) -> Mesh:
    """Read a mesh by meshio; physical groups of Gmsh become named boundaries and subdomains, and
    sets of nodes of Abaqus boundaries. All cells have one shape and order, first or second."""
    import meshio
    from skfem.io.meshio import from_meshio

    path = Path(path)
    if not path.is_file():
        raise InputError(f"mesh file {path} does not exist")
    quiet = io.StringIO()  # meshio's readers print empty lines, and errors before they exit
    try:
        with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
            if path.suffix == ".msh":
                _check_gmsh(path.read_bytes())
            file = _named(_abaqus(path) if path.suffix.lower() == ".inp" else meshio.read(path))
        mesh = _with_node_sets(from_meshio(file, ignore_orientation=True), file.point_sets)
    except (Exception, SystemExit) as error:  # meshio's readers raise errors of any type
        printed = quiet.getvalue().strip().partition("\n")[0]
        said = (printed if isinstance(error, SystemExit) else error) or "bad format"
        raise InputError(f"mesh file {path} cannot be read: {said}") from error
    if mesh.dim() not in (2, 3):
        raise InputError(f"mesh file {path}: expected a mesh of dimension 2 or 3")
    if not np.all(np.isfinite(mesh.doflocs)):
        raise InputError(f"mesh file {path}: holds coordinates that are not finite")
    height = np.ptp(file.points[:, mesh.dim() :], axis=0).max(initial=0.0)
    if height > 1e-9 * np.ptp(mesh.p, axis=1).max():
        raise InputError(f"mesh file {path}: a surface in space, not in the plane of x and y")
    return mesh


def _check_gmsh(data: bytes) -> None:
    """Refuse a file that ends early, and node numbers that are huge, repeated, or not as many as it
    declares: meshio makes an array as long as the largest, and leaves missing ones uninitialised.
    Formats 2.2, 4.0 and 4.1 (Gmsh reference manual, "MSH file format")."""
    sections = re.findall(rb"^\$([A-Za-z]+)\s*$", data, re.MULTILINE) or [b"MeshFormat"]
    whole = b"EndElements" in sections and sections[-1].startswith(b"End")
    if b"$MeshFormat".startswith(data[:11]) and not whole:
        raise InputError(f"it ends early, at ${sections[-1].decode()}; write or copy it anew")
    words, begin, end = data[:80].split(), data.find(b"$Nodes\n"), data.find(b"$EndNodes")
    if words[:1] != [b"$MeshFormat"] or min(begin, end) < 0:
        return  # meshio reports the error
    version, at = float(words[1]), begin + len(b"$Nodes\n")
    integer, size, real = "<i4", "<u8", "<f8"
    if words[2] == b"0":  # text is converted to binary numbers of one type
        data, at = np.array(data[at:end].split(), dtype=float).tobytes(), 0
        integer = size = real

    def take(kind: Any, count: int) -> Any:
        nonlocal at
        found = np.frombuffer(data, kind, int(count), at)
        at += found.nbytes
        return found

    rows = [("tag", integer), ("place", real, 3)]
    if version < 4:
        line = at if at == 0 else data.index(b"\n", at) + 1  # text even in binary files
        total = take(size, 1)[0] if at == 0 else int(data[at:line])
        at = max(at, line)
        tags = [take(rows, total)["tag"]]
    else:
        blocks, total = take(size, 4 if version > 4 else 2)[:2]
        tags = []
        for _ in range(int(blocks)):
            take(integer, 3)
            count = take(size, 1)[0]
            tags.append(take(size, count) if version > 4 else take(rows, count)["tag"])
            if version > 4:
                take(real, 3 * count)
    numbers = np.concatenate(tags).astype(np.int64)
    if numbers.size != total or np.unique(numbers).size != total:
        raise InputError(f"{total:.0f} nodes are announced, {np.unique(numbers).size} found")
    # Meshio makes an array as long as the largest number.
    if numbers.min(initial=1) < 1 or numbers.max(initial=1) > max(10_000_000, len(data)):
        raise InputError(f"a node has the number {max(numbers, key=abs)}; renumber them from 1")


def _abaqus(path: Path) -> Any:
    """An Abaqus input. meshio knows few names of plane and axisymmetric cells: all variants get
    that of one with the same nodes."""
    import meshio

    known = {"3": "CPS3", "4": "CPS4", "6": "CPE6"}
    cells = r"(?i)(\btype\s*=\s*)(?:CPE|CPS|CAX|CGAX)([346])\w*"
    text = re.sub(cells, lambda found: found[1] + known[found[2]], path.read_text())
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "mesh.inp"
        copy.write_text(text)
        return meshio.read(copy)


def _with_node_sets(mesh: Mesh, sets: Any) -> Mesh:
    """The mesh, with the outer facets whose vertices all lie in a set of nodes under its name."""
    facets, found = mesh.boundary_facets(), {}
    for name, nodes in sets.items():
        own = facets[np.isin(mesh.facets[:, facets], nodes).all(axis=0)]
        if own.size and name not in (mesh.boundaries or {}):
            found[name] = own
    return mesh.with_boundaries(found) if found else mesh


def _named(file: Any) -> Any:
    """The same mesh in scikit-fem's order: boundary cells by their corners, corners numbered first.
    scikit-fem numbers the vertices of a mesh of second order anew, and looks boundary cells up
    by the new numbers: they must be the old ones."""
    import meshio

    kinds = [block.type for block in file.cells]
    dimensions = {"triangle": 2, "quad": 2, "tetra": 3, "hexahedron": 3, "wedge": 3, "pyramid": 3}
    dimension = {kind: dimensions.get(kind.rstrip("0123456789"), 0) for kind in kinds}
    body = max(dimension.values(), default=0)
    of_body = sorted(kind for kind in dimension if body and dimension[kind] == body)
    if len(of_body) > 1:
        raise InputError(
            f"its body consists of {' and '.join(of_body)} cells, of which scikit-fem would read "
            "one kind only; mesh it with cells of one kind"
        )
    cells = []
    # Corners of boundary cells of second order, by which scikit-fem names facets.
    first_order = {"line3": ("line", 2), "triangle6": ("triangle", 3), "quad9": ("quad", 4)}
    for block in file.cells:
        named = np.asarray(block.data)
        wrong = named[(named < 0) | (named >= len(file.points))]
        if wrong.size:
            raise InputError(f"a cell names point {wrong[0]} of {len(file.points)}, counted from 0")
        kind, corners = first_order.get(block.type, (block.type, None))
        on_boundary = dimensions.get(kind, 1) < body
        if on_boundary and corners:
            cells.append((kind, block.data[:, :corners]))
        else:
            cells.append((block.type, block.data))
    corners_of = {"triangle6": 3, "quad9": 4, "tetra10": 4, "hexahedron27": 8}
    numbered = [data[:, : corners_of[kind]].ravel() for kind, data in cells if kind in corners_of]
    points, of_points = file.points, file.point_sets
    if numbered:
        vertices = np.unique(np.concatenate(numbered))
        order = np.concatenate((vertices, np.setdiff1d(np.arange(len(points)), vertices)))
        place = np.empty_like(order)
        place[order] = np.arange(order.size)
        points, cells = points[order], [(kind, place[data]) for kind, data in cells]
        of_points = {name: place[nodes] for name, nodes in of_points.items()}
    # Gmsh's own sets, such as gmsh:bounding_entities, name no part of the body.
    sets = {n: s for n, s in file.cell_sets.items() if not n.startswith("gmsh:")}
    return meshio.Mesh(
        points,
        cells,
        cell_data=file.cell_data,
        field_data=file.field_data,
        point_sets=of_points,
        cell_sets=sets,
    )
