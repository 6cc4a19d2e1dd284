"""The interface of elastic bodies that contact uses, and its part for bodies with a Basis."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.body.cell_finder import find_cells, places_in
from contact.body.cell_strains import has_slender_cells, internal_forces
from contact.body.constitutive import StressLaw
from contact.body.rigid_modes import rigid_modes, value_dofs
from contact.body.supports import live_rows
from contact.body.surface import Surface
from contact.errors import InputError, numbers
from contact.portable import Portable, PortableBasis

if TYPE_CHECKING:
    from skfem import Basis, Mesh


Array = NDArray[np.float64]


class Solid(Portable, ABC):
    """An elastic body under loads and supports, as contact sees it.

    Attributes
    ----------
    dim : int
    plane : {"strain", "stress", None}
    f : ndarray, shape (ndofs,)
        Load on every dof.
    name : str
        By which errors and results of several bodies know it; see `named`.
    """

    dim: int
    plane: str | None
    name: str = ""
    _f: Array
    _supports: list[Any]
    if TYPE_CHECKING:
        stiffness: Any
    _material: Any = None
    _FUNCTIONS: ClassVar[tuple[str, ...]] = ("_supports",)
    _IDENTITY: ClassVar[str] = "basis"  # the attribute that all copies of a body share

    def __repr__(self) -> str:
        element = vars(self).get("element")
        of = f" of {type(element).__name__}" if element is not None else ""
        return f"{type(self).__name__}({self.dim}-D, {self.f.size} unknowns{of})"

    @property
    def f(self) -> Array:
        """Load on every dof, shape (ndofs,)."""
        return self._f

    @f.setter
    def f(self, value: Array) -> None:
        given = numbers("f", value)
        expected = self._f.shape if "_f" in self.__dict__ else given.shape
        if given.shape != expected or given.ndim != 1 or not np.all(np.isfinite(given)):
            raise InputError(
                f"f: expected finite numbers of shape {expected}, one a dof, got shape "
                f"{given.shape}" + ("" if np.all(np.isfinite(given)) else " with NaN or infinity")
            )
        self._f = given

    def check_unchanged(self) -> None:
        """Raise an `InputError` if the loads were edited in place to values that are not finite."""
        if not np.all(np.isfinite(self._f)):
            raise InputError("f: the load vector holds values that are not finite")

    def snapshot(self) -> Self:
        """A copy for a result, which later loads and supports do not change."""
        other = copy(self)
        other._f = self._f.copy()
        return other

    def has_stiffness_of(self, other: Solid) -> bool:
        """Whether two bodies answer alike, as far as their matrices are at hand."""
        S: Any = self.stiffness
        if self._material is other._material or not isinstance(S, sparse.csr_array):
            return True
        # Rounding of another machine, should one of them come from a file.
        return S.shape == other.stiffness.shape and bool(
            abs(S - other.stiffness).max() <= 1e-12 * abs(S).max()
        )

    def named(self, name: str) -> Self:
        """Give the body a name, by which errors and results of several bodies know it.

        Parameters
        ----------
        name : str

        Returns
        -------
        Solid
            Itself, for chaining.

        Raises
        ------
        InputError
            Not a word.
        """
        if not isinstance(name, str) or not name:
            raise InputError(f"name={name!r}: expected a word")
        self.name = name
        return self

    def surface(self, boundary: Any, clearance: Any = None) -> Surface:
        """A boundary of this body as the obstacle of another one, or of another boundary.

        Parameters
        ----------
        boundary : str, list of str or array of facet numbers
        clearance : float, callable x -> array, or ndarray of shape (m,), optional
            The gap at the contact points of the other side; default: measured between the meshes.

        Returns
        -------
        Surface

        Raises
        ------
        InputError
            No such boundary.

        Examples
        --------
        >>> from skfem import MeshQuad
        >>> from contact import ContactProblem, ElasticBody
        >>> mesh = MeshQuad().refined(2).with_defaults()
        >>> lower = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("bottom", "xy")
        >>> above = mesh.translated((0.0, 1.0)).refined(1).with_defaults()
        >>> upper = ElasticBody.from_mesh(above, E=2.0, nu=0.3).fix("top", "xy", -0.01)
        >>> result = ContactProblem(upper, "bottom", lower.surface("top"), friction=0.3).solve()
        >>> bool((result.pressure > 0).all())
        True
        """
        return Surface(self, self.trace.whole_facets(boundary), clearance)

    @property
    def materials(self) -> tuple[Any, ...]:
        """The material of each of the `bodies`."""
        return (self._material,)

    @property
    def bodies(self) -> tuple[Any, ...]:
        """The bodies that this one consists of: itself alone, but for `Bodies`."""
        return (self,)

    @property
    def slices(self) -> tuple[slice, ...]:
        """Where the dofs of each of the `bodies` stand among all dofs."""
        return (slice(0, self._f.size),)

    @property
    def extent(self) -> float:
        """Largest extent along a coordinate axis."""
        return float(np.ptp(self.trace.mesh.p, axis=1).max())

    def number_of(self, body: Any) -> int:
        """Which of the `bodies` is meant by one of them, as it is or was, or by a number.

        Raises
        ------
        InputError
            None of them, or not one alone.
        """
        if isinstance(body, Solid) and body.is_same_body(self):
            return 0
        if isinstance(body, int) and body == 0:
            return 0
        raise InputError(f"body: {body!r} is not the body of this result")

    def is_same_body(self, other: Solid) -> bool:
        """Whether another object is this body, or the same one under other loads."""
        ours, theirs = (vars(body).get(self._IDENTITY) for body in (self, other))
        return other is self or (ours is not None and theirs is ours)

    def said_of(self, k: int, motion: str) -> str:
        """A motion of body k in the words of an error message."""
        return motion

    @property
    @abstractmethod
    def trace(self) -> Any:
        """A body with a Basis; its dofs come first in this body and determine the boundary."""

    @abstractmethod
    def embed(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """Rows given on the dofs of `trace`, extended to all dofs of this body."""

    @abstractmethod
    def live(self, rows: sparse.csr_array) -> NDArray[np.bool_]:
        """Rows that the supports do not fix; see `contact.body.supports.live_rows`."""

    @abstractmethod
    def equilibrium(self, u: Array, contact: Array, load: Array) -> tuple[float, float]:
        """Largest residual force at a free dof, and the largest sum of the terms' moduli there.

        Parameters
        ----------
        u, contact, load : ndarray, shape (ndofs,)
            Displacement; contact forces with the opposite sign; applied loads.
        """

    def internal(self, u: Array) -> Array:
        """Internal forces S u of a displacement, shape (ndofs,)."""
        forces: Array = self.stiffness @ u
        return forces

    @abstractmethod
    def reach(self, u: Array) -> float:
        """Largest displacement at a node; dofs that are derivatives do not count."""

    @abstractmethod
    def deformation(self, u: Array) -> float:
        """Largest part of a displacement that no rigid motion explains, in the units of `reach`."""

    @abstractmethod
    def support_error(self, u: Array) -> float:
        """Largest deviation from a prescribed displacement."""

    @abstractmethod
    def at_supports(self, forces: Array) -> Array:
        """The part of forces on all dofs that acts where a displacement is prescribed."""

    @abstractmethod
    def total(self, forces: Array) -> Array:
        """Resultant of forces on all dofs, shape (dim,)."""

    @abstractmethod
    def displacement(self, u: Array, points: Array) -> Array:
        """Displacement at points, by the element's own interpolation, shape (dim, npoints)."""

    @abstractmethod
    def gradient(self, u: Array, points: Array) -> Array:
        """Gradient d u_i / d x_j of the displacement at points, shape (dim, dim, npoints)."""

    @abstractmethod
    def law_at(self, points: Array) -> StressLaw:
        """Stress from strain at points, shape (dim, npoints)."""

    def mean_dilatation(self, u: Array) -> Array | None:
        """Mean div u of each cell, shape (ncells,), with mean dilatation; else None."""
        return None

    def give(self, forces: Array) -> float:
        """Scale of the displacement that the forces would cause; 0 where it is unknown."""
        return 0.0


class BasisSolid(Solid):
    """A `Solid` with a scikit-fem Basis: sparse matrices, scikit-fem's element finder."""

    basis: Basis
    lam: Array
    mu: Array
    nu: Array
    law: StressLaw
    dilatation: str
    _live: tuple[sparse.csr_array, sparse.csr_array, NDArray[np.bool_]] | None = None
    _give: tuple[sparse.csr_array, Array] | None = None
    _portable: PortableBasis
    _ANEW = ("stiffness", "absolute_stiffness", "lengths", "_live", "_give")
    _KEPT: ClassVar[tuple[str, ...]] = ("constraint",)
    _values: NDArray[np.bool_] | None = None
    _slender: bool | None = None

    if TYPE_CHECKING:

        @property
        def mesh(self) -> Mesh:
            """The mesh of the basis."""
            ...

        @property
        def stiffness(self) -> sparse.csr_array:
            """S, all dofs."""
            ...

        @property
        def absolute_stiffness(self) -> sparse.csr_array:
            """|S| entry by entry."""
            ...

        @property
        def constraint(self) -> tuple[sparse.csr_array, Array]:
            """P and u0 of u = P z + u0."""
            ...

        @property
        def lengths(self) -> tuple[Array, Array]:
            """Length of each dof and of each free unknown."""
            ...

    def snapshot(self) -> Self:
        """A copy for a result, which shares the matrices."""
        _ = self.stiffness, self.absolute_stiffness, self.lengths
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
        """The body itself."""
        return self

    def embed(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """The same rows."""
        return matrix

    def live(self, rows: sparse.csr_array) -> NDArray[np.bool_]:
        """Rows that the supports do not fix; see `contact.body.supports.live_rows`."""
        P = self.constraint[0]
        if self._live is None or self._live[0] is not rows or self._live[1] is not P:
            self._live = rows, P, live_rows(rows, P, self.lengths)
        return self._live[2]

    def equilibrium(self, u: Array, contact: Array, load: Array) -> tuple[float, float]:
        """Largest residual force at a free dof, and the largest sum of the terms' moduli there."""
        P, _ = self.constraint
        _, lengths = self.lengths
        force = self.internal(u) + contact - load
        terms = self.absolute_stiffness @ np.abs(u) + np.abs(load)
        return _largest(P.T @ force / lengths), _largest(abs(P.T @ terms) / lengths)

    def give(self, forces: Array) -> float:
        """Largest displacement that one of the forces would cause if all other dofs were fixed."""
        if self._give is None or self._give[0] is not self.stiffness:
            self._give = self.stiffness, self.lengths[0] / self.stiffness.diagonal()
        return _largest(forces * self._give[1])

    @property
    def picked(self) -> sparse.csr_array:
        """E with ``z = E^T (u - u0)``: P itself, because its columns are orthonormal."""
        return self.constraint[0]

    def internal(self, u: Array) -> Array:
        """Internal forces S u, without the mean translation, which would only add rounding.

        Slender cells: from the strains, see `contact.body.cell_strains`.
        """
        if self.slender:
            return internal_forces(self, u)
        at_rest, values = u.copy(), self._are_values
        for c in range(self.dim):
            own = values & (np.arange(u.size) % self.dim == c)
            at_rest[own] -= u[own].mean()
        forces: Array = self.stiffness @ at_rest
        return forces

    @property
    def slender(self) -> bool:
        """Whether cells are too slender to compute forces with the assembled matrix."""
        if self._slender is None:
            self._slender = has_slender_cells(self.mesh)
        return self._slender

    @property
    def _are_values(self) -> NDArray[np.bool_]:
        if self._values is None:
            self._values = value_dofs(self)
        return self._values

    def reach(self, u: Array) -> float:
        """Largest displacement at a node; if all are zero, largest derivative times its length."""
        return _largest(u[self._are_values]) or _largest(self.lengths[0] * u)

    def deformation(self, u: Array) -> float:
        """Largest part of a displacement that no rigid motion explains, in the units of `reach`."""
        lengths = self.lengths[0]
        modes = rigid_modes(self) * lengths[:, None]
        modes /= np.linalg.norm(modes, axis=0)
        motion = np.linalg.lstsq(modes, lengths * u, rcond=None)[0]
        return _largest(lengths * u - modes @ motion)

    def support_error(self, u: Array) -> float:
        """Largest deviation from a prescribed displacement; derivatives are times their length."""
        P, u0 = self.constraint
        return _largest(self.lengths[0] * (u - u0 - P @ (self.picked.T @ (u - u0))))

    def at_supports(self, forces: Array) -> Array:
        """The part of forces on all dofs that acts where a displacement is prescribed."""
        P, _ = self.constraint
        part: Array = forces - self.picked @ (P.T @ forces)
        return part

    def total(self, forces: Array) -> Array:
        """Resultant of forces on all dofs, shape (dim,)."""
        per_piece = self.dim * (self.dim + 1) // 2
        sums = (rigid_modes(self).T @ forces).reshape(-1, per_piece)
        return np.asarray(sums[:, : self.dim].sum(axis=0))

    def mean_dilatation(self, u: Array) -> Array | None:
        """Mean div u of each cell, shape (ncells,), with mean dilatation; else None."""
        if self.dilatation != "mean":
            return None
        divergence = np.trace(np.asarray(self.basis.interpolate(u).grad))
        return np.asarray(np.average(divergence, axis=1, weights=self.basis.dx))

    def displacement(self, u: Array, points: Array) -> Array:
        """Displacement at points, by the element's own interpolation, shape (dim, npoints)."""
        cells = self.cells_of(points)
        return sum(
            (np.asarray(field)[..., 0] * u[dofs] for field, dofs in self._local(points, cells)),
            start=np.zeros((self.dim, points.shape[1])),
        )

    def gradient(self, u: Array, points: Array) -> Array:
        """Gradient d u_i / d x_j of the displacement at points, shape (dim, dim, npoints)."""
        cells = self.cells_of(points)
        return sum(
            (field.grad[..., 0] * u[dofs] for field, dofs in self._local(points, cells)),
            start=np.zeros((self.dim, self.dim, points.shape[1])),
        )

    def law_at(self, points: Array) -> StressLaw:
        """Stress from strain at points, shape (dim, npoints)."""
        return self.law.at(self.cells_of(points))

    def _local(self, points: Array, cells: NDArray[np.int64]) -> Any:
        """Each local basis function at the points, and its dof in the cell of each point."""
        basis = self.basis
        X = places_in(self.mesh, basis.mapping, points, cells)[:, :, None]
        for i in range(basis.Nbfun):
            field = basis.elem.gbasis(basis.mapping, X, i, tind=cells)[0]
            yield field, basis.element_dofs[i, cells]

    def cells_of(self, points: Array) -> NDArray[np.int64]:
        """Number of the cell that each point lies in, shape (npoints,)."""
        return find_cells(self.mesh, points)


def _largest(x: Any) -> float:
    return float(np.abs(x).max(initial=0.0))
