"""Facets and edges that carry boundary data, and the data sampled on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import MeshHex1DG, MeshQuad1DG

from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of

Array = NDArray[np.float64]
Indices = NDArray[np.integer]
Value = float | Callable[[Array], Any] | Sequence[Any] | Array


def imposed_components(components: int | Sequence[int] | None, count: int) -> list[int]:
    """Return the chosen components as a sorted list, all `count` of them by default."""
    if components is None:
        return list(range(count))
    given = np.atleast_1d(array_of("components", components))
    whole = given.dtype.kind in "iu" or given.size == 0
    chosen = sorted({int(c) for c in given}) if whole and given.ndim == 1 else []
    if not chosen or chosen[0] < 0 or chosen[-1] >= count:
        raise InputError(f"components: expected some of 0 to {count - 1}, got {components!r}")
    return chosen


def facet_numbers(mesh: Any, facets: Any) -> Indices:
    """Return the sorted numbers of facets; None stands for the whole boundary.
    Facets are given by indices, boundary name, callable of the midpoints, or a set of these."""
    if facets is None:
        facets = mesh.boundary_facets()
    if isinstance(facets, str) and facets not in (mesh.boundaries or {}):
        known = sorted(mesh.boundaries or {})
        raise InputError(f"facets: no boundary {facets!r} in the mesh; it has {known}")
    try:
        index = array_of("facets", mesh.normalize_facets(facets))
    except (ValueError, TypeError, IndexError, KeyError, NotImplementedError) as error:
        raise InputError(f"facets: cannot select facets by {facets!r}: {error}") from error
    if index.size == 0:
        raise InputError("facets: the set is empty; give at least one facet of the mesh")
    whole = index.dtype.kind in "iu"
    if not whole or index.min() < 0 or index.max() >= mesh.facets.shape[1]:
        span = f" from {index.min()} to {index.max()}" if whole else ""
        raise InputError(
            f"facets: expected whole numbers from 0 to {mesh.facets.shape[1] - 1}, got an "
            f"array of {index.dtype}{span}"
        )
    return np.unique(index)


def facet_corners(mesh: Any, facets: Indices) -> Array:
    """Return the coordinates of the vertices of facets, shape (dim, 2 or 4, facets). On a periodic
    mesh a vertex has several positions; those of the first cell are returned."""
    vertices = mesh.facets[:, facets]
    if not isinstance(mesh, MeshQuad1DG | MeshHex1DG):
        return np.asarray(mesh.p[:, vertices])
    cells = mesh.f2t[0, facets]
    local = (mesh.t[None, :, cells] == vertices[:, None]).argmax(axis=1)
    nodes = np.take_along_axis(mesh.dofs.element_dofs[:, cells], local, axis=0)
    return np.asarray(mesh.doflocs[:, nodes])


def refuse_periodic(mesh: Any) -> None:
    """Raise InputError for meshes whose vertices have no unique positions."""
    if isinstance(mesh, MeshQuad1DG | MeshHex1DG):
        raise InputError(
            f"basis: the mesh is periodic ({type(mesh).__name__}), where a vertex has several "
            "places and edges no direction that could be read from them; essential_dofs(basis, "
            "facets) finds the dofs on axis-parallel sides that are not periodic"
        )


def sample(value: Value, points: Array, count: int) -> Array:
    """Evaluate data at points (dim, facets, points of a facet), as (count, facets, points).
    The value is a number, a callable that returns (facets, points) or (count, facets, points),
    or a sequence of `count` numbers and scalar callables."""
    shape = (count, *points.shape[1:])
    if callable(value):
        data = array_of("value", value(points))
        expected = shape[1:] if count == 1 else shape
        if data.ndim and data.shape not in (expected, shape):
            raise InputError(
                f"value: the function returned shape {data.shape} for points of shape "
                f"{points.shape}; expected {expected}"
            )
    elif isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0):
        if len(value) != count:
            raise InputError(f"value: expected {count} components, got {len(value)}")
        data = np.concatenate([sample(part, points, 1) for part in value])
    else:
        data = array_of("value", value)
    try:
        data = np.broadcast_to(data, shape).astype(float, casting="same_kind")
    except (TypeError, ValueError) as error:
        raise InputError(f"value: expected a real number or function, got {value!r}") from error
    if not np.isfinite(data).all():
        raise InputError("value: the data hold NaN or infinity on the given facets")
    return data


@dataclass(frozen=True)
class BoundaryEdges:
    """Straight edges of a mesh: its facets in 2-D, the sides of its facets in 3-D."""

    vertices: Indices  # first and last vertex of every edge, shape (2, edges)
    first: Array  # end points, shape (dim, edges)
    last: Array

    @classmethod
    def of(cls, mesh: Any, facets: Indices) -> BoundaryEdges:
        """Return the edges of facets with vertices (2 or 4, facets), each edge once."""
        vertices = facets
        if len(facets) > 2:
            sides = np.array([facets, np.roll(facets, -1, axis=0)]).reshape(2, -1)
            vertices = np.unique(np.sort(sides, axis=0), axis=1)
        return cls(vertices, mesh.p[:, vertices[0]], mesh.p[:, vertices[1]])

    @cached_property
    def length(self) -> Array:
        """Lengths, shape (edges,)."""
        return np.linalg.norm(self.last - self.first, axis=0)

    @cached_property
    def tangent(self) -> Array:
        """Unit vectors from the first to the last vertex, shape (dim, edges)."""
        return (self.last - self.first) / self.length

    def points(self, s: Array) -> Array:
        """Return the points at the fractions s of every edge, shape (dim, edges, points)."""
        return self.first[:, :, None] * (1 - s) + self.last[:, :, None] * s

    def along(self, normals: Array) -> tuple[Array, Array]:
        """Return unit tangents, (dim, edges), at the first and at the last vertices.
        They are orthogonal to the unit normals (dim, vertices); where these are zero, along the
        edge."""
        first, last = (
            self.tangent - n * np.sum(n * self.tangent, axis=0)
            for n in normals[:, self.vertices].swapaxes(0, 1)
        )
        return first / np.linalg.norm(first, axis=0), last / np.linalg.norm(last, axis=0)

    def curve(self, s: Array, ends: tuple[Array, Array]) -> Array:
        """Return points, (dim, edges, points), on the cubics with these unit tangents at the ends.
        The fractions s are as in `points`."""
        bumps = s * (1 - s) ** 2, -(s**2) * (1 - s)
        turns = ((end - self.tangent) * self.length for end in ends)
        bent = sum(turn[:, :, None] * bump for turn, bump in zip(turns, bumps, strict=True))
        return np.asarray(self.points(s) + bent)
