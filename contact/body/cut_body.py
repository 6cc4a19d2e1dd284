"""An elastic body whose boundary cuts the cells of its mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from skfem import Basis, ElementVector, MeshQuad

from contact.body.axisymmetry import AXISYMMETRIC
from contact.body.boundary_names import select_facets
from contact.body.cell_finder import find_cells
from contact.body.cut_arc import CutArc
from contact.body.elastic_body import ElasticBody, Field
from contact.errors import InputError
from contact.settled import settled
from skfem_adini import (
    AdiniExtension,
    CutDomain,
    CutQuadrature,
    ElementQuadAdini,
    LevelSet,
    Polygon,
)
from skfem_adini.ground.arguments import (
    array_of,
    evaluated,
    function_of_places,
    numbers,
    pointwise,
    positive_number,
)

Array = NDArray[np.float64]
_LATTICE = 4  # intervals along a cell's edge, as by default in pictures


@settled("make a new CutBody", "domain", "threshold", "level_set")
class CutBody(ElasticBody):
    """An elastic body inside a level set, on a mesh of rectangles that need not fit it.

    The body has Adini elements on the cells that it fills or cuts, and integrals are taken over the
    part inside. At nodes outside, the displacement continues the polynomial of a cell well inside
    (`AdiniExtension`), so that small cuts do not spoil the condition of the matrices. Contact may
    occur on the curve, see `arc`; supports lie on mesh lines.

    Parameters
    ----------
    mesh : MeshQuad
        Axis-parallel rectangles, graded or with hanging vertices if wanted.
    level_set : callable, LevelSet or Polygon
        Negative inside, see `skfem_adini.CutDomain`.
    E, nu : float or ndarray, shape (ncells,)
        Material, for each cell of the mesh if it varies.
    plane : {"strain", "stress"}
    threshold : float
        Smallest share inside of a cell whose polynomial may be continued, see
        `skfem_adini.AdiniExtension`.
    q : int
        Gauss points in each direction in cut cells.

    Attributes
    ----------
    domain : CutDomain
        On the active cells, those partly or wholly inside; ``body.mesh`` are these.

    Raises
    ------
    InputError
        A mesh or a level set that `CutDomain` refuses, a domain too thin for the mesh, or a
        material constant outside its range.

    Notes
    -----
    A level set is a function and cannot be stored. `ContactResult.save` keeps the quadrature of the
    cut cells and of the curve, from which everything is computed, and for pictures the values of
    the level set at the places where `ContactResult.to_pyvista` takes them by default; between
    these the loaded body interpolates.

    Examples
    --------
    A half disk pressed by its flat side on a plane .02 below it:

    >>> import numpy as np
    >>> from contact import ContactProblem, Plane
    >>> mesh = MeshQuad.init_tensor(np.linspace(-1.1, 1.1, 12), np.linspace(-1.1, 0, 7))
    >>> disk = CutBody(mesh.with_defaults(), lambda x: x[0]**2 + x[1]**2 - 1, E=1.0, nu=0.3)
    >>> disk = disk.fix("top", "x").fix("top", "y", -0.05)
    >>> result = ContactProblem(disk, disk.arc(), Plane((0.0, -1.02), (0.0, 1.0))).solve()
    >>> bool(abs(result.balance()["support"][1] + result.resultant[1]) < 1e-12)
    True
    """

    _COUPLES = False
    _KEPT, _FUNCTIONS = ("constraint", "picked"), ("_supports", "_applied", "level_set")
    _slender = False  # forces from strains would need integrals over parts of cells

    def __init__(
        self,
        mesh: MeshQuad,
        level_set: LevelSet | Polygon | Callable[[Array], Any],
        E: ArrayLike,
        nu: ArrayLike,
        plane: str | None = "strain",
        *,
        threshold: float = 0.5,
        q: int = 8,
    ) -> None:
        if plane == AXISYMMETRIC:
            raise InputError(
                "plane='axisymmetric': a CutBody has no radii; take a mesh that fits the boundary "
                "(ElasticBody)"
            )
        whole = CutDomain(mesh, level_set, q=q)
        E, nu = (
            _of_active("E", E, mesh.nelements, whole.active),
            _of_active("nu", nu, mesh.nelements, whole.active),
        )
        self._begin(whole.on_active_cells(), level_set, E, nu, plane, threshold)
        _ = self.extension

    def _begin(
        self, domain: CutDomain, level_set: Any, E: Any, nu: Any, plane: Any, threshold: float
    ) -> None:
        self.domain, self.level_set, self.threshold = domain, level_set, threshold
        element = ElementVector(ElementQuadAdini(derivatives=1))
        super().__init__(Basis(domain.mesh, element), E, nu, plane)

    def stored(self) -> dict[str, Any]:
        """The arrays of the cut that a file stores: its quadrature, and the level set on lattices,
        which serve only to clip pictures."""
        rule = self.domain.quadrature
        lattice = np.moveaxis(_lattice(rule.lower, rule.upper), 0, -1)
        level = self.level_at(lattice.reshape(-1, 2).T).reshape(lattice.shape[:-1])
        return {"level": level, **{f.name: getattr(rule, f.name) for f in fields(CutQuadrature)}}

    @classmethod
    def from_stored(
        cls, mesh: MeshQuad, arrays: dict[str, Any], E: Any, nu: Any, plane: Any, threshold: float
    ) -> CutBody:
        """The body from the arrays of `stored`, without supports and extension."""
        level = arrays["level"]
        if level.shape != (mesh.nelements, _LATTICE + 1, _LATTICE + 1):
            raise InputError(f"cut/level: its shape {level.shape} does not fit the mesh")
        rule = CutQuadrature(**{f.name: arrays[f.name] for f in fields(CutQuadrature)})
        domain = CutDomain.from_quadrature(mesh, rule)
        body = cls.__new__(cls)
        body._begin(
            domain, LatticeLevel(mesh, rule.lower, rule.upper, level), E, nu, plane, threshold
        )
        return body

    @classmethod
    def from_mesh(cls, *args: Any, **options: Any) -> NoReturn:
        """Raise an error: a level set is needed."""
        raise InputError("from_mesh: a CutBody is made as CutBody(mesh, level_set, E=, nu=)")

    def arc(
        self,
        parts: int | Sequence[int] | None = None,
        where: Callable[[Array], Any] | None = None,
        spacing: float = 1.5,
    ) -> CutArc:
        """The curved boundary, or a part of it, for `ContactProblem` and `load`.

        Parameters
        ----------
        parts : int or list of int, optional
            Leaves of the level set or sides of the polygon.
        where : callable, optional
            Function of points (2, n) that returns which of them belong to the arc.
        spacing : float
            Distance of the contact points, in cell sizes along the arc. Below 1 the multipliers
            become unstable, see `contact.rows.contact_boundaries`.

        Returns
        -------
        CutArc
            Places of the contact points with their normals and weights.

        Raises
        ------
        InputError
            No boundary there, or a spacing that is not positive.
        """
        positive_number("spacing", spacing)
        if callable(parts):
            raise InputError("parts: expected numbers; a function of the points is where=")
        if where is not None:
            where = function_of_places("where", where)
        listed: Any = None if parts is None else array_of("parts", parts)
        basis = self.domain.boundary(self.element, listed)
        x, normals = np.asarray(basis.global_coordinates()), np.asarray(basis.normals)
        real = basis.dx > 0
        if where is not None:
            chosen = np.asarray(where(x[:, real]))
            if chosen.dtype != bool or chosen.shape != (int(real.sum()),):
                raise InputError(
                    f"where: expected {int(real.sum())} booleans, one a point, got shape "
                    f"{chosen.shape} of {chosen.dtype}"
                )
            real[real] = chosen
        if not real.any():
            raise InputError("where: holds on no point of the boundary")
        cell, _ = np.nonzero(real)
        corners = self.mesh.p[:, self.mesh.t[:, basis.tind]]
        tangent = np.abs(normals[::-1][:, real]) / np.ptp(corners, axis=1)[:, cell]
        values = np.stack([np.asarray(field[0])[real] for field in basis.basis], axis=1)
        columns = self.scalar_dofs.element_dofs[:, basis.tind[cell]].T
        rows = np.repeat(np.arange(cell.size), columns.shape[1])
        shape = cell.size, self.scalar_dofs.N
        trace = sparse.coo_array((values.ravel(), (rows, columns.ravel())), shape=shape)
        number, part = self._numbered(basis, parts)
        return CutArc(
            self,
            number[real],
            x[:, real],
            normals[:, real],
            basis.dx[real],
            1.0 / np.hypot(*tangent),
            part[real],
            sparse.csr_array(trace),
            float(spacing),
        )

    def _numbered(self, basis: Any, parts: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Number and part of the quadrature points, in the padded order of a basis."""
        rule = self.domain.quadrature
        keep = np.arange(rule.parts.size)
        if parts is not None:
            keep = keep[np.isin(rule.parts, np.atleast_1d(np.asarray(parts)))]
        cells = rule.boundary_cells[keep]
        start = np.searchsorted(cells, basis.tind)
        slots = np.minimum(start[:, None] + np.arange(basis.dx.shape[1]), keep.size - 1)
        return keep[slots], rule.parts[keep[slots]]

    def load(self, boundary: Any, traction: Field) -> Self:
        """Add a surface traction on an arc, or on facets of cells that lie wholly inside.

        Parameters
        ----------
        boundary : CutArc, str, list of str or array of facet numbers
        traction : array of shape (2,) or callable x -> array of shape (2, n)

        Raises
        ------
        InputError
            A facet of a cut cell, or a traction of the wrong shape. On an arc also a function that
            reduces over the points it is given, as ``x - x.mean()``: the quadrature points lie more
            densely in some cells than in others, so such a mean has no meaning.
        """
        if not isinstance(boundary, CutArc):
            self.whole_facets(boundary)
            return super().load(boundary, traction)
        value = evaluated("traction", _pointwise("traction", traction), boundary.x)
        if value.ndim == 1:
            value = value[:, None]
        if value.shape not in ((2, 1), boundary.x.shape) or not np.all(np.isfinite(value)):
            raise InputError(f"traction: expected 2 finite components, got shape {value.shape}")
        self.f = self.f + boundary.integral(np.broadcast_to(value, boundary.x.shape))
        return self

    def heat(self, temperature: Any, expansion: ArrayLike) -> NoReturn:
        """Raise an error: thermal forces on cut cells are not implemented."""
        raise InputError("heat: a CutBody takes no thermal strains; make an ElasticBody")

    def whole_facets(self, boundary: Any) -> NDArray[np.int64]:
        """Facet numbers of a boundary that no cut cell touches; else InputError, as a facet may lie
        partly outside the body."""
        facets = self.facets(boundary)
        cells = self.mesh.f2t[0, facets]
        beside = facets[~self.domain.quadrature.full[cells]]
        if beside.size:
            x, y = self.mesh.p[:, self.mesh.facets[:, beside[0]]].mean(axis=1)
            raise InputError(
                f"boundary: the facet at ({x:.6g}, {y:.6g}) belongs to a cut cell and may lie "
                "partly outside; leave such facets out, or describe the side by the level set"
            )
        return facets

    def body_force(self, force: Field) -> Self:
        """Add a volume force (force per volume); see `ElasticBody.body_force`.

        Parameters
        ----------
        force : array of shape (2,) or callable x -> array of shape (2, ...)

        Raises
        ------
        InputError
            A force of the wrong shape, or a function that reduces over the points it is given, as
            ``x - x.mean()``: they are passed in batches, more densely in some cells than in
            others, so such a mean has no meaning.
        """
        force = _pointwise("force", force)
        loads = [
            self._load_vector(basis, force, "force")
            for basis in self.domain.groups(self.basis.elem)
        ]
        self.f = self.f + np.sum(loads, axis=0)
        return self

    def clipped(self, grid: Any) -> Any:
        """The part of a pyvista grid of linear cells inside the body, with a straight boundary in
        each of them: fine ones resolve the curve."""
        grid.point_data["level_set"] = self.level_at(np.asarray(grid.points, dtype=float).T[:2])
        return grid.clip_scalar(scalars="level_set", value=0.0)

    def level_at(self, x: Array) -> Array:
        """The level set, of a polygon the signed distance, at points (2, n), shape (n,)."""
        if isinstance(self.level_set, Polygon):
            a, b = self.level_set.start[:, :, None], self.level_set.end[:, :, None]
            along = np.sum((x[:, None] - a) * (b - a), axis=0) / np.sum((b - a) ** 2, axis=0)
            foot = a + np.clip(along, 0.0, 1.0) * (b - a)
            distance = np.hypot(*(x[:, None] - foot)).min(axis=0)
            return np.asarray(np.where(self.level_set.contains(x), -distance, distance))
        return np.asarray(self.level_set(x[:, :, None]), dtype=float).ravel()

    @cached_property
    def stiffness(self) -> sparse.csr_array:
        """S on all dofs of the active cells, integrated over their parts inside."""
        total = sparse.csr_array((self.basis.N, self.basis.N))
        for basis in self.domain.groups(self.basis.elem):
            total = total + self.law.at(basis.tind).stiffness(basis)
        return sparse.csr_array(total)

    def stiffness_on(self, xp: Any) -> None:
        """Return None: cut cells are not congruent."""

    @cached_property
    def extension(self) -> AdiniExtension:
        """The extension to the nodes outside, which respects the supports."""
        essential = self._supported() if self._supports else None
        return AdiniExtension(self.basis, self.domain, self.threshold, essential)

    @cached_property
    def constraint(self) -> tuple[sparse.csr_array, Array]:
        """P and u0 of ``u = P z + u0``: the supports and the extension to the nodes outside."""
        return sparse.csr_array(self.extension.P), self.extension.x0

    @cached_property
    def picked(self) -> sparse.csr_array:
        """E with ``E^T P = I``: every free unknown is a dof."""
        P = self.constraint[0]
        single = np.flatnonzero(np.diff(P.indptr) == 1)
        single = single[P.data[P.indptr[single]] == 1.0]
        column, first = np.unique(P.indices[P.indptr[single]], return_index=True)
        place = single[first], column
        return sparse.csr_array(sparse.coo_array((np.ones(column.size), place), shape=P.shape))

    def fix(
        self, boundary: Any, components: Any = None, value: Field = 0.0, smooth: bool | None = None
    ) -> Self:
        """Prescribe displacement components on mesh lines; see `ElasticBody.fix`.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
            Also of lines inside the body, as a line of symmetry.
        components, value, smooth
            As for `ElasticBody.fix`.

        Raises
        ------
        InputError
            An arc, for displacements are prescribed on mesh lines only; those of `ElasticBody.fix`.
        """
        for derived in ("extension", "picked"):
            self.__dict__.pop(derived, None)
        return super().fix(boundary, components, value, smooth)

    def _held_facets(self, boundary: Any) -> NDArray[np.int64]:
        if isinstance(boundary, CutArc):
            raise InputError(
                "boundary: displacements are prescribed on mesh lines; for a curve add "
                "skfem_adini.nitsche to the stiffness matrix"
            )
        found = np.zeros(0, dtype=np.int64)
        if not isinstance(boundary, str) or np.size((self.mesh.boundaries or {}).get(boundary, 0)):
            found = select_facets(self.mesh, boundary, inside=True)
            start, end = self.mesh.p[:, self.mesh.facets[:, found], None].swapaxes(0, 1)
            x = start + (end - start) * np.linspace(0.0, 1.0, 17)
            level = self.level_at(x.reshape(2, -1)).reshape(x.shape[1:])
            rounding = 1e-9 * np.abs(self.level_at(self.mesh.p)).max()
            found = found[(level <= rounding).any(axis=1)]  # others would hold nothing of the body
        if not found.size:
            raise InputError(
                f"boundary {boundary!r} lies outside the level set; supports are on mesh lines "
                "that meet the body, also inside it: name one, as its line of symmetry, by "
                "mesh.with_boundaries({...}, boundaries_only=False)"
            )
        return found


class LatticeLevel:
    """A level set interpolated bilinearly from a lattice in each cell."""

    def __init__(self, mesh: MeshQuad, lower: Array, upper: Array, values: Array) -> None:
        self.mesh, self.lower, self.upper, self.values = mesh, lower, upper, values

    def __call__(self, x: Array) -> Array:
        """Values at points (2, n, k), shape (n, k)."""
        points = x.reshape(2, -1)
        cell = find_cells(self.mesh, points)
        low = self.lower[:, cell]
        at = _LATTICE * (points - low) / (self.upper[:, cell] - low)
        at = np.where(np.abs(at - np.rint(at)) < 1e-9, np.rint(at), at)  # lattice points
        i, j = np.clip(at.astype(np.int64), 0, _LATTICE - 1)
        s, t = at - (i, j)
        v = self.values
        below = (1 - s) * v[cell, i, j] + s * v[cell, i + 1, j]
        above = (1 - s) * v[cell, i, j + 1] + s * v[cell, i + 1, j + 1]
        return np.asarray((1 - t) * below + t * above).reshape(x.shape[1:])


def _lattice(lower: Array, upper: Array) -> Array:
    """Points of the lattices of cells, shape (2, ncells, n + 1, n + 1)."""
    s = np.arange(_LATTICE + 1) / _LATTICE
    along = lower[..., None] + (upper - lower)[..., None] * s
    shape = along.shape[1], s.size, s.size
    return np.stack(
        [np.broadcast_to(along[0][:, :, None], shape), np.broadcast_to(along[1][:, None], shape)]
    )


def _pointwise(name: str, value: Field) -> Field:
    return pointwise(name, function_of_places(name, value)) if callable(value) else value


def _of_active(name: str, value: ArrayLike, count: int, active: Any) -> Array:
    """Material of the active cells from a number or from values of all cells."""
    given = numbers(name, value)
    if given.shape == (count,):
        return np.asarray(given[active])
    if given.shape:
        raise InputError(
            f"{name}: expected a number or one value for each of the {count} cells, got shape "
            f"{given.shape}"
        )
    return given
