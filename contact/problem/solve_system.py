"""One discrete system, solved on a condensation of its body and certified."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from contact.arrays.blas_threads import one_blas_thread
from contact.body.basis_solid import BasisSolid
from contact.body.free_motions import not_held, strained_by_rotation
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.condensation.condensed_contact import CondensedContact
from contact.errors import Infeasible, NoEquilibrium, NotConverged, Unbounded
from contact.laws.friction import Friction
from contact.laws.iteration import Iteration, Report
from contact.laws.load_balance import BALANCE, at_the_limit, by_friction_alone, undetermined_slip
from contact.laws.methods import solve_boundary
from contact.laws.options import Options
from contact.problem.nested_start import start_forces
from contact.problem.stiffness_form import fits, refined, solved_stiffly
from contact.result.certify import certify, take_strains
from contact.result.contact_result import ContactResult
from contact.result.contact_system import ContactState, ContactSystem

Array = NDArray[np.float64]
RESERVE = 0.1  # refine displacements if the imbalance exceeds this part of the tolerance


def solve_system(
    system: ContactSystem,
    condensed: CondensedContact,
    options: Options,
    start: ContactResult | None,
    report: Report = lambda line: None,
) -> ContactResult:
    """Solve one system on a condensation of its body and certify it.
    `report` takes each `Iteration`; errors as of `ContactProblem.solve`."""
    history: list[Iteration] = []

    def keep(line: Iteration) -> None:
        history.append(line)
        report(line)

    with condensed.blas_threads():
        return _solved(system, condensed, options, start, keep, history)


def _solved(
    system: ContactSystem,
    condensed: CondensedContact,
    options: Options,
    start: ContactResult | None,
    report: Report,
    history: list[Iteration],
) -> ContactResult:
    scale = condensed.point_scale
    friction = system.scaled_friction(scale)
    # Layers have no assembled stiffness matrix.
    whole = all(isinstance(body, BasisSolid) for body in system.body.bodies)

    def solved(
        load: Array, warm: ContactResult | Forces | None, line: Report, s: Array | None = None
    ) -> _Solution:
        boundary = _boundary_problem(system, condensed, load)
        boundary = boundary if s is None else replace(boundary, s=s)
        if isinstance(warm, ContactResult):
            warm = start_forces(warm, system, boundary, scale)
        with one_blas_thread(condensed.size):
            forces, slack = solve_boundary(boundary, friction, options, warm, scale, line)
        endless = undetermined_slip(boundary, friction, forces.mu, forces.t)
        if endless is not None:
            raise undetermined(condensed, endless)
        return _Solution(forces, slack, condensed.recover(load, boundary, forces), boundary.s)

    load = condensed.placed(system.load)
    try:
        found = solved(load, start, report)
        forces, slack, state, _ = _refined(found, system, condensed, load, options.tol, solved)
    except Infeasible as error:
        if error.certificate is None:
            raise
        raise driven(condensed, error.certificate) from error
    except NoEquilibrium as error:
        raise NoEquilibrium(str(error), tuple(history)) from error
    except NotConverged as error:
        slender = whole and (condensed.thin or condensed.slender)
        if slender and options.max_iterations >= 50:  # otherwise the limit may be why it failed
            with suppress(NotConverged, LinAlgError):
                return solved_stiffly(system, condensed, options, None, report, history)
        more = doubt(condensed, _boundary_problem(system, condensed, system.load), friction)
        raise NotConverged(f"{error}{more}", tuple(history)) from error
    (u, mu, t), motion = state, condensed.obstacle_motion(system.motion, forces)
    t = system.with_held_points(u, mu, t, motion)
    answer = ContactState(  # displacements stay on their device
        system, u, mu, t, options.method, tuple(history), motion, options.tol, slack
    )
    result = ContactResult(**vars(replace(answer, u=condensed.fetched(u))))
    stiff = ("newton", "pdas", "tresca_loop")  # methods that may take the stiffness form
    if condensed.slender and fits(condensed) and options.method in stiff:
        return refined(system, condensed, options, result, report, history)
    try:
        certify(answer, options.tol, slack)
    except NotConverged:
        if whole and options.method in stiff:
            for _ in range(2):
                with suppress(NotConverged, LinAlgError):
                    return solved_stiffly(system, condensed, options, result, report, history)
                if not take_strains(system.body):
                    break
        raise
    result.keep_facts_of_many()
    return result


class _Solution(NamedTuple):
    """Forces of the boundary problem, violation of the laws, (u, mu, t), and the loads balanced."""

    forces: Forces
    slack: float
    state: tuple[Any, Array, Array]
    s: Array


def _refined(
    found: _Solution,
    system: ContactSystem,
    condensed: CondensedContact,
    load: Array,
    tol: float,
    solved: Callable[..., _Solution],
) -> _Solution:
    """The solution after one step of iterative refinement, where that is needed and helps.
    Its contact forces balance the given loads; residual loads add up to rounding."""
    always = condensed.always_refined
    before = np.inf if always else system.balance(*found.state)
    rest = condensed.unbalanced(load, *found.state) if before > RESERVE * tol else None
    if rest is None:
        return found
    with suppress(NotConverged):
        better = solved(load + rest, found.forces, lambda line: None, found.s)
        if always or system.balance(*better.state) < before:
            return better
    return found


def _boundary_problem(
    system: ContactSystem, condensed: CondensedContact, load: Array
) -> BoundaryProblem:
    problem = condensed.boundary_problem(load, system.rows.gap, system.slip_from, system.motion)
    return replace(problem, compliance=system.compliance(condensed.point_scale))


def driven(condensed: CondensedContact, a: Array) -> Unbounded:
    """The error for a motion a driven by the loads that contact forces cannot balance."""
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
        f"the slip is undetermined: the loads are within {BALANCE.limit:.0e} of the limit of what "
        f"friction holds, and {name} may go on for ever; load less, add friction or a support",
        u / (np.abs(u).max() or 1.0),
    )


def doubt(condensed: CondensedContact, problem: BoundaryProblem, friction: Friction | None) -> str:
    """A possible reason why no solution was found: the end of an error message, or empty.
    Raises Unbounded if the loads are at the limit of friction."""
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
