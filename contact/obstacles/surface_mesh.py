"""A rigid obstacle bounded by the facets of a mesh."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, ClassVar

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError
from contact.obstacles.arguments import column, vector
from contact.obstacles.box_tree import BoxTree
from contact.obstacles.facets import (
    check_facets,
    coordinates,
    edges_of,
    facet_normals,
    gap_to_facets,
    is_free,
    merged,
    outwards,
    read_facets,
    read_points,
)
from contact.obstacles.rigid_motion import RigidMotion, fitted
from contact.obstacles.surface_files import polydata, read_surface
from skfem_adini.ground.arguments import flag, numbers, positive_number

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceMesh:
    """An obstacle whose surface is a mesh: segments in two dimensions, triangles in three.

    A closed surface bounds a solid for either orientation of its facets, if it is consistent.
    Duplicate points are merged, as STL files require. The gap is measured along the body's normal
    to the flat facets, or, in a `ClosestPoint`, to their nearest point.

    Parameters
    ----------
    points : array_like, shape (dim, npoints)
    facets : array_like of int, shape (dim, nfacets)
        Numbers of the points of each facet.
    hollow : bool
        The obstacle is the other side of the surface: a cavity, with the body in it.
    sheet : bool
        The surface may have a border. The obstacle is the region behind its facets: the side from
        which a triangle is clockwise, and the left of a polyline. The border itself is not in
        contact.

    Attributes
    ----------
    normals : ndarray, shape (dim, nfacets)
        Unit normals, out of the obstacle.

    Raises
    ------
    InputError
        Wrong shapes, NaN, point numbers out of range; facets without area; a border without
        `sheet`; edges of more than two facets; inconsistent orientations of neighbours or of nested
        closed parts.

    Notes
    -----
    The normal at the nearest point decides whether a point is inside; at edges and corners it is
    the angle-weighted mean of the facet normals. Self-intersections are not detected.

    References
    ----------
    J. A. Baerentzen and H. Aanaes, Signed distance computation using the angle weighted
    pseudonormal, IEEE Transactions on Visualization and Computer Graphics 11 (2005), 243-253.

    Examples
    --------
    A wedge, 1 below the origin:

    >>> wedge = SurfaceMesh([[0.0, -1.0, 1.0], [-1.0, -3.0, -3.0]], [[0, 1, 2], [1, 2, 0]])
    >>> wedge
    SurfaceMesh(3 points, 3 segments)
    >>> x, down = np.array([[0.0, 0.5], [0.0, 0.0]]), np.array([[0.0, 0.0], [-1.0, -1.0]])
    >>> print(wedge(x, down), wedge.distance(x)[0].round(4))
    [1. 2.] [1.    1.118]
    """

    points: Array
    facets: Index
    hollow: bool = False
    sheet: bool = False
    normals: Array = field(init=False)
    _flat: FlatFacets = field(init=False)
    _shift: Array = field(init=False)
    _slides_in_itself: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name in ("hollow", "sheet"):
            flag(name, getattr(self, name))
        points = read_points(self.points)
        points, facets = merged(points, read_facets(self.facets, points))
        check_facets(points, facets)
        free = is_free(facets)
        if np.any(free) and not self.sheet:
            raise InputError(
                f"facets: the surface is open at {int(free.sum())} "
                f"{'ends' if len(points) == 2 else 'edges'}, so that it bounds no solid; close it "
                "(pyvista's fill_holes), or sheet=True if what lies behind it is the obstacle"
            )
        if not np.any(free):
            facets = outwards(points, facets)
        if self.hollow:
            facets = facets[::-1]
        # Coordinates relative to the middle avoid rounding from a distant origin.
        shift = 0.5 * (points.min(axis=1) + points.max(axis=1))
        faces = FlatFacets.of(points - shift[:, None], facets)
        self._set(points=points, facets=facets, normals=faces.pseudonormals[:, 0].T.copy())
        self._set(_flat=faces, _shift=shift)

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    @classmethod
    def from_file(
        cls,
        path: str | PathLike[str],
        scale: float = 1.0,
        *,
        hollow: bool = False,
        sheet: bool = False,
    ) -> SurfaceMesh:
        """Read an STL, PLY, OBJ or VTP file.

        Parameters
        ----------
        path : str or path
            A file of lines without faces, in a plane of constant z, makes an obstacle in two
            dimensions.
        scale : float
            Unit of the file in that of the body: 1e-3 for a file in mm and a body in m.
        hollow, sheet : bool
            See `SurfaceMesh`.

        Returns
        -------
        SurfaceMesh

        Raises
        ------
        InputError
            No such file, another format, nothing in it; what `SurfaceMesh` refuses.
        MissingDependency
            pyvista is not installed.

        Examples
        --------
        >>> import tempfile, pyvista
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     pyvista.Cube().triangulate().save(folder + "/cube.stl")
        ...     SurfaceMesh.from_file(folder + "/cube.stl", scale=1e-3).points.max().round(9)
        np.float64(0.0005)
        """
        size = positive_number("scale", scale)
        points, facets = read_surface(path)
        return cls(size * points, facets, hollow, sheet)

    def __repr__(self) -> str:
        """Return the class with the numbers of points and facets."""
        facets = "segments" if len(self.points) == 2 else "triangles"
        kind = "".join(f", {name}=True" for name in ("hollow", "sheet") if getattr(self, name))
        return f"SurfaceMesh({self.points.shape[1]} points, {self.facets.shape[1]} {facets}{kind})"

    def __call__(self, x: Array, n: Array) -> Array:
        """Return the gap along n from x; both of shape (dim, ...)."""
        n = n.reshape(len(n), -1).T
        faces = self._flat
        return gap_to_facets(faces.corners, faces.tree, self._home(x), n).reshape(x.shape[1:])

    def distance(self, x: Array) -> tuple[Array, Array]:
        """Signed distance, positive outside the obstacle, and its gradient.

        Parameters
        ----------
        x : ndarray, shape (dim, ...)

        Returns
        -------
        distance : ndarray, shape (...)
            Infinite if the nearest point of a sheet is on its border and x is not straight above
            it.
        gradient : ndarray, shape (dim, ...)
            On an edge, where it jumps, the angle-weighted mean of the facet normals.

        Raises
        ------
        InputError
            Places of another dimension.

        Examples
        --------
        >>> square = SurfaceMesh([[0, 1, 1, 0], [0, 0, 1, 1]], [[0, 1, 2, 3], [1, 2, 3, 0]])
        >>> print(*square.distance(np.array([[0.5, 2.0], [0.9, 0.5]])))
        [-0.1  1. ] [[0. 1.]
         [1. 0.]]
        """
        home = self._home(x)
        faces = self._flat
        near = faces.nearest(home)
        normal = faces.pseudonormals[near.facet, near.part]
        away = home - near.foot
        height = np.sum(away * normal, axis=1)
        length = np.linalg.norm(away, axis=1)
        side = np.where(height < 0, -1.0, 1.0)
        lateral = np.linalg.norm(away - height[:, None] * normal, axis=1)
        # Above a facet, or above an edge within a face, the normal is exact; close to an edge,
        # where differences lose digits, the mean normal is as accurate.
        straight = (near.part == 0) | (lateral <= 1e-14 * faces.size)
        flat = straight | (length <= 1e-8 * faces.size)
        unit = away / np.where(flat, 1.0, side * length)[:, None]
        gradient = np.where(flat[:, None], normal, unit)
        distance = np.where(straight, height, side * length)
        beside = lateral > 1e-10 * faces.size
        distance[faces.border[near.facet, near.part] & beside] = np.inf
        return distance.reshape(x.shape[1:]), gradient.T.reshape(x.shape)

    def closest(self, x: ArrayLike) -> Array:
        """Nearest places of the surface.

        Parameters
        ----------
        x : array_like, shape (dim, ...)

        Returns
        -------
        ndarray, shape (dim, ...)

        Raises
        ------
        InputError
            Places that are not finite, or of another dimension.

        Examples
        --------
        >>> square = SurfaceMesh([[0, 1, 1, 0], [0, 0, 1, 1]], [[0, 1, 2, 3], [1, 2, 3, 0]])
        >>> square.closest([[0.4, 3.0], [0.9, 2.0]])
        array([[0.4, 1. ],
               [1. , 1. ]])
        """
        places = numbers("x", x)
        if places.ndim < 1 or not np.all(np.isfinite(places)):
            raise InputError("x: expected finite places of shape (dim, ...)")
        near = self._flat.nearest(self._home(places))
        return np.asarray((near.foot + self._shift).T.reshape(places.shape))

    def translated(self, displacement: Sequence[float]) -> SurfaceMesh:
        """The translated surface, without new checks. `Moved` also rotates it.

        Parameters
        ----------
        displacement : sequence of float
            One number a direction.

        Returns
        -------
        SurfaceMesh

        Raises
        ------
        InputError
            A wrong number of components, or one that is not finite.

        Examples
        --------
        >>> square = SurfaceMesh([[0, 1, 1, 0], [0, 0, 1, 1]], [[0, 1, 2, 3], [1, 2, 3, 0]])
        >>> square.translated((0.0, -3.0)).points
        array([[ 0.,  1.,  1.,  0.],
               [-3., -3., -2., -2.]])
        """
        move = vector("displacement", displacement, self._shift.size)
        moved = copy.copy(self)
        moved._set(points=self.points + move[:, None], _shift=self._shift + move)
        return moved

    def motion_from(self, before: SurfaceMesh) -> RigidMotion | None:
        """Rigid motion of the points.

        Parameters
        ----------
        before : SurfaceMesh

        Returns
        -------
        RigidMotion or None
            None if the motion is not rigid.
        """
        if (before.hollow, before.sheet) != (self.hollow, self.sheet):
            return None
        if before._flat is self._flat:  # `translated`
            return RigidMotion.between(before._shift, self._shift)
        same = before.points.shape == self.points.shape
        if not same or not np.array_equal(before.facets, self.facets):
            return None
        return fitted(before.points, self.points)

    def to_pyvista(self) -> Any:
        """The surface with its cell data ``normal``.

        Returns
        -------
        pyvista.PolyData

        Raises
        ------
        MissingDependency
            pyvista is not installed.

        Examples
        --------
        >>> square = SurfaceMesh([[0, 1, 1, 0], [0, 0, 1, 1]], [[0, 1, 2, 3], [1, 2, 3, 0]])
        >>> square.to_pyvista().n_lines
        4
        """
        return polydata(self.points, self.facets, self.normals)

    def _home(self, x: Array) -> Array:
        """Points (dim, ...) as (npoints, dim), relative to the middle of the surface."""
        away = x - column(self._shift, x)
        return np.ascontiguousarray(away.reshape(len(x), -1).T)


@dataclass(frozen=True)
class FlatFacets:
    """Facets with the search structures for their nearest points and sides."""

    corners: Array  # shape (nfacets, dim, dim)
    tree: BoxTree
    vertices: scipy.spatial.KDTree
    pseudonormals: Array  # unit normals of the parts in `Nearest.part`, (nfacets, nparts, dim)
    border: NDArray[np.bool_]  # parts on the border of a sheet, (nfacets, nparts)
    size: float  # diagonal of the box around them

    @classmethod
    def of(cls, points: Array, facets: Index) -> FlatFacets:
        """Search structures for checked points (dim, npoints) and facets (dim, nfacets)."""
        corners = np.ascontiguousarray(points.T[facets.T])
        dim, count = facets.shape
        flat = facet_normals(corners)
        flat = flat / np.linalg.norm(flat, axis=1)[:, None] + 0.0  # no -0
        free = is_free(facets)
        at_corner = _unit_sums(facets.reshape(1, -1), np.tile(flat, (dim, 1)), _angles(corners))
        at_border = np.isin(facets, edges_of(facets)[:, free]).T
        normals, border = [flat[:, None], at_corner], [np.zeros((count, 1), bool), at_border]
        if dim == 3:
            edges = np.sort(edges_of(facets), axis=0)
            at_edge = _unit_sums(edges, np.tile(flat, (3, 1)), np.ones(3 * count))
            normals, border = (
                [normals[0], at_edge, normals[1]],
                [border[0], free.reshape(3, -1).T, border[1]],
            )
        tree, vertices = BoxTree(corners), scipy.spatial.KDTree(points.T)
        size = float(np.linalg.norm(np.ptp(points, axis=1)))
        return cls(corners, tree, vertices, np.concatenate(normals, 1), np.hstack(border), size)

    def nearest(self, x: Array) -> Nearest:
        """Nearest places to x (npoints, dim)."""
        return nearest_on_facets(self.corners, self.tree, self.vertices, x)


def _unit_sums(keys: Index, normals: Array, weights: Array) -> Array:
    """Unit sums of weighted normals over equal keys (k, n); (nfacets, n / nfacets, dim)."""
    key = keys[0] * (int(keys.max()) + 1) + keys[-1]
    _, number = np.unique(key, return_inverse=True)
    total = np.stack([np.bincount(number, weights * part) for part in normals.T], axis=1)[number]
    length = np.linalg.norm(total, axis=1)
    sharp = length < 1e-12 * weights  # facets folded onto each other: take any
    unit = np.where(sharp[:, None], normals, total / np.where(sharp, 1.0, length)[:, None])
    dim = normals.shape[1]  # as many edges and as many corners
    return np.asarray(unit.reshape(dim, -1, dim).transpose(1, 0, 2))


def _angles(corners: Array) -> Array:
    """Angles of the facets at their corners, corner by corner; ones in 2-D."""
    if corners.shape[2] == 2:
        return np.ones(2 * len(corners))
    angles = []
    for i in range(3):
        one, two = corners[:, i - 2] - corners[:, i], corners[:, i - 1] - corners[:, i]
        across = np.linalg.norm(np.cross(one, two), axis=1)
        angles.append(np.arctan2(across, np.sum(one * two, axis=1)))
    return np.concatenate(angles)


@dataclass(frozen=True)
class Nearest:
    """The nearest places of a surface."""

    foot: Array  # shape (npoints, dim)
    facet: Index
    part: Index  # 0 inside the facet, then its edges (3-D), then its corners


def nearest_on_facets(
    corners: Array, tree: BoxTree, vertices: scipy.spatial.KDTree, x: Array
) -> Nearest:
    """Nearest points of facets (nfacets, dim, dim) to x (npoints, dim); the first facet if equal.
    The search is bounded by the distances to the nearest vertex, good for small facets, and to a
    facet in a near box, good for large ones."""
    normals = facet_normals(corners)
    facet = tree.one_near(x)
    foot, part = _on_each(corners[facet], normals[facet], x)
    square = _square(x - foot)
    bound = np.minimum(square, vertices.query(x)[0] ** 2)
    for place, candidate in tree.near_points(x, bound):
        if not place.size:
            continue
        there, where = _on_each(corners[candidate], normals[candidate], x[place])
        away = _square(x[place] - there)
        first = _least(place, away, candidate)
        one, new, away = place[first], candidate[first], away[first]
        nearer = (away < square[one]) | ((away == square[one]) & (new < facet[one]))
        one, first = one[nearer], first[nearer]
        square[one], facet[one] = away[nearer], new[nearer]
        foot[one], part[one] = there[first], where[first]
        np.minimum(bound, square, out=bound)
    return Nearest(foot, facet, part)


def _least(place: Index, away: Array, facet: Index) -> Index:
    """For each point the pair of smallest distance; among equal ones that of the first facet."""
    order = np.lexsort((facet, away, place))
    return np.asarray(order[np.flatnonzero(np.diff(place[order], prepend=-1))])


def _on_each(c: Array, normal: Array, x: Array) -> tuple[Array, Index]:
    """Nearest point of one facet for each x, and the part of the facet that contains it.
    C. Ericson, Real-Time Collision Detection, Morgan Kaufmann 2005, section 5.1."""
    dim = c.shape[2]
    if dim == 2:
        foot, s = _on_segment(c[:, 0], c[:, 1], x)
        return foot, np.where(s <= 0, 1, np.where(s >= 1, 2, 0))
    area = _square(normal)
    height = np.einsum("fi,fi->f", x - c[:, 0], normal) / area
    foot = x - height[:, None] * normal
    part = np.zeros(len(x), dtype=np.int64)
    beside = np.flatnonzero(np.any(coordinates(c, normal, x) <= 0, axis=1))
    least = np.full(beside.size, np.inf)
    for i in range(3):
        there, s = _on_segment(c[beside, i], c[beside, i - 2], x[beside])
        away = _square(x[beside] - there)
        nearer = away < least
        at = beside[nearer]
        least[nearer], foot[at], s = away[nearer], there[nearer], s[nearer]
        part[at] = np.where(s <= 0, 4 + i, np.where(s >= 1, 4 + (i + 1) % 3, 1 + i))
    return foot, part


def _on_segment(start: Array, end: Array, x: Array) -> tuple[Array, Array]:
    edge = end - start
    s = np.einsum("fi,fi->f", x - start, edge) / _square(edge)
    s = np.clip(s, 0.0, 1.0)
    foot = start + s[:, None] * edge
    return np.where((s >= 1)[:, None], end, foot), s


def _square(vectors: Array) -> Array:
    return np.asarray(np.einsum("fi,fi->f", vectors, vectors))
