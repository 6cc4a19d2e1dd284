"""The field at any points, by the profile of a state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array, diags_array

from cip.errors import InputError, NotSupported
from cip.formulas.sphere_spline import at_places, centre_values
from cip.grid import Array, Grid, Sphere
from cip.profiles.catalogue import SPHERE, moments
from cip.profiles.plain import slope_weights
from cip.stages.state import State, state_of, values_of
from skfem_adini.ground.arguments import real_array

Indices = NDArray[np.int64]


def sample(state: State, points: ArrayLike) -> Array:
    """The profile of a state, without limiter, at points of shape (dim, ...), or (...) on lines.
    Profiles in one dimension and ``bicubic`` are evaluated as the schemes do; ``csl2`` and ``csl4``
    by their tensor products; all others, ``adini`` among them, by the multilinear interpolant plus,
    for each edge of the cell, the cubic bubble of the slopes at its ends times the linear weights
    of the other directions: Adini's profile in two dimensions, its Boolean sum in three. On a
    sphere by quintic splines of the values at the centres of cells."""
    state = state.host()
    if isinstance(state.grid, Sphere):
        return _on_sphere(state, points_of(points, 2))
    place = points_of(points, state.grid.dim)
    data = {name: np.asarray(state.data[q], dtype=float) for q, name in enumerate(state.names)}
    found = profile_value(state.profile, data, state.grid, place.reshape(state.grid.dim, -1))
    return np.asarray(found).reshape(place.shape[1:])


def _on_sphere(state: State, place: Array) -> Array:
    """A field at longitudes and latitudes (2, ...)."""
    if not np.isfinite(place).all() or np.abs(place[1]).max(initial=0.0) > 0.5 * np.pi:
        raise InputError("points: expected finite lon, lat in radians, lat from -pi/2 to pi/2")
    values = values_of(state)
    if "u" not in state.names:
        values = centre_values(values, SPHERE[state.profile])
    return at_places(values, *place)


def sample_sea(state: State, points: ArrayLike, land: NDArray[np.bool_]) -> Array:
    """As `sample` beside land, where the field is 0: in several dimensions by the parabolas of
    csl2, since the slopes of csl4 would be taken across coasts."""
    grid = state.grid
    if grid.dim > 1:
        state = state_of(grid, "csl2", state.data, state.t)
    found, place = sample(state, points), points_of(points, grid.dim)
    cells = [_cells(grid, axis, x.ravel())[0] for axis, x in enumerate(place)]
    return np.where(land[tuple(cells)].reshape(found.shape), 0.0, found)


def points_of(points: ArrayLike, dim: int) -> Array:
    """Points as coordinates of shape (dim, ...); on lines the first axis may be missing."""
    place = real_array("points", points).astype(float)
    if dim == 1 and (place.ndim == 0 or place.shape[0] != 1 or place.ndim == 1):
        place = place[None]
    if place.ndim == 0 or place.shape[0] != dim:
        raise InputError(f"points: expected shape ({dim}, ...), got {place.shape}")
    return place


def profile_value(
    profile: str, data: Mapping[str, Any], grid: Grid, points: Array, shift: Any = None
) -> Any:
    """The profile of these moments at points of shape (dim, n). The moments are arrays, or anything
    that can be indexed by nodes, added, and multiplied by arrays. A `shift` of all points, which
    may be imaginary, continues the polynomial of their cells."""
    cells = [_cells(grid, axis, x) for axis, x in enumerate(points)]
    if shift is not None:
        cells = [(k, r, s + d / h, h) for (k, r, s, h), d in zip(cells, shift, strict=True)]
    if profile in ("csl2", "csl4") or (grid.dim == 1 and profile != "linear"):
        evaluate = _line if grid.dim == 1 else _tensor_means
        return evaluate(profile, data, grid, cells)
    if profile == "bicubic":
        return _bicubic(data, grid, cells)
    return _boolean(profile != "linear", data, grid, cells)


Cell = tuple[Indices, Indices, Array, Array]


def _cells(grid: Grid, axis: int, x: Array) -> Cell:
    """For each point: left and right node of its cell, local coordinate in [0, 1], cell width."""
    low, high = grid.bounds[axis]
    if not np.isfinite(x).all():
        raise InputError(f"points: NaN or infinity in direction {'xyz'[axis]}")
    if grid.periodic[axis]:
        x = low + (x - low) % (high - low)
    elif np.any((x < low) | (x > high)):
        worst = x[np.argmax(np.maximum(low - x, x - high))]
        raise InputError(
            f"points: {'xyz'[axis]} = {worst:.6g} lies outside [{low:.6g}, {high:.6g}]"
        )
    edges = grid.edges[axis]
    k = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, grid.cells[axis] - 1)
    width = grid.widths[axis][k]
    return k, (k + 1) % grid.nodes[axis], (x - edges[k]) / width, width


def _cubic(a: Any, b: Any, va: Any, vb: Any, s: Array) -> Any:
    d = b - a
    value: Any = a + s * d + s * (1.0 - s) * ((va - d) * (1.0 - s) - (vb - d) * s)
    return value


def _line(profile: str, data: Mapping[str, Any], grid: Grid, cells: list[Cell]) -> Any:
    k, r, s, h = cells[0]
    a, b = data["u"][k], data["u"][r]
    if profile == "csl2":
        return _quadratic(a, b, data["mean"][k], s)
    va, vb = h * data["u_x"][k], h * data["u_x"][r]
    if profile == "cubic":
        return _cubic(a, b, va, vb, s)
    if profile in ("piecewise_linear", "smoothed"):
        d = b - a
        left, right, chord = a + va * s, b - vb * (1.0 - s), a + d * s
        crossing = (vb - d) * (va - d) <= 0.0
        envelope = np.where(va > vb, np.minimum(left, right), np.maximum(left, right))
        return np.where(crossing, envelope, chord)
    if profile == "csl4":
        return _quartic(a, b, va, vb, data["mean"][k], s)
    wa, wb = h**2 / 2 * data["u_xx"][k], h**2 / 2 * data["u_xx"][r]
    A, B, C = b - a - va - wa, vb - va - 2 * wa, wb - wa
    c3, c4, c5 = 10 * A - 4 * B + C, -15 * A + 7 * B - 2 * C, 6 * A - 3 * B + C
    return a + s * (va + s * (wa + s * (c3 + s * (c4 + s * c5))))


def _quadratic(a: Any, b: Any, m: Any, s: Array) -> Any:
    value: Any = a + s * ((6 * m - 4 * a - 2 * b) + s * 3 * (a + b - 2 * m))
    return value


def _quartic(a: Any, b: Any, va: Any, vb: Any, m: Any, s: Array) -> Any:
    A, B, C = b - a - va, vb - va, m - a - va / 2
    c2, c3, c4 = -12 * A + 1.5 * B + 30 * C, 28 * A - 4 * B - 60 * C, -15 * A + 2.5 * B + 30 * C
    value: Any = a + s * (va + s * (c2 + s * (c3 + s * c4)))
    return value


def _tensor_means(profile: str, data: Mapping[str, Any], grid: Grid, cells: list[Cell]) -> Array:
    """Apply the profile of values and means in one direction after the other."""
    names = list(data)
    rules = [slope_weights(grid, axis) for axis in range(grid.dim if profile == "csl4" else 0)]

    def reduced(bits: int, axis: int, index: tuple[Indices, ...]) -> Array:
        if axis == grid.dim:
            return data[names[bits]][index]
        k, r, s, width = cells[axis]

        def value(node: Indices) -> Array:
            return reduced(bits, axis + 1, (*index, node))

        def mean(cell: Indices) -> Array:
            return reduced(bits | 1 << axis, axis + 1, (*index, cell))

        a, b, m = value(k), value(r), mean(k)
        if profile == "csl2":
            return _quadratic(a, b, m, s)
        va = width * _slope(rules[axis], k, value, mean)
        vb = width * _slope(rules[axis], r, value, mean)
        return _quartic(a, b, va, vb, m, s)

    return reduced(0, 0, ())


def _slope(rule: tuple[Any, Any], node: Indices, value: Any, mean: Any) -> Any:
    """Slopes at nodes, by a rule of `slope_weights`, from functions that give values at nodes and
    means of cells."""
    place, weights = rule
    parts = [value(place[q, node]) for q in range(3)] + [mean(place[q, node]) for q in range(2)]
    total: Any = 0.0
    for weight, part in zip(weights, parts, strict=True):
        total = total + weight[node] * part
    return total


def _bicubic(data: Mapping[str, Any], grid: Grid, cells: list[Cell]) -> Any:
    (k, r, s, hx), (l, q, t, hy) = cells

    def along(name: str, j: Indices) -> Any:
        a, b = data[name][k, j], data[name][r, j]
        slope = data["u_x" if name == "u" else "u_xy"]
        return _cubic(a, b, hx * slope[k, j], hx * slope[r, j], s)

    low, high = ((along("u", j), hy * along("u_y", j)) for j in (l, q))
    return _cubic(low[0], high[0], low[1], high[1], t)


def _linear(cells: list[Cell], sides: Sequence[int]) -> Any:
    """The multilinear weight of a corner of the cell of each point."""
    parts = [cell[2] if side else 1.0 - cell[2] for cell, side in zip(cells, sides, strict=True)]
    return reduce(np.multiply, parts, np.ones(()))


def _boolean(slopes: bool, data: Mapping[str, Any], grid: Grid, cells: list[Cell]) -> Any:
    total: Any = 0.0
    for corner in product((0, 1), repeat=grid.dim):
        index = tuple(cell[side] for cell, side in zip(cells, corner, strict=True))
        total = total + _linear(cells, corner) * data["u"][index]
    if not slopes:
        return total
    for axis, (k, r, s, h) in enumerate(cells):
        slope = data["u_" + "xyz"[axis]]
        for corner in product((0, 1), repeat=grid.dim - 1):
            others = [cell for b, cell in enumerate(cells) if b != axis]
            inner = [cell[side] for cell, side in zip(others, corner, strict=True)]
            left = (*inner[:axis], k, *inner[axis:])
            right = (*inner[:axis], r, *inner[axis:])
            weight = _linear(others, corner)
            d = data["u"][right] - data["u"][left]
            bubble = (h * slope[left] - d) * (1.0 - s) - (h * slope[right] - d) * s
            total = total + weight * s * (1.0 - s) * bubble
    return total


class _Rows:
    """Linear functionals of the moments, one for each point, as rows of a sparse matrix:
    `profile_value` computes with them as with numbers."""

    # Makes arrays leave products and sums with rows to the methods below.
    __array_ufunc__ = None

    def __init__(self, matrix: csr_array) -> None:
        self.matrix = matrix

    def __add__(self, other: Any) -> _Rows:
        if isinstance(other, _Rows):
            return _Rows(self.matrix + other.matrix)
        assert np.all(other == 0.0)  # a constant is no linear functional; sums begin with 0
        return self

    __radd__ = __add__

    def __sub__(self, other: _Rows) -> _Rows:
        return _Rows(self.matrix - other.matrix)

    def __mul__(self, factor: Any) -> _Rows:
        factors = np.broadcast_to(np.asarray(factor, dtype=float), (self.matrix.shape[0],))
        return _Rows(csr_array(diags_array(factors) @ self.matrix))

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> _Rows:
        return self * (1.0 / divisor)


class _Moment:
    """One moment at all nodes: indexing it by nodes gives the rows that evaluate it there."""

    def __init__(self, offset: int, grid: Grid, columns: int) -> None:
        self._offset, self._grid, self._columns = offset, grid, columns

    def __getitem__(self, index: Any) -> _Rows:
        nodes = np.ravel_multi_index(
            index if isinstance(index, tuple) else (index,), self._grid.nodes
        )
        ones = (np.ones(nodes.size), (np.arange(nodes.size), self._offset + nodes))
        return _Rows(csr_array(ones, shape=(nodes.size, self._columns)))


def sample_rows(grid: Grid, profile: str, points: ArrayLike) -> csr_array:
    """The matrix of `cip.output.sample.sample`, by the same formulas: shape (n, N), applied to
    ``state.data.ravel()``. Raises `NotSupported` for a profile that is not linear in its moments.
    """
    wanted = moments(profile, grid.dim)
    if profile in ("piecewise_linear", "smoothed"):
        raise NotSupported(f"profile: {profile!r} is not linear in its moments; take 'cubic'")
    size = grid.size
    data = {one.name: _Moment(q * size, grid, len(wanted) * size) for q, one in enumerate(wanted)}
    place = points_of(points, grid.dim).reshape(grid.dim, -1)
    found: csr_array = profile_value(profile, data, grid, place).matrix
    found.sum_duplicates()
    return found
