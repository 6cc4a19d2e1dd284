"""Mesh edges that carry boundary data, and the data sampled on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.element import ElementVector

from .element_quad_adini import ElementQuadAdini
from .errors import InputError

Array = NDArray[np.float64]
Indices = NDArray[np.integer]
Value = float | Callable[[Array], Any] | Sequence[Any] | Array


def adini_dofs(basis: Any) -> Indices:
    """Return the dofs as (3, components, vertices): u, u_x, u_y of every component and vertex."""
    elem = basis.elem.elem if isinstance(basis.elem, ElementVector) else basis.elem
    if not isinstance(elem, ElementQuadAdini):
        raise InputError(
            f"basis: expected ElementQuadAdini or ElementVector(ElementQuadAdini()), "
            f"got {type(elem).__name__}"
        )
    nodal = basis.dofs.nodal_dofs
    return np.asarray(nodal).reshape(3, len(nodal) // 3, -1)


def imposed_components(components: int | Sequence[int] | None, count: int) -> list[int]:
    """Return the chosen components as a sorted list, all `count` of them by default."""
    if components is None:
        return list(range(count))
    chosen = sorted({int(c) for c in np.atleast_1d(np.asarray(components))})
    if not chosen or chosen[0] < 0 or chosen[-1] >= count:
        raise InputError(f"components: expected some of 0 to {count - 1}, got {components!r}")
    return chosen


@dataclass(frozen=True)
class BoundaryEdges:
    """Straight edges of a mesh.

    Attributes
    ----------
    vertices
        First and last vertex of every edge, shape (2, edges).
    first, last
        End points, shape (2, edges).
    """

    vertices: Indices
    first: Array
    last: Array

    @classmethod
    def select(cls, mesh: Any, facets: Any) -> BoundaryEdges:
        """Find edges by indices, boundary name, callable of the midpoints, or a set of these.

        Raises
        ------
        InputError
            Unknown boundary name, indices out of range, or no edge at all.
        """
        if isinstance(facets, str) and facets not in (mesh.boundaries or {}):
            known = sorted(mesh.boundaries or {})
            raise InputError(f"facets: no boundary {facets!r} in the mesh; it has {known}")
        try:
            index = np.asarray(mesh.normalize_facets(facets))
        except (ValueError, NotImplementedError) as error:
            raise InputError(f"facets: cannot select edges by {facets!r}: {error}") from error
        if index.size == 0:
            raise InputError("facets: the set is empty; give at least one edge of the mesh")
        whole = np.issubdtype(index.dtype, np.integer)
        if not whole or index.min() < 0 or index.max() >= mesh.facets.shape[1]:
            raise InputError(
                f"facets: expected whole numbers from 0 to {mesh.facets.shape[1] - 1}, got an "
                f"array of {index.dtype} from {index.min()} to {index.max()}"
            )
        vertices = mesh.facets[:, np.unique(index)]
        return cls(vertices, mesh.p[:, vertices[0]], mesh.p[:, vertices[1]])

    @cached_property
    def length(self) -> Array:
        """Shape (edges,)."""
        return np.hypot(*(self.last - self.first))

    @cached_property
    def tangent(self) -> Array:
        """Unit vectors from the first to the last vertex, shape (2, edges)."""
        return (self.last - self.first) / self.length

    def sample(self, value: Value, s: Array, count: int) -> Array:
        """Evaluate data at the fractions s of every edge, as (count, edges, points).

        Parameters
        ----------
        value
            A number for every component; a callable of points (2, edges, points) that returns
            (edges, points) or, for vector fields, (count, edges, points); or a sequence of `count`
            numbers and scalar callables.
        s
            Fractions of the edge, from 0 at the first vertex to 1 at the last.
        count
            Number of components of the field.
        """
        points = self.first[:, :, None] * (1 - s) + self.last[:, :, None] * s
        shape = (count, *points.shape[1:])
        if callable(value):
            data = np.asarray(value(points))
            expected = shape[1:] if count == 1 else shape
            if data.ndim and data.shape not in (expected, shape):
                raise InputError(
                    f"value: the function returned shape {data.shape} for points of shape "
                    f"{points.shape}; expected {expected}"
                )
        elif isinstance(value, list | tuple | np.ndarray) and np.ndim(value) > 0:
            if len(value) != count:
                raise InputError(f"value: expected {count} components, got {len(value)}")
            data = np.concatenate([self.sample(part, s, 1) for part in value])
        else:
            data = np.asarray(value)
        try:
            data = np.broadcast_to(data, shape).astype(float, casting="same_kind")
        except (TypeError, ValueError) as error:
            raise InputError(f"value: expected a real number or function, got {value!r}") from error
        if not np.isfinite(data).all():
            raise InputError("value: the data hold NaN or infinity on the given edges")
        return data
