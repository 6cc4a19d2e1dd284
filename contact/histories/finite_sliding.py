"""Steps in which bodies of small strain slide by more than a facet.

Contact rows are recomputed at the positions :math:`x + u` of the last iterate until u converges.
The first problem of a step assumes small sliding and uses the factorisation of the bodies, which
keeps all dofs of both boundaries; in the plane, unless a body floats, the others are Newton steps
(`newton_step`). Friction opposes the step's displacement along the current tangents. A result and
its certificate use the rows at its displacement.

P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapters 4 and 9."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError, lu_factor, lu_solve

from contact.body.basis_solid import BasisSolid
from contact.condensation.boundary_problem import Forces
from contact.condensation.condensed_contact import CondensedContact
from contact.errors import InputError, NotConverged
from contact.laws.condensed_newton import Condensed
from contact.laws.friction import Tresca
from contact.laws.iteration import Iteration
from contact.laws.newton import LIMITS, newton
from contact.laws.status import Status
from contact.obstacles.rigid import ObstacleMotion
from contact.obstacles.rigid_motion import same_gaps
from contact.result.certify import certify
from contact.result.contact_result import ContactResult
from contact.result.contact_system import ContactSystem
from contact.rows.contact_boundaries import ContactBoundaries
from contact.rows.contact_rows import ContactRows
from contact.rows.interfaces import Interfaces
from contact.rows.mortar.mortar_rows import Interface
from contact.rows.outline import Outline
from skfem_adini.ground.arguments import numbers

if TYPE_CHECKING:
    from contact.laws.options import Options
    from contact.problem.contact_problem import ContactProblem

Array = NDArray[np.float64]


class FiniteSliding:
    """Solves the steps of a history in which the bodies of a problem slide.
    `largest_rotation` in radians is 0.1 by default: the strain error is then 5e-3. Raises
    InputError without two touching bodies, with a given clearance, or for no angle."""

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
        angle = 0.1 if largest_rotation is None else largest_rotation
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
        """Solve one step of `body` under its loads, near u (ndofs,) or the last step.
        `moving` has rigid obstacles that vary, as `ContactProblem.system_of`. Raises NotConverged,
        or InputError if boundaries separate completely or a body rotates too far."""
        rest = np.zeros(body.f.size) if last is None else last.u
        u, result, change = (rest if near is None else near), last, np.inf
        kept, lines = self._all_kept(), list[Iteration]()
        most = 30  # projections in one step
        for k in range(most):
            system, here = self._system(body, u, last, moving)
            condensed = kept.touched_by(body, system.rows)
            found = self._newton(system, here, condensed, rest, result, options) if k else None
            if found is None:
                result = self._problem.solve_system(system, condensed, options, result)
            else:
                result = found
            before, change = change, body.largest_displacement(result.u - u)
            u, size = result.u, body.largest_displacement(result.u) or 1.0
            lines += [*(result.history if found is None else ()), _line(k, result, change / size)]
            # Change by the next Newton step, if this one was a Newton step.
            ahead = change if found is None else min(change, change**2 / before)
            if ahead <= 1e-2 * options.tol * size:
                break
        again, _ = self._system(body, u, last, moving)
        if result is not None and again.rows.gap.size == result.mu.size:
            result = replace(result, system=again, history=tuple(lines))
            certify(result, options.tol, result.slack)
            refuse_large_rotations(self._interfaces, u, self._angle)
            return result
        raise NotConverged(
            f"finite sliding: after {most} projections the displacement still changes by "
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
        """The next iterate with the derivative of the projection; None if unavailable."""
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
        """The condensation onto all dofs of the boundaries, for the current materials."""
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
        except InputError:  # possibly due to a rotation
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
        """Current motions of rigid obstacles, and w_t of the last step at the current points."""
        now = moving.get("obstacle", self._problem.opposite)
        motion = here.motion(now)
        travel = np.zeros((rows.gap.size, rows.tangents.shape[1]))
        gap, before = self._problem.rows.gap, None
        if last is not None:  # points opposite rigid obstacles stay but are renumbered
            gap, before = last.system.rows.gap, last.system.motion
        at, of = (
            self.rigid_points(r) for r in (rows, last.system.rows if last else self._problem.rows)
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

    def rigid_points(self, rows: ContactRows) -> NDArray[np.int64]:
        """Contact points opposite rigid obstacles, in their order."""
        rigid = [isinstance(side, ContactBoundaries) for side in self._interfaces.sides]
        return np.flatnonzero(np.array(rigid)[rows.part])


def _line(k: int, result: ContactResult, change: float) -> Iteration:
    """History line of a projection; the residual is the relative change of the displacement."""
    open_, stick, slip = np.bincount(result.status, minlength=3)[: Status.SLIP + 1]
    active = result.mu.size - int(open_)
    return Iteration(k + 1, "projection", active, int(stick), int(slip), change)


if TYPE_CHECKING:
    from contact.condensation.condensed_contact import CondensedContact
    from contact.result.contact_result import ContactResult
    from contact.result.contact_system import ContactSystem
    from contact.rows.interfaces import RowsInMotion


def newton_step(
    system: ContactSystem,
    condensed: CondensedContact,
    change: RowsInMotion,
    last: ContactResult,
    tol: float,
) -> tuple[Array, Array, Array]:
    r"""The next iterate (u, mu, t) by Newton's method with the derivative of the projection.

    With derivatives E of the contact conditions and K of the forces in the displacement,

    .. math:: (S + K) \delta + B^T l = f - S u, \qquad v = v(u) + (B + E) \delta ,

    and the laws between v and l, on boundary dofs only. Raises NotConverged, or LinAlgError."""
    u, points = last.u, condensed.points
    left = system.load - system.body.internal(u)
    live_n = points.normal >= 0
    live_t = (points.tangent >= 0).ravel()
    E = sparse.vstack([change.normal[live_n], change.tangential[live_t]], format="csr")
    B, rows = condensed.B.toarray(), condensed.restrict(sparse.csr_array(E))
    K = condensed.restrict(sparse.csr_array(condensed.restricted_columns(change.force)))
    factor = lu_factor(condensed.stiffness + K, check_finite=False)
    response = lu_solve(factor, np.column_stack((condensed.carried(left), B.T)), check_finite=False)
    moved = (B + rows) @ response
    u_n, u_t = system.relative(u, last.motion)
    v = points.stacked(u_n, system.slip_increment(u_t)) + moved[:, 0]
    scale = condensed.point_scale
    of_rows = points.stacked(scale, np.repeat(scale[:, None], u_t.shape[1], axis=1))
    problem = replace(
        condensed.boundary_problem(system.load, system.rows.gap, system.slip_from, system.motion),
        W=moved[:, 1:] / of_rows / of_rows[:, None],
        v0=v / of_rows,
        compliance=system.compliance(scale),
    )
    friction = system.scaled_friction(scale) or Tresca(np.zeros(scale.size))
    start = Forces(last.mu * scale, last.t * scale[:, None], np.zeros(0))
    forces = newton(Condensed(problem, friction), start, tol=LIMITS.inner * tol)
    l = problem.forces(forces.mu, forces.t) / of_rows
    du = condensed.moved(left, response[:, 0] - response[:, 1:] @ l)
    u, mu = u + du, forces.mu / scale
    return u, mu, system.with_held_points(u, mu, forces.t / scale[:, None], last.motion)


def refuse_large_rotations(interfaces: Interfaces, u: Array, largest: float) -> None:
    r"""Raise InputError if a body or a contact boundary turns by more than `largest` (radians).
    Small strains give a rotation by :math:`\theta` a strain of :math:`\cos\theta - 1`, which must
    be negligible (P. Wriggers, Computational Contact Mechanics, 2006, section 3.1)."""
    bodies = interfaces.bodies
    for side in interfaces.sides:
        if not isinstance(side, Interface):
            continue
        for outline in (side.first, side.second):
            k = bodies.number_of_trace(outline.body)
            for what, angle in _angles(outline, u[bodies.slices[k]]):
                if angle > largest:
                    raise InputError(
                        f"sliding: {what}{bodies.called(k)} turns by {np.degrees(angle):.3g} "
                        "degrees, which small strains mistake for a strain of "
                        f"{1.0 - np.cos(angle):.2g}; they allow rotations of up to "
                        f"{np.degrees(largest):.3g} degrees, see largest_rotation"
                    )


def _angles(outline: Outline, u: Array) -> list[tuple[str, float]]:
    """Rotations in radians of a contact boundary and of its whole body."""
    body, corners = outline.body, outline.corners
    X, moved = body.mesh.p, _of_vertices(body, u)
    edges = X[:, corners] - X[:, corners].mean(axis=2, keepdims=True)
    area = np.linalg.norm(edges, axis=0).mean(axis=1) ** (body.dim - 1)
    weight = np.bincount(
        corners.ravel(), np.repeat(area, corners.shape[1]), minlength=X.shape[1]
    ).astype(np.float64)
    used = np.unique(body.mesh.t)
    return [
        ("the contact boundary of ", rotation(X, moved, weight)),
        ("", rotation(X[:, used], moved[:, used], np.ones(used.size))),
    ]


def _of_vertices(body: Any, u: Array) -> Array:
    """Displacement of the vertices of a mesh, shape (dim, nvertices)."""
    value = body.scalar_dofs.nodal_dofs[0]
    return np.array([u[body.dim * value + c] for c in range(body.dim)])


def rotation(X: Array, u: Array, weight: Array) -> float:
    """Angle in radians of the rotation that takes places X closest to X + u, both (dim, n).
    Least squares with weights (n,): W. Kabsch, Acta Cryst. A 32 (1976), 922-923."""
    x = X + u
    here, there = (v - (v @ weight / weight.sum())[:, None] for v in (X, x))
    U, _, V = np.linalg.svd((there * weight) @ here.T)
    U[:, -1] *= np.sign(np.linalg.det(U @ V))
    R = U @ V
    if len(R) == 2:
        return float(abs(np.arctan2(R[1, 0] - R[0, 1], np.trace(R))))
    turn = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arctan2(turn, np.trace(R) - 1.0))
