"""The solution inside one body: displacement, stress, and the balance of its forces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.body.constitutive import IsotropicLaw, total_stress
from contact.body.layers.layered_block import LayeredBlock
from contact.body.vector_element import GRADIENT_DOFS
from contact.errors import InputError
from contact.output.vtk import body_grid
from skfem_adini import nodal_stress as stress_of_dofs
from skfem_adini.ground.arguments import numbers

Array = NDArray[np.float64]


class BodyFields:
    """Quantities derived from the displacement of a body and the forces on it."""

    if TYPE_CHECKING:
        u: Array

        @property
        def body(self) -> Any:
            """The body, a `Solid`."""

        @property
        def solid(self) -> Any:
            """The body, or all bodies together."""

        @property
        def applied(self) -> Array:
            """Load on every dof, shape (ndofs,)."""
            ...

        @property
        def contact_forces(self) -> Array:
            """Contact forces on every dof, with the opposite sign, shape (ndofs,)."""
            ...

        @property
        def tie_forces(self) -> Array:
            """Forces of ties on every dof, with the opposite sign, shape (ndofs,)."""
            ...

    @cached_property
    def _meshed(self) -> Any:
        """The body; for a `LayeredBlock` its cells on a mesh with the same dof numbers."""
        return self.body.meshed() if isinstance(self.body, LayeredBlock) else self.body

    @property
    def on_mesh(self) -> BodyResult:
        """The same fields on a body with a Basis, for pictures and VTK data."""
        forces = self.contact_forces, self.tie_forces
        return BodyResult(self._meshed, self.u, self.applied, *forces)

    @cached_property
    def reactions(self) -> Array:
        """Forces of the supports on all dofs, shape (ndofs,)."""
        forces = self.contact_forces + self.tie_forces
        return np.asarray(self.solid.internal(self.u) + forces - self.applied)

    def balance(self) -> dict[str, Array]:
        """Applied load, support reactions, contact force, and the residual of their sum.

        Returns
        -------
        dict
            ``load``, ``support``, ``contact``: resultants, shape (dim,); ``residual``: their sum
            divided by the largest of them, or by the internal forces of the body if all resultants
            are rounding errors of these. Only reactions at prescribed displacements count. With
            ties also ``tie``, their resultant, which is zero for all bodies together.
        """
        body = self.solid
        parts = {
            "load": body.total(self.applied),
            "support": body.total(body.at_supports(self.reactions)),
            "contact": body.total(-self.contact_forces),
        }
        if np.any(self.tie_forces):
            parts["tie"] = body.total(-self.tie_forces)
        largest = max(float(np.abs(part).max()) for part in parts.values())
        forces = self.contact_forces + self.tie_forces
        _, cancelling = body.equilibrium(self.u, forces, self.applied)
        if largest <= 1e-12 * cancelling:  # only rounding of internal forces
            largest = cancelling or 1.0
        parts["residual"] = sum(parts.values(), start=np.zeros(body.dim)) / largest
        return parts

    def stress(self, points: ArrayLike | None = None) -> Array:
        """Cauchy stress in the quadrature points of the basis, or at given points.

        Parameters
        ----------
        points : array, shape (dim, npoints), optional

        Returns
        -------
        ndarray, shape (dim, dim, ncells, nquadrature) or (dim, dim, npoints)
            Of an axisymmetric body in the axes r, z, theta, shape (3, 3, ...).

        Raises
        ------
        InputError
            Points of another shape, not finite, or outside the body.
        """
        if points is not None:
            return np.asarray(self.body.stress_at(self.u, self._points(points)))
        body = self._meshed
        local = body.basis.X  # bodies without a single basis raise an error with the alternative
        mean, gradient = body.mean_dilatation(self.u), body.gradients(self.u)
        volume = None if mean is None else mean[:, None]
        strain = body.thermal_strain_in(local)
        return total_stress(body.law, gradient, volume, strain)

    def nodal_stress(self) -> Array:
        """Cauchy stress at the vertices of the mesh, shape (3, 3, nvertices).

        Returns
        -------
        ndarray
            In the unit of E; from the dofs of Adini's and the BFS element, see
            `skfem_adini.nodal_stress`, else means over the cells around a vertex.
        """
        return nodal_stress(self._meshed, self.u)

    def cell_stress(self) -> Array:
        """Mean Cauchy stress of each cell, shape (3, 3, ncells).

        Returns
        -------
        ndarray
            In the unit of E, shape (3, 3, ncells); in 2-D the last row and column hold only
            sigma_zz, of an axisymmetric body the hoop stress.
        """
        return cell_stress(self._meshed, self.stress())

    def von_mises(self, points: ArrayLike | None = None) -> Array:
        """Von Mises stress, at the points of `stress`; includes sigma_zz or the hoop stress.

        Parameters
        ----------
        points : array, shape (dim, npoints), optional

        Returns
        -------
        ndarray, shape (ncells, nquadrature) or (npoints,)
            In the unit of E.

        Raises
        ------
        InputError
            Points of another shape, not finite, or outside the body.
        """
        body = self._meshed if points is None else self.body
        sigma = self.stress(points)
        trace = np.trace(sigma)
        if len(sigma) == 2:
            if points is None:
                law, free = body.law, body.thermal_strain_in(body.basis.X)
            else:
                where = self._points(points)
                law, free = body.law_at(where), body.thermal_strain_at(where)
            out_of_plane = law.out_of_plane(sigma, free)
        else:
            out_of_plane = np.zeros_like(trace)
        trace = trace + out_of_plane
        square = np.sum(sigma**2, axis=(0, 1)) + out_of_plane**2
        return np.asarray(np.sqrt(1.5 * np.maximum(square - trace**2 / 3, 0.0)))

    def sample(self, points: ArrayLike) -> Array:
        """Displacement at points of the body by the element's own interpolation.

        Parameters
        ----------
        points : array, shape (dim, npoints)

        Returns
        -------
        ndarray, shape (dim, npoints)

        Raises
        ------
        InputError
            Points of another shape, not finite, or outside the body.
        """
        return np.asarray(self.body.displacement(self.u, self._points(points)))

    def _points(self, points: ArrayLike) -> Array:
        where, dim = numbers("points", points), self.body.dim
        if where.ndim != 2 or where.shape[0] != dim or not np.all(np.isfinite(where)):
            raise InputError(f"points: expected finite numbers of shape ({dim}, n)")
        return where

    def to_pyvista(self, subdivide: int | None = None) -> Any:
        """The body as a pyvista grid: displacement and stress.

        Parameters
        ----------
        subdivide : int, optional
            Linear cells along each edge of a cell instead of exact ones, as for
            `skfem_adini.to_pyvista`.

        Returns
        -------
        pyvista.UnstructuredGrid

        Raises
        ------
        MissingDependency
            pyvista is not installed.
        """
        return body_grid(self, subdivide)

    def on_grid(self, grid: Any) -> Any:
        """The grid of the body, to which nothing is added."""
        return grid


@dataclass(frozen=True, eq=False, repr=False)
class BodyResult(BodyFields):
    """The part of a `ContactResult` that belongs to one body: ``result[body]``.

    Attributes
    ----------
    body : Solid
        As it was when the problem was solved.
    u : ndarray, shape (ndofs,)
        Displacement of all dofs of ``body.basis``.
    applied : ndarray, shape (ndofs,)
        The load.
    contact_forces : ndarray, shape (ndofs,)
        ``G^T mu + T^T t`` on its dofs: the contact forces with the opposite sign.
    tie_forces : ndarray, shape (ndofs,)
        The same of bonded points.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> body = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("left", "x")
    >>> problem = ContactProblem(body.load("top", (0.0, -0.1)), "bottom", 0.0, friction=0.3)
    >>> inside = problem.solve()[body]
    >>> bool(abs(inside.resultant[1] - 0.1) < 1e-10)
    True
    """

    body: Any
    u: Array
    applied: Array
    contact_forces: Array
    tie_forces: Array

    def __repr__(self) -> str:
        size = self.body.largest_displacement(self.u)
        return f"BodyResult({self.body!r}; displacement at most {size:.6g})"

    @property
    def solid(self) -> Any:
        """The body."""
        return self.body

    @property
    def resultant(self) -> Array:
        """Contact force on the body, without its ties, shape (dim,)."""
        return np.asarray(self.body.total(-self.contact_forces))

    @property
    def tie_resultant(self) -> Array:
        """Force of the ties on the body, shape (dim,)."""
        return np.asarray(self.body.total(-self.tie_forces))


if TYPE_CHECKING:
    from skfem import Mesh

    from contact.body.elastic_body import ElasticBody


def nodal_stress(body: ElasticBody, u: Array) -> Array:
    """Stress at the vertices, (3, 3, nvertices): from dofs, or size-weighted means over cells."""
    from_dofs = isinstance(body.law, IsotropicLaw) and body.thermal is None  # not axisymmetric
    if isinstance(body.element, GRADIENT_DOFS) and from_dofs:
        plane: Any = body.plane or "strain"
        return stress_of_dofs(body.basis, u, body.E, body.nu, plane)
    mesh, size = body.mesh, body.measure.sum(axis=1)
    X = np.repeat(mesh.elem.refdom.p[:, None], mesh.nelements, axis=1)
    at = _full(body, _stress_at(body, u, X), body.thermal_strain_in(X))
    return vertex_means(mesh, at, size)


def vertex_means(mesh: Mesh, at: Array, size: Array) -> Array:
    """Means (3, 3, nvertices) over the cells around each vertex, of values (3, 3, ncells, ncorners)
    weighted by the sizes of the cells."""
    total, share = np.zeros((mesh.nvertices, 3, 3)), np.zeros(mesh.nvertices)
    for corner, vertices in enumerate(mesh.t):
        np.add.at(total, vertices, (at[..., corner] * size).transpose(2, 0, 1))
        np.add.at(share, vertices, size)
    return (total / share[:, None, None]).transpose(1, 2, 0)


def cell_stress(body: ElasticBody, sigma: Array) -> Array:
    """Mean of each cell of the stress in the quadrature points, shape (3, 3, ncells)."""
    dx, free = body.measure, body.thermal_strain_in(body.basis.X)
    mean = np.sum(sigma * dx, axis=-1) / dx.sum(axis=1)
    if free is not None:
        free = np.sum(free * dx, axis=-1) / dx.sum(axis=1)
    return _full(body, mean, free)


def _stress_at(body: ElasticBody, u: Array, X: Array) -> Array:
    """Stress at reference points (dim, ncells, npoints) of every cell."""
    everywhere, size = np.arange(X.shape[1]), 3 if body.is_ring else body.dim
    gradient = np.zeros((size, size, *X.shape[1:]))
    x = np.asarray(body.basis.mapping.F(X, tind=everywhere))
    for i, dofs in enumerate(body.basis.element_dofs):
        field = body.basis.elem.gbasis(body.basis.mapping, X, i, tind=everywhere)[0]
        gradient += body.in_space(field, x) * u[dofs][:, None]
    mean = body.mean_dilatation(u)
    volume = None if mean is None else mean[:, None]
    return total_stress(body.law, gradient, volume, body.thermal_strain_in(X))


def _full(body: ElasticBody, sigma: Array, thermal_strain: Array | None) -> Array:
    """Tensors with nine components: sigma_zz of plane strain follows from the law."""
    if len(sigma) == 3:
        return sigma
    full = np.zeros((3, 3, *sigma.shape[2:]))
    full[:2, :2] = sigma
    full[2, 2] = body.law.out_of_plane(sigma, thermal_strain)
    return full
