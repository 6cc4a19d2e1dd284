"""Elastic bodies with a scikit-fem Basis."""

from __future__ import annotations

from abc import abstractmethod
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.dense_arrays import HostArrays
from contact.arrays.ranges import diagonal
from contact.arrays.sparse_rows import SparseRows
from contact.body.axisymmetry import with_hoop
from contact.body.cell_finder import find_cells, places_in
from contact.body.cell_strains import has_slender_cells, internal_forces
from contact.body.constitutive import StressLaw
from contact.body.multipoint import column_lengths, picked_by
from contact.body.rigid_modes import dof_lengths, rigid_modes, value_dofs
from contact.body.solid import Solid
from contact.body.space import KeptSpaces, Space
from contact.body.supports import selected, unconstrained_rows
from contact.portable import PortableBasis

if TYPE_CHECKING:
    from skfem import Basis, Mesh


Array = NDArray[np.float64]


class BasisSolid(Solid):
    """A `Solid` with a scikit-fem Basis: sparse matrices, scikit-fem's element finder."""

    basis: Basis
    lam: Array
    mu: Array
    nu: Array
    law: StressLaw
    dilatation: str
    _live: tuple[sparse.csr_array, sparse.csr_array, NDArray[np.bool_]] | None = None
    _diagonal: tuple[sparse.csr_array, Array] | None = None
    _picked: tuple[sparse.csr_array, sparse.csr_array] | None = None
    _chosen: tuple[sparse.csr_array, NDArray[np.integer] | None] | None = None
    _portable: PortableBasis
    _ANEW = ("stiffness", "lengths", "_live", "_picked", "_chosen", "_diagonal", "_kept", "_rigid")
    _KEPT: ClassVar[tuple[str, ...]] = ("constraint",)
    _values: NDArray[np.bool_] | None = None
    _slender: bool | None = None
    takes_strains = False  # compute forces from strains although no cell is slender
    _rigid: Array | None = None

    @property
    @abstractmethod
    def constraint(self) -> tuple[sparse.csr_array, Array]:
        """P and u0 of u = P z + u0."""

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
    def lengths(self) -> tuple[Array, Array]:
        """Lengths that make each dof, and each free unknown, a displacement; see `dof_lengths`."""
        of_dof, chosen = dof_lengths(self), self.chosen
        of_free = column_lengths(self.picked, of_dof) if chosen is None else of_dof[chosen]
        return of_dof, of_free

    def snapshot(self) -> Self:
        """Copy the body for a result; the matrices are shared."""
        _ = self.vectors
        return super().snapshot()

    def __getstate__(self) -> dict[str, Any]:
        state = super().__getstate__()
        del state["basis"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.basis = self._portable.basis

    @property
    def trace(self) -> Self:
        """The body itself, which has a Basis."""
        return self

    def embed(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """Return the rows unchanged: the trace has all dofs."""
        return matrix

    def unconstrained(self, rows: sparse.csr_array) -> NDArray[np.bool_]:
        """Rows that the supports do not fix; see `contact.body.supports.unconstrained_rows`."""
        P = self.constraint[0]
        if self._live is None or self._live[0] is not rows or self._live[1] is not P:
            self._live = rows, P, unconstrained_rows(rows, P, self.lengths)
        return self._live[2]

    @cached_property
    def _kept(self) -> KeptSpaces:
        return KeptSpaces()

    def stiffness_on(self, xp: Any) -> Any | None:
        """S in CSR format, assembled with NumPy or CuPy; None if cells have too many shapes."""
        few = self.law.classes(self.basis, self.dilatation == "mean")
        return None if few is None else few[0].matrix(few[1], xp)

    @property
    def vectors(self) -> Space:
        """The `Space` that computes with vectors of all dofs, shared by all copies of the body."""
        return self._kept.of(self)

    def compute_with(
        self, arrays: HostArrays, beside: int = 0, stiffness: SparseRows | None = None
    ) -> Space:
        """Compute on the device of the arrays while the returned object is kept, if it fits with
        `beside` bytes free; `stiffness` is that of the body, if it is on the device."""
        return self._kept.on(arrays, self, beside, stiffness)

    def on_host(self) -> Self:
        """A copy that computes on the host; the body itself if it does so already."""
        if self.vectors.arrays.xp is np:
            return self
        other = copy(self)
        del other._kept
        return other

    def placed(self, v: Any) -> Any:
        """Move a vector of all dofs to the device on which the body computes."""
        return self.vectors.placed(v)

    @property
    def diagonal(self) -> Array:
        """Diagonal of the stiffness matrix, shape (ndofs,)."""
        S = self.stiffness
        if self._diagonal is None or self._diagonal[0] is not S:
            self._diagonal = S, diagonal(S)
        return self._diagonal[1]

    @property
    def rigid(self) -> Array:
        """`contact.body.rigid_modes.rigid_modes` of this body (read-only)."""
        if self._rigid is None:
            self._rigid = rigid_modes(self)
            self._rigid.setflags(write=False)
        return self._rigid

    @property
    def picked(self) -> sparse.csr_array:
        """E with ``z = E^T (u - u0)``; P itself where its columns are orthonormal."""
        P = self.constraint[0]
        if self._picked is None or self._picked[0] is not P:
            self._picked = P, picked_by(P, lambda: dof_lengths(self))
        return self._picked[1]

    @property
    def chosen(self) -> NDArray[np.integer] | None:
        """The dof of each free unknown, shape (nfree,); None unless every unknown is a dof."""
        P = self.constraint[0]
        if self._chosen is None or self._chosen[0] is not P:
            self._chosen = P, selected(P)
        return self._chosen[1]

    def forces_on(self, u: Any) -> Any:
        """S u on the device of u; from strains if cells are slender
        (`contact.body.cell_strains`)."""
        space = self.vectors
        if not self.slender:
            return space.forces(u)
        strained, on_host = internal_forces, space.arrays.get
        return space.remembered(
            u, lambda: space.placed(strained(self, np.asarray(on_host(u)))), strained=True
        )

    @property
    def slender(self) -> bool:
        """Whether cells are so slender that forces are computed from strains, not from S."""
        if self._slender is None:
            self._slender = has_slender_cells(self.mesh)
        return self._slender

    def take_strains(self) -> bool:
        """Compute forces from strains from now on, which is more accurate in a slender body; False
        if they are already, or if the body has no such computation."""
        if self.slender or type(self)._slender is False:
            return False
        self._slender = self.takes_strains = True
        return True

    @property
    def are_values(self) -> NDArray[np.bool_]:
        """Dofs that are displacements, not derivatives, shape (ndofs,)."""
        if self._values is None:
            self._values = value_dofs(self)
        return self._values

    def mean_dilatation(self, u: Array) -> Array | None:
        """Mean div u of each cell, shape (ncells,), with mean dilatation; else None."""
        if self.dilatation != "mean":
            return None
        divergence = np.trace(self.gradients(u))
        return np.asarray(np.average(divergence, axis=1, weights=self.measure))

    @property
    def measure(self) -> Array:
        """Quadrature weights of integrals over the body, shape (ncells, npoints)."""
        dx: Array = self.basis.dx
        return dx * self.depth(np.asarray(self.basis.global_coordinates())) if self.is_ring else dx

    def gradients(self, u: Array) -> Array:
        """Gradient of the displacement in the quadrature points, (dim, dim, ncells, npoints); of an
        axisymmetric body in the axes r, z, theta, (3, 3, ncells, npoints)."""
        field = self.basis.interpolate(u)
        return self.in_space(field, np.asarray(self.basis.global_coordinates()))

    def in_space(self, field: Any, x: Array) -> Array:
        """Gradient of a displacement field (dim, ...) at points x (dim, ...), with the hoop strain
        if axisymmetric."""
        gradient = np.asarray(field.grad)
        return with_hoop(gradient, np.asarray(field)[0], x[0]) if self.is_ring else gradient

    def mean_dilatation_at(self, u: Array, points: Array) -> Array | None:
        """Mean div u of the cell of each point, with mean dilatation; else None."""
        mean = self.mean_dilatation(u)
        return None if mean is None else mean[self.cells_of(points)]

    def displacement(self, u: Array, points: Array) -> Array:
        """Displacement at points, by the element's own interpolation, shape (dim, npoints)."""
        cells = self.cells_of(points)
        return sum(
            (np.asarray(field)[..., 0] * u[dofs] for field, dofs in self._local(points, cells)),
            start=np.zeros((self.dim, points.shape[1])),
        )

    def gradient(self, u: Array, points: Array) -> Array:
        """Gradient d u_i / d x_j of the displacement at points, shape (dim, dim, npoints); of an
        axisymmetric body in the axes r, z, theta, (3, 3, npoints)."""
        cells = self.cells_of(points)
        gradient = sum(
            (field.grad[..., 0] * u[dofs] for field, dofs in self._local(points, cells)),
            start=np.zeros((self.dim, self.dim, points.shape[1])),
        )
        if not self.is_ring:
            return gradient
        return with_hoop(gradient, self.displacement(u, points)[0], points[0])

    def law_at(self, points: Array) -> StressLaw:
        """`StressLaw` of the cells that hold the points, shape (dim, npoints)."""
        return self.law.at(self.cells_of(points))

    def _local(self, points: Array, cells: NDArray[np.int64]) -> Any:
        """Values of each local basis function at the points, and its dofs there."""
        basis = self.basis
        X = places_in(self.mesh, basis.mapping, points, cells)[:, :, None]
        for i in range(basis.Nbfun):
            field = basis.elem.gbasis(basis.mapping, X, i, tind=cells)[0]
            yield field, basis.element_dofs[i, cells]

    def cells_of(self, points: Array) -> NDArray[np.int64]:
        """Number of the cell that each point lies in, shape (npoints,)."""
        return find_cells(self.mesh, points)
