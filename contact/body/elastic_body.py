"""An elastic body: mesh, element, material, supports and loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from skfem import Basis, ElementVector, Mesh

from contact.body.anisotropic import Anisotropic
from contact.body.axisymmetry import AXISYMMETRIC, axis_facets, refuse_axis
from contact.body.boundary_names import read_mesh, select_components, select_facets
from contact.body.cell_check import check_basis, check_cells
from contact.body.coupled_body import CoupledBody
from contact.body.deferred_basis import DeferredBasis, DofNumbers, dofs_on_facets
from contact.body.multipoint import column_lengths, coupled
from contact.body.rigid_modes import dof_lengths
from contact.body.supports import in_order
from contact.body.thermal_strain import HeatedBody
from contact.body.vector_element import DEFAULT_ELEMENT, GRADIENT_DOFS, vector_element
from contact.errors import InputError, evaluated, function_of_places, numbers
from contact.facet_basis import facet_basis
from contact.portable import PortableBasis
from contact.settled import settled
from skfem_adini import InputError as AdiniInputError
from skfem_adini import essential_constraints

_OF_RADII = 2  # degrees of quadrature for r and 1 / r, beside those of the plane
Field = float | ArrayLike | Callable[[NDArray[np.float64]], ArrayLike]


@settled("make a new body", "basis", "dim", "element")
class ElasticBody(CoupledBody, HeatedBody):
    """A linearly elastic body, discretised by any scikit-fem vector basis.

    The data flow is `basis -> stiffness S, load f, conditions C x = c`; each is an attribute.
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
        pressures stay forces per area; on the axis the radial displacement is held.
    dilatation : {"pointwise", "mean"}
        "mean" replaces div u in each Q1 cell by its mean, so that nearly incompressible materials
        do not lock, see `stiffness_matrix`. All other elements are "pointwise".
    material : Anisotropic or Orthotropic, optional
        Instead of E and nu. In two dimensions the plane must be one of symmetry. It may be assigned
        later as `anisotropy`; E and nu are None then.

    Raises
    ------
    InputError
        Not a vector basis, a material constant outside its range, or a material beside E and nu.

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
        if element is None:
            if type(mesh).__name__ not in DEFAULT_ELEMENT:
                raise InputError(f"element: no default for {type(mesh).__name__}; pass one")
            element = DEFAULT_ELEMENT[type(mesh).__name__]()
        element = vector_element(element, mesh)
        check_cells(mesh)
        try:
            more = _OF_RADII if isinstance(plane, str) and plane == AXISYMMETRIC else 0
            basis = DeferredBasis(mesh, element, 2 * element.maxdeg + more)
        except AdiniInputError as error:
            raise InputError(str(error)) from error
        return cls(basis, E, nu, plane, dilatation, material)

    @property
    def mesh(self) -> Mesh:
        """The mesh of the basis."""
        mesh: Mesh = self.basis.mesh
        return mesh

    @cached_property
    def stiffness(self) -> sparse.csr_array:
        """S of ``a(u, v) = int sigma(u) : eps(v)``, all dofs, shape (ndofs, ndofs)."""
        self.check_unchanged()
        return self.law.stiffness(self.basis, self.dilatation == "mean")

    @cached_property
    def scalar_dofs(self) -> Any:
        """Dof numbering of the scalar element; vector dof = dim * scalar dof + component."""
        return DofNumbers(self.mesh, self.element)

    def facets(self, boundary: str | Sequence[str] | ArrayLike) -> NDArray[np.int64]:
        """Facet numbers of a boundary of this body; see
        `contact.body.boundary_names.select_facets`.
        """
        return select_facets(self.mesh, boundary)

    def whole_facets(self, boundary: str | Sequence[str] | ArrayLike) -> NDArray[np.int64]:
        """The given facets, refused if the boundary of the body cuts their cells (`CutBody`).

        Those on the axis of an axisymmetric body are refused too: they have no area.
        """
        facets = self.facets(boundary)
        if self.is_ring:
            refuse_axis(self.mesh, facets)
        return facets

    def fix(
        self,
        boundary: str | Sequence[str] | ArrayLike,
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
        facets = self.facets(boundary)
        function = function_of_places("value", value) if callable(value) else _constant(value)
        chosen = select_components(self.dim, components)
        if not isinstance(smooth, bool | None):
            raise InputError(f"smooth={smooth!r}: expected True, False or None")
        smooth = not callable(value) if smooth is None else smooth
        self._supports = [*self._supports, *((facets, c, function, smooth) for c in chosen)]
        for derived in ("constraint", "lengths"):
            self.__dict__.pop(derived, None)
        return self

    def load(self, boundary: str | Sequence[str] | ArrayLike, traction: Field) -> Self:
        """Add a surface traction (force per area) on a boundary, of a ring on all its surface.

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
        self.f = self.f + self._load_vector(basis, traction, "traction")
        return self

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
        self.f = self.f + self._load_vector(self.basis, force, "force")
        return self

    def _load_vector(self, basis: Any, density: Field, name: str) -> NDArray[np.float64]:
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
    def constraint(self) -> tuple[sparse.csr_array, NDArray[np.float64]]:
        """All prescribed displacements as ``u = P z + u0`` with free unknowns z.

        Returns
        -------
        P : csr_array, shape (ndofs, nfree)
        u0 : ndarray, shape (ndofs,)

        Raises
        ------
        InputError
            Two prescriptions contradict each other.
        """
        P, u0 = self._supported()
        return coupled(P, u0, self._couplings, dof_lengths(self)) if self._couplings else (P, u0)

    def _supported(self) -> tuple[sparse.csr_array, NDArray[np.float64]]:
        if not self._supports:
            return sparse.eye_array(self.basis.N, format="csr"), np.zeros(self.basis.N)
        if isinstance(self.element, GRADIENT_DOFS):
            try:
                P, u0 = essential_constraints(
                    self.basis,
                    [
                        (facets, [function if c == d else None for d in range(self.dim)])
                        for facets, c, function, _ in self._supports
                    ],
                    smooth=[smooth for *_, smooth in self._supports],
                )
            except AdiniInputError as error:
                raise InputError(str(error)) from error
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

    def under(self, f: NDArray[np.float64], u0: NDArray[np.float64], thermal: Any = None) -> Self:
        """The same body, sharing its matrices, with other loads and prescribed displacements.

        Parameters
        ----------
        f, u0 : ndarray, shape (ndofs,)
            u0 takes the place of ``constraint[1]``; the supported dofs are the same.
        """
        _ = self.vectors
        other = copy(self)
        other.f, other.constraint = f, (self.constraint[0], u0)
        return other

    @cached_property
    def lengths(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lengths that make each dof, and each free unknown, a displacement; see `dof_lengths`."""
        of_dof, chosen = dof_lengths(self), self.chosen
        of_free = column_lengths(self.picked, of_dof) if chosen is None else of_dof[chosen]
        return of_dof, of_free


def _constant(value: Any) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    number = numbers("value", value)
    if number.shape != () or not np.isfinite(number):
        raise InputError(f"value={value!r}: expected a finite number or a callable")
    return partial(_everywhere, float(number))


def _everywhere(number: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.full(x.shape[1:], number)
