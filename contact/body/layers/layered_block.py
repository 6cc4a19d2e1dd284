"""A rectangle of layers of equal Adini cells: the body for structured condensation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, ElementVector, MeshQuad
from skfem.element import Element

from contact.body.boundary_names import select_components
from contact.body.constitutive import IsotropicLaw
from contact.body.deferred_basis import DeferredBasis
from contact.body.elastic_body import ElasticBody, Field
from contact.body.layers.block_vectors import BlockVectors
from contact.body.layers.lateral_sides import elastic_of, hold, meshed_of, vanishing
from contact.body.layers.layers import (
    PER_NODE,
    CellRows,
    Layer,
    checked_path,
    each_side,
    flat_plane,
    grid,
    read_columns,
    read_layers,
    read_lengths,
    read_sides,
)
from contact.body.layers.meshed_block import meshed_block
from contact.errors import InputError
from contact.settled import settled
from skfem_adini import ElementQuadAdini
from skfem_adini.ground.arguments import keywords_named

SIDES = ("left", "right", "top")


def built_edge(block: Any, name: str) -> tuple[ElasticBody, NDArray[np.int64]]:
    """One line of cells along an edge of a `LayeredBlock`, and its dofs in the block."""
    y = block.y
    if name in ("top", "bottom"):
        at = slice(-2, None) if name == "top" else slice(0, 2)
        cell = block.cell_bodies[-1 if name == "top" else 0]
        row = strip(block, grid(block.x, y[at]), cell, intorder=1)
        start = block.ndofs - row.ndofs if name == "top" else 0
        return row, start + np.arange(row.ndofs)
    i = np.array([0, 1] if name == "left" else [block.columns - 1, block.columns])
    nodes = (block.columns + 1) * np.arange(y.size)[:, None] + i
    dofs = PER_NODE * nodes.ravel()[:, None] + np.arange(PER_NODE)
    # The material is irrelevant: edges serve supports and tractions.
    return strip(block, grid(block.x[i], y), block.cell_bodies[0], intorder=1), dofs.ravel()


def strip(block: Any, mesh: MeshQuad, cell: ElasticBody, intorder: int | None) -> ElasticBody:
    """A body of some cells of a block, without supports."""
    element = ElementVector(ElementQuadAdini(1))
    # Edges serve supports and tractions, which need no shape functions inside the cells.
    basis = Basis(mesh, element) if intorder is None else DeferredBasis(mesh, element, intorder)
    return ElasticBody(basis, E=cell.E, nu=cell.nu, plane=block.plane)


def prescribed_on_edges(block: Any) -> tuple[NDArray[np.int64], Array]:
    """Dofs of a block with a prescribed displacement, ascending, and its values."""
    dofs, values = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for name in SIDES:
        own = [(c, value) for b, c, value in block._supports if b == name]
        if own:
            edge, place = block._edge(name)
            for c, value in own:
                edge.fix(edge.facets(name), c, value)
            P, u0 = edge.constraint
            held = np.diff(P.indptr) == 0
            dofs.append(place[held])
            values.append(u0[held])
    besides = vanishing(block, block.node_rows)
    besides = np.setdiff1d(besides, np.concatenate(dofs))
    dofs.append(besides)
    values.append(np.zeros(besides.size))
    where, value = np.concatenate(dofs), np.concatenate(values)
    found, first, inverse = np.unique(where, return_index=True, return_inverse=True)
    # A derivative is compared times the length of a cell.
    cell = np.tile([1.0, 1.0, *[block.cell_size] * 4], 1)[found % PER_NODE]
    size = float(np.abs(value * cell[inverse]).max(initial=0.0))
    if np.any(np.abs(value - value[first][inverse]) * cell[inverse] > 1e-10 * size):
        raise InputError("value: two prescribed displacements differ where they meet")
    return found, value[first]


Array = NDArray[np.float64]


@settled(
    "make a new LayeredBlock",
    *("plane", "layers", "lengths", "sides", "top", "width", "height", "columns", "path"),
)
class LayeredBlock(BlockVectors):
    """A rectangle of horizontal layers, each of equal Adini cells and of one material.

    The same body as an `ElasticBody` on the same mesh (`elastic` builds it), but without a Basis
    and without a sparse matrix: `ContactProblem` condenses it by
    `contact.condensation.layers`, on the CPU or with ``problem.condense(device="cuda")`` on
    a GPU. Contact may occur on its "bottom".

    In space, with another element or periodic sides, it is an `ElasticBody` whose contact is
    condensed by transforms if its side conditions allow it, else by a sparse factorisation;
    ``problem.condense().path`` names the method.

    Node (i, j), counted from the bottom left, carries dofs ``6 ((columns + 1) j + i) + k``, k = 0,
    ..., 5 for ``u, v, u_x, v_x, u_y, v_y``.

    Parameters
    ----------
    lengths : float or (float, float)
        Width, or width and height; the height must be the sum of the layers'. In space the widths
        along x and y. The bottom left corner lies at the origin.
    layers : sequence of (height, cells, E, nu)
        From the bottom up: height, number of cell rows, Young's modulus, Poisson's ratio.
    sides : str, pair of str or None
        Displacement components fixed on both sides, e.g. "y"; or on the left and the right one,
        e.g. ("xy", None); in space across x and across y. "periodic" ties the sides instead.
    top : str or None
        Components fixed on the top.
    columns : int, optional
        Number of cells in a row. Default: cells of the first layer as square as can be.
    plane : {"strain", "stress"}
    cells : int or (int, int), optional
        Two numbers, along x and y, make a block in space; one number is `columns`.
    element : skfem element, optional
        Scalar. Default: `ElementQuadAdini`, in space `ElementHex1`.
    path : {"fourier"}, optional
        Require transforms: sides are periodic, on rollers or fixed tangentially, and derivatives
        that vanish by symmetry are fixed as well, see `PeriodicLayers`. By default transforms serve
        only periodic sides and elements without derivatives.

    Raises
    ------
    InputError
        A malformed argument, which the message names; sides without the `path` asked for.

    Examples
    --------
    A soft layer under a stiff one, pressed on a foundation .01 below it:

    >>> from contact import ContactProblem, LayeredBlock
    >>> block = LayeredBlock(1.0, [(0.25, 4, 1.0, 0.4), (0.75, 12, 10.0, 0.3)], sides="x")
    >>> result = ContactProblem(block.load("top", (0.0, -1.0)), "bottom", 0.01, 0.3).solve()
    >>> round(float(result.resultant[1]), 6)
    1.0
    """

    _ANEW, _KEPT = ("stiffness", "_edges", "arrays"), ("prescribed", "trace")
    _IDENTITY = "cell_bodies"

    @keywords_named
    def __new__(
        cls, lengths: Any = None, layers: Any = None, sides: Any = None, top: str | None = None, *,
        columns: Any = None, plane: str | None = "strain", cells: Any = None, element: Any = None,
        path: str | None = None,
    ) -> Any:  # fmt: skip
        """Make a `MeshedBlock` if the arguments require one."""
        checked_path(path)
        tied = "periodic" in each_side(sides)
        if not tied and cells is None and element is None:
            return super().__new__(cls)
        return meshed_block(
            lengths,
            layers,
            sides,
            top,
            columns,
            plane=plane,
            cells=cells,
            element=element,
            path=path,
        )

    def __init__(
        self,
        lengths: float | Sequence[float],
        layers: Sequence[tuple[float, int, float, float]],
        sides: str | Sequence[str | None] | None = None,
        top: str | None = None,
        *,
        columns: int | None = None,
        plane: str | None = "strain",
        cells: int | Sequence[int] | None = None,
        element: Element | None = None,
        path: str | None = None,
    ) -> None:
        self.dim, self.plane = 2, flat_plane(plane, 2)
        self.lengths, self.sides, self.top, self.path = lengths, sides, top, path
        self.layers = read_layers(layers)
        self.width, self.height = read_lengths(lengths, self.layers)
        self.columns = read_columns(columns, self.width, self.layers[0])
        self.node_rows = 1 + sum(layer.cells for layer in self.layers)
        self.row_size = PER_NODE * (self.columns + 1)
        self.cell_bodies = [
            ElasticBody.from_mesh(
                grid(
                    np.array([0.0, self.width / self.columns]), np.array([0.0, l.height / l.cells])
                ),
                ElementQuadAdini(),
                E=l.E,
                nu=l.nu,
                plane=self.plane,
            )
            for l in self.layers
        ]
        vanishing(self, 1)  # refuses sides that the path does not support
        self._unload(self.node_rows * self.row_size)
        self._supports: list[tuple[str, int, Field]] = []
        for boundary, components in zip(SIDES, (*read_sides(sides), top), strict=True):
            if components is not None:
                self.fix(boundary, components)

    def fix(
        self,
        boundary: str,
        components: str | int | Sequence[int] | None = None,
        value: Field = 0.0,
    ) -> Self:
        """Prescribe displacement components on "left", "right" or "top"; see `ElasticBody.fix`.

        Parameters
        ----------
        boundary : str or list of str
        components : str, int or sequence of int, optional
            E.g. "y"; default: all.
        value : float or callable x -> array of shape (...)
            In units of length.
        """
        for name in self._names(boundary):
            edge, _ = self._edge(name)
            edge.fix(edge.facets(name), components, value)  # checks
            chosen = select_components(2, components)
            self._supports = [*self._supports, *((name, c, value) for c in chosen)]
        self.__dict__.pop("prescribed", None)
        self.__dict__.pop("trace", None)
        return self

    def load(self, boundary: str, traction: Field) -> Self:
        """Add a surface traction on "left", "right", "top" or "bottom"; see `ElasticBody.load`.

        Parameters
        ----------
        boundary : str or list of str
        traction : array of shape (2,) or callable x -> array of shape (2, ...)
            Force per area, added to earlier loads.
        """
        found = []
        for name in self._names(boundary, (*SIDES, "bottom")):
            edge, dofs = self._edge(name)
            found.append((dofs, edge.load(edge.facets(name), traction).f))
        self._add(found)
        return self

    def body_force(self, force: Field) -> Self:
        """Add a volume force; see `ElasticBody.body_force`.

        Parameters
        ----------
        force : array of shape (2,) or callable x -> array of shape (2, ...)
            Force per volume.
        """
        f = self.f.copy()
        for layer, cell in zip(self.layers, self.cell_bodies, strict=True):
            for row in range(layer.cells):  # strip by strip: no Basis of the whole body
                low = layer.bottom + row * layer.height / layer.cells
                strip = self._strip(np.array([low, low + layer.height / layer.cells]), cell)
                first = (layer.first + row) * self.row_size
                f[first : first + strip.f.size] += strip.body_force(force).f
        self.f = f
        return self

    def _names(self, boundary: Any, known: tuple[str, ...] = SIDES) -> list[str]:
        names = [boundary] if isinstance(boundary, str) else boundary
        if not isinstance(names, list | tuple) or not names or any(n not in known for n in names):
            raise InputError(
                f"boundary={boundary!r}: a LayeredBlock offers {', '.join(map(repr, known))} here"
            )
        return list(names)

    def _edge(self, name: str) -> tuple[ElasticBody, NDArray[np.int64]]:
        """One line of cells along an edge, as a body without supports, and its dofs in this one."""
        edges = self.__dict__.setdefault("_edges", {})
        body, dofs = edges.get(name) or edges.setdefault(name, built_edge(self, name))
        fresh = copy(body)
        fresh._supports = []
        return fresh, dofs

    def _strip(self, y: Array, cell: ElasticBody, intorder: int | None = None) -> ElasticBody:
        """One row of cells between two heights."""
        return strip(self, grid(self.x, y), cell, intorder)

    @property
    def x(self) -> Array:
        """Abscissae of the nodes, shape (columns + 1,)."""
        return np.linspace(0.0, self.width, self.columns + 1)

    @property
    def y(self) -> Array:
        """Heights of the node rows, shape (node_rows,)."""
        parts = [l.bottom + np.linspace(0.0, l.height, l.cells + 1)[1:] for l in self.layers]
        return np.concatenate(([0.0], *parts))

    @cached_property
    def prescribed(self) -> tuple[NDArray[np.int64], Array]:
        """Dofs with a prescribed displacement, ascending, and its values; InputError if two
        prescriptions contradict each other."""
        return prescribed_on_edges(self)

    @property
    def cell_size(self) -> float:
        """Mean cell size: square root of the mean area."""
        return float(np.sqrt(self.width * self.height / (self.columns * (self.node_rows - 1))))

    @cached_property
    def trace(self) -> ElasticBody:
        """The bottom row of cells, supported at its sides; its dofs come first in this body."""
        edge, _ = self._edge("bottom")
        basis, bottom = copy(edge.basis), {"bottom": edge.facets("bottom")}
        basis.mesh = replace(edge.mesh, _boundaries=bottom)  # contact is possible there only
        strip = LowestRow(basis, E=edge.E, nu=edge.nu, plane=self.plane)
        for name, c, value in self._supports:
            if name != "top" or self.node_rows == 2:
                strip.fix(edge.facets(name), c, value)
        hold(strip, vanishing(self, 2))
        return strip

    @property
    def cell_rows(self) -> list[CellRows]:
        """Element matrix and number of cell rows of each layer, from the bottom up."""
        found = []
        for cell, layer in zip(self.cell_bodies, self.layers, strict=True):
            dofs = cell.basis.element_dofs[:, 0]
            found.append(CellRows(cell.stiffness.toarray()[np.ix_(dofs, dofs)], layer.cells))
        return found

    @property
    def constraint(self) -> tuple[sparse.csr_array, Array]:
        """P and u0 of ``u = P z + u0``, as `ElasticBody.constraint`; built anew on every call."""
        dofs, values = self.prescribed
        u0, free = np.zeros(self.ndofs), np.ones(self.ndofs, dtype=bool)
        u0[dofs], free[dofs] = values, False
        return sparse.csr_array(sparse.eye_array(self.ndofs, format="csc")[:, free]), u0

    def under(self, f: Array, u0: Array) -> Self:
        """The same body with other loads and other prescribed displacements."""
        other = copy(self)
        dofs, _ = self.prescribed
        other.f, other.prescribed = f, (dofs, u0[dofs])
        return other

    def in_unknowns(self, rows: sparse.csr_array) -> sparse.csr_array:
        """Rows on all dofs, nonzero only on those of the `trace`, on the trace's unknowns."""
        return sparse.csr_array(rows[:, : self.trace.ndofs] @ self.trace.constraint[0])

    def displacement(self, u: Array, points: Array) -> Array:
        """Displacement at points, by the element's own interpolation, shape (2, npoints)."""
        value = np.zeros((2, points.shape[1]))
        for at, field, own in shape_functions(self, u, points):
            value[:, at] += np.asarray(field)[:, 0] * own
        return value

    def gradient(self, u: Array, points: Array) -> Array:
        """Gradient d u_i / d x_j of the displacement at points, shape (2, 2, npoints)."""
        value = np.zeros((2, 2, points.shape[1]))
        for at, field, own in shape_functions(self, u, points):
            value[:, :, at] += np.asarray(field.grad)[:, :, 0] * own
        return value

    def law_at(self, points: Array) -> IsotropicLaw:
        """`StressLaw` of the layers that hold the points, shape (2, npoints)."""
        table = np.array([[float(c.lam), float(c.mu), float(c.nu)] for c in self.cell_bodies])
        lame_lambda, lame_mu, nu = table[located(self, points)[0]].T
        return IsotropicLaw(lame_lambda, lame_mu, nu, self.plane)

    def elastic(self) -> ElasticBody:
        """The same body as an `ElasticBody`, with loads, supports and dof numbers."""
        return elastic_of(self)

    def meshed(self) -> ElasticBody:
        """As `elastic`, without supports and loads, for pictures and stresses."""
        return meshed_of(self)

    def stored(self) -> dict[str, Any]:
        """The data that a file stores: arguments, and the supported components of the sides."""
        return {
            "lengths": [self.width, self.height],
            "layers": [[l.height, l.cells, l.E, l.nu] for l in self.layers],
            "columns": self.columns,
            "plane": self.plane,
            "path": self.path,
            "sides": self.sides if self.path else None,
            "supports": [[name, int(c)] for name, c, _ in self._supports],
        }

    @classmethod
    def from_stored(cls, words: dict[str, Any], ndofs: int) -> LayeredBlock:
        """The block from the output of `stored`, supports at zero; refused unless it has `ndofs`
        dofs."""
        rows = sum(cells for _, cells, *_ in words["layers"])
        if PER_NODE * (words["columns"] + 1) * (rows + 1) != ndofs:
            raise InputError(f"block: its cells do not make the {ndofs} dofs of its supports")
        options = {key: words[key] for key in ("columns", "plane", "path")}
        block: LayeredBlock = cls(words["lengths"], words["layers"], words["sides"], **options)
        block._supports = []
        for name, c in words["supports"]:
            block.fix(name, c)
        return block

    @property
    def basis(self) -> Any:
        """Raise an `InputError`: a `LayeredBlock` has no Basis; `elastic` builds one."""
        raise InputError(
            "a LayeredBlock has no mesh and no Basis, which this needs; block.elastic() is the "
            "same body with them, and result.sample(points) evaluates the solution anywhere"
        )

    mesh = element = basis


class LowestRow(ElasticBody):
    """The bottom row of cells of a `LayeredBlock`; only its edge "bottom" may be in contact."""

    def whole_facets(self, boundary: Any) -> NDArray[np.int64]:
        """Facets of "bottom", given by name: facet numbers would belong to another mesh."""
        names = [boundary] if isinstance(boundary, str) else boundary
        if not isinstance(names, list | tuple) or any(not isinstance(n, str) for n in names):
            raise InputError(
                f"boundary={boundary!r}: a LayeredBlock meets obstacles on its 'bottom', by that "
                "name; block.elastic() takes facet numbers"
            )
        return super().whole_facets(boundary)


class Layered(Protocol):
    """The part of `LayeredBlock` that evaluation at points needs."""

    width: float
    height: float
    columns: int
    layers: list[Layer]
    cell_bodies: list[Any]  # one body of a single cell per layer


def located(block: Layered, points: Array) -> tuple[NDArray[np.int64], Array, Array]:
    """Layer of each point, and its two coordinates in units of that layer's cells."""
    x, y = points
    width, height = block.width, block.height
    slack = 1e-12 * max(width, height)  # rounding of the coordinates
    outside = (x < -slack) | (x > width + slack) | (y < -slack) | (y > height + slack)
    if np.any(outside):
        raise InputError(f"points: {points[:, np.argmax(outside)]} lies outside the block")
    bottoms, size = np.array([(l.bottom, l.height / l.cells) for l in block.layers]).T
    at = np.clip(np.searchsorted(bottoms, y, side="right") - 1, 0, None)
    return at, x * block.columns / width, (y - bottoms[at]) / size[at]


def shape_functions(
    block: Layered, u: Array, points: Array
) -> Iterator[tuple[NDArray[np.int64], Any, Array]]:
    """For each layer and local basis function: points, values of the function and of its dof."""
    at, columns, rows = located(block, points)
    for k, (layer, cell) in enumerate(zip(block.layers, block.cell_bodies, strict=True)):
        here = np.flatnonzero(at == k)
        if here.size == 0:
            continue
        i = np.clip(columns[here].astype(np.int64), 0, block.columns - 1)
        j = np.clip(rows[here].astype(np.int64), 0, layer.cells - 1)
        X = np.stack((columns[here] - i, rows[here] - j))
        corner = (block.columns + 1) * (layer.first + j) + i
        above = block.columns + 1
        nodes = (corner, corner + 1, corner + above + 1, corner + above)
        basis = cell.basis
        for local in range(basis.Nbfun):
            field = basis.elem.gbasis(basis.mapping, X, local)[0]
            yield here, field, u[PER_NODE * nodes[local // PER_NODE] + local % PER_NODE]
