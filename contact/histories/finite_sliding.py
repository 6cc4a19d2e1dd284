r"""Steps in which bodies of small strain slide by more than a facet.

The contact rows depend on the displacement: in a step they are projected anew, at the places
:math:`x + u` of the last iterate, until the displacement does not change any more. The first of
these problems in a step is one of small sliding, on the same sparse factorisation of each body,
because all dofs of both boundaries were kept. In the plane, and unless a body floats, the others
are steps of Newton's method with the derivative of the projection, see
`contact.histories.sliding_newton`. The slip that friction opposes is the part of the step's
displacement along the present tangents. A result has the rows of its own displacement, and so has
its certificate.

References
----------
P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapters 4 and 9.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from contact.body.basis_solid import BasisSolid
from contact.condensation.condensed_contact import CondensedContact
from contact.errors import InputError, NotConverged, numbers
from contact.histories.rotations import refuse_large_rotations
from contact.histories.sliding_newton import newton_step
from contact.laws.iteration import Iteration
from contact.laws.status import Status
from contact.obstacles.rigid import ObstacleMotion
from contact.obstacles.rigid_motion import same_gaps
from contact.result.certify import certify
from contact.result.contact_result import ContactResult
from contact.result.contact_system import ContactSystem
from contact.rows.contact_boundaries import ContactBoundaries
from contact.rows.contact_rows import ContactRows
from contact.rows.interfaces import Interfaces

if TYPE_CHECKING:
    from contact.laws.options import Options
    from contact.problem.contact_problem import ContactProblem

Array = NDArray[np.float64]

PROJECTIONS = 30  # at most, in one step
SMALL_ANGLE = 0.1  # radians: small strains are then off by 5e-3
# Change of the displacement, relative to the largest, at which a step ends, over the tolerance.
SETTLED = 1e-2


class FiniteSliding:
    """Solves the steps of a history in which the bodies of a problem slide.

    Parameters
    ----------
    problem : ContactProblem
    largest_rotation : float or None
        Angle in radians; default: `SMALL_ANGLE`.

    Raises
    ------
    InputError
        A problem without two bodies that touch, or one whose clearance is given; an angle that is
        none.
    """

    def __init__(self, problem: ContactProblem, largest_rotation: float | None = None) -> None:
        interfaces = problem.boundaries
        if not isinstance(interfaces, Interfaces):
            raise InputError(
                "sliding: finite sliding is that of elastic bodies on each other; a problem with a "
                "rigid obstacle alone has none"
            )
        if any(pair.two_bodies and pair.opposite.clearance is not None for pair in problem.pairs):
            raise InputError(
                "clearance: in finite sliding the gap is that between the meshes where the bodies "
                "are; leave clearance out"
            )
        for side in interfaces.sides:
            if isinstance(side, ContactBoundaries):
                continue
            for k in {interfaces.bodies.number_of_trace(o.body) for o in (side.first, side.second)}:
                body = interfaces.bodies.bodies[k]
                if not isinstance(body, BasisSolid):
                    raise InputError(
                        f"sliding: {interfaces.bodies.called(k)} is a {type(body).__name__}, whose "
                        "condensation keeps one set of contact rows; let block.elastic() slide"
                    )
        angle = SMALL_ANGLE if largest_rotation is None else largest_rotation
        value = numbers("largest_rotation", angle)
        if value.shape != () or not 0.0 < value < 0.5 * np.pi:
            raise InputError(
                f"largest_rotation={angle!r}: expected an angle in radians between 0 and pi / 2"
            )
        self._problem, self._interfaces, self._angle = problem, interfaces, float(angle)
        self._condensed: tuple[Any, CondensedContact] | None = None

    def step(
        self,
        body: Any,
        last: ContactResult | None,
        near: Array | None,
        options: Options,
        moving: dict[str, Any],
    ) -> ContactResult:
        """Solve one step.

        Parameters
        ----------
        body : Bodies
            Under the loads and prescribed displacements of the step.
        last : ContactResult or None
            The last step.
        near : ndarray, shape (ndofs,), or None
            Where to look first; default: the last step.
        options : Options
        moving : dict
            Rigid obstacles that vary, as for `ContactProblem.system_of`.

        Raises
        ------
        NotConverged
            The displacement does not settle, or a solve fails.
        InputError
            Boundaries that do not face each other any more; a body, or its boundary, that turns by
            more than a small angle.
        """
        rest = np.zeros(body.f.size) if last is None else last.u
        u, result, change = (rest if near is None else near), last, np.inf
        kept, lines = self._all_kept(), list[Iteration]()
        for k in range(PROJECTIONS):
            system, here = self._system(body, u, last, moving)
            condensed = kept.touched_by(body, system.rows)
            found = self._newton(system, here, condensed, rest, result, options) if k else None
            if found is None:
                result = self._problem.solve_system(system, condensed, options, result)
            else:
                result = found
            before, change = change, body.reach(result.u - u)
            u, size = result.u, body.reach(result.u) or 1.0
            lines += [*(result.history if found is None else ()), _line(k, result, change / size)]
            # What Newton's next step would still change, where this one was a step of it.
            ahead = change if found is None else min(change, change**2 / before)
            if ahead <= SETTLED * options.tol * size:
                break
        again, _ = self._system(body, u, last, moving)
        if result is not None and again.rows.gap.size == result.mu.size:
            result = replace(result, system=again, history=tuple(lines))
            certify(result, options.tol, result.slack)
            refuse_large_rotations(self._interfaces, u, self._angle)
            return result
        raise NotConverged(
            f"finite sliding: after {PROJECTIONS} projections the displacement still changes by "
            f"{change:.1e} (before: {before:.1e}); take smaller steps",
            tuple(lines),
        )

    def _newton(
        self,
        system: ContactSystem,
        here: Interfaces,
        condensed: CondensedContact,
        rest: Array,
        result: ContactResult | None,
        options: Options,
    ) -> ContactResult | None:
        """The next iterate with the derivative of the projection; None where there is none."""
        if result is None or options.method != "newton" or condensed.N.shape[1]:
            return None
        if system.rows.gap.size != result.mu.size or system.motion is not None:
            return None
        change = here.in_motion(result.u, rest, result.mu, result.t)
        if change is None:
            return None
        with suppress(NotConverged, LinAlgError):
            u, mu, t = newton_step(system, condensed, change, result, options.tol)
            return replace(result, system=system, u=u, mu=mu, t=t)
        return None

    def _all_kept(self) -> CondensedContact:
        """The condensation onto all dofs of the boundaries, of the present materials."""
        problem = self._problem
        materials = problem.body.materials
        kept = self._condensed
        if kept is None or any(a is not b for a, b in zip(kept[0], materials, strict=True)):
            keep = self._interfaces.boundary_dofs
            made = CondensedContact(problem.body, problem.rows, problem.solver, keep=keep)
            kept = self._condensed = materials, made
        return kept[1]

    def _system(
        self, body: Any, u: Array, last: ContactResult | None, moving: dict[str, Any]
    ) -> tuple[ContactSystem, Interfaces]:
        """The system of small sliding about the displacement u, and its projected rows."""
        problem = self._problem
        try:
            here = self._interfaces.displaced(u)
        except InputError:  # perhaps because of a rotation
            refuse_large_rotations(self._interfaces, u, self._angle)
            raise
        rows, now = here.rows, moving.get("obstacle", problem.opposite)
        if moving:
            rows = replace(rows, gap=here.gap(now))
        friction = here.friction(problem.given_friction)
        motion, before = self._motion(here, rows, friction, last, moving)
        if problem.law == "tresca":
            friction = friction * rows.weights
        slip_from = None
        if last is not None:
            slip_from = (rows.T @ last.u).reshape(rows.gap.size, -1) - before
            slip_from[rows.ties] = 0.0
        law, laws = problem.law, problem.overclosure
        rigid = problem.rigid(now)
        system = ContactSystem(body, rows, body.f, law, friction, slip_from, motion, laws, rigid)
        return system, here

    def _motion(
        self,
        here: Interfaces,
        rows: ContactRows,
        friction: Array,
        last: ContactResult | None,
        moving: dict[str, Any],
    ) -> tuple[ObstacleMotion | None, Array]:
        """Motions of rigid obstacles now, and their w_t of the last step at the present points."""
        now = moving.get("obstacle", self._problem.opposite)
        motion = here.motion(now)
        travel = np.zeros((rows.gap.size, rows.tangents.shape[1]))
        gap, before = self._problem.rows.gap, None
        if last is not None:  # rigid sides keep their points, whose numbers change
            gap, before = last.system.rows.gap, last.system.motion
        at, of = (
            _rigid_points(r, self._interfaces)
            for r in (rows, last.system.rows if last else self._problem.rows)
        )
        was, w = np.full(rows.gap.size, np.nan), travel.copy()
        was[at] = gap[of]
        if before is not None and last is not None and last.motion is not None:
            w[at] = before.displacement(last.motion)[1][of]
            if before.travel is not None:
                travel[at] = before.travel[of]
        if moving:
            travel = travel + here.travel(
                moving["since"],
                now,
                moving["said"],
                unchanged=same_gaps(was, rows.gap),
                felt=friction,
                first=last is None,
            )
        if np.any(travel):
            motion = ObstacleMotion.with_travel(motion, travel)
        return motion, w


def _rigid_points(rows: ContactRows, interfaces: Interfaces) -> NDArray[np.int64]:
    """Contact points opposite rigid obstacles, in their order."""
    rigid = [isinstance(side, ContactBoundaries) for side in interfaces.sides]
    return np.flatnonzero(np.array(rigid)[rows.part])


def _line(k: int, result: ContactResult, change: float) -> Iteration:
    """A projection in the history; its residual is the relative change of the displacement."""
    open_, stick, slip = np.bincount(result.status, minlength=3)[: Status.SLIP + 1]
    active = result.mu.size - int(open_)
    return Iteration(k + 1, "projection", active, int(stick), int(slip), change)
