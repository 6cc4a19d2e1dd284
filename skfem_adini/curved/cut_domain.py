"""A domain inside a mesh of rectangles, with scikit-fem bases for its cells and its boundary."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import BilinearForm, CellBasis, Dofs, LinearForm, MeshQuad, MeshQuad1DG
from skfem.assembly.form.form import Form, FormExtraParams
from skfem.element import DiscreteField, Element
from skfem.refdom import RefQuad

from skfem_adini.assembly.local_tensors import rows_of
from skfem_adini.assembly.pointwise_check import TRIED, check_pointwise, not_pointwise
from skfem_adini.curved.boundary_basis import BoundaryBasis
from skfem_adini.curved.quadrature.cut_quadrature import CutQuadrature, cut_quadrature
from skfem_adini.curved.quadrature.level_set import LevelSet
from skfem_adini.curved.quadrature.polygon import Polygon
from skfem_adini.elements.field_on_demand import existing_parts
from skfem_adini.elements.straight_cells import GEOMETRY, reference_points, straight_corners
from skfem_adini.errors import InputError, NotSupported

Array = NDArray[np.float64]
Indices = NDArray[np.integer]


class CutDomain:
    r"""The part of a mesh of axis-parallel rectangles that lies inside a level set or polygon.

    Forms are assembled cell by cell over :math:`K \cap \Omega`: on full cells with scikit-fem's own
    rule, on cut cells with a rule for each. All dofs of the mesh keep their numbers; those of cells
    outside get empty rows. `AdiniExtension` or `ghost_penalty` make the problem well-posed however
    small the cut cells are.

    Parameters
    ----------
    mesh
        `MeshQuad` of axis-parallel rectangles, graded or with hanging vertices if wanted, or a
        `MeshQuad2` with its other nodes in the middle of edges and cells.
    level_set
        Function negative inside, `LevelSet`, `FieldLevelSet` or `Polygon`. Sides of the mesh need
        no level set: a domain may end on mesh lines, with conditions from `essential_dofs`.
    gradient
        Gradient of the function, see `cut_quadrature`.
    q
        Gauss points in each direction in cut cells.

    Attributes
    ----------
    mesh
        The mesh.
    quadrature
        Points, weights and normals, a `CutQuadrature`.

    Raises
    ------
    InputError
        The cells are not axis-parallel rectangles, or nothing lies inside; those of
        `cut_quadrature`.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from skfem.models.poisson import mass
    >>> from skfem_adini import ElementQuadAdini
    >>> mesh = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)
    >>> domain = CutDomain(mesh, lambda x: x[0] ** 2 + x[1] ** 2 - 0.81)
    >>> M = domain.assemble(mass, ElementQuadAdini())
    >>> ones = np.zeros(M.shape[0])
    >>> ones[::3] = 1
    >>> bool(abs(ones @ M @ ones - 0.81 * np.pi) < 1e-12)
    True
    """

    def __init__(
        self,
        mesh: MeshQuad,
        level_set: LevelSet | Polygon | Callable[[Array], Any],
        gradient: Callable[[Array], Any] | None = None,
        q: int = 8,
    ) -> None:
        corners = axis_parallel_cells(mesh)
        self.mesh = mesh
        self.quadrature: CutQuadrature = cut_quadrature(level_set, *corners, q, gradient)
        if self.active.size == 0:
            raise InputError(
                "level_set: no cell of the mesh lies inside; it must be negative there"
            )

    @classmethod
    def from_quadrature(cls, mesh: MeshQuad, quadrature: CutQuadrature) -> CutDomain:
        """Return the domain whose points, weights and normals are known, as from a file.

        Parameters
        ----------
        mesh
            `MeshQuad` of axis-parallel rectangles.
        quadrature
            Of all cells of this mesh.

        Returns
        -------
        CutDomain

        Raises
        ------
        InputError
            The arrays do not fit each other or the mesh: shapes, cells that do not exist, points
            outside their cells, weights that are not positive, normals that have not length one.
        """
        corners = axis_parallel_cells(mesh)
        if not all(map(np.array_equal, corners, (quadrature.lower, quadrature.upper))):
            raise InputError("quadrature: its cells are not those of the mesh")
        quadrature.check()
        domain = cls.__new__(cls)
        domain.mesh, domain.quadrature = mesh, quadrature
        return domain

    @cached_property
    def full(self) -> Indices:
        """Cells inside."""
        return np.flatnonzero(self.quadrature.full)

    @cached_property
    def cut(self) -> Indices:
        """Cells partly inside."""
        return np.flatnonzero(self.quadrature.cut)

    @cached_property
    def active(self) -> Indices:
        """Cells wholly or partly inside."""
        return np.flatnonzero(self.quadrature.cut | self.quadrature.full)

    @property
    def fractions(self) -> Array:
        """Share of every cell that lies inside, shape (cells,)."""
        return self.quadrature.fractions

    @property
    def area(self) -> float:
        """Area of the domain."""
        return self.quadrature.area

    @property
    def perimeter(self) -> float:
        """Length of the boundary, without the part on the boundary of the mesh."""
        return self.quadrature.perimeter

    @cached_property
    def ghost_facets(self) -> Indices:
        """Facets between two active cells of which at least one is cut."""
        left, right = self.mesh.f2t
        inner = right >= 0
        rule = self.quadrature
        active = rule.cut | rule.full
        chosen = inner & active[left] & active[right] & (rule.cut[left] | rule.cut[right])
        return np.flatnonzero(chosen)

    @cached_property
    def outer_facets(self) -> Indices:
        """Facets on the boundary of the box or union of boxes that the mesh covers: those with one
        cell that overlap no other one of one cell, as those at hanging vertices do."""
        mesh = self.mesh
        single = mesh.boundary_facets()
        ends = np.sort(mesh.p[:, mesh.facets[:, single]], axis=1)
        along = np.argmax(ends[:, 1] - ends[:, 0], axis=0)
        pick = np.arange(len(single))
        level = ends[1 - along, 0, pick]
        low, high = ends[along, 0, pick], ends[along, 1, pick]
        slack = 1e-9 * np.ptp(mesh.p)  # smaller differences are rounding of coordinates
        covered = np.zeros(len(single), dtype=bool)
        order = np.lexsort((low, level, along))
        for group in np.split(
            order,
            np.flatnonzero((np.diff(along[order]) != 0) | (np.diff(level[order]) > slack)) + 1,
        ):
            a, b = low[group], high[group]
            overlap = np.minimum(b[:, None], b) - np.maximum(a[:, None], a)
            np.fill_diagonal(overlap, 0)
            covered[group] = (overlap > slack).any(axis=1)
        return single[~covered]

    def active_dofs(self, basis: Any) -> Indices:
        """Return the dofs of the active cells, for `skfem.condense(..., I=...)`.

        Parameters
        ----------
        basis
            Basis on the mesh of the domain.

        Returns
        -------
        ndarray
            Dof numbers, ascending.
        """
        return np.unique(basis.dofs.element_dofs[:, self.active])

    def basis(self, elem: Any, intorder: int | None = None) -> tuple[CellBasis, ...]:
        """Return scikit-fem bases of the full and of the cut cells.

        Parameters
        ----------
        elem
            Any element of quadrilaterals.
        intorder
            Degree integrated exactly in full cells; scikit-fem's choice by default.

        Returns
        -------
        tuple of CellBasis
            (full, cut). The matrix of a form is the sum of those on both. If no cell is full, or
            none is cut, that basis is left out.
        """
        _check_element(elem)
        found = []
        if self.full.size:
            found.append(CellBasis(self.mesh, elem, intorder=intorder, elements=self.full))
        if self.cut.size:
            rule = self.quadrature
            cells, X, W, _ = self._padded(rule.cells, rule.points, rule.weights)
            found.append(CellBasis(self.mesh, elem, quadrature=(X, W), elements=cells))
        return tuple(found)

    def boundary(self, elem: Any, parts: int | Sequence[int] | None = None) -> BoundaryBasis:
        """Return a scikit-fem basis on the cut boundary, with normals for forms as `w.n`.

        Forms must act on each quadrature point alone: points of weight zero lie among the others,
        and a mean over `w.x` would count them.

        Parameters
        ----------
        elem
            Any element of quadrilaterals.
        parts
            Leaves of the level set, in the order of its `leaves`, or sides of the polygon, on
            which the boundary is wanted; all by default.

        Returns
        -------
        BoundaryBasis

        Raises
        ------
        InputError
            No part of the boundary lies there.
        """
        _check_element(elem)
        rule = self.quadrature
        keep = np.ones(len(rule.parts), dtype=bool)
        if parts is not None:
            keep = np.isin(rule.parts, np.atleast_1d(np.asarray(parts)))
        if not keep.any():
            raise InputError(
                f"parts: {parts!r} has no boundary in the mesh; there are "
                f"{np.unique(rule.parts).tolist()}"
            )
        cells, X, W, slots = self._padded(
            rule.boundary_cells[keep], rule.boundary_points[:, keep], rule.boundary_weights[keep]
        )
        normals = DiscreteField(rule.normals[:, keep][:, slots])
        return BoundaryBasis(
            self.mesh, elem, quadrature=(X, W), elements=cells, normals=normals, domain=self
        )

    def assemble(self, form: Any, elem: Any, intorder: int | None = None, **fields: Any) -> Any:
        """Return the sum of a form over full and cut cells.

        Parameters
        ----------
        form
            BilinearForm, LinearForm or Functional. It must act on each quadrature point alone:
            cells come in several batches, with points of weight zero among the others. (The bases
            of :meth:`basis` give the same sum by hand.)
        elem, intorder
            As for :meth:`basis`.
        fields
            Numbers and vectors of dofs handed to the form.

        Returns
        -------
        csr_matrix, ndarray or float
            Matrix (dofs, dofs), load vector (dofs,) or number, by the kind of form; dofs of cells
            outside have empty rows.

        Raises
        ------
        InputError
            No form; a form that reduces over the cells, as with ``w.x / w.x.max()``, or takes the
            mean over the points of a cell.
        """
        if not isinstance(form, Form):
            raise InputError(
                f"form: expected a BilinearForm, LinearForm or Functional, got "
                f"{type(form).__name__}"
            )
        total, sample = 0, CutSample(form)
        for basis in self.groups(elem, intorder):
            parameters = {
                name: basis.interpolate(value) if np.ndim(value) == 1 else value
                for name, value in fields.items()
            }
            total = total + form.assemble(basis, **parameters)
            sample.add(basis, parameters)
        if self.cut.size:
            sample.check()
        return total

    def groups(
        self, elem: Any, intorder: int | None = None, cells: Indices | None = None
    ) -> Iterator[CellBasis]:
        """Yield bases whose integrals add up to those over the domain.

        The full cells have one basis, as in :meth:`basis`. Cut cells are grouped by similar numbers
        of points, because all cells of a basis are padded to the same number.

        Parameters
        ----------
        elem
            Any element of quadrilaterals.
        intorder
            Order of integration on the full cells; that of `skfem.CellBasis` by default.
        cells
            Numbers of the cells that are wanted, all by default.

        Yields
        ------
        CellBasis
            All with the dof numbers of the whole mesh.
        """
        _check_element(elem)
        dofs = Dofs(self.mesh, elem)
        full = self.full if cells is None else np.intersect1d(self.full, cells)
        if full.size:
            yield CellBasis(self.mesh, elem, intorder=intorder, elements=full, dofs=dofs)
        rule = self.quadrature
        count = np.bincount(rule.cells, minlength=self.mesh.t.shape[1])
        if cells is not None:
            count[np.setdiff1d(self.cut, cells)] = 0
        bound = int(2 ** np.floor(np.log2(count[count > 0].min()))) if count.any() else 0
        while bound and bound <= count.max():
            keep = (count[rule.cells] >= bound) & (count[rule.cells] < 2 * bound)
            bound *= 2
            if keep.any():
                places = rule.cells[keep], rule.points[:, keep], rule.weights[keep]
                cells, X, W, _ = self._padded(*places)
                yield CellBasis(self.mesh, elem, quadrature=(X, W), elements=cells, dofs=dofs)

    def on_active_cells(self) -> CutDomain:
        """Return the same domain on the mesh of its active cells alone, in their order.

        Returns
        -------
        CutDomain
            It shares the points, weights and normals with this one.
        """
        rule, active = self.quadrature, self.active
        place = np.full(self.mesh.t.shape[1], -1)
        place[active] = np.arange(active.size)
        other = copy(self)
        for derived in ("full", "cut", "active", "ghost_facets", "outer_facets"):
            other.__dict__.pop(derived, None)
        mesh = self.mesh
        if type(mesh) is not MeshQuad:  # the other nodes of a second-order mesh are not needed
            p = np.ascontiguousarray(mesh.p[:, : mesh.nvertices])
            named = {"_boundaries": mesh.boundaries, "_subdomains": mesh.subdomains}
            mesh = MeshQuad(p, mesh.t, **named)
        other.mesh = mesh.restrict(active)
        other.quadrature = replace(
            rule,
            lower=rule.lower[:, active],
            upper=rule.upper[:, active],
            full=rule.full[active],
            cells=place[rule.cells],
            boundary_cells=place[rule.boundary_cells],
        )
        return other

    def _padded(
        self, owner: Indices, points: Array, weights: Array
    ) -> tuple[Indices, Array, Array, Indices]:
        """Return cells, reference points (2, cells, most), weights and the source of each point.

        `most` is the largest number of points; other cells repeat their first with weight 0."""
        cells, start, count = np.unique(owner, return_index=True, return_counts=True)
        order = np.arange(count.max())
        real = order < count[:, None]
        slots = np.where(real, start[:, None] + order, start[:, None])
        X = reference_points(self.mesh, cells, points[:, slots])
        size = np.prod(np.ptp(self.mesh.p[:, self.mesh.t[:, cells]], axis=1), axis=0)
        return cells, X, np.where(real, weights[slots], 0.0) / size[:, None], slots


def _check_element(elem: Any) -> None:
    if not isinstance(elem, Element) or elem.refdom is not RefQuad:
        got = elem.__name__ if isinstance(elem, type) else type(elem).__name__
        raise InputError(
            f"elem: expected an element of quadrilaterals, as ElementQuad1(), got {got}"
        )


def axis_parallel_cells(mesh: Any) -> tuple[Array, Array]:
    """Return lower and upper corners of the cells."""
    if not isinstance(mesh, MeshQuad) or isinstance(mesh, MeshQuad1DG) or mesh.t.shape[0] != 4:
        raise InputError(f"mesh: expected a MeshQuad, got {type(mesh).__name__}")
    if not np.isfinite(mesh.doflocs).all():
        raise InputError("mesh: a vertex is NaN or infinite")
    corners = straight_corners(mesh, None).swapaxes(0, 1)
    lower, upper = corners.min(axis=1), corners.max(axis=1)
    size = upper - lower
    off = np.minimum(corners - lower[:, None], upper[:, None] - corners) / size[:, None]
    sides = np.abs(np.roll(corners, -1, axis=1) - corners) / size[:, None]
    if not np.maximum(off.max(), np.minimum(sides[0], sides[1]).max()) <= GEOMETRY.slant:
        raise InputError(
            "mesh: expected axis-parallel rectangles, as MeshQuad.init_tensor gives; rotate the "
            "level set instead of the mesh"
        )
    return lower, upper


Values = NDArray[Any]
Integers = NDArray[np.integer]
Parts = list[Values | None]  # value, gradient, ... over (..., cells, points)


class CutSample:
    """A few functions at a few points in a few cells of each batch, for tests of a form."""

    def __init__(self, form: Form) -> None:
        self._form = form
        self._rng = np.random.default_rng(0)
        self._which: list[int] = []
        self._functions: list[list[list[Parts]]] = []
        self._fields: list[dict[str, Parts]] = []
        self._others: dict[str, Any] = {}

    def add(self, basis: CellBasis, parameters: dict[str, Any]) -> None:
        """Add cells of a batch: those with extreme coordinates or parameters, and random others.
        Derivatives that the form did not use are not computed."""
        if not self._which:
            self._which = sorted(self._rng.permutation(basis.Nbfun)[: TRIED.functions])
        cells, points = shape = basis.dx.shape
        fields = {**basis.default_parameters(), **parameters}
        for name, value in list(fields.items()):
            if not (isinstance(value, DiscreteField) and value.shape[-2:] == shape):
                self._others[name] = fields.pop(name)
        numbers = _first_points([[np.asarray(field)] for field in fields.values()])
        chosen = np.unique([*numbers.argmin(axis=1), *numbers.argmax(axis=1),
                            *self._rng.permutation(cells)[:TRIED.cells]])  # fmt: skip
        some = np.linspace(0, points - 1, TRIED.points).astype(int)

        def sampled(field: DiscreteField) -> Parts:
            return [
                None
                if p is None
                else np.broadcast_to(p, (*p.shape[:-2], *shape))[..., chosen[:, None], some]
                for p in existing_parts(field)
            ]

        self._functions.append([[sampled(part) for part in basis.basis[i]] for i in self._which])
        self._fields.append({name: sampled(field) for name, field in fields.items()})

    def check(self) -> None:
        """Compare integrands from batches of different cells and numbers of points."""
        rows = _Rows(self._form, self._functions, self._fields, self._others)
        classes, entries = (part.ravel() for part in np.indices(rows.shape))
        try:
            with np.errstate(all="ignore"):  # statistics of equal numbers divide by zero
                there = rows.densities(classes, entries)
                padded = rows.densities(
                    classes, entries, np.append(np.arange(TRIED.points), [0, 0, 0])
                )
            found = there.sum(axis=1).reshape(rows.shape)
            check_pointwise(rows, found, rows.sizes, rows.coefficients, len(classes))
            limit = TRIED.rounding * np.abs(there).max()
            if not np.allclose(
                padded[:, : TRIED.points], there, rtol=0, atol=limit, equal_nan=True
            ):
                raise not_pointwise("it gives other numbers where a point comes several times")
        except NotSupported as error:
            raise InputError(
                f"form: {str(error).removeprefix('the form ')}. On a cut domain cells come in "
                "several batches, with points of weight zero: compute such numbers beforehand and "
                "hand them over, as in assemble(form, elem, largest=...)"
            ) from error


class _Rows:
    """Integrands at the points of a sample, for `check_pointwise`."""

    def __init__(
        self, form: Form, functions: list[list[list[Parts]]], fields: list[dict[str, Parts]],
        others: dict[str, Any],
    ) -> None:  # fmt: skip
        self._form, self._others = form, others
        self._fields = {name: _joined([batch[name] for batch in fields]) for name in fields[0]}
        each = zip(*functions, strict=True)
        self._functions = [
            _joined(component)
            for component in zip(*(part for function in each for part in function), strict=True)
        ]
        self.coefficients = _first_points(list(self._fields.values()))
        self._arguments = 2 * isinstance(form, BilinearForm) or int(isinstance(form, LinearForm))
        self.sizes = (len(functions[0]),) * self._arguments or (1,)
        self.shape = self.coefficients.shape[1], int(np.prod(self.sizes))

    def prepare(self, classes: Integers) -> None:
        """Do nothing: the functions of the sample are already evaluated."""

    def densities(
        self, classes: Integers, entry: Integers, points: Integers | None = None
    ) -> Values:
        """Return the integrands without weights, shape (rows, points)."""
        indices = np.divmod(entry, self.sizes[0])[::-1] if self._arguments == 2 else (entry,)
        arguments = [
            field
            for index in indices[: self._arguments]
            for field in rows_of(self._functions, index * self.shape[0] + classes)
        ]
        fields = rows_of(list(self._fields.values()), classes)
        if points is not None:
            arguments, fields = ([_at(f, points) for f in some] for some in (arguments, fields))
        parameters = {**self._others, **dict(zip(self._fields, fields, strict=True))}
        width = TRIED.points if points is None else len(points)
        try:
            density = self._form.form(*arguments, FormExtraParams(parameters))
            return np.asarray(density * np.ones((len(classes), width)))
        except Exception as error:
            raise not_pointwise(repr(error)) from error


def _at(field: DiscreteField, points: Integers) -> DiscreteField:
    return DiscreteField(*(None if p is None else p[..., points] for p in field.astuple))


def _joined(several: Sequence[Parts]) -> Parts:
    """Return several fields as one, concatenated along the cells."""
    return [
        None if parts[0] is None else np.concatenate(parts, axis=-2)
        for parts in zip(*several, strict=True)
    ]


def _first_points(fields: Sequence[Parts]) -> Values:
    """Return the values at the first point of each cell, shape (numbers, cells)."""
    first = [np.asarray(parts[0])[..., 0].real for parts in fields]
    return np.concatenate([values.reshape(-1, values.shape[-1]) for values in first])
