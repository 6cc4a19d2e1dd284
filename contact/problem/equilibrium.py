"""Errors for loads that no contact forces balance, and for motions that loads do not determine."""

from __future__ import annotations

import numpy as np

from contact.body.free_motions import not_held, strained_by_rotation
from contact.condensation.boundary_problem import Array, BoundaryProblem
from contact.condensation.condensed_contact import CondensedContact
from contact.errors import Unbounded
from contact.laws.friction import Friction
from contact.laws.load_balance import LIMIT, at_the_limit, by_friction_alone


def driven(condensed: CondensedContact, a: Array) -> Unbounded:
    """The error for a motion a that the loads drive and no contact forces resist."""
    if condensed.moves_obstacle(a):
        return Unbounded(
            "the obstacle is not held: contact forces cannot balance the force or moment given "
            "to its `Rigid`; hold a component of its motion, turn the force towards the body, "
            "or add friction",
            np.zeros_like(condensed.body.f),
        )
    return not_held(condensed.body, *condensed.rigid_motion(a))


def undetermined(condensed: CondensedContact, a: Array) -> Unbounded:
    """The error for a rigid motion a at the limit of friction, whose size is undetermined."""
    name, u = condensed.rigid_motion(a)
    return Unbounded(
        f"the slip is undetermined: the loads are within {LIMIT:.0e} of the limit of what "
        f"friction holds, and {name} may go on for ever; load less, add friction or a support",
        u / (np.abs(u).max() or 1.0),
    )


def doubt(condensed: CondensedContact, problem: BoundaryProblem, friction: Friction | None) -> str:
    """A possible reason why no solution was found: the end of an error message, or empty.
    Raises Unbounded where the loads are at the limit of what friction holds."""
    limit, a = at_the_limit(problem, friction), by_friction_alone(problem)
    if limit is not None:
        raise undetermined(condensed, limit)
    if a is None or condensed.moves_obstacle(a):
        bodies = condensed.body.bodies
        return next(filter(None, (strained_by_rotation(body.trace) for body in bodies)), "")
    return (
        f"; or there is no equilibrium: {condensed.rigid_motion(a)[0]} is driven by "
        "the loads, friction alone resists it, and the pressure may be too small for that"
    )
