"""Displacement and its gradient at points inside periodic layers, from their planes of nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.body.elastic_body import ElasticBody
from contact.body.layers.layers import Layer
from contact.errors import InputError, numbers

Array = NDArray[np.float64]


def read_points(
    points: Any, layers: Sequence[Layer], dim: int, sides: Sequence[float | None]
) -> Array:
    """Points, shape (dim, n), between the lower side and the top, and within sides.

    `sides` are the widths of directions that are not periodic, None for others.

    Raises
    ------
    InputError
    """
    x = numbers("points", points)
    if x.ndim != 2 or x.shape[0] != dim or not np.all(np.isfinite(x)):
        raise InputError(f"points: expected finite numbers of shape ({dim}, n)")
    height = layers[-1].bottom + layers[-1].height
    outside = (x[-1] < -1e-12 * height) | (x[-1] > (1 + 1e-12) * height)
    if np.any(outside):
        raise InputError(f"points: {x[:, np.argmax(outside)]} lies below or above the layers")
    for axis, width in enumerate(sides):
        if width is not None:
            outside = np.abs(x[axis] - 0.5 * width) > (0.5 + 1e-12) * width
            if np.any(outside):
                raise InputError(f"points: {x[:, np.argmax(outside)]} lies beyond a side")
    return x


def read_forces(xp: Any, forces: Any, shape: tuple[int, ...]) -> Any:
    """Forces on the grid, as an array of the module xp.

    Raises
    ------
    InputError
    """
    try:
        given = xp.asarray(forces)
    except ValueError:  # ragged
        given = xp.zeros(0)
    if given.shape != shape or given.dtype.kind not in "fiu" or not bool(xp.isfinite(given).all()):
        raise InputError(f"forces: expected finite numbers of shape {shape}")
    return given


def layer_of(layers: Sequence[Layer], x: Array) -> NDArray[np.int64]:
    """Number of the layer of each point; of the upper one between two of them."""
    bottoms = [layer.bottom for layer in layers]
    return np.clip(np.searchsorted(bottoms, x[-1], side="right") - 1, 0, None)


def fields_at(
    x: Array,
    layers: Sequence[Layer],
    cells: Sequence[ElasticBody],
    plane: Callable[[int, bool], Array],
    last: Sequence[int | None],
) -> tuple[Array, Array]:
    """Displacement, shape (dim, n), and gradient d u_i / d x_j, shape (dim, dim, n), at points.

    Only two planes of nodes are held at a time.

    Parameters
    ----------
    x : ndarray, shape (dim, n)
    layers : sequence of Layer
    cells : sequence of ElasticBody
        One cell of each layer.
    plane : callable
        Number of a plane of nodes, and whether those of the layer above it are asked for where two
        meet -> its unknowns, shape (r, nx[, ny]).
    last : sequence of int or None
        Number of the last cell of each lateral direction that is not periodic.
    """
    dim, n = x.shape
    u, gradient = np.zeros((dim, n)), np.zeros((dim, dim, n))
    number = layer_of(layers, x)
    sizes = np.array([cell.mesh.p.max(axis=1) for cell in cells]).T[:, number]
    low, high = np.array([(layer.first, layer.cells) for layer in layers]).T[:, number]
    local = x.copy()
    local[-1] -= np.array([layer.bottom for layer in layers])[number]
    index = np.floor(local / sizes).astype(np.int64)
    index[-1] = np.clip(index[-1], 0, high - 1)
    for axis, end in enumerate(last):
        if end is not None:
            index[axis] = np.clip(index[axis], 0, end)
    local -= index * sizes
    rows = low + index[-1]
    seams = {layer.first for layer in layers[1:]}
    found: dict[tuple[int, bool], Array] = {}
    for row in map(int, np.unique(rows)):
        ends = (row, row in seams), (row + 1, False)
        found = {end: found[end] if end in found else plane(*end) for end in ends}
        here = np.flatnonzero(rows == row)
        body = cells[number[here[0]]]
        for field, values in _functions(
            body, local[:, here], index[:, here], [found[end] for end in ends]
        ):
            u[:, here] += np.asarray(field)[:, 0] * values
            gradient[:, :, here] += np.asarray(field.grad)[:, :, 0] * values
    return u, gradient


def _functions(body: ElasticBody, local: Array, index: Any, planes: Any) -> Any:
    """Each function of a cell at places in it, and the values of its unknown."""
    basis, places = body.basis, body.mesh.p > 0
    origin = np.zeros((local.shape[0], 1))
    shift, slope = basis.mapping.F(origin)[:, 0, 0], basis.mapping.DF(origin)[:, :, 0, 0]
    X = np.linalg.solve(slope, local - shift[:, None])
    nodal = basis.nodal_dofs
    for i, dof in enumerate(basis.element_dofs[:, 0]):
        kind, vertex = np.argwhere(nodal == dof)[0]
        values = planes[int(places[-1, vertex])][kind]
        at = tuple(
            (k + int(further)) % size
            for k, further, size in zip(index, places[:-1, vertex], values.shape, strict=False)
        )
        yield basis.elem.gbasis(basis.mapping, X, i)[0], values[at]
