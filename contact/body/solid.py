"""The interface of elastic bodies that contact uses, and their surfaces as obstacles."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.arrays.sparse_rows import transpose
from contact.body.axisymmetry import AXISYMMETRIC, circumference
from contact.body.constitutive import StressLaw, total_stress
from contact.body.supports import unconstrained_rows
from contact.errors import InputError
from contact.portable import Portable
from skfem_adini.ground.arguments import numbers


@dataclass(frozen=True, eq=False)
class Surface:
    """Facets of an elastic body that another body may touch; see `ElasticBody.surface`.

    Attributes
    ----------
    body : Solid
    facets : ndarray of int, shape (n,)
        Numbers of the facets in its mesh.
    clearance : float, callable, ndarray or None
        The gap, if it is not that between the two meshes, as for `Pair`.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.3)
    >>> body.surface("top").facets.size
    4
    """

    body: Any
    facets: NDArray[np.int64]
    clearance: Any = None

    def __repr__(self) -> str:
        return f"Surface({self.facets.size} facets of {self.body!r})"


Array = NDArray[np.float64]


def _no_links(name: str) -> Any:
    def refused(self: Solid, *given: Any, **named: Any) -> None:
        raise InputError(
            f"{name}: a {type(self).__name__} takes no equations between its dofs; use "
            "ElasticBody.from_mesh for the same body with them"
        )

    refused.__name__ = name
    refused.__doc__ = f"""Equations between dofs: for bodies with a mesh, see `ElasticBody.{name}`.

    Raises
    ------
    InputError
        This body takes none.
    """
    return refused


class Solid(Portable, ABC):
    """An elastic body under loads and supports: the interface that contact uses."""

    dim: int
    plane: str | None
    name: str = ""  # in errors and results of several bodies, see `named`
    _f: Array
    _supports: list[Any]
    _couplings: tuple[Any, ...] = ()
    if TYPE_CHECKING:
        stiffness: Any
        constraint: Any
        rigid: Any
        vectors: Any  # its `contact.body.space.Space`
    _material: Any = None
    # Tractions and volume forces in `f`: the method that adds one, its arguments, a factor.
    _applied: tuple[tuple[str, tuple[Any, ...], float], ...] = ()
    thermal: Any = None  # thermal strain, see `contact.body.thermal_strain`
    _FUNCTIONS: ClassVar[tuple[str, ...]] = ("_supports", "_applied")
    _IDENTITY: ClassVar[str] = "basis"  # the attribute that all copies of a body share

    def __repr__(self) -> str:
        element = vars(self).get("element")
        of = f" of {type(element).__name__}" if element is not None else ""
        kind = self.plane if self.is_ring else f"{self.dim}-D"
        return f"{type(self).__name__}({kind}, {self.ndofs} unknowns{of})"

    @property
    def is_ring(self) -> bool:
        """Whether the mesh is the section of an axisymmetric body."""
        return self.plane == AXISYMMETRIC

    @property
    def translations(self) -> NDArray[np.bool_]:
        """The components along which a translation is rigid, shape (dim,)."""
        return np.arange(self.dim) == 1 if self.is_ring else np.ones(self.dim, dtype=bool)

    def depth(self, x: Array) -> Array | float:
        """Factor that turns integrals over the mesh at x (dim, ...) into integrals over the body: 2
        pi r, shape (...), for an axisymmetric body, else 1."""
        return circumference(x) if self.is_ring else 1.0

    @property
    def f(self) -> Array:
        """Load on every dof, shape (ndofs,)."""
        return self._f

    @f.setter
    def f(self, value: Array) -> None:
        self._f, self._applied = self._checked_load(value), ()

    def _checked_load(self, value: Array) -> Array:
        """A copy of a load vector; an `InputError` unless it holds a finite number for each dof."""
        given = numbers("f", value)
        expected = self._f.shape if "_f" in self.__dict__ else given.shape
        if given.shape != expected or given.ndim != 1 or not np.all(np.isfinite(given)):
            raise InputError(
                f"f: expected finite numbers of shape {expected}, one a dof, got shape "
                f"{given.shape}" + ("" if np.all(np.isfinite(given)) else " with NaN or infinity")
            )
        return given

    @property
    def loads(self) -> Array:
        """The load on every dof, read-only, shape (ndofs,)."""
        return self.f

    @property
    def ndofs(self) -> int:
        """Number of dofs."""
        return int(self._f.size)

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
        """Whether two bodies have the same material, or stiffnesses equal up to rounding."""
        if self._material is other._material:
            return True
        S: Any = self.stiffness
        if not isinstance(S, sparse.csr_array):
            return True
        # A body from a file may carry the rounding of another machine.
        return S.shape == other.stiffness.shape and bool(
            abs(S - other.stiffness).max() <= 1e-12 * abs(S).max()
        )

    def named(self, name: str) -> Self:
        """Give the body a name, used in errors and results of several bodies.

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

    periodic, tie, constrain = map(_no_links, ("periodic", "tie", "constrain"))

    @property
    def materials(self) -> tuple[Any, ...]:
        """The material of each of the `bodies`."""
        return (self._material,)

    @property
    def bodies(self) -> tuple[Any, ...]:
        """The bodies that this one consists of: itself, except for `Bodies`."""
        return (self,)

    @property
    def slices(self) -> tuple[slice, ...]:
        """Slice of the dofs of each of the `bodies` among all dofs."""
        return (slice(0, self.ndofs),)

    @property
    def extent(self) -> float:
        """Largest extent along a coordinate axis."""
        return float(np.ptp(self.trace.mesh.p, axis=1).max())

    def number_of(self, body: Any) -> int:
        """Position among the `bodies` of one given as object, copy, number or name; InputError for
        none, or several."""
        bodies = self.bodies
        found = [k for k, own in enumerate(bodies) if own is body]
        if not found and isinstance(body, Solid):
            found = [k for k, own in enumerate(bodies) if own.is_same_body(body)]
        elif isinstance(body, str):
            found = [k for k, own in enumerate(bodies) if own.name == body]
        elif isinstance(body, int | np.integer) and not isinstance(body, bool):
            found = [int(body)] if 0 <= body < len(bodies) else []
        if len(found) != 1:
            known = ", ".join(self.called(k) for k in range(len(bodies)))
            raise InputError(f"body: {body!r} is not one of {known}")
        return found[0]

    def called(self, k: int) -> str:
        """Name of one of the `bodies`, or its number as words."""
        name = self.bodies[k].name
        return repr(name) if name else f"body {k}"

    def is_same_body(self, other: Solid) -> bool:
        """Whether another object is this body, or the same one under other loads."""
        ours, theirs = (vars(body).get(self._IDENTITY) for body in (self, other))
        return other is self or (ours is not None and theirs is ours)

    def describe(self, k: int, motion: str) -> str:
        """Describe a motion of body k for an error message."""
        return motion

    @property
    @abstractmethod
    def trace(self) -> Any:
        """A body with a Basis; its dofs come first in this body and determine the boundary."""

    def embed(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """Rows given on the dofs of `trace`, extended to all dofs of this body."""
        shape = matrix.shape[0], self.ndofs
        return sparse.csr_array((matrix.data, matrix.indices, matrix.indptr), shape=shape)

    def unconstrained(self, rows: sparse.csr_array) -> NDArray[np.bool_]:
        """Rows that the supports do not fix; see `contact.body.supports.unconstrained_rows`."""
        own = sparse.csr_array(rows[:, : self.trace.ndofs])
        return unconstrained_rows(own, self.trace.constraint[0], self.trace.lengths)

    def forces_on(self, u: Any) -> Any:
        """S u on the own dofs, without mean translations, which would only add rounding."""
        return self.vectors.forces(u)

    def moduli_on(self, u: Any) -> Any:
        """``|S| |u|`` on the own dofs, the scale of residuals."""
        return self.vectors.moduli(u)

    def internal(self, u: Any) -> Any:
        """Internal forces S u on the device of u (read-only)."""
        return self.vectors.returned(self.forces_on(self.placed(u)), u)

    def know(self, u: Array, forces: Array) -> None:
        """Take S u of a displacement, known from those of others, for the next calls."""
        for body, own in zip(self.bodies, self.slices, strict=True):
            body.vectors.know(u[own], forces[own], body.slender)

    def equilibrium(
        self, u: Any, contact: Any, load: Any, moduli: Any = None
    ) -> tuple[float, float]:
        """Largest residual force at a free dof, and the largest sum of the terms' moduli there, of
        vectors (ndofs,). `contact` has the opposite sign; `moduli` are by default those of the
        load, see `ContactSystem`."""
        space, u = self.vectors, self.placed(u)
        load = space.own(load)
        forces = self.forces_on(u) + space.own(contact) - load
        terms = self.moduli_on(u) + (abs(load) if moduli is None else space.own(moduli))
        return (
            space.largest(space.transposed @ forces / space.free_lengths),
            space.largest(space.of_moduli @ terms / space.free_lengths),
        )

    def local_displacement(self, forces: Any) -> float:
        """Largest displacement that one of the forces would cause if all other dofs were fixed."""
        space = self.vectors
        return float(space.largest(space.own(forces) * space.lengths / space.diagonal))

    def largest_displacement(self, u: Any) -> float:
        """Largest displacement at a node; if all are zero, largest derivative times its length."""
        space = self.vectors
        own = space.own(u)
        at_nodes = space.largest(space.arrays.xp.where(space.values, own, 0.0))
        return float(at_nodes or space.largest(space.lengths * own))

    def deformation(self, u: Any) -> float:
        """Largest component of a displacement after removing rigid motions, scaled as in
        `largest_displacement`."""
        space = self.vectors
        return float(space.largest(space.strained(space.lengths * space.own(u), self.rigid)))

    def support_error(self, u: Any) -> float:
        """Largest deviation from a prescribed displacement; derivatives are scaled by their
        length."""
        space = self.vectors
        off = space.own(u) - space.own(self.constraint[1])
        return float(space.largest(space.lengths * (off - space.P @ (space.picks @ off))))

    def at_supports(self, forces: Any) -> Any:
        """The part of forces on all dofs that acts where a displacement is prescribed."""
        space = self.vectors
        own = space.own(forces)
        return space.returned(own - space.picked @ (space.transposed @ own), forces)

    def total(self, forces: Any) -> Array:
        """Resultant of forces on all dofs, shape (dim,); in a ring only the axial component."""
        space = self.vectors
        return np.asarray(space.resultant(space.own(forces)))

    def placed(self, v: Any) -> Any:
        """Move a vector of all dofs to the device on which the body computes."""
        return v

    def contact_forces(self, rows: Any, mu: Array, t: Array) -> Any:
        """``G^T mu + T^T t`` on all dofs, from `ContactRows`, on the device of the body."""
        return transpose(rows.G) @ mu + transpose(rows.T) @ t.ravel()

    def at_points(self, rows: sparse.csr_array, u: Any) -> Array:
        """Product of contact rows, shape (n, ndofs), and a displacement, on the device of u."""
        return np.asarray(rows @ u)

    def in_unknowns(self, rows: sparse.csr_array) -> sparse.csr_array:
        """Rows on all dofs, restricted to the free unknowns."""
        own: Any = self
        return sparse.csr_array(rows @ own.constraint[0])

    def dot(self, a: Array, b: Array) -> float:
        """Inner product of two vectors of all dofs."""
        return float(a @ b)

    @abstractmethod
    def displacement(self, u: Array, points: Array) -> Array:
        """Displacement at points, by the element's own interpolation, shape (dim, npoints)."""

    @abstractmethod
    def gradient(self, u: Array, points: Array) -> Array:
        """Gradient d u_i / d x_j of the displacement at points, shape (dim, dim, npoints); of an
        axisymmetric body in the axes r, z, theta, (3, 3, npoints)."""

    @abstractmethod
    def law_at(self, points: Array) -> StressLaw:
        """`StressLaw` of the cells that hold the points, shape (dim, npoints)."""

    def stress_at(self, u: Array, points: Array) -> Array:
        """Cauchy stress at points, shape (dim, dim, npoints)."""
        gradient, strain = self.gradient(u, points), self.thermal_strain_at(points)
        mean = self.mean_dilatation_at(u, points)
        return total_stress(self.law_at(points), gradient, mean, strain)

    def mean_dilatation_at(self, u: Array, points: Array) -> Array | None:
        """Mean div u of the cell of each point, with mean dilatation; else None."""
        return None

    def support_motion(self, boundary: Any, components: Any, value: Any) -> Array:
        """Displacement of all dofs prescribed by one support, with the others zero; InputError if
        there is none, or its motion contradicts another one."""
        return motion_of_support(self, boundary, components, value)

    def mean_dilatation(self, u: Array) -> Array | None:
        """Mean div u of each cell, shape (ncells,), with mean dilatation; else None."""
        return None

    def thermal_strain_at(self, points: Array) -> Array | None:
        """Thermal strain at points, shape (3, 3, npoints); None if the body was not heated."""
        return None


def motion_of_support(held: Any, boundary: Any, components: Any, value: Any) -> Array:
    """Displacement of all dofs if the support on a boundary prescribed this value.
    The body must be fixed there; boundary, components and value are as for `ElasticBody.fix`."""
    at_rest = copy(held)
    at_rest._supports = []
    at_rest.fix(boundary, components, value)  # checks the value
    moved = at_rest._supports
    for place, c, *_ in moved:
        if not any(c == d and np.array_equal(place, f) for f, d, *_ in held._supports):
            raise InputError(
                f"move: the body is not fixed on boundary {boundary!r} in component "
                f"{'xyz'[c]}; fix it first, with body.fix({boundary!r}, ...)"
            )
    at_rest._couplings = tuple(each.at_rest() for each in held._couplings)
    at_rest._supports = [
        next(
            ((f, c, m[2], *how) for m in moved if m[1] == c and np.array_equal(m[0], f)),
            (f, c, _still, *how),
        )
        for f, c, _, *how in held._supports
    ]
    for derived in ("constraint", "prescribed"):
        at_rest.__dict__.pop(derived, None)
    found: Array = at_rest.constraint[1]
    return found


def _still(x: Array) -> Array:
    return np.zeros(x.shape[1:])
