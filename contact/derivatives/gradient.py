"""Gradients of a function of a result by the data of its problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.body.distributed_body import DistributedBody
from contact.condensation.condensed_contact import CondensedContact
from contact.derivatives.adjoint import Adjoint, Cotangents, adjoint
from contact.derivatives.of_cells import by_moduli, refuse_body
from contact.derivatives.of_places import by_places, by_pose
from contact.errors import InputError, warn
from skfem_adini.ground.arguments import finite_numbers

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyGradient:
    """The part of a `ContactGradient` that belongs to one body, ``gradient[body]``.

    Attributes
    ----------
    body : Solid
    load, support : ndarray, shape (ndofs,)
        As those of `ContactGradient`, on the dofs of the body.
    whole : ContactGradient
    number : int
        Of the body.

    References
    ----------
    K. Ito and K. Kunisch, Lagrange Multiplier Approach to Variational Problems and Applications,
    SIAM 2008, chapter 8.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.0)
    >>> problem = ContactProblem(body.fix("top", "y", -0.1).fix("left", "x"), "bottom", 0.0)
    >>> gradient = problem.solve().vjp(resultant=(0.0, 1.0))
    >>> round(float(gradient[body].E), 9)
    0.1
    """

    body: Any
    load: Array
    support: Array
    whole: ContactGradient
    number: int

    @cached_property
    def _moduli(self) -> tuple[Array, Array]:
        own = self.whole.result.solid.slices[self.number]
        return by_moduli(self.body, self.whole.result.u[own], self.load)

    @property
    def E(self) -> Array:
        """By Young's modulus, in its shape: () or (ncells,)."""
        return self._moduli[0]

    @property
    def nu(self) -> Array:
        """By Poisson's ratio, in its shape: () or (ncells,)."""
        return self._moduli[1]

    @property
    def vertices(self) -> Array:
        """By the places of the mesh's nodes, the shape of ``mesh.doflocs``."""
        return self.whole._vertices[self.number]


@dataclass(frozen=True, eq=False)
class ContactGradient:
    """Gradients of a function of a result; what `ContactResult.vjp` returns.

    Attributes
    ----------
    result : ContactResult
    adjoint : Adjoint
        The solution of the transposed system.
    cotangents : Cotangents
        The derivatives of the function, as given.
    problem : ContactProblem or None
        For `vertices` and `pose`.

    References
    ----------
    K. Ito and K. Kunisch, Lagrange Multiplier Approach to Variational Problems and Applications,
    SIAM 2008, chapter 8.

    Examples
    --------
    The force of a column that is compressed by .1 is .1 E:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody
    >>> body = ElasticBody.from_mesh(MeshQuad().refined(2).with_defaults(), E=1.0, nu=0.0)
    >>> problem = ContactProblem(body.fix("top", "y", -0.1).fix("left", "x"), "bottom", 0.0)
    >>> gradient = problem.solve().vjp(resultant=(0.0, 1.0))
    >>> round(float(gradient.E), 9), round(float(gradient.gap.sum()), 9)
    (0.1, -1.0)
    """

    result: Any
    adjoint: Adjoint
    cotangents: Cotangents
    problem: Any = None

    def __repr__(self) -> str:
        weak = int(self.degenerate.sum())
        return f"ContactGradient({self.result!r}; {weak} degenerate points)"

    @property
    def load(self) -> Array:
        """By the load on every dof, ``body.f``, shape (ndofs,): the adjoint displacement."""
        return self.adjoint.load

    @property
    def support(self) -> Array:
        """By the prescribed displacement of every dof, zero at free ones, shape (ndofs,)."""
        return self.adjoint.support

    @property
    def gap(self) -> Array:
        """By the gap of every contact point, shape (m,)."""
        return -self.adjoint.normal

    @property
    def friction(self) -> Array:
        """By `ContactProblem.friction`, coefficient or bound, of every point, shape (m,)."""
        rows = self.result.system.rows
        of_bound = rows.weights if self.result.system.law == "tresca" else 1.0
        return np.asarray(self.adjoint.friction * of_bound)

    @property
    def motion(self) -> Array:
        """By the prescribed motions of `Rigid` obstacles, zero for free ones, shape (k,)."""
        return self.adjoint.motion

    @property
    def force(self) -> Array:
        """By the forces and moments on `Rigid` obstacles, zero if there are none, shape (k,)."""
        return self.adjoint.force

    @property
    def slip_from(self) -> Array:
        """By the slip of the last step of a history, shape (m, dim - 1)."""
        free = ~self.result.system.rows.ties
        return np.asarray(-self.adjoint.tangent * free[:, None])

    def memory(self) -> dict[str, Array]:
        """Gradients by what the step of a history takes from the one before, by its name."""
        result = self.result
        if result.origin is not None and result.origin.slide is not None:
            return dict(result.origin.slide.memory(result.system, -self.slip_from))
        return {"slip": self.slip_from}

    @property
    def travel(self) -> Array:
        """By the tangential path of obstacles' shapes at the points, shape (m, dim - 1)."""
        return np.asarray(-self.adjoint.tangent - self.cotangents.slip)

    @property
    def degenerate(self) -> NDArray[np.bool_]:
        """Points that touch without force, or stick at the bound of friction, shape (m,).

        There the gradients are those of one side.
        """
        return self.adjoint.degenerate

    def __getitem__(self, body: Any) -> BodyGradient:
        """The part that belongs to a body: the body, its number, or its name.

        Raises
        ------
        InputError
            No such body.
        """
        solid = self.result.solid
        k = solid.number_of(body)
        own = solid.slices[k]
        return BodyGradient(solid.bodies[k], self.load[own], self.support[own], self, k)

    @cached_property
    def _single(self) -> BodyGradient:
        if len(self.result.solid.bodies) > 1:
            raise InputError("gradient: there are several bodies; choose one, gradient[body].E")
        return self[0]

    @property
    def E(self) -> Array:
        """By Young's modulus of the body, in its shape: () or (ncells,)."""
        return self._single.E

    @property
    def nu(self) -> Array:
        """By Poisson's ratio of the body, in its shape: () or (ncells,)."""
        return self._single.nu

    @property
    def vertices(self) -> Array:
        """By the places of the mesh's nodes, the shape of ``mesh.doflocs``.

        Tractions, volume forces and functions of places follow the mesh; forces assigned to
        ``body.f`` and gaps and friction given as arrays stay. Zero across the axis of a ring.
        """
        return self._single.vertices

    @cached_property
    def _vertices(self) -> list[Array]:
        return vertices_of([self])

    def pose(self, centre: ArrayLike | None = None) -> Array:
        """By small motions of the obstacles' shapes, at the place where they are.

        Parameters
        ----------
        centre : array, shape (dim,), optional
            Of the rotations. Default: the origin.

        Returns
        -------
        ndarray, shape (nboundaries, dim (dim + 1) / 2)
            Translations, then rotations, by the gap alone: friction counts no path of the obstacle.

        Raises
        ------
        InputError
            A gap that is no shape; a result from a file or a copy.
        """
        dim = self.result.solid.dim
        about = np.zeros(dim) if centre is None else finite_numbers("centre", centre, (dim,))
        sides = self._posed("pose").boundaries
        return by_pose(sides, self.result.system.obstacle, self.gap, about)

    def _posed(self, name: str) -> Any:
        if self.problem is None:
            raise InputError(
                f"{name}: needs the ContactProblem with its functions of places, which a result "
                "from a file or a copy or of finite sliding has not, or whose arrays were changed; "
                "solve again"
            )
        return self.problem


def vertices_of(steps: Sequence[ContactGradient]) -> list[Array]:
    """Sum of the gradients of steps by the nodes of each body; rows are made once for all."""
    problem, solid = steps[0]._posed("vertices"), steps[0].result.solid
    for body in solid.bodies:
        refuse_body(body, "vertices")
    for step in steps:
        motion = step.result.system.motion
        if motion is not None and motion.travel is not None:
            raise InputError("vertices: the path of obstacles that are moved depends on places too")
    return by_places(steps, problem)


def gradient(result: Any, problem: Any, given: dict[str, Any]) -> ContactGradient:
    """Gradients of the function with the derivatives `given`; see `ContactResult.vjp`."""
    cotangents = Cotangents.checked(result, given)
    origin, rows = result.origin, result.system.rows
    # For what depends on functions of places: a result from a file has none.
    posed = None if origin is None or origin.posed is None else problem or origin.posed
    if posed is not None and not (
        _same_rows(posed.rows, rows) and _same_friction(result.system, posed)
    ):
        posed = None
    if problem is None and origin is not None:
        problem = origin.problem
    found = adjoint(result, condensation(result, problem), cotangents)
    return ContactGradient(result, found, cotangents, posed)


def _same_friction(system: Any, problem: Any) -> bool:
    if problem.law != system.law:
        return False
    of_bound = system.rows.weights if system.law == "tresca" else 1.0
    return np.array_equal(problem.friction * of_bound, system.friction)


def condensation(result: Any, problem: Any) -> CondensedContact:
    """The factors of a result's bodies, those of its problem where they are still right."""
    system, origin = result.system, result.origin
    if any(isinstance(one, DistributedBody) for one in system.body.bodies):
        raise InputError("vjp: a DistributedBody has no derivatives; take ElasticBody.from_mesh")
    if origin is not None and origin.slide is not None:
        return cast(CondensedContact, origin.slide.condensed(system))
    if system.surface is not None:
        raise InputError(
            "vjp: adhesion, hardness and wear have no gradients; ask for those of a problem without"
        )
    if problem is not None and not _same_rows(problem.rows, system.rows):
        problem = None
    if system.moduli is not None:
        raise InputError("vjp: steps in time with inertia have no gradients; take LoadStepper")
    condensed: Any = None if problem is None else problem.kept_condensation(system.body)
    if condensed is None:
        condensed = CondensedContact(system.body, system.rows)
    if not isinstance(condensed, CondensedContact) or not condensed.on_host:
        raise InputError(
            "vjp: the problem was condensed on a device, whose factors have no derivatives here; "
            "take problem.condense(device='cpu') and solve again"
        )
    return condensed


def _same_rows(one: Any, other: Any) -> bool:
    if one.G is other.G and one.T is other.T:
        return True
    if one.G.shape != other.G.shape or one.T.shape != other.T.shape:
        return False
    pairs = (one.G, other.G), (one.T, other.T)
    # Rounding of a file from another machine.
    return all(abs(a - b).max() <= 1e-12 * abs(a).max() for a, b in pairs)


def warn_of(degenerate: NDArray[np.bool_]) -> None:
    """Warn if some points are degenerate."""
    if degenerate.any():
        warn(
            f"vjp: {int(degenerate.sum())} contact points touch without force or stick at the "
            "bound of friction (see `degenerate`): the gradients are those of one side there"
        )
