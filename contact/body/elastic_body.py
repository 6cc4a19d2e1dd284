"""An elastic body: mesh, element, material, supports and loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from skfem import Basis, ElementVector, Mesh

from contact.body.anisotropic import Anisotropic
from contact.body.axisymmetry import AXISYMMETRIC, axis_facets, refuse_axis
from contact.body.basis_solid import BasisSolid
from contact.body.boundary_names import read_mesh, select_components, select_facets
from contact.body.cell_check import check_basis, check_cells
from contact.body.cell_finder import places_in
from contact.body.deferred_basis import DeferredBasis, DofNumbers, dofs_on_facets
from contact.body.elasticity import checked_dilatation
from contact.body.jacobians import turning_move
from contact.body.material import anisotropic, checked_plane, isotropic
from contact.body.multipoint import (
    Coupling,
    coupled,
    jump_of,
    periodic_equations,
    tied_equations,
    words_of,
)
from contact.body.rigid_modes import dof_lengths
from contact.body.supports import in_order
from contact.body.thermal_strain import interpolated, thermal_forces, thermal_strain
from contact.body.vector_element import GRADIENT_DOFS, vector_element
from contact.errors import InputError
from contact.facet_basis import facet_basis
from contact.portable import PortableBasis
from contact.settled import settled
from skfem_adini import essential_constraints
from skfem_adini.ground.arguments import evaluated, function_of_places, keywords_named, numbers

_OF_RADII = 2  # degrees added to the quadrature order for the factors r and 1 / r
Array = NDArray[np.float64]
Boundary = str | Sequence[str] | ArrayLike
Field = float | ArrayLike | Callable[[Array], ArrayLike]


def _property(name: str, text: str) -> Any:
    def change(body: ElasticBody, value: Any) -> None:
        body._set_material(**{name: value})

    return property(lambda body: body._material[name], change, doc=text)


@settled("it follows from E, nu, plane and material; set these", "lam", "mu", "law")
@settled("make a new body", "basis", "dim", "element")
class ElasticBody(BasisSolid):
    """A linearly elastic body, discretised by any scikit-fem vector basis.

    E, nu, plane, dilatation and f may be assigned later: problems then use the new values, results
    keep those that they were solved with.

    Parameters
    ----------
    basis : Basis
        Of ``ElementVector(...)``, 2-D or 3-D. `contact.body.cell_strains` says how slender cells
        may be. Stresses and contact pressures of linear triangles whose diagonals are all parallel,
        and of linear tetrahedra, are of first order only: take crossed triangles
        (``MeshQuad.to_meshtri(style="x")``) or quadratic elements.
    E : float or ndarray, shape (ncells,)
        Young's modulus, positive.
    nu : float or ndarray, shape (ncells,)
        Poisson's ratio, in (-1, 1/2); how near to 1/2: see `contact.body.elasticity`.
    plane : {"strain", "stress", "axisymmetric"}
        Two dimensions only. "axisymmetric": x is the radius and y the axis, see
        `contact.body.axisymmetry`. Loads are integrated over the whole ring, tractions and
        pressures stay forces per area; on the axis the radial displacement is zero.
    dilatation : {"pointwise", "mean"}
        "mean" replaces div u in each Q1 cell by its mean, so that nearly incompressible materials
        do not lock, see `stiffness_matrix`. All other elements are "pointwise".
    material : Anisotropic or Orthotropic, optional
        Instead of E and nu. In two dimensions the plane must be one of symmetry. It may be assigned
        later as `anisotropy`; E and nu are None then.

    Raises
    ------
    InputError
        Not a vector basis, a material constant outside its range, or both a material and E, nu.

    Examples
    --------
    A unit square held at its left side and pulled at its right one:

    >>> from skfem import Basis, ElementQuad1, ElementVector, MeshQuad
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> body = ElasticBody(Basis(mesh, ElementVector(ElementQuad1())), E=1.0, nu=0.0)
    >>> body = body.fix("left", "xy").load("right", (0.1, 0.0))
    >>> bool(abs(body.f.sum() - 0.1) < 1e-12)
    True
    """

    E = _property("E", "Young's modulus, a number or one a cell; None if anisotropic.")
    nu = _property("nu", "Poisson's ratio, a number or one a cell; None if anisotropic.")
    anisotropy = _property("anisotropy", "The `Anisotropic` material; None if isotropic.")
    plane = _property("plane", '"strain", "stress" or "axisymmetric"; None in three dimensions.')
    dilatation = _property("dilatation", '"pointwise" or "mean".')
    _COUPLES: ClassVar[bool] = True

    @keywords_named
    def __init__(
        self,
        basis: Basis,
        E: ArrayLike | None = None,
        nu: ArrayLike | None = None,
        plane: str | None = "strain",
        dilatation: str = "pointwise",
        material: Anisotropic | None = None,
    ) -> None:
        if not isinstance(basis, Basis) or not isinstance(basis.elem, ElementVector):
            raise InputError(
                "basis: expected a skfem Basis(mesh, ElementVector(element)), got "
                f"{type(getattr(basis, 'elem', basis)).__name__}"
            )
        if basis.elem.dim != basis.mesh.dim() or basis.elem.dim not in (2, 3):
            raise InputError(
                f"basis: {basis.elem.dim} displacement components on a mesh of dimension "
                f"{basis.mesh.dim()}; both must be 2 or both 3"
            )
        check_basis(basis)
        self.basis, self.dim, self.element = basis, basis.elem.dim, basis.elem.elem
        self._portable = PortableBasis(basis)
        if material is None and (E is None or nu is None):
            raise InputError("E, nu: an isotropic body needs both; an anisotropic one a material")
        self._set_material(E=E, nu=nu, plane=plane, dilatation=dilatation, anisotropy=material)
        self.f = np.zeros(basis.N)
        self.check_unchanged()
        self._supports: list[tuple[NDArray[np.int64], int, Callable[..., Any], bool]] = []
        if self.is_ring and (axis := axis_facets(basis.mesh)).size:
            self._supports.append((axis, 0, _constant(0.0), True))

    @classmethod
    @keywords_named
    def from_mesh(
        cls,
        mesh: Mesh | str | Path,
        element: Any = None,
        *,
        E: ArrayLike | None = None,
        nu: ArrayLike | None = None,
        plane: str | None = "strain",
        dilatation: str = "pointwise",
        material: Anisotropic | None = None,
    ) -> Self:
        """Build a body from a mesh or from a mesh file with named boundaries.

        Parameters
        ----------
        mesh : Mesh, str or Path
            A scikit-fem mesh, or a file that meshio reads (.msh, .vtu, .xdmf, ...). Physical
            groups become the names of boundaries.
        element : Element, optional
            Scalar or vector element. Default: P2 triangles, Q2 quadrilaterals, P1 tetrahedra,
            Q1 hexahedra; on meshes of second order P2 and Q2.
        E, nu, plane, dilatation, material
            As for the class.

        Returns
        -------
        ElasticBody

        Raises
        ------
        InputError
            The file is missing, truncated or holds no mesh of dimension 2 or 3.
        """
        mesh = read_mesh(mesh) if isinstance(mesh, str | Path) else mesh
        if not isinstance(mesh, Mesh):
            raise InputError(f"mesh: expected a Mesh or a path, got {type(mesh).__name__}")
        element = vector_element(element, mesh)
        check_cells(mesh)
        more = _OF_RADII if isinstance(plane, str) and plane == AXISYMMETRIC else 0
        basis = DeferredBasis(mesh, element, 2 * element.maxdeg + more)
        return cls(basis, E, nu, plane, dilatation, material)

    def _set_material(self, **changed: Any) -> None:
        """Check and store a material; a problem recognises a change by the identity of the dict."""
        if self.thermal is not None:
            raise InputError(
                f"{', '.join(changed)}: the body was heated, and the forces of that hold its old "
                "material; make a new body, and heat it after its material is set"
            )
        new = self.__dict__.get("_material", {}) | changed
        new["plane"] = checked_plane(new["plane"], self.dim)
        old = self.__dict__.get("_material", new)["plane"]
        if old != new["plane"] and AXISYMMETRIC in (old, new["plane"]):
            raise InputError(
                f"plane: a body with plane={old!r} does not become one with {new['plane']!r}, for "
                "its loads and supports are others; make a new body"
            )
        new["dilatation"] = checked_dilatation(new["dilatation"], self.element)
        count = self.mesh.nelements
        if new["anisotropy"] is None:
            derived = isotropic(new, self.element, count)
        else:
            derived = {"lam": None, "mu": None, "law": anisotropic(new, self.dim, count)}
        self._material = new
        self.__dict__.update(derived)
        self.__dict__.pop("stiffness", None)

    def check_unchanged(self) -> None:
        """Raise an `InputError` if the mesh was edited in place, or the loads to invalid values."""
        super().check_unchanged()
        if not hasattr(self, "_places"):
            self._places = self.mesh.doflocs.copy(), self.mesh.t.copy()
        places, cells = self._places
        if not (np.array_equal(places, self.mesh.doflocs) and np.array_equal(cells, self.mesh.t)):
            raise InputError(
                "mesh: its vertices or cells were changed after the body was made, whose Basis and "
                "matrices are still those of the old ones; make a new mesh and a new body"
            )

    @cached_property
    def scalar_dofs(self) -> Any:
        """Dof numbering of the scalar element; vector dof = dim * scalar dof + component."""
        return DofNumbers(self.mesh, self.element)

    @cached_property
    def turning_move(self) -> float:
        """Corner displacement below which no cell inverts; see `contact.body.jacobians`."""
        return turning_move(self.mesh)

    def facets(self, boundary: Boundary) -> NDArray[np.int64]:
        """Facet numbers of a boundary of this body; see
        `contact.body.boundary_names.select_facets`.
        """
        return select_facets(self.mesh, boundary)

    def whole_facets(self, boundary: Boundary) -> NDArray[np.int64]:
        """Facet numbers of a boundary; refuses facets of cut cells (`CutBody`), and facets on the
        axis of an axisymmetric body, which have no area."""
        facets = self.facets(boundary)
        if self.is_ring:
            refuse_axis(self.mesh, facets)
        return facets

    def fix(
        self,
        boundary: Boundary,
        components: str | int | Sequence[int] | None = None,
        value: Field = 0.0,
        smooth: bool | None = None,
    ) -> Self:
        """Prescribe displacement components on a boundary.

        With Adini elements the value and its tangential derivative are prescribed, the normal
        derivative in corners only.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        components : "x", "y", "z", "xy", ..., numbers, or None for all
        value : float or callable x -> array of shape x.shape[1:]
            The displacement; x has shape (dim, npoints).
        smooth : bool, optional
            For Adini elements only. True: straight facets that meet at an angle of less than .9 rad
            approximate a curve, and the derivative along that curve is prescribed. False: the whole
            gradient of `value` is prescribed where facets meet at an angle, which is right if
            `value` is a field. Default: True for a number, False for a callable.

        Returns
        -------
        ElasticBody
            Itself, for chaining.

        Raises
        ------
        InputError
            Unknown boundary or component, a value that is not finite.
        """
        facets = self._held_facets(boundary)
        function = function_of_places("value", value) if callable(value) else _constant(value)
        chosen = select_components(self.dim, components)
        if not isinstance(smooth, bool | None):
            raise InputError(f"smooth={smooth!r}: expected True, False or None")
        smooth = not callable(value) if smooth is None else smooth
        self._supports = [*self._supports, *((facets, c, function, smooth) for c in chosen)]
        return self._held_anew()

    def _held_facets(self, boundary: Boundary) -> NDArray[np.int64]:
        """Facets on which displacements are prescribed."""
        return self.facets(boundary)

    def _held_anew(self) -> Self:
        for derived in ("constraint", "lengths"):
            self.__dict__.pop(derived, None)
        return self

    def periodic(
        self, boundary: Boundary, other: Boundary, jump: ArrayLike | Sequence[float | None] = 0.0
    ) -> Self:
        """Let the displacement on one boundary be that on another one, plus a jump.

        All dofs at matching points are linked; derivatives, if the element has them, are equal. The
        body stays free to be translated; it cannot rotate, unless supports and other conditions say
        otherwise. Contact points on both boundaries, as where a contact boundary ends at a periodic
        one, share their unknowns: only the sum of their forces is determined, and a result with
        contact there is refused.

        Parameters
        ----------
        boundary, other : str, list of str or array of facet numbers
            Boundaries that a translation takes vertex by vertex into each other.
        jump : float or sequence of float or None, one a component
            ``u(boundary) - u(other)``; None does not link the component.

        Returns
        -------
        Self
            Itself, for chaining.

        Raises
        ------
        InputError
            An unknown boundary, one that no translation takes into the other, or a jump that is
            not finite.

        Examples
        --------
        A cell of a plate that is stretched by one per cent:

        >>> from skfem import MeshQuad
        >>> from contact import ElasticBody
        >>> mesh = MeshQuad().refined(2).with_defaults()
        >>> body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3)
        >>> body = body.periodic("right", "left", (0.01, 0.0)).fix("bottom", "y")
        >>> P, u0 = body.constraint
        >>> bool(abs(u0).max() > 0.004)
        True
        """
        facets, its = select_facets(self.mesh, boundary), select_facets(self.mesh, other)
        given = np.asarray(jump, dtype=object)
        if given.shape not in ((), (self.dim,)):
            raise InputError(f"jump={jump!r}: expected a number or {self.dim} of them")
        steps = [jump_of(one) for one in np.broadcast_to(given, (self.dim,))]
        if all(one is None for one in steps):
            raise InputError("jump: None for every component links nothing")
        C, c = periodic_equations(self, facets, its, steps)
        return self._couple(C, c, f"periodic {words_of(boundary)}")

    def tie(
        self,
        boundary: Boundary,
        components: str | int | Sequence[int] | None = None,
        rigid: bool = False,
    ) -> Self:
        """Let all points of a boundary share one unknown displacement.

        A load on the boundary then acts by its resultant. With Adini elements the tangential
        derivatives follow, as for `fix`.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        components : "x", "y", "z", "xy", ..., numbers, or None for all
            Components that are the same at all points of the boundary.
        rigid : bool
            The boundary moves as a rigid body instead: a translation and small rotations. Requires
            all components.

        Returns
        -------
        Self
            Itself, for chaining.

        Raises
        ------
        InputError
            An unknown boundary or component, components of a rigid boundary, or a rigid one of an
            axisymmetric body.

        Examples
        --------
        The side of a block stays plane while it is pulled:

        >>> from skfem import MeshQuad
        >>> from contact import ElasticBody
        >>> mesh = MeshQuad().refined(2).with_defaults()
        >>> body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("left", "xy")
        >>> free = body.constraint[0].shape[1]
        >>> body.tie("right", "x").constraint[0].shape[1] - free
        -8
        """
        facets, chosen = select_facets(self.mesh, boundary), select_components(self.dim, components)
        if not isinstance(rigid, bool):
            raise InputError(f"rigid={rigid!r}: expected True or False")
        if rigid and self.is_ring:
            raise InputError(
                "rigid=True: a rigid part of an axisymmetric body moves along its axis only; take "
                "fix(boundary, 'x') and tie(boundary, 'y')"
            )
        if rigid and len(chosen) < self.dim:
            raise InputError("components: a rigid boundary moves in all of them; leave them out")
        self._check_couples("tie")
        probe: Any = copy(self)
        probe._supports, probe._couplings = [], ()
        held = probe.fix(facets, chosen)._supported()[0]
        C = tied_equations(self, facets, held, chosen, rigid)
        return self._couple(C, np.zeros(C.shape[0]), f"tie {words_of(boundary)}")

    def constrain(self, C: Any, c: ArrayLike = 0.0) -> Self:
        """Prescribe linear equations between dofs, ``C u = c``.

        Parameters
        ----------
        C : sparse or dense array, shape (k, ndofs)
            Redundant equations are found and count once.
        c : float or ndarray, shape (k,)

        Returns
        -------
        Self
            Itself, for chaining. Equations that contradict each other or the supports are refused
            where the unknowns are first needed, in `constraint`.

        Raises
        ------
        InputError
            Arrays of the wrong shape, not finite, or an equation without entries.

        Examples
        --------
        >>> import numpy as np
        >>> from skfem import MeshQuad
        >>> from contact import ElasticBody
        >>> body = ElasticBody.from_mesh(MeshQuad().refined(1), E=1.0, nu=0.3)
        >>> C = np.zeros((1, body.basis.N))
        >>> C[0, [0, 3]] = 1.0, -2.0
        >>> P, u0 = body.constrain(C, 0.3).constraint
        >>> bool(abs(C @ u0 - 0.3) < 1e-12), bool(abs(C @ P).max() < 1e-12)
        (True, True)
        """
        n = self.basis.N
        given: Any = C if sparse.issparse(C) else numbers("C", C)
        if given.ndim != 2 or given.shape[1] != n:
            raise InputError(f"C: expected the shape (k, {n}), a column a dof, got {given.shape}")
        matrix: Any = sparse.csr_array(given, copy=True).astype(float)
        matrix.sum_duplicates()
        matrix.eliminate_zeros()
        right = numbers("c", c)
        if right.shape not in ((), (matrix.shape[0],)):
            raise InputError(f"c: expected a number or {matrix.shape[0]}, got {right.shape}")
        if not (np.all(np.isfinite(matrix.data)) and np.all(np.isfinite(right))):
            raise InputError("C, c: hold values that are not finite")
        if not matrix.shape[0] or np.any(np.diff(matrix.indptr) == 0):
            raise InputError("C: an equation without entries constrains nothing; leave it out")
        return self._couple(matrix, np.broadcast_to(right, matrix.shape[0]).copy(), "constrain")

    def _check_couples(self, name: str) -> None:
        if not self._COUPLES:
            raise InputError(
                f"{name}: a {type(self).__name__} ends inside cells, where dofs are no unknowns of "
                "its own; take a mesh that fits the boundary (ElasticBody)"
            )

    def _couple(self, C: sparse.csr_array, c: Array, name: str) -> Self:
        self._check_couples(name)
        self._couplings = (*self._couplings, Coupling(C, c, name))
        return self._held_anew()

    def load(self, boundary: Boundary, traction: Field) -> Self:
        """Add a surface traction (force per area) on a boundary, in a ring all around it.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        traction : array of shape (dim,) or callable x -> array of shape (dim, ...)

        Returns
        -------
        ElasticBody
            Itself, for chaining.

        Raises
        ------
        InputError
            An unknown boundary, or a traction of the wrong shape or not finite.
        """
        element, facets = self.basis.elem, self.facets(boundary)
        if self.is_ring:
            refuse_axis(self.mesh, facets)
        degree = 2 * element.maxdeg + _OF_RADII * self.is_ring
        dofs = self.basis.dofs
        basis = facet_basis(self.mesh, element, facets, intorder=degree, dofs=dofs)
        return self._add("load", (facets, traction), self._load_vector(basis, traction, "traction"))

    def body_force(self, force: Field) -> Self:
        """Add a volume force (force per volume).

        Parameters
        ----------
        force : array of shape (dim,) or callable x -> array of shape (dim, ...)

        Raises
        ------
        InputError
            A force of the wrong shape or not finite.
        """
        return self._add("body_force", (force,), self._load_vector(self.basis, force, "force"))

    def _add(self, name: str, arguments: tuple[Any, ...], forces: Array) -> Self:
        """Add forces, and remember the call that made them."""
        applied = self._applied
        self.f = self.f + forces
        self._applied = (*applied, (name, arguments, 1.0))
        return self

    def heat(self, temperature: Any, expansion: ArrayLike) -> Self:
        """Add a change of temperature: thermal strains, and the forces equivalent to them on `f`.

        Stresses in results exclude the thermal strain. Repeated calls add up. Set the material
        before, since the forces depend on it.

        Parameters
        ----------
        temperature : float or callable x -> array of shape x.shape[1:]
            Difference from the temperature at which the body is free of stress. In each cell it is
            taken as a quadratic polynomial; with mean dilatation, as its mean.
        expansion : array, shape (), (3,) or (3, 3)
            Coefficient of thermal expansion, one over the unit of `temperature`: isotropic, three
            coefficients along x, y, z, or a symmetric tensor in the axes of the mesh. The third
            direction counts in plane strain too. For values that vary by cell add a leading axis
            ncells; scalar coefficients then have the shape (ncells, 1, 1).

        Returns
        -------
        Self
            Itself, for chaining.

        Raises
        ------
        InputError
            A temperature or an expansion of another shape, or not finite.

        Examples
        --------
        A bar between smooth walls that is heated by 100 K:

        >>> from skfem import MeshHex
        >>> from contact import ContactProblem, ElasticBody
        >>> mesh = MeshHex().with_defaults()
        >>> bar = ElasticBody.from_mesh(mesh, E=2e5, nu=0.25).heat(100.0, 1e-5)
        >>> bar = bar.fix(["left", "right"], "x").fix(["front", "back"], "z").fix("top", "y")
        >>> result = ContactProblem(bar, "bottom", 0.0).solve()
        >>> round(float(result.pressure.mean()), 6)  # E alpha T / (1 - 2 nu)
        400.0
        """
        self.check_unchanged()
        strain = thermal_strain(self, temperature, expansion)
        forces = thermal_forces(self, strain)
        self.thermal = strain if self.thermal is None else self.thermal + strain
        self.f = self.f + forces
        return self

    def thermal_strain_in(self, X: Array) -> Array | None:
        """Thermal strain, (3, 3, ncells, npoints) or None, at reference points (dim, npoints),
        common to all cells, or (dim, ncells, npoints)."""
        return None if self.thermal is None else interpolated(self, self.thermal, X)

    def thermal_strain_at(self, points: Array) -> Array | None:
        """Thermal strain at points (dim, npoints), shape (3, 3, npoints), or None."""
        if self.thermal is None:
            return None
        cells = self.cells_of(points)
        X = places_in(self.mesh, self.basis.mapping, points, cells)
        return interpolated(self, self.thermal[:, cells], X[:, :, None])[..., 0]

    def _load_vector(self, basis: Any, density: Field, name: str) -> Array:
        self.check_unchanged()
        x = np.asarray(basis.global_coordinates())
        value = evaluated(name, density, x)
        if value.ndim == 0 or value.shape[0] != self.dim:
            raise InputError(
                f"{name}: expected {self.dim} components, got an array of shape {value.shape}"
            )
        value = value.reshape(value.shape + (1,) * (x.ndim - value.ndim))
        try:
            value = np.broadcast_to(value, (self.dim, *x.shape[1:]))
        except ValueError:
            raise InputError(
                f"{name}: shape {value.shape} does not fit points of shape {x.shape}"
            ) from None
        if not np.all(np.isfinite(value)):
            raise InputError(f"{name}: holds values that are not finite")
        result, measure = np.zeros(self.basis.N), basis.dx * self.depth(x)
        for i in range(basis.Nbfun):
            c = i % self.dim  # only this component of an ElementVector function is not zero
            density_i = basis.basis[i][0][c] * value[c] * measure
            np.add.at(result, basis.element_dofs[i], density_i.sum(axis=1))
        return result

    @cached_property
    def constraint(self) -> tuple[sparse.csr_array, Array]:
        """All prescribed displacements as ``u = P z + u0`` with free unknowns z: P, csr_array of
        shape (ndofs, nfree), and u0, (ndofs,). InputError if two prescriptions contradict each
        other."""
        P, u0 = self._supported()
        return coupled(P, u0, self._couplings, dof_lengths(self)) if self._couplings else (P, u0)

    def _supported(self) -> tuple[sparse.csr_array, Array]:
        if not self._supports:
            return sparse.eye_array(self.basis.N, format="csr"), np.zeros(self.basis.N)
        if isinstance(self.element, GRADIENT_DOFS):
            P, u0 = essential_constraints(
                self.basis,
                [
                    (facets, [function if c == d else None for d in range(self.dim)])
                    for facets, c, function, _ in self._supports
                ],
                smooth=[smooth for *_, smooth in self._supports],
            )
            return in_order(sparse.csr_array(P)), u0
        u0 = np.full(self.basis.N, np.nan)
        size = 0.0
        for facets, component, function, _ in self._supports:
            dofs = dofs_on_facets(self.basis, facets)
            dofs = dofs[dofs % self.dim == component]
            value = evaluated("value", function, self.basis.doflocs[:, dofs])
            if value.shape != dofs.shape or not np.all(np.isfinite(value)):
                raise InputError(
                    f"value: expected {dofs.size} finite numbers, got shape {value.shape}"
                )
            size = max(size, float(np.abs(value).max(initial=0.0)))
            if np.any(np.abs(u0[dofs] - value) > 1e-10 * size):
                raise InputError("value: two prescribed displacements differ where they meet")
            u0[dofs] = value
        free = np.isnan(u0)
        unit = sparse.eye_array(self.basis.N, format="csr")
        return sparse.csr_array(unit[:, free]), np.where(free, 0.0, u0)

    def under(self, f: Array, u0: Array, thermal: Any = None) -> Self:
        """The same body, sharing its matrices, with other loads f and prescribed displacements u0,
        (ndofs,), in place of ``constraint[1]``; the supported dofs are the same."""
        _ = self.vectors
        other = copy(self)
        other.f, other.constraint = f, (self.constraint[0], u0)
        return other


def _constant(value: Any) -> Callable[[Array], Array]:
    number = numbers("value", value)
    if number.shape != () or not np.isfinite(number):
        raise InputError(f"value={value!r}: expected a finite number or a callable")
    return partial(_everywhere, float(number))


def _everywhere(number: float, x: Array) -> Array:
    return np.full(x.shape[1:], number)
