"""A body of large strain or a nonlinear material, by a stress function or weak forms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, BilinearForm, ElementTetP1, ElementTriP1, LinearForm, Mesh

from contact.body.boundary_names import read_mesh
from contact.body.elastic_body import ElasticBody
from contact.body.vector_element import vector_element
from contact.errors import InputError
from contact.nonlinear.cell_forces import CellForces, FormForces, det, with_unit
from contact.nonlinear.stress_forces import StressForces

Array = NDArray[np.float64]
__all__ = ["NonlinearBody"]


class NonlinearBody(ElasticBody):
    r"""A body whose stress is any function of the deformation gradient, also of its history.

    Supports, loads and names are those of `ElasticBody`; tractions are forces per undeformed area
    that keep their direction. `NonlinearStepper` solves for it; `ContactProblem.solve` refuses.

    Parameters
    ----------
    basis : Basis
        Of ``ElementVector(...)``, 2-D or 3-D. Its quadrature points carry the state.
    stress : callable
        ``stress(F) -> P``: first Piola-Kirchhoff stress, force per undeformed area, of deformation
        gradients, both of shape (3, 3, ncells, npoints). If it has a state,
        ``stress(F, state, dt) -> P, new state`` from that of the last accepted step. Analytic in F
        where possible: the tangent is taken by complex steps (see `contact.nonlinear.cell_forces`).
    plane : {"strain", "stress", "axisymmetric"}
        Two dimensions only; F_33 is 1, such that P_33 = 0, or 1 + u_r / r. Forces in plane stress
        are those of the unit of undeformed thickness.
    dilatation : {"pointwise", "mean"}
        "mean" takes the stress at F with the volume change projected onto constants in each cell,
        in quadratic quadrilaterals and hexahedra onto linear functions, so that nearly
        incompressible materials do not lock and have a pressure that means something. For rubber
        take it with ``ElementQuad2``.
    state : dict, optional
        Initial values of one point by name, scalars or tensors. Default: ``stress.state``, if any.

    Raises
    ------
    InputError
        Not a vector basis, a stress that cannot be called, mean dilatation in linear triangles and
        tetrahedra, whose volume change is constant and locks, or in plane stress, which does not.

    References
    ----------
    J. Bonet and R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed.,
    Cambridge University Press 2008.

    Examples
    --------
    A rubber of one line, pressed onto a floor:

    >>> from contact import ContactProblem, NonlinearStepper, Plane
    >>> from skfem import MeshQuad
    >>> from skfem.helpers import det, inv, transpose
    >>> def rubber(F):
    ...     return F - transpose(inv(F)) * (1.0 - 9.0 * np.log(det(F)))
    >>> mesh = MeshQuad().refined(1).with_defaults()
    >>> body = NonlinearBody.from_mesh(mesh, stress=rubber).fix("left", "x").fix("top", "y")
    >>> problem = ContactProblem(body, "bottom", Plane((0.0, 0.0), (0.0, 1.0)), friction=0.3)
    >>> history = NonlinearStepper(problem).move("top", "y", -0.3).run([0.5, 1.0])
    >>> history.results[-1].certificate["balance"] < 1e-9
    True
    """

    E = property(lambda body: None, lambda body, value: body._set_material(E=value))
    nu = property(lambda body: None, lambda body, value: body._set_material(nu=value))

    def __init__(
        self,
        basis: Basis,
        stress: Callable[..., Any],
        plane: str | None = "strain",
        dilatation: str = "pointwise",
        state: Mapping[str, Any] | None = None,
    ) -> None:
        if not callable(stress):
            raise InputError(f"stress: expected a function of F, got {type(stress).__name__}")
        self._hold(basis, plane)
        if dilatation not in ("pointwise", "mean"):
            raise InputError(f"dilatation={dilatation!r}: expected 'pointwise' or 'mean'")
        state = getattr(stress, "state", None) if state is None else state
        mean = dilatation == "mean"
        if mean and isinstance(self.element, ElementTriP1 | ElementTetP1):
            raise InputError(
                f"dilatation='mean': the volume change of {type(self.element).__name__} is "
                "constant in each cell, so nearly incompressible materials lock; take quadratic "
                "elements, or quadrilaterals or hexahedra"
            )
        if mean and plane == "stress":
            raise InputError("dilatation='mean': plane stress does not lock; leave it out")
        self.cells: CellForces = StressForces(self.basis, stress, state, mean, plane)

    def _hold(self, basis: Basis, plane: str | None) -> None:
        """Take the basis, supports and loads of an elastic body; its material is never used."""
        ElasticBody.__init__(self, basis, E=1.0, nu=0.0, plane=plane)

    def _set_material(self, **changed: Any) -> None:
        if "_material" in self.__dict__:
            raise InputError(
                f"{', '.join(changed)}: a NonlinearBody's material is its stress; make a new body"
            )
        super()._set_material(**changed)

    @classmethod
    def from_mesh(  # type: ignore[override]
        cls,
        mesh: Mesh | str | Path,
        element: Any = None,
        *,
        stress: Callable[..., Any],
        plane: str | None = "strain",
        dilatation: str = "pointwise",
        state: Mapping[str, Any] | None = None,
    ) -> Self:
        """Build a body from a mesh or a mesh file; see `ElasticBody.from_mesh`.

        Parameters
        ----------
        mesh : Mesh, str or Path
        element : Element, optional
            Default: P2 triangles, Q2 quadrilaterals, P1 tetrahedra, Q1 hexahedra.
        stress, plane, dilatation, state
            As for the class.

        Returns
        -------
        NonlinearBody

        Raises
        ------
        InputError
            No mesh, or as of the class.
        """
        return cls(_basis(mesh, element), stress, plane, dilatation, state)

    @classmethod
    def from_forms(
        cls,
        mesh: Mesh | str | Path,
        element: Any = None,
        *,
        internal: LinearForm,
        tangent: BilinearForm | None = None,
        state: Mapping[str, Any] | None = None,
        update: Callable[[Any], Mapping[str, Any]] | None = None,
        plane: str | None = "strain",
        intorder: int | None = None,
    ) -> Self:
        """Build a body from its internal virtual work as scikit-fem forms.

        Parameters
        ----------
        mesh : Mesh, str or Path
        element : Element, optional
            As for `from_mesh`.
        internal : LinearForm
            Of ``(v, w)``, with the displacement ``w["u"]`` and its derivatives ``w["u"].grad``, the
            state of the last accepted step by its names, and the time step ``w["dt"]``. In
            axisymmetry it contains the factor 2 pi r and the hoop terms.
        tangent : BilinearForm, optional
            Its derivative in u, of ``(du, v, w)``. Default: complex steps of `internal`; or, where
            it is not analytic, central differences.
        state : dict, optional
            Initial values of one point by name.
        update : callable, optional
            ``update(w)`` -> dict of the new state, called where a step is accepted.
        plane : {"strain", "axisymmetric"}
        intorder : int, optional
            Degree of the quadrature; default twice that of the element.

        Returns
        -------
        NonlinearBody

        Raises
        ------
        InputError
            Forms of another kind, or a state without its update.
        """
        if plane == "stress":
            raise InputError(
                "plane='stress': forms do not say what P_33 is; let them find F_33 themselves, or "
                "give stress="
            )
        body = cls.__new__(cls)
        body._hold(_basis(mesh, element, intorder), plane)
        body.cells = FormForces(body.basis, internal, tangent, update, state)
        return body

    @classmethod
    def from_felupe(
        cls,
        mesh: Mesh | str | Path,
        element: Any = None,
        *,
        umat: Any,
        plane: str | None = "strain",
        dilatation: str = "pointwise",
        intorder: int | None = None,
    ) -> Self:
        """Build a body from a material of felupe or matadi, with its own tangent.

        Parameters
        ----------
        mesh : Mesh, str or Path
        element : Element, optional
            As for `from_mesh`.
        umat : object
            With ``gradient([F, z]) -> [P, new z]``, ``hessian([F, z]) -> [dP/dF]`` for arrays with
            two trailing axes, and ``x``, the example [F, z] of one point; z, called "z" in results,
            starts from zeros. Neither package is imported here.
        plane, dilatation
            As for the class.
        intorder : int, optional
            As for `from_forms`; 3 gives felupe's points in quadrilaterals and hexahedra.

        Returns
        -------
        NonlinearBody

        Raises
        ------
        InputError
            An object without these methods, or a material of mixed fields.

        Examples
        --------
        >>> class Spring:  # P = F - I
        ...     x = [np.eye(3), np.zeros(0)]
        ...     def gradient(self, x):
        ...         return [x[0] - np.eye(3)[:, :, None, None], x[1]]
        ...     def hessian(self, x):
        ...         unit = np.einsum("ik,jl->ijkl", np.eye(3), np.eye(3))
        ...         return [unit[..., None, None]]
        >>> from skfem import MeshQuad
        >>> body = NonlinearBody.from_felupe(MeshQuad().with_defaults(), umat=Spring())
        >>> float(body.cauchy_stress(np.zeros(body.ndofs), {}).max())
        0.0
        """
        return cls(_basis(mesh, element, intorder), _Umat(umat), plane, dilatation)

    @property
    def stiffness(self) -> NoReturn:
        """Refused: the tangent depends on the displacement."""
        raise InputError(
            "body: a NonlinearBody has no stiffness of its own; solve with "
            "NonlinearStepper(problem).run(times)"
        )

    def heat(self, temperature: Any, expansion: Any) -> NoReturn:
        """Refused: let the stress function contain the thermal strain.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(
            "heat: thermal strains belong into the stress of a NonlinearBody, stress(F / (1 + a T))"
        )

    def snapshot(self) -> Self:
        """A copy for a result, which later loads and supports do not change."""
        other = copy(self)
        other._f = self._f.copy()
        return other

    def under(self, f: Array, u0: Array, thermal: Any = None) -> Self:
        """The same body with other loads and prescribed displacements, shape (ndofs,)."""
        other = copy(self)
        other.f, other.constraint = f, (self.constraint[0], u0)
        return other

    def largest_displacement(self, u: Array) -> float:
        """Largest component of the displacement at a node."""
        return float(np.abs(u[self.are_values]).max(initial=0.0))

    def deformation_gradient(self, u: Array, at_nodes: bool = False) -> Array:
        """F (3, 3, ncells, npoints) at the quadrature points, or at the corners of the cells.

        In plane stress F_33 is given as 1. The array is read-only.

        Parameters
        ----------
        u : ndarray, shape (ndofs,)
        at_nodes : bool

        Returns
        -------
        ndarray
        """
        if not at_nodes and isinstance(self.cells, StressForces):
            return self.cells.gradient(u[self.basis.element_dofs])
        basis = self._at_corners if at_nodes else self.basis
        x = np.asarray(basis.global_coordinates())
        return with_unit(self.in_space(basis.interpolate(u), x))

    @cached_property
    def _at_corners(self) -> Basis:
        corners = self.mesh.elem.refdom.p
        rule = corners, np.ones(corners.shape[1])
        return Basis(self.mesh, self.basis.elem, quadrature=rule, dofs=self.basis.dofs)

    def cauchy_stress(self, u: Array, state: dict[str, Array], dt: float = 0.0) -> Array:
        """Cauchy stress at the quadrature points, shape (3, 3, ncells, npoints).

        Parameters
        ----------
        u : ndarray, shape (ndofs,)
        state : dict
            Before the step that led to u.
        dt : float

        Returns
        -------
        ndarray

        Raises
        ------
        InputError
            A body given by forms, whose stress is not known.
        """
        if not isinstance(self.cells, StressForces):
            raise InputError("stress: forms do not say what their stress is; give stress= instead")
        P = self.cells.stresses(u[self.basis.element_dofs], state, dt)
        F = self.cells.thinned(self.deformation_gradient(u), state, dt)
        return np.asarray(np.einsum("ij...,kj...->ik...", P, F) / det(F))


class _Umat:
    """Stress of a material of felupe; at complex F by its tangent, P + i dP/dF : Im F."""

    def __init__(self, umat: Any) -> None:
        if not all(hasattr(umat, name) for name in ("gradient", "hessian", "x")):
            raise InputError(
                f"umat: expected gradient, hessian and x, as felupe's materials have, got a "
                f"{type(umat).__name__}"
            )
        if len(umat.x) != 2:
            raise InputError(
                "umat: a material of mixed fields; take that of F alone, with dilatation='mean'"
            )
        self._umat, z = umat, np.asarray(umat.x[1])
        self.state = {"z": np.zeros(z.shape)} if z.size else {}
        self._known: tuple[Any, ...] = (None, None, None)

    def __call__(self, F: Any, state: Mapping[str, Any] | None = None, dt: float = 0.0) -> Any:
        z = np.zeros(0) if state is None else state["z"]
        at = np.ascontiguousarray(F.real)
        P, new = self._umat.gradient([at, z])[:2]
        if np.iscomplexobj(F):
            last, old, A = self._known
            if old is not z or not np.array_equal(last, at):
                A = np.asarray(self._umat.hessian([at, z])[0])
                self._known = at, z, A
            P = P + 1j * np.einsum("ijkl...,kl...->ij...", A, F.imag)
        return P if state is None else (P, {"z": new})


def _basis(mesh: Any, element: Any, intorder: int | None = None) -> Basis:
    mesh = read_mesh(mesh) if isinstance(mesh, str | Path) else mesh
    if not isinstance(mesh, Mesh):
        raise InputError(f"mesh: expected a Mesh or a path, got {type(mesh).__name__}")
    chosen = vector_element(element, mesh)
    return Basis(mesh, chosen, intorder=2 * chosen.maxdeg if intorder is None else intorder)
