"""Pairs of boundaries that may touch, and boundaries that are tied."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from contact.body.several_bodies import Bodies
from contact.body.solid import Solid, Surface
from contact.errors import InputError, warn
from contact.portable import carried
from skfem_adini.ground.arguments import choice


@dataclass(frozen=True, eq=False)
class Pair:
    """A boundary that may touch a boundary of another body, or a rigid obstacle.

    Parameters
    ----------
    body : Solid
        It carries the multipliers: contact points lie on its boundary (the non-mortar side).
    boundary : str, list of str, array of facet numbers or CutArc
    opposite : Solid, Surface or obstacle
        The other body; or a surface of it; or a rigid obstacle, see `contact.obstacles.shapes`.
    other : str, list of str or array of facet numbers, optional
        The boundary of the other body; left out for a surface or an obstacle.
    friction : float, callable x -> array, or ndarray of shape (m,)
        As for `ContactProblem`.
    functional : {None, "standard", "hat"}, optional
        Multipliers between two bodies: dual by default, see `contact.rows.mortar.multipliers`. For
        a
        rigid obstacle: as for `ContactProblem`.
    clearance : float, callable x -> array, or ndarray of shape (m,), optional
        The gap between two bodies along the normals, if known better than from the meshes, whose
        facets
        may miss a curve by more than an interference. Default: measured between the meshes.
    multipliers : {"first", "second"}
        Which of two bodies carries the multipliers. The one with the finer mesh, or the softer one,
        is the better choice.

    Raises
    ------
    InputError
        No body, or an argument that does not fit the others.

    References
    ----------
    B. I. Wohlmuth, A mortar finite element method using dual spaces for the Lagrange multiplier,
    SIAM J. Numer. Anal. 38 (2000), 989-1012.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, Pair
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> lower = ElasticBody.from_mesh(mesh, E=1.0, nu=0.3).fix("bottom", "xy")
    >>> above = mesh.translated((0.0, 1.0)).refined(1).with_defaults()
    >>> upper = ElasticBody.from_mesh(above, E=2.0, nu=0.3).load("top", (0.0, -0.1))
    >>> pair = Pair(upper.fix("left", "x"), "bottom", lower, "top", friction=0.3)
    >>> result = ContactProblem([upper, lower], [pair]).solve()
    >>> round(float(result.resultant[1]), 6)
    0.1
    """

    body: Any
    boundary: Any
    opposite: Any
    other: Any = None
    friction: Any = 0.0
    functional: Any = None
    clearance: Any = None
    multipliers: str = "first"

    def __post_init__(self) -> None:
        kind = type(self).__name__
        if not isinstance(self.body, Solid):
            raise InputError(f"{kind}: expected a body first, got {type(self.body).__name__}")
        choice("multipliers", self.multipliers, ("first", "second"))
        if isinstance(self.opposite, Solid):
            if self.other is None:
                raise InputError(f"{kind}: name the boundary of the other body as well")
            try:
                surface = self.opposite.surface(self.other, clearance=self.clearance)
            except InputError as error:
                whose = f" of {self.opposite.name!r}" if self.opposite.name else ""
                raise InputError(f"other{whose}: {error}") from error
            object.__setattr__(self, "opposite", surface)
        elif self.other is not None:
            raise InputError(
                f"{kind}: other={self.other!r} is the boundary of a body, but "
                f"{type(self.opposite).__name__} is none"
            )
        elif isinstance(self.opposite, Surface):
            if self.clearance is not None:
                surface = replace(self.opposite, clearance=self.clearance)
                object.__setattr__(self, "opposite", surface)
        elif self.clearance is not None or self.multipliers == "second":
            raise InputError(
                f"{kind}: clearance and multipliers are for two bodies; a rigid obstacle may be a "
                "number or a callable, the gap itself"
            )

    def __getstate__(self) -> dict[str, Any]:
        return {name: carried(value) for name, value in vars(self).items()}

    @property
    def two_bodies(self) -> bool:
        """Whether the opposite side is elastic."""
        return isinstance(self.opposite, Surface)


@dataclass(frozen=True, eq=False)
class Tie(Pair):
    """Two boundaries that are bonded: they neither part nor slip, whatever the forces.

    Meshes need not match. A gap between them stays as it is; a clearance, if given, is closed.

    Parameters
    ----------
    body, boundary, opposite, other, clearance, multipliers
        As for `Pair`; the opposite side is elastic.
    friction : float
        0, because nothing slips.
    functional : {None, "dual", "standard", "hat"}, optional
        Standard multipliers by default in the plane, where they keep the order of the elements;
        dual ones in space.

    Raises
    ------
    InputError
        A rigid obstacle, or friction.

    References
    ----------
    C. Bernardi, Y. Maday and A. T. Patera, A new nonconforming approach to domain decomposition:
    the mortar element method, in: Nonlinear Partial Differential Equations and their Applications,
    Pitman 1994.

    Examples
    --------
    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, Tie
    >>> mesh = MeshQuad().refined(2).with_defaults()
    >>> lower = ElasticBody.from_mesh(mesh, E=1.0, nu=0.0).fix("bottom", "xy")
    >>> above = mesh.translated((0.0, 1.0)).refined(1).with_defaults()
    >>> upper = ElasticBody.from_mesh(above, E=1.0, nu=0.0).load("top", (0.0, 0.1))
    >>> result = ContactProblem([upper, lower], [Tie(upper, "bottom", lower, "top")]).solve()
    >>> round(float(result[upper].sample([[0.5], [2.0]])[1, 0]), 6)
    0.2
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.two_bodies:
            raise InputError("Tie: expected two bodies; `fix` holds a boundary of one")
        if not (isinstance(self.friction, int | float) and self.friction == 0.0):
            raise InputError("friction: tied boundaries do not slip")


def between(
    body: Solid, boundary: Any, obstacle: Any, functional: Any
) -> tuple[Solid, tuple[Pair, ...]]:
    """Bodies and pairs of a problem given by a body and obstacles; no pairs if all are rigid.
    Raises InputError for lists of different lengths."""
    several = isinstance(obstacle, list | tuple)
    obstacles = list(obstacle) if several else [obstacle]
    if not any(isinstance(one, Surface) for one in obstacles):
        return body, ()
    boundaries = list(boundary) if several else [boundary]
    if len(boundaries) != len(obstacles):
        raise InputError(f"obstacle: {len(obstacles)} obstacles for {len(boundaries)} boundaries")
    given = isinstance(functional, list | tuple)
    forms = list(functional) if given else [functional] * len(obstacles)
    if len(forms) != len(obstacles):
        raise InputError(f"functional: {len(forms)} given for {len(obstacles)} boundaries")
    pairs = [
        Pair(body, place, one, functional=form)
        for place, one, form in zip(boundaries, obstacles, forms, strict=True)
    ]
    bodies = [body, *(pair.opposite.body for pair in pairs if pair.two_bodies)]
    together = Bodies(list({id(one): one for one in bodies}.values()))
    _warn_of_planes(together)
    return together, tuple(pairs)


def _warn_of_planes(bodies: Bodies) -> None:
    """Warn if some bodies are in plane stress and others in plane strain."""
    if {"strain", "stress"} <= {body.plane for body in bodies.bodies}:
        said = [f"{bodies.called(k)} in plane {b.plane}" for k, b in enumerate(bodies.bodies)]
        warn(
            f"bodies: {', '.join(said)}; each is taken to be one unit thick. Give all of them the "
            "same plane= unless this is meant"
        )


def given_pairs(
    bodies: Any, pairs: Any, obstacle: Any, functional: Any
) -> tuple[Bodies, tuple[Pair, ...]]:
    """Bodies and pairs of a problem given by lists of them, checked.
    Raises InputError for malformed lists, or arguments that belong in the pairs."""
    if not isinstance(bodies, list | tuple):
        raise InputError(
            "body: expected an ElasticBody, a LayeredBlock or a CutBody, or a list of them, got "
            f"{type(bodies).__name__}"
        )
    together = Bodies(bodies)
    if not isinstance(pairs, list | tuple) or not all(isinstance(one, Pair) for one in pairs):
        raise InputError("boundary: expected a list of Pair and Tie beside a list of bodies")
    if not pairs:
        raise InputError("boundary: no Pair and no Tie is given")
    for name, value in (("obstacle", obstacle), ("functional", functional)):
        if value is not None:
            raise InputError(f"{name}: give it to the pairs, Pair(body, boundary, obstacle)")
    touched = set()
    for pair in pairs:
        touched.add(together.number_of(pair.body))
        if pair.two_bodies:
            touched.add(together.number_of(pair.opposite.body))
    left = sorted(set(range(len(bodies))) - touched)
    if left:
        raise InputError(f"bodies: {together.called(left[0])} belongs to no pair")
    _warn_of_planes(together)
    return together, tuple(pairs)
