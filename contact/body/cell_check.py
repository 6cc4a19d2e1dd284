"""Checks of a mesh: every cell is valid, and no two cells overlap at a facet."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from skfem import Basis, MappingIsoparametric, Mesh
from skfem.refdom import RefHex, RefQuad, RefTet, RefTri

from contact.arrays.ranges import in_ranges
from contact.body.deferred_basis import DeferredBasis
from contact.body.jacobians import is_straight, jacobians, measures
from contact.errors import InputError
from contact.facet_basis import places_on_facets
from skfem_adini.ground.jit import compiled_later
from skfem_adini.kept_functions import functions_of_another_mesh

_compiled = cache(compiled_later)


def check_cells(mesh: Mesh) -> None:
    """Raise unless every cell's mapping is injective and no cell overlaps a neighbour."""
    if not mesh.nelements:
        raise InputError("mesh: has no cells")
    _check_numbers(mesh)
    if not np.all(np.isfinite(mesh.doflocs)):
        raise InputError("mesh: has coordinates that are not finite")
    sound = np.concatenate(in_ranges(partial(_sound, mesh), mesh.nelements))
    if not np.all(sound):
        raise InputError(
            f"mesh: {np.sum(~sound)} cells are flat, not convex or folded (first: "
            f"{int(np.argmin(sound))}); order their vertices cyclically and untangle them"
        )
    number_facets(mesh)
    _check_beside(mesh)


def _check_numbers(mesh: Mesh) -> None:
    """Raise if vertex numbers are out of range: compiled code does not check them."""
    if len(mesh.doflocs) != mesh.dim():
        raise InputError(
            f"mesh: {type(mesh).__name__} has points of {mesh.dim()} coordinates, got "
            f"{len(mesh.doflocs)}"
        )
    wrong = np.flatnonzero(((mesh.t < 0) | (mesh.t >= mesh.p.shape[1])).any(axis=0))
    if wrong.size:
        raise InputError(
            f"mesh: cell {wrong[0]} has the vertices {mesh.t[:, wrong[0]].tolist()}, of 0 to "
            f"{mesh.p.shape[1] - 1}; it names one that does not exist"
        )
    # Number the dofs of a curved mesh now: threads read them later.
    if not is_straight(mesh) and mesh.doflocs.shape[1] < mesh.dofs.N:
        raise InputError(
            f"mesh: its cells have {mesh.dofs.N} nodes, and places are given for "
            f"{mesh.doflocs.shape[1]}"
        )


def _sound(mesh: Mesh, cells: slice) -> NDArray[np.bool_]:
    """Whether each cell has a positive thickness and a Jacobian of one sign at its nodes."""
    places = mesh.elem.refdom.p[:, :1] if mesh.affine else mesh.elem.doflocs.T
    det, _, size = measures(mesh, cells, places)
    flat = 1e-12  # thickness over size below which rounding of coordinates dominates
    with np.errstate(all="ignore"):
        limit = flat * size[:, None] ** mesh.dim()
        sound = np.all(det > limit, axis=1) | np.all(det < -limit, axis=1)
    # The determinant does not detect cells that are thin in two directions.
    doubtful = np.flatnonzero(~sound & (size > 0))
    near = jacobians(mesh, cells.start + doubtful, places)
    sign = np.sign(np.linalg.det(near))
    thin = np.linalg.svd(near, compute_uv=False)[..., -1] <= flat * size[doubtful, None]
    sound[doubtful] = (np.abs(sign.sum(axis=1)) == sign.shape[1]) & ~thin.any(axis=1)
    return np.asarray(sound)


def _check_beside(mesh: Mesh) -> None:
    """Raise if a facet has more than two cells, or two on the same side."""
    shared = np.bincount(mesh.t2f.ravel(), minlength=mesh.nfacets)
    if shared.max(initial=0) > 2:
        raise InputError(
            f"mesh: {shared.max()} cells share facet {int(np.argmax(shared))}, which has room for "
            "two: remove cells that are there twice"
        )
    inner = np.flatnonzero(mesh.f2t[1] >= 0)
    on_one_side = _on_one_side if is_straight(mesh) else _normals_agree
    folded = inner[on_one_side(mesh, inner) > 0]
    if folded.size:
        one, two = mesh.f2t[:, folded[0]]
        raise InputError(
            f"mesh: at {folded.size} facets both cells lie on the same side, one upon the other "
            f"(first: cells {one} and {two}): the mesh folds over itself; untangle its vertices"
        )


def _on_one_side(mesh: Mesh, facets: NDArray[np.int64]) -> NDArray[np.float64]:
    of_mesh = mesh.p, mesh.t, mesh.facets, mesh.f2t

    def compared(some: slice) -> NDArray[np.float64]:
        return np.asarray(_compiled(on_one_side)(*of_mesh, facets[some]))

    return np.concatenate([np.zeros(0), *in_ranges(compared, facets.size)])


def _normals_agree(mesh: Mesh, facets: NDArray[np.int64]) -> NDArray[np.float64]:
    """Product of both cells' outward normals at the middle of curved facets."""
    middle = mesh.brefdom.p.mean(axis=1)[:, None]

    def compared(some: slice) -> NDArray[np.float64]:
        # Each thread has its own mapping, which stores tables.
        here, mapping = facets[some], MappingIsoparametric(mesh, mesh.elem(), mesh.bndelem)
        ours, theirs = (
            mapping.normals(
                places_on_facets(mesh, here, middle, side), mesh.f2t[side, here], here, mesh.t2f
            )[..., 0]
            for side in (0, 1)
        )
        return np.asarray(np.sum(ours * theirs, axis=0))

    return np.concatenate([np.zeros(0), *in_ranges(compared, facets.size)])


def check_basis(basis: Basis) -> None:
    """Check cells and shape functions of a basis; the cells of a deferred one have been checked."""
    if not isinstance(basis, DeferredBasis):
        check_cells(basis.mesh)
    check_functions(basis)


def check_functions(basis: Basis) -> None:
    """Raise if an element's shape functions do not suit the cells.
    Elements by global functionals keep the functions of the first mesh they were used on; those of
    Bogner, Fox and Schmit are discontinuous across sides not parallel to an axis."""
    mesh, element = basis.mesh, basis.elem.elem
    if functions_of_another_mesh(element, basis.mapping):
        name = type(element).__name__
        raise InputError(
            f"basis: this skfem.{name} has kept the shape functions of another mesh that it was "
            f"used on before; build the basis with a new skfem.{name}()"
        )
    if not isinstance(element, skfem.ElementQuadBFS):
        return
    corner = mesh.p[:, mesh.t]
    side = np.abs(np.roll(corner, -1, axis=1) - corner)
    slanted = (side.min(axis=0) > 1e-10 * side.max(axis=0)).any(axis=0)
    if slanted.any():
        raise InputError(
            f"element: {slanted.sum()} of {slanted.size} cells are no rectangles with sides "
            f"parallel to the axes (first: {int(np.argmax(slanted))}), and skfem.ElementQuadBFS "
            "is not continuous between others; turn the coordinates or use ElementQuadAdini"
        )


def number_facets(mesh: Mesh) -> None:
    """Set ``facets``, ``t2f`` and ``f2t`` of a mesh, unless it has computed them.
    Two corners identify a facet in the plane and three in space; they are sorted by counting.
    scikit-fem sorts records of all corners, which is slower."""
    if hasattr(mesh, "_t2f") or mesh.refdom not in (RefTri, RefQuad, RefTet, RefHex):
        return
    t, corners = np.ascontiguousarray(mesh.t), np.array(mesh.refdom.facets)
    facets, numbers, beside, sound = _compiled(number)(
        t, corners, mesh.dim(), mesh.nvertices, mesh.refdom is RefHex
    )
    if sound:  # no two facets share three corners but not the fourth
        found: Any = mesh
        found._facets, found._t2f, found._f2t = facets, numbers, beside


def number(t: Any, corners: Any, known: int, vertices: int, in_turn: bool) -> Any:
    """Sort the m corners of all facets of cells t (k, ncells), and count equal facets once.
    Return facets (m, nfacets), cyclic if `in_turn`; numbers (facets a cell, ncells); first and last
    cell (2, nfacets) or -1; whether `known` corners identify a facet."""
    cells, (sides, m) = t.shape[1], corners.shape
    count = sides * cells
    ascending = np.empty((count, m), dtype=t.dtype)
    for side in range(sides):
        for cell in range(cells):
            i = side * cells + cell
            for j in range(m):
                vertex, k = t[corners[side, j], cell], j
                while k > 0 and ascending[i, k - 1] > vertex:
                    ascending[i, k] = ascending[i, k - 1]
                    k -= 1
                ascending[i, k] = vertex
    order, spare = np.arange(count).astype(np.int32), np.empty(count, dtype=np.int32)
    for j in range(known - 1, -1, -1):  # a stable counting sort by each corner, the lowest last
        begin = np.zeros(vertices + 1, dtype=np.int64)
        for i in range(count):
            begin[ascending[i, j] + 1] += 1
        for v in range(vertices):
            begin[v + 1] += begin[v]
        for i in order:
            vertex = ascending[i, j]
            spare[begin[vertex]] = i
            begin[vertex] += 1
        order, spare = spare, order
    numbers, sound, found, before = np.empty(count, dtype=np.int64), True, -1, 0
    first = spare  # first occurrence of each facet
    for i in order:
        same = found >= 0
        for j in range(known):
            same = same and ascending[i, j] == ascending[before, j]
        if not same:
            found += 1
            first[found] = before = i
        elif ascending[i, m - 1] != ascending[before, m - 1]:
            sound = False
        numbers[i] = found
    facets, beside = (
        np.empty((m, found + 1), dtype=t.dtype),
        np.empty((2, found + 1), dtype=np.int32),
    )
    for i in order:  # the last cell of each facet remains
        beside[1, numbers[i]] = i % cells
    for f in range(found + 1):
        i = first[f]
        beside[0, f] = i % cells
        if beside[0, f] == beside[1, f]:
            beside[1, f] = -1
        for j in range(m):
            facets[j, f] = t[corners[i // cells, j], i % cells] if in_turn else ascending[i, j]
    return facets, numbers.reshape(sides, cells), beside, sound


def on_one_side(p: Any, t: Any, facets: Any, f2t: Any, some: Any) -> Any:
    """Positive where both cells of a facet lie on one side of it: the product of their signs, (n,).
    A straight cell lies on the side of the opposite vertex or facet. Differences of vertices avoid
    rounding errors that grow with the distance from the origin."""
    (dim, _), corners, nodes = p.shape, facets.shape[0], t.shape[0]
    product = np.ones(some.size)
    x, normal = np.zeros((corners, 3)), np.zeros(3)
    for k in range(some.size):
        facet = some[k]
        origin = facets[0, facet]
        for j in range(corners):
            for d in range(dim):
                x[j, d] = p[d, facets[j, facet]] - p[d, origin]
        if dim == 2:
            normal[0], normal[1] = -x[1, 1], x[1, 0]
        else:
            # The diagonals of a bilinear facet are parallel to its middle.
            one = x[1] if corners == 3 else x[2]
            other = x[2] if corners == 3 else x[3] - x[1]
            for d in range(3):
                a, b = (d + 1) % 3, (d + 2) % 3
                normal[d] = one[a] * other[b] - one[b] * other[a]
        for side in range(2):
            cell = f2t[side, facet]
            base, along = t[0, cell], 0.0
            for d in range(dim):
                to_middle, middle = 0.0, 0.0
                for j in range(nodes):
                    to_middle += p[d, t[j, cell]] - p[d, base]
                for j in range(corners):
                    middle += x[j, d]
                way = (p[d, base] - p[d, origin]) + to_middle / nodes
                along += normal[d] * (way - middle / corners)
            product[k] *= np.sign(along)
    return product
