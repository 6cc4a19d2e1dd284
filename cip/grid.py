"""Tensor-product grids of nodes in one, two and three dimensions, and the sphere."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import reduce
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cip.errors import InputError
from skfem_adini.ground.arguments import integer, keywords_named, positive_number, real_array

Array = NDArray[np.float64]
AXES = ("x", "y", "z")


class _Lines:
    """What all grids of lines of coordinates have."""

    nodes: tuple[int, ...]
    edges: tuple[Array, ...]
    widths: tuple[Array, ...]
    coordinates: tuple[Array, ...]

    @property
    def size(self) -> int:
        """Number of nodes."""
        return prod(self.nodes)

    @property
    def bounds(self) -> tuple[tuple[float, float], ...]:
        """Ends of the lines in each direction."""
        return tuple((float(line[0]), float(line[-1])) for line in self.edges)

    @property
    def spacing(self) -> tuple[float, ...]:
        """Smallest cell width in each direction."""
        return tuple(float(width.min()) for width in self.widths)

    def mesh(self) -> tuple[Array, ...]:
        """Coordinates of all nodes, one array of shape `nodes` for each direction.

        Returns
        -------
        tuple of ndarray
            In the unit of the bounds; on a sphere longitudes and latitudes in radians.
        """
        return tuple(np.meshgrid(*self.coordinates, indexing="ij"))


class Grid(_Lines):
    """Nodes of a box, uniform or not, periodic or not in each direction.

    Parameters
    ----------
    bounds : (low, high), or one such pair for each direction
        Ends of the box.
    shape : int, or one for each direction
        Number of cells, at least 4 each. A periodic direction has as many nodes as cells (the last
        node is the first again), another one node more.
    periodic : bool, or one for each direction

    Attributes
    ----------
    dim : int
    cells : tuple of int
        Number of cells in each direction.
    nodes : tuple of int
        Number of nodes in each direction: the shape of nodal arrays.
    coordinates : tuple of ndarray
        Coordinates of the nodes in each direction.
    widths : tuple of ndarray
        Widths of the cells in each direction.
    periodic, uniform : tuple of bool

    Raises
    ------
    InputError
        Bounds that do not increase or are not finite, or fewer than 4 cells.

    Examples
    --------
    >>> from cip import Grid
    >>> grid = Grid((-2, 2), 200)
    >>> grid.nodes, grid.spacing
    ((201,), (0.02,))
    >>> Grid([(0, 1), (0, 2)], (10, 20), periodic=True).nodes
    (10, 20)
    """

    @keywords_named
    def __init__(
        self, bounds: ArrayLike, shape: int | Sequence[int], periodic: bool | Sequence[bool] = False
    ) -> None:
        try:
            counts = np.atleast_1d(real_array("shape", shape))
        except InputError as error:
            raise InputError(f"shape: expected whole numbers of cells, got {shape!r}") from error
        if counts.ndim != 1 or counts.size not in (1, 2, 3) or counts.dtype.kind not in "iu":
            raise InputError(f"shape: expected 1 to 3 whole numbers of cells, got {shape!r}")
        box = real_array("bounds: expected pairs (low, high)", bounds).astype(float)
        if box.shape == (2,):
            box = np.tile(box, (counts.size, 1))
        if box.shape != (counts.size, 2):
            raise InputError(
                f"bounds: expected {counts.size} pairs (low, high) for shape {shape!r}, "
                f"got shape {box.shape}"
            )
        if not np.isfinite(box).all() or np.any(box[:, 1] <= box[:, 0]):
            raise InputError(f"bounds: each low must be finite and below its high, got {bounds!r}")
        if counts.min() < 4:
            raise InputError(f"shape: expected at least 4 cells in each direction, got {shape!r}")
        with np.errstate(all="ignore"):
            try:
                lines = [
                    np.linspace(float(pair[0]), float(pair[1]), int(n) + 1)
                    for pair, n in zip(box, counts, strict=True)
                ]
            except MemoryError as error:
                raise InputError(f"shape: {shape!r} cells do not fit into memory") from error
            if not all(np.all(np.diff(line) > 0.0) and np.isfinite(line).all() for line in lines):
                raise InputError(
                    f"bounds: {bounds!r} cannot be divided into {shape!r} cells in float64"
                )
        self._set(lines, periodic)

    @classmethod
    def from_coordinates(
        cls,
        x: ArrayLike,
        y: ArrayLike | None = None,
        z: ArrayLike | None = None,
        periodic: bool | Sequence[bool] = False,
    ) -> Grid:
        """The grid through given coordinates, both ends of the box included.

        Parameters
        ----------
        x, y, z : array_like
            Strictly increasing coordinates, at least 5 in each direction; in a periodic direction
            the last one is the image of the first.
        periodic : bool, or one for each direction

        Returns
        -------
        Grid

        Raises
        ------
        InputError
            Coordinates that do not increase, too few of them, or z without y.
        """
        if x is None:
            raise InputError("x: expected coordinates, got None")
        if y is None and z is not None:
            raise InputError("z: given without y")
        lines = []
        for name, value in zip(AXES, (x, y, z), strict=True):
            if value is None:
                continue
            line = real_array(name, value).astype(float)
            if line.ndim != 1 or line.size < 5 or not np.isfinite(line).all():
                raise InputError(
                    f"{name}: expected at least 5 finite coordinates in one row, got shape "
                    f"{line.shape}"
                )
            if np.any(np.diff(line) <= 0):
                at = int(np.argmax(np.diff(line) <= 0))
                raise InputError(
                    f"{name}: coordinates must increase, but the spacing after node {at} is "
                    f"{np.diff(line)[at]:.3g}"
                )
            lines.append(line)
        grid = object.__new__(cls)
        grid._set(lines, periodic)
        return grid

    def _set(self, lines: list[Array], periodic: bool | Sequence[bool]) -> None:
        try:
            flags = np.atleast_1d(real_array("periodic", periodic))
        except InputError as error:
            raise InputError(f"periodic: expected True or False, got {periodic!r}") from error
        if flags.dtype != bool or flags.shape not in ((1,), (len(lines),)):
            raise InputError(
                f"periodic: expected True or False for each of {len(lines)} directions, "
                f"got {periodic!r}"
            )
        self.dim = len(lines)
        self.periodic = tuple(bool(flag) for flag in np.broadcast_to(flags, (self.dim,)))
        self.edges = tuple(lines)
        self.cells = tuple(line.size - 1 for line in lines)
        self.nodes = tuple(n + (not p) for n, p in zip(self.cells, self.periodic, strict=True))
        self.coordinates = tuple(line[:n] for line, n in zip(lines, self.nodes, strict=True))
        widths = [np.diff(line) for line in lines]
        # Widths are equal up to the error of the feet.
        self.uniform = tuple(
            bool(
                np.ptp(width)
                <= 1e-10 * width.mean() + 8.0 * np.finfo(float).eps * np.abs(line).max()
            )
            for width, line in zip(widths, lines, strict=True)
        )
        self.widths = tuple(
            np.full(width.size, (line[-1] - line[0]) / width.size) if uniform else width
            for width, line, uniform in zip(widths, lines, self.uniform, strict=True)
        )

    def __repr__(self) -> str:
        box = ", ".join(f"[{line[0]:g}, {line[-1]:g}]" for line in self.edges)
        return f"Grid({box}, cells={self.cells}, periodic={self.periodic})"

    @property
    def weights(self) -> Array:
        """Weight of each node in sums over the grid: its share of the adjacent cells.

        Those of the trapezoidal rule, shape `nodes`: on a uniform periodic grid h^dim everywhere,
        at an end that is not periodic half a cell.
        """
        parts = [shares(self, axis) for axis in range(self.dim)]
        return np.asarray(reduce(np.multiply.outer, parts))

    @property
    def volumes(self) -> Array:
        """Size of each cell, shape `cells`."""
        return np.asarray(reduce(np.multiply.outer, self.widths))

    def index_displacement(self, axis: int, start: Array, shift: Array, index: Any) -> Array:
        """Displacement in cells (with fraction) of the point start + shift from node `index`.

        Parameters
        ----------
        axis : int
        start : ndarray
            Coordinate of the node.
        shift : ndarray
            Displacement of the point from the node, not reduced modulo the period.
        index : ndarray of int
            Number of the node along the direction.

        Returns
        -------
        ndarray
            In cells, positive to the right.
        """
        line, cells = self.edges[axis], self.cells[axis]
        if self.uniform[axis]:
            return shift / self.widths[axis][0]
        point, turns = start + shift, np.zeros_like(shift)
        if self.periodic[axis]:
            length = line[-1] - line[0]
            turns = np.floor((point - line[0]) / length)
            point = point - turns * length
        k = np.clip(np.searchsorted(line, point, side="right") - 1, 0, cells - 1)
        result = turns * cells + k + (point - line[k]) / self.widths[axis][k] - index
        return np.where(shift == 0.0, 0.0, result)


class Sphere(_Lines):
    """Cells of equal steps in longitude and latitude on a sphere, for `SphereSolver`.

    Arrays of fields have the shape ``(nlon, nlat)``, from longitude 0 eastward and from the south
    pole northward. Longitudes and latitudes are in radians.

    Parameters
    ----------
    nlon : int
        Number of cells around the sphere, even, at least 8: a great circle goes on beyond a pole
        half the way around.
    nlat : int
        Number of cells from pole to pole, at least 4.
    radius : float
        In the unit of length of velocities.

    Attributes
    ----------
    cells, nodes : tuple of int
        (nlon, nlat). Values belong to the centres of cells, so no pole is a node.
    coordinates, edges : tuple of ndarray
        Longitudes and latitudes of the centres of cells, and of their edges.
    widths : tuple of ndarray
        Of the cells in longitude and latitude, in radians.
    radius : float

    Raises
    ------
    InputError
        An odd or too small number of cells, or a radius that is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from cip import Sphere
    >>> earth = Sphere(72, 36, radius=6371.22)
    >>> earth.nodes, bool(np.isclose(earth.weights.sum(), 4 * np.pi * 6371.22**2))
    ((72, 36), True)
    """

    dim = 2
    periodic = (True, False)
    uniform = (True, True)

    @keywords_named
    def __init__(self, nlon: int, nlat: int, radius: float = 1.0) -> None:
        around = integer("nlon", nlon, 8)
        if around % 2:
            raise InputError(
                f"nlon={nlon}: expected an even number of cells, so that great circles go on "
                "beyond the poles"
            )
        self.cells = self.nodes = (around, integer("nlat", nlat, 4))
        self.radius = positive_number("radius", radius)
        self.edges = (
            np.linspace(0.0, 2.0 * np.pi, self.cells[0] + 1),
            np.linspace(-0.5 * np.pi, 0.5 * np.pi, self.cells[1] + 1),
        )
        self.coordinates = tuple(0.5 * (line[1:] + line[:-1]) for line in self.edges)
        self.widths = tuple(
            np.full(n, (line[-1] - line[0]) / n)
            for n, line in zip(self.cells, self.edges, strict=True)
        )

    def __repr__(self) -> str:
        return f"Sphere({self.cells[0]}, {self.cells[1]}, radius={self.radius:g})"

    @property
    def weights(self) -> Array:
        """Areas of the cells, shape ``(nlon, nlat)``: R^2 dlon (sin of the upper latitude less
        that of the lower one)."""
        row = self.radius**2 * self.widths[0][0] * np.diff(np.sin(self.edges[1]))
        return np.tile(row, (self.cells[0], 1))

    @property
    def volumes(self) -> Array:
        """Areas of the cells, as `weights`."""
        return self.weights


GridLike = Grid | Sphere


def in_space(lon: ArrayLike, lat: ArrayLike) -> Array:
    """Points of the unit sphere, shape (3, ...)."""
    lon, lat = np.broadcast_arrays(lon, lat)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


def shares(grid: Grid, axis: int) -> Array:
    """For each node of a line along an axis half the widths of its cells."""
    width = grid.widths[axis]
    if grid.periodic[axis]:
        return np.asarray(0.5 * (width + np.roll(width, 1)))
    return np.asarray(0.5 * (np.append(width, 0.0) + np.append(0.0, width)))


def places_of(grid: GridLike, averaged: Collection[int]) -> list[Array]:
    """Coordinates of nodes, or of the middles of cells in some directions, in each direction."""
    lines = list(grid.coordinates)
    for axis in averaged:
        line = grid.edges[axis][: grid.nodes[axis]]
        lines[axis] = line + 0.5 * np.append(grid.widths[axis], 0.0)[: line.size]
    return lines


def same_grid(one: GridLike, other: GridLike) -> bool:
    """Whether two grids have the same nodes."""
    alike = one.nodes == other.nodes and one.periodic == other.periodic
    return one is other or (alike and all(map(np.array_equal, one.edges, other.edges)))


def check_grid(grid: Any) -> None:
    """Raise `InputError` unless the argument `grid` is one."""
    if not isinstance(grid, Grid):
        raise InputError(f"grid: expected a Grid, got {type(grid).__name__}")


def wall_name(axis: int, side: int) -> str:
    """Name of the lower (0) or upper (1) wall of a direction, in arguments and messages."""
    return f"{AXES[axis]}{'-+'[side]}"


def node_name(grid: GridLike, flat: int) -> str:
    """Indices and coordinates of a node, for messages."""
    place = np.unravel_index(int(flat), grid.nodes)
    point = ", ".join(f"{line[i]:.6g}" for line, i in zip(grid.coordinates, place, strict=True))
    return f"node {tuple(int(i) for i in place)} at ({point})"
