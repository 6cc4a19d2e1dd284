"""Quadrature on the parts of rectangles that lie inside a level set, and on its zero line."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skfem_adini.curved.quadrature.level_set import LevelSet, TruthTable, as_level_set
from skfem_adini.curved.quadrature.polygon import Polygon, cut_polygon
from skfem_adini.curved.quadrature.polynomial_boxes import AccurateBoxes, accurate_boxes
from skfem_adini.errors import InputError
from skfem_adini.ground.arguments import array_of, finite_numbers, integer
from skfem_adini.ground.jit import compiled

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class CutQuadrature:
    """Quadrature points of cut cells and of the boundary.

    Coordinates and weights have the units of the mesh.

    Attributes
    ----------
    lower, upper
        Corners of all cells, shape (2, cells).
    full
        Which cells lie inside, shape (cells,). They have no points here.
    cells, points, weights
        Points inside cut cells: the cell of each, ascending, shape (n,); coordinates, (2, n);
        positive weights, (n,).
    boundary_cells, boundary_points, boundary_weights
        The same for points of the boundary, shapes (m,), (2, m), (m,). A piece that lies on a
        grid line belongs to the cell inside.
    normals
        Outward unit normals at the boundary points, shape (2, m).
    parts
        Which of the level set's leaves, or which side of the polygon, the boundary points lie on,
        shape (m,).

    Examples
    --------
    The area of a disk of radius .9: full cells, and weights in the others:

    >>> corners = np.meshgrid(np.linspace(-1, 0.75, 8), np.linspace(-1, 0.75, 8))
    >>> lower = np.reshape(corners, (2, -1))
    >>> rule = cut_quadrature(lambda x: x[0] ** 2 + x[1] ** 2 - 0.81, lower, lower + 0.25)
    >>> area = rule.full.sum() * 0.25**2 + rule.weights.sum()
    >>> bool(abs(area - 0.81 * np.pi) < 1e-12)
    True
    """

    lower: Array
    upper: Array
    full: NDArray[np.bool_]
    cells: Indices
    points: Array
    weights: Array
    boundary_cells: Indices
    boundary_points: Array
    boundary_weights: Array
    normals: Array
    parts: Indices

    def __repr__(self) -> str:
        return (
            f"CutQuadrature({len(self.full)} cells, {np.count_nonzero(self.full)} of them inside, "
            f"{np.count_nonzero(self.cut)} cut; {self.weights.size} points inside and "
            f"{self.boundary_weights.size} on the boundary)"
        )

    @cached_property
    def cut(self) -> NDArray[np.bool_]:
        """Which cells are neither full nor empty."""
        result = np.zeros(len(self.full), dtype=bool)
        result[self.cells] = True
        result[self.boundary_cells] = True
        return result & ~self.full

    @cached_property
    def fractions(self) -> Array:
        """Share of every cell that lies inside, shape (cells,)."""
        volume = np.bincount(self.cells, self.weights, len(self.full))
        return np.where(self.full, 1.0, volume / np.prod(self.upper - self.lower, axis=0))

    def check(self) -> None:
        """Check that the arrays are consistent.

        Raises
        ------
        InputError
            See `CutDomain.from_quadrature`.
        """
        count = self.full.size
        slack = 1e-9 * (self.upper - self.lower)  # rounding of a place in a cell
        inside = (self.cells, self.points, self.weights)
        line = (self.boundary_cells, self.boundary_points, self.boundary_weights)
        for kind, (cells, points, weights) in (("points", inside), ("boundary_points", line)):
            if points.shape != (2, cells.size) or weights.shape != cells.shape or cells.ndim != 1:
                raise InputError(f"quadrature: {kind} have other shapes than their cells")
            if cells.dtype.kind != "i" or np.any((cells < 0) | (cells >= count)):
                raise InputError(f"quadrature: {kind} lie in cells that do not exist")
            if np.any(np.diff(cells) < 0):
                raise InputError(f"quadrature: {kind} are not in the order of their cells")
            low, high = self.lower - slack, self.upper + slack
            if not np.all((points >= low[:, cells]) & (points <= high[:, cells])):
                raise InputError(f"quadrature: {kind} lie outside their cells")
            if not np.all((weights > 0) & np.isfinite(weights)):
                raise InputError(f"quadrature: weights of {kind} are not positive")
        shape = self.boundary_points.shape
        if self.full.dtype != bool or self.parts.shape != shape[1:] or self.normals.shape != shape:
            raise InputError("quadrature: full, normals or parts have other shapes than the points")
        if not np.all(np.abs(np.hypot(*self.normals) - 1.0) < 1e-9):
            raise InputError("quadrature: normals have not length one")

    @property
    def area(self) -> float:
        """Area of the domain."""
        whole = np.prod(self.upper - self.lower, axis=0)[self.full]
        return float(np.sum(whole) + np.sum(self.weights))

    @property
    def perimeter(self) -> float:
        """Length of the boundary, as far as it lies in the cells."""
        return float(np.sum(self.boundary_weights))


def cut_quadrature(
    level_set: LevelSet | Polygon | Callable[[Array], Any],
    lower: ArrayLike,
    upper: ArrayLike,
    q: int = 8,
    gradient: Callable[[Array], Any] | None = None,
) -> CutQuadrature:
    r"""Return quadrature rules for :math:`\{\varphi < 0\}` and its boundary in rectangles.

    In each cell phi is interpolated at 9 x 9 Chebyshev points; cells that may be cut, and in which
    the interpolant is not accurate to 3e-12 of its variation, are divided in four. Signs of
    Bernstein coefficients then decide, rigorously for the interpolant, which boxes are inside,
    outside or cut and in which coordinate phi is monotone. In a cut box the zero line is a graph
    over one side. Gauss points are placed on that side, between the abscissae where the graph meets
    the top, the bottom or another zero line, and for each of them along the height. Boxes without a
    suitable coordinate are divided further, at a point where two zero lines meet or in the middle.
    All weights are positive.

    Values of phi below 1e-13 of its size in a cell count as zero, so a boundary along a grid line
    is found, and belongs to the cell inside alone.

    Parameters
    ----------
    level_set
        Function phi of points (2, cells, points), a `LevelSet` (compositions keep their corners),
        a `FieldLevelSet`, or a `Polygon`, for which the rule is exact.
    lower, upper
        Opposite corners of the cells, shape (2, cells).
    q
        Gauss points in each direction, 1 to 30. Errors in area and length fall like
        :math:`h^{2q}` for smooth phi.
    gradient
        Gradient of phi, shape (2, cells, points); used for the normals instead of the
        interpolant's.

    Returns
    -------
    CutQuadrature

    Raises
    ------
    InputError
        Cells that are empty or not finite; a level set that is not finite on the cells, is not
        smooth along its zero line, or vanishes on an area; a gradient that does not fit.

    References
    ----------
    R. I. Saye, High-order quadrature methods for implicitly defined surfaces and volumes in
    hyperrectangles, SIAM Journal on Scientific Computing 37 (2015), A993-A1019.

    R. I. Saye, High-order quadrature on multi-component domains implicitly defined by multivariate
    polynomials, Journal of Computational Physics 448 (2022), 110720.

    Examples
    --------
    >>> rule = cut_quadrature(lambda x: x[0] ** 2 + x[1] ** 2 - 1, [[0.0], [0.0]], [[1.0], [1.0]])
    >>> bool(abs(rule.area - np.pi / 4) < 1e-11)
    True
    """
    lower, upper = _checked_cells(lower, upper)
    q = integer("q", q, 1, 30)
    if isinstance(level_set, Polygon):
        if gradient is not None:
            raise InputError("gradient: a polygon has none; leave it out")
        return CutQuadrature(lower, upper, *cut_polygon(level_set, lower, upper, q))
    table = TruthTable.of(as_level_set(level_set, gradient))
    boxes = accurate_boxes(table, lower, upper - lower)
    volume, edge, whole = _integrate(boxes, q)
    full = boxes.count_in_cell == whole
    volume = volume.of_cells(~full)
    return CutQuadrature(
        lower,
        upper,
        full,
        volume.cells,
        volume.points,
        volume.weights,
        edge.cells,
        edge.points,
        edge.weights,
        _oriented(table, edge),
        edge.parts,
    )


@dataclass(frozen=True)
class _Points:
    """Points with cells, weights and, on boundaries, normals and leaves."""

    cells: Indices
    points: Array
    weights: Array
    normals: Array
    parts: Indices

    @classmethod
    def inner(cls, cells: Indices, points: Array, weights: Array) -> _Points:
        """Points that lie on no boundary."""
        return cls(cells, points, weights, np.zeros_like(points), np.zeros_like(cells))

    @classmethod
    def joined(cls, pieces: list[_Points]) -> _Points:
        """Join several sets, sorted by cell."""
        cells = np.concatenate([piece.cells for piece in pieces])
        order = np.argsort(cells, kind="stable")
        return cls(
            cells[order],
            np.concatenate([piece.points for piece in pieces], axis=1)[:, order],
            np.concatenate([piece.weights for piece in pieces])[order],
            np.concatenate([piece.normals for piece in pieces], axis=1)[:, order],
            np.concatenate([piece.parts for piece in pieces])[order],
        )

    def of_cells(self, chosen: NDArray[np.bool_]) -> _Points:
        """Keep the points of some cells."""
        keep = chosen[self.cells]
        return _Points(
            self.cells[keep],
            self.points[:, keep],
            self.weights[keep],
            self.normals[:, keep],
            self.parts[keep],
        )


def _integrate(boxes: AccurateBoxes, q: int) -> tuple[_Points, _Points, Indices]:
    """Return the points of volume and boundary, and how many boxes of each cell lie inside."""
    nodes, weights = np.polynomial.legendre.leggauss(q)
    nodes, weights = (nodes + 1) / 2, weights / 2
    cell, lower, size = boxes.inside
    unit = np.array(np.meshgrid(nodes, nodes, indexing="ij")).reshape(2, -1)
    points = lower[:, :, None] + size[:, :, None] * unit[:, None]
    share = np.prod(size, axis=0)[:, None] * np.outer(weights, weights).ravel()
    volumes = [_Points.inner(np.repeat(cell, q * q), points.reshape(2, -1), share.ravel())]
    edges = [_Points.inner(cell[:0], lower[:, :0], share[:0, 0])]
    whole = np.bincount(cell, minlength=len(boxes.count_in_cell))
    for group in boxes.groups:
        rows, line, complete, bad = compiled_cut_boxes()(
            group.coefficients, group.tolerances, group.tables, group.size.T.copy(), nodes, weights
        )
        if bad >= 0:
            x, y = group.lower[:, bad]
            raise InputError(
                f"level_set: its zero line is degenerate in the cell at ({x:.6g}, {y:.6g}): the "
                "gradient must not vanish on it, nor may two zero lines touch along a curve"
            )
        whole += np.bincount(group.cell[complete], minlength=len(whole))
        owner = rows[:, 0].astype(np.int64)
        points = group.lower[:, owner] + group.size[:, owner] * rows[:, 1:3].T
        area = np.prod(group.size[:, owner], axis=0) * rows[:, 3]
        volumes.append(_Points.inner(group.cell[owner], points, area))
        owner = line[:, 0].astype(np.int64)
        points = group.lower[:, owner] + group.size[:, owner] * line[:, 1:3].T
        leaf = line[:, 6].astype(np.int64)
        normals = line[:, 4:6].T
        edges.append(
            _Points(group.cell[owner], points, line[:, 3], normals, group.leaves[owner, leaf])
        )
    return _Points.joined(volumes), _Points.joined(edges), whole


def _oriented(table: TruthTable, edge: _Points) -> Array:
    """Return unit normals: of the level sets' gradients where given, else of the interpolants."""
    normals = edge.normals.copy()
    for k, leaf in enumerate(table.leaves):
        here = np.flatnonzero(edge.parts == k)
        if here.size == 0:
            continue
        given = leaf.evaluate_gradient(edge.points[:, here, None], edge.cells[here])
        if given is None:
            continue
        length = np.linalg.norm(given[..., 0], axis=0)
        given = given[..., 0] / np.where(length > 0, length, 1)
        given *= np.sign(np.sum(given * normals[:, here], axis=0))
        off = np.abs(given - normals[:, here]).max(axis=0)
        if not off.max() <= 1e-4:  # above the error of the interpolant's unit normal
            x, y = edge.points[:, here[off.argmax()]]
            raise InputError(
                f"gradient: at ({x:.6g}, {y:.6g}) its direction differs by {off.max():.2g} from "
                "that of the level set's slope; return d phi / dx and d phi / dy"
            )
        normals[:, here] = given
    return normals


def _checked_cells(lower: ArrayLike, upper: ArrayLike) -> tuple[Array, Array]:
    corners = array_of("lower", lower), array_of("upper", upper)
    shape = corners[0].shape
    if len(shape) != 2 or shape[0] != 2 or shape[1] == 0 or shape != corners[1].shape:
        raise InputError(
            f"lower, upper: expected corners of shape (2, cells), got {shape}, {corners[1].shape}"
        )
    low: Array = finite_numbers("lower", corners[0], shape)
    high: Array = finite_numbers("upper", corners[1], shape)
    if not (high > low).all():
        raise InputError("lower, upper: the cells need positive sides")
    return low, high


# Several threads may request the kernels at once; the lock lets one of them replace the functions.
_lock = threading.Lock()


@lru_cache
def compiled_cut_boxes() -> Callable[..., Any]:
    """Return `graph_boxes.cut_boxes`, compiled by numba, with all that it calls.
    Compiled functions replace the plain ones in their modules, callees first, so that calls find
    them."""
    from skfem_adini.curved.quadrature import bernstein_kernels, graph_boxes, graph_rules

    with _lock:
        for module in (bernstein_kernels, graph_rules, graph_boxes):
            for name, kernel in list(vars(module).items()):
                if isinstance(kernel, FunctionType) and kernel.__module__ == module.__name__:
                    wrapped = name == "cut_boxes"
                    kernel = compiled(kernel, no_cpython_wrapper=not wrapped, no_cfunc_wrapper=True)
                    setattr(module, name, kernel)
    return graph_boxes.cut_boxes
