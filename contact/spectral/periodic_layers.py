"""A block of layers whose loads and displacements repeat periodically along its surface."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import MeshHex, MeshQuad
from skfem.element import Element

from contact.body.boundary_names import select_components
from contact.body.elastic_body import ElasticBody
from contact.body.layers.lateral_sides import odd_unknowns, read_sides, unsupported
from contact.body.layers.layers import Layer, flat_plane, read_layers
from contact.body.layers.meshed_block import meshed, supported
from contact.errors import InputError
from contact.spectral.condensed_layers import CondensedLayers
from contact.spectral.filtered_compliance import FilteredCompliance
from contact.spectral.half_space import HalfSpace
from contact.spectral.lateral_waves import LateralWaves
from contact.spectral.layer_arguments import (
    named,
    node_kinds,
    node_lengths,
    read_base,
    read_cells,
)
from contact.spectral.real_symbol import RealSymbol
from contact.spectral.slab_symbols import cell
from contact.spectral.wave_cells import parities
from skfem_adini.ground.arguments import choice, integer, keywords_named, numbers
from skfem_adini.ground.arrays import host

Array = NDArray[np.float64]


class PeriodicLayers(FilteredCompliance):
    r"""Layers of equal cells, periodic or mirrored at their sides, condensed wave by wave.

    The stiffness is exactly that of the finite elements, by default bilinear or trilinear: the body
    equals that of `elastic`, with its sides tied to each other, on rollers or fixed tangentially.
    The cost of condensation onto the lower side is proportional to the points of the surface and to
    the logarithm of the number of layers, and contact needs transforms only
    (`contact.spectral.grid_contact`).

    The bottom left corner lies at the origin, and contact occurs on the lower side, as for
    `LayeredBlock`.

    Parameters
    ----------
    lengths : float or (float, float)
        Widths in the lateral directions: one for a body in the plane, two for one in space.
    layers : sequence of (height, cells, E, nu)
        From the bottom up: height, number of layers of cells, Young's modulus, Poisson's ratio.
    cells : int or (int, int)
        Cells in each direction: the number of surface points, one less where it is not periodic.
    top : str, optional
        Components that are fixed on the top, e.g. "xy", others are free there; default: all.
    motion : sequence of float, optional
        Displacement of the top where it is fixed; default: none.
    sides : str or pair of str
        "periodic" (default), or the components that are fixed on both sides of a direction, as
        `LayeredBlock` spells them: the normal one alone, rollers free of shear ("x" across x), or
        the others alone, fixed tangentially without normal traction ("y" in the plane, "yz" in
        space). In space one entry per direction, such as ``("periodic", "y")``. The body is half of
        a mirror-symmetric one: derivatives that vanish by symmetry at the sides are fixed as well;
        zero traction would imply this only in the limit of mesh refinement.
    base : (E, nu), optional
        An elastic half space (in the plane: half plane in plane strain) that the top is bonded to,
        instead of supports. Displacements are then measured from the mean of the lower side.
    plane : {"strain", "stress"}
        Of a body in the plane.
    element : skfem element, optional
        Scalar element whose unknowns belong to vertices: `ElementQuad1` or `ElementHex1` (default),
        `ElementQuadAdini`, `ElementHexAdini`, `ElementQuadBFS`. Forces of contact act on the values
        at the vertices.
    interfaces : {"smooth", "kinked"}
        Derivatives across the interface of two materials, if the element has them: shared by both
        layers, as in a mesh (default), or each layer's own, as a displacement has a kink there. Its
        errors then are those of the element in one material.
    xp : module
        `numpy`, or `cupy` to condense and solve on a device.

    Attributes
    ----------
    shape : tuple of int
        Points of the surface along each direction.
    spacing : tuple of float
    normal : ndarray, shape (dim,)
        Outward normal of the lower side.
    constant : ndarray of bool, shape (dim,)
        Components in which neither the top nor a side supports the body.
    weights : array, shape (nx[, ny])
        Area of each point in units of a cell: half on a side that is not periodic.
    mirrored : tuple of bool
        Directions that are not periodic.
    fixed : ndarray of bool, shape (dim, nx[, ny])
        Components of points that a side fixes.
    initial : array, shape (dim, nx[, ny])
        Displacement of the lower side without forces on it.
    contact_modulus : float
        E* of the lowest layer: E / (1 - nu^2), in plane stress E.

    Raises
    ------
    InputError
        A malformed argument; the message names it.

    References
    ----------
    R. J. Guyan, AIAA Journal 3 (1965), 380, for condensation; the waves are those of the mesh, not
    of the continuum.

    Examples
    --------
    A column that its lower side compresses by one per cent:

    >>> block = PeriodicLayers(1.0, [(0.5, 4, 1.0, 0.0)], cells=8)
    >>> forces = np.zeros((2, 8))
    >>> forces[1] = 0.01 / 8  # a pressure of .01 upwards
    >>> print(block.apply(forces)[1].round(12))
    [0.005 0.005 0.005 0.005 0.005 0.005 0.005 0.005]
    """

    @keywords_named
    def __init__(
        self,
        lengths: ArrayLike,
        layers: Sequence[tuple[float, int, float, float]],
        cells: int | Sequence[int],
        *,
        top: str | None = None,
        motion: ArrayLike | None = None,
        sides: str | Sequence[str] = "periodic",
        base: tuple[float, float] | None = None,
        plane: str = "strain",
        element: Element | None = None,
        interfaces: str = "smooth",
        xp: Any = np,
    ) -> None:
        given = np.atleast_1d(numbers("lengths", lengths))
        if given.shape not in ((1,), (2,)) or not np.all(np.isfinite(given) & (given > 0)):
            raise InputError(f"lengths={lengths!r}: expected one or two positive numbers")
        self.lengths, self.dim = tuple(map(float, given)), given.size + 1
        self._sides, self.sides = read_sides(sides, self.dim), sides
        self.cells = read_cells(cells, self._sides)
        self.spacing = tuple(np.divide(self.lengths, self.cells).tolist())
        flat_plane(plane, self.dim)
        self.layers, self.plane = read_layers(layers), plane
        lowest = self.layers[0]
        self.contact_modulus = lowest.E / (1 - (plane != "stress") * lowest.nu**2)
        self._mesh = MeshQuad if self.dim == 2 else MeshHex
        self.element = self._mesh.elem() if element is None else element
        if base is not None and type(self.element) is not self._mesh.elem:
            raise InputError("base: the half space is joined to linear cells only; leave element")
        if base is not None and (top is not None or motion is not None or plane != "strain"):
            raise InputError(
                "base: a top on a half space is not fixed; leave top, motion and plane"
            )
        self.base = None if base is None else read_base(base)
        self.held = np.zeros(self.dim, dtype=bool)
        if base is None:
            self.held[select_components(self.dim, top)] = True
        self.normal = -np.eye(self.dim)[-1]
        self.constant = unsupported(self._sides, self.held | (base is not None))
        self._xp = xp
        self.interfaces = choice("interfaces", interfaces, ("smooth", "kinked"))
        self._condense()
        moved = np.zeros(self.dim) if motion is None else numbers("motion", motion)
        if moved.shape != (self.dim,) or not np.all(np.isfinite(moved)):
            raise InputError(f"motion={motion!r}: expected {self.dim} finite numbers")
        self.motion = np.where(self.held, moved, 0.0)
        by_sides = sorted({c for fixed in self._sides for c in fixed or ()})
        if np.any(self.motion[by_sides]):
            raise InputError(f"motion={motion!r}: the sides hold {named(by_sides)} at zero")
        self.initial = xp.zeros((self.dim, *self.shape))
        self.initial += xp.asarray(self.motion).reshape(-1, *[1] * len(self.shape))

    def __repr__(self) -> str:
        rows = sum(layer.cells for layer in self.layers)
        size = " x ".join(map(str, (*self.cells, rows)))
        sides = "" if self.sides == "periodic" else f", sides={self.sides!r}"
        return f"PeriodicLayers({self.dim}-D, {size} cells, {self.unknowns} unknowns{sides})"

    @property
    def unknowns(self) -> int:
        """Number of unknowns of all nodes of the layers that are not fixed."""
        rows = sum(layer.cells for layer in self.layers)
        free = [np.count_nonzero(~self._waves.held(k)) for k in range(self._kinds.size)]
        once = [*self._body.loose, *self._body.own]
        return int(sum(free)) * rows + int(sum(free[k] for k in once))

    def displacement(self, forces: Any, row: int) -> Any:
        """Displacement of the nodes on one level inside, under forces on the lower side.

        Parameters
        ----------
        forces : array, shape (dim, nx[, ny])
        row : int
            Number of the plane of nodes, 0 for the lower side.

        Returns
        -------
        array, shape (dim, nx[, ny])
            Includes the motion of the top, but not free translations.

        Raises
        ------
        InputError
            A level that the body does not have.
        """
        row = integer("row", row, 0, sum(layer.cells for layer in self.layers))
        return self._plane(self._load(forces), row)[: self.dim] + self.initial

    def sample(self, forces: Any, points: ArrayLike) -> Array:
        """Displacement at points inside, by the element's own interpolation, on the host.

        Parameters
        ----------
        forces : array, shape (dim, nx[, ny])
            On the lower side. For a `GridResult` these are its shear and, as the last component,
            its pressure, times ``result.cell`` and `weights`.
        points : array, shape (dim, n)
            The lower side lies at height zero; coordinates are taken modulo a period.

        Returns
        -------
        ndarray, shape (dim, n)
            Includes the motion of the top, but not free translations.

        Raises
        ------
        InputError
            Points outside the layers, or of another shape.
        """
        u, _ = self._fields(forces, self._read_points(points))
        return u + self.motion[:, None]

    def stress(self, forces: Any, points: ArrayLike) -> Array:
        """Cauchy stress at points inside, on the host; between two layers that of the upper one.

        Parameters
        ----------
        forces, points
            As for `sample`.

        Returns
        -------
        ndarray, shape (dim, dim, n)

        Raises
        ------
        InputError
            Points outside the layers, or of another shape.
        """
        x = self._read_points(points)
        _, gradient = self._fields(forces, x)
        number, sigma = layer_of(self.layers, x), np.zeros_like(gradient)
        for k, body in enumerate(self._cell_bodies):
            here = np.flatnonzero(number == k)
            law = body.law_at(np.zeros((self.dim, here.size)))
            sigma[:, :, here] = law.stress(gradient[:, :, here])
        return sigma

    def _read_points(self, points: ArrayLike) -> Array:
        sides = [length if twice else None
                 for length, twice in zip(self.lengths, self.mirrored, strict=True)]  # fmt: skip
        return read_points(points, self.layers, self.dim, sides)

    def _fields(self, forces: Any, x: Array) -> tuple[Array, Array]:
        load = self._load(forces)
        return fields_at(
            x,
            self.layers,
            self._cell_bodies,
            lambda row, above: host(self._plane(load, row, above)),
            [n - 1 if twice else None for n, twice in zip(self.cells, self.mirrored, strict=True)],
        )

    def _load(self, forces: Any) -> Any:
        """Waves of forces on the lower side."""
        given = read_forces(self._xp, forces, (self.dim, *self.shape))
        return self._waves.forward(self._waves.doubled(given))

    def _plane(self, load: Any, row: int, above: bool = False) -> Any:
        """Unknowns on a plane of nodes, shape (r, nx[, ny]), with zero supports."""
        return self._waves.inverse(self._body.plane(load, row, above))

    def elastic(self) -> ElasticBody:
        """The same body on a mesh, with its sides' conditions, and boundaries "bottom" and "top".

        Returns
        -------
        ElasticBody
            Of ``prod(cells)`` times the number of layers cells.

        Raises
        ------
        InputError
            The block lies on a half space, or its interfaces have kinks of their own.
        """
        if self.base is not None:
            raise InputError("base: a half space has no mesh")
        if self._body.own:
            raise InputError("interfaces: a mesh shares all derivatives; take interfaces='smooth'")
        mesh, of = meshed(self._mesh, self.lengths, self.cells, self.layers)
        body = ElasticBody.from_mesh(
            mesh, self.element, E=np.array([layer.E for layer in self.layers])[of],
            nu=np.array([layer.nu for layer in self.layers])[of], **self._in_plane(),
        )  # fmt: skip
        for axis in map(int, np.flatnonzero(self.held)):
            body.fix("top", "xyz"[axis], float(self.motion[axis]))
        supported(body, self._sides)
        return body

    def _in_plane(self) -> dict[str, Any]:
        return {"plane": self.plane} if self.dim == 2 else {}

    def _condense(self) -> None:
        cells = [
            cell(
                (*self.spacing, layer.height / layer.cells), self.element,
                E=layer.E, nu=layer.nu, **self._in_plane(),
            )
            for layer in self.layers
        ]  # fmt: skip
        self._cell_bodies, self._kinds = cells, node_kinds(cells[0])
        lengths = node_lengths(self._kinds, self.spacing, self.layers)
        self._waves = LateralWaves(self.cells, odd_unknowns(self._sides, self._kinds), self._xp)
        self.shape = self._waves.points
        self.weights, self.mirrored = self._waves.weights, self._waves.mirrored
        self.fixed = np.array([self._waves.held(c) for c in range(self.dim)])
        counts = [layer.cells for layer in self.layers]
        changes = [False]
        for lower, upper in pairwise(self.layers):
            other = (lower.E, lower.nu) != (upper.E, upper.nu)
            changes.append(other and self.interfaces == "kinked")
        self._body = CondensedLayers(
            cells, counts, self._kinds, lengths, self.held, self._waves, self._below(), changes
        )
        lateral = self._waves if any(self._waves.mirrored) else None
        self._take_symbols(*self._body.symbols(), self.dim - 1, lateral)

    def _below(self) -> RealSymbol | None:
        """Stiffness of the half space that the top is bonded to."""
        if self.base is None:
            return None
        twice = 1 + np.array(self._waves.mirrored)
        above = HalfSpace(
            (twice * self.lengths).tolist(), (twice * self.cells).tolist(), *self.base, xp=self._xp
        )
        at = tuple(slice(n) for n in self._waves.shape)
        return RealSymbol.of(above.stiffness[(..., *at)], parities(self._kinds, self.dim).tolist())


def read_points(
    points: Any, layers: Sequence[Layer], dim: int, sides: Sequence[float | None]
) -> Array:
    """Points, (dim, n), between the lower side and the top, and within sides; `sides` are the
    widths of directions that are not periodic, None for others.
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
    """Forces on the grid, as an array of the module xp."""
    try:
        given = xp.asarray(forces)
    except ValueError:  # sequences of unequal length
        given = xp.zeros(0)
    if given.shape != shape or given.dtype.kind not in "fiu" or not bool(xp.isfinite(given).all()):
        raise InputError(f"forces: expected finite numbers of shape {shape}")
    return given


def layer_of(layers: Sequence[Layer], x: Array) -> NDArray[np.int64]:
    """Number of the layer of each point; the upper one at an interface."""
    bottoms = [layer.bottom for layer in layers]
    return np.clip(np.searchsorted(bottoms, x[-1], side="right") - 1, 0, None)


def fields_at(
    x: Array,
    layers: Sequence[Layer],
    cells: Sequence[ElasticBody],
    plane: Callable[[int, bool], Array],
    last: Sequence[int | None],
) -> tuple[Array, Array]:
    """Displacement, (dim, n), and gradient d u_i / d x_j, (dim, dim, n), at points. `plane` returns
    the unknowns of a plane, of the layer above it or below; two planes are in memory at a time."""
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
    """Each function of a cell at local points, and the values of its unknown."""
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
