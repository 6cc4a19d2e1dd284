"""Steps in which bodies of small strain slide by more than a facet, also on rigid tools.

Contact rows are recomputed at the positions :math:`x + u` of the last iterate, and the poses of
tools there, until both converge. The first problem of a step assumes small sliding and uses the
factorisation of the bodies, which keeps all dofs of the boundaries; the others are Newton steps
(`newton_step`). Friction opposes the step's displacement along the current
tangents, that of a tool's surface included. A result and its certificate use the rows at its
displacement and pose.

P. Wriggers, Computational Contact Mechanics, 2nd ed., Springer 2006, chapters 4 and 9."""

from __future__ import annotations

import weakref
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError, block_diag, lu_factor, lu_solve

from contact.arrays.blas_threads import one_blas_thread
from contact.body.axisymmetry import AXISYMMETRIC
from contact.body.basis_solid import BasisSolid
from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.condensation.condensed_contact import CondensedContact
from contact.errors import CHANGED, InputError, NotConverged
from contact.laws.condensed_newton import Condensed, is_stable
from contact.laws.friction import Tresca
from contact.laws.iteration import Iteration
from contact.laws.newton import LIMITS, followed, newton
from contact.laws.status import Status
from contact.laws.surface_law import SurfaceState
from contact.obstacles.rigid import ObstacleMotion, Rigid
from contact.obstacles.rigid_motion import (
    RigidMotion,
    closest_rotation,
    motion_between,
    said_motion,
    same_gaps,
    unknown_motion,
)
from contact.obstacles.shapes import is_tool
from contact.obstacles.tool import Pose, Tool, WornTools, moved_frame
from contact.portable import Origin
from contact.problem.solve_system import solve_system
from contact.result.certify import certify
from contact.result.contact_result import ContactResult
from contact.result.contact_system import ContactSystem
from contact.rows.contact_boundaries import ArcGap, ContactBoundaries, is_axial
from contact.rows.contact_rows import ContactRows
from contact.rows.interfaces import Interfaces
from contact.rows.mortar.mortar_rows import Interface
from contact.rows.outline import Outline
from contact.rows.tool_rows import RowsInMotion, ToolRows
from skfem_adini.ground.arguments import numbers

if TYPE_CHECKING:
    from contact.laws.options import Options
    from contact.problem.contact_problem import ContactProblem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Step:
    """The obstacles of a step: those opposite each side now, and what moved them since the last."""

    now: list[Any]
    since: list[Any]
    said: Any  # displacements given by the caller, one a side, or None
    last: list[Pose]  # poses of `Rigid` obstacles at the last step
    moves: list[RigidMotion | None]  # of the shapes of tools inside a `Rigid`; None: no tool


class FiniteSliding:
    """Solves the steps of a history in which bodies slide on each other and on rigid tools.
    `largest_rotation` in radians is 0.1 by default: the strain error is then 5e-3. Raises
    InputError with a given clearance, for layers, or for no angle."""

    def __init__(self, problem: ContactProblem, largest_rotation: float | None = None) -> None:
        found = problem.boundaries
        interfaces = (
            found
            if isinstance(found, Interfaces)
            else Interfaces.of_obstacles(problem.body, found, problem.obstacle)
        )
        if any(pair.two_bodies and pair.opposite.clearance is not None for pair in problem.pairs):
            raise InputError(
                "clearance: in finite sliding the gap is that between the meshes where the bodies "
                "are; leave clearance out"
            )
        for k, body in enumerate(interfaces.bodies.bodies):
            if not isinstance(body, BasisSolid):
                raise InputError(
                    f"sliding: {interfaces.bodies.called(k)} is a {type(body).__name__}, whose "
                    "condensation keeps one set of contact rows; let block.elastic() slide"
                )
        surface = problem.surface
        if (
            surface is not None
            and surface.remembers
            and not all(isinstance(side, ContactBoundaries) for side in interfaces.sides)
        ):
            raise InputError(
                "hardness, wear: the contact points of two elastic bodies come and go as these "
                "slide, and what was taken off stays behind; take a rigid tool for one of them, "
                "sliding='small', or adhesion and overclosure, which remember nothing"
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
        step = self._step(last, moving)
        poses = self._poses(step)
        u, result, change, least = (rest if near is None else near), last, np.inf, np.inf
        kept, lines, settled = self._all_kept(), list[Iteration](), False
        most, part, way = 40, 1.0, 0.0 * u  # projections in one step; how far they go
        for k in range(most):
            system, here = self._system(body, u, poses, last, step)
            condensed = kept.touched_by(body, system.rows)
            label = _labels(poses, step)
            found, before = None, change
            if k:
                found = self._newton(system, here, condensed, rest, result, options, step, label)
            if found is not None:
                change = self._change(system, found, u, label)
            if found is None or not change <= 10.0 * before:  # a Newton step may go too far
                found = None
                result = solve_system(system, condensed, options, result)
                change = self._change(system, result, u, label)
            else:
                result = found
            size = body.largest_displacement(result.u) or 1.0
            if part < 1.0 or (k > 5 and change > 0.5 * least):  # a cycle between flanks of a tool
                part = relaxed(part, way, result.u - u)
            way, least = result.u - u, min(least, change)
            result = between(part, result, u, label)
            poses = self._moved(poses, system, result, step)
            u = result.u
            lines += [*(result.history if found is None else ()), _line(k, result, change / size)]
            # Change by the next Newton step, if this one was a Newton step.
            full = found is not None and part == 1.0
            ahead = min(change, change**2 / before) if full else change
            settled = ahead <= max(1e-2 * options.tol * size, self._rounding(poses))
            if settled:
                break
        again, here = self._system(body, u, poses, last, step)
        if result is not None and again.rows.gap.size == result.mu.size:
            w = None if again.motion is None else _labels(poses, step)
            slide = Origin(slide=Slide(here, step.now, rest, weakref.ref(kept)))
            result = replace(result, system=again, history=tuple(lines), motion=w, origin=slide)
            result = self._worn(result, here)
            with nullcontext() if settled else suppress(NotConverged):
                certify(result, options.tol, result.slack)
                self._check_tools(result, here)
                refuse_large_rotations(self._interfaces, u, self._angle)
                return result
        raise NotConverged(
            f"finite sliding: after {most} projections the displacement still changes by "
            f"{change:.1e} (before: {before:.1e}); take smaller steps",
            tuple(lines),
        )

    def following(self, result: ContactResult, obstacle: Any) -> NDArray[np.bool_]:
        """Contact points (m,) whose rows are those at the displacement, not at rest."""
        sides = zip(self._interfaces.sides, self._each(obstacle), strict=True)
        follow = [isinstance(side, Interface) or is_tool(o) for side, o in sides]
        return np.asarray(np.array(follow)[result.system.rows.boundary])

    def system_at(
        self, body: Any, last: ContactResult | None, result: ContactResult, moving: dict[str, Any]
    ) -> ContactSystem:
        """The system of a step at the displacement and the poses of a result."""
        step = self._step(last, moving)
        return self._system(body, result.u, self._stored(step.now, result), last, step)[0]

    def _stored(self, obstacles: list[Any], result: ContactResult | None) -> list[Pose]:
        """The poses of obstacles in a result, None: at rest."""
        dim, k, poses = self._interfaces.bodies.dim, 0, []
        size = dim * (dim + 1) // 2
        motion = None if result is None else result.system.motion
        for o in obstacles:
            pose = Pose.at_rest(dim)
            if isinstance(o, Rigid) and result is not None and result.motion is not None:
                turns = None if motion is None else motion.turns
                if turns is None or len(turns) <= k:
                    raise InputError("obstacle: the step is none of finite sliding of this Rigid")
                pose = Pose(result.motion[size * k : size * (k + 1)], turns[k])
                k += 1
            poses.append(pose)
        return poses

    def _each(self, given: Any) -> list[Any]:
        """What is given for all sides, as a list with one entry for each."""
        count = len(self._interfaces.sides)
        several = self._problem.pairs or isinstance(self._problem.opposite, list | tuple)
        if several and isinstance(given, list | tuple) and len(given) == count:
            return list(given)
        return [given] * count

    def _step(self, last: ContactResult | None, moving: dict[str, Any]) -> _Step:
        """The obstacles of a step, with the motions of tools. Raises InputError if nothing slides,
        or a motion that friction needs is unknown."""
        sides, rest = self._interfaces.sides, self._problem.opposite
        given = moving.get("obstacle", rest), moving.get("since", rest), moving.get("said")
        now, since, said = (self._each(v) for v in given)
        moves: list[RigidMotion | None] = []
        for i, (side, was, o, own) in enumerate(zip(sides, since, now, said, strict=True)):
            tool = isinstance(side, ContactBoundaries) and is_tool(o)
            moves.append(self._move(i, was, o, own, last is None) if tool else None)
        if not any(moves) and not any(isinstance(side, Interface) for side in sides):
            raise InputError(
                "sliding: finite sliding is that of elastic bodies on each other and on rigid "
                "shapes; a gap given as a number, an array or a function of x has no shape to "
                "slide on: give a Plane, Sphere, SurfaceMesh, ... as the obstacle"
            )
        known = said if any(v is not None for v in said) else None
        return _Step(now, since, known, self._stored(since, last), moves)

    def _move(self, i: int, was: Any, now: Any, said: Any, first: bool) -> RigidMotion:
        """Motion of a tool's shape since the last step, without that of its `Rigid`."""
        given = said_motion(said, self._interfaces.bodies.dim)
        if given is not None:
            return RigidMotion.between(0.0 * given, given)
        found = motion_between(was, now)
        if found is None and first and not is_tool(was):
            return RigidMotion.at_rest()  # it starts where it is
        ring = self._interfaces.bodies.plane == AXISYMMETRIC
        if found is None or (ring and not is_axial(found)):
            felt = self._problem.friction[self._problem.rows.boundary == i] > 0
            if np.any(felt) or self._problem.wear is not None:
                raise unknown_motion(was, now)
            return RigidMotion.at_rest()
        return found

    def _poses(self, step: _Step) -> list[Pose]:
        """The poses of `Rigid` tools before their free motions are known."""
        dim = self._interfaces.bodies.dim
        return [
            pose.under(o.components(dim)[0]) if isinstance(o, Rigid) else Pose.at_rest(dim)
            for o, pose in zip(step.now, step.last, strict=True)
        ]

    def _moved(
        self, poses: list[Pose], system: ContactSystem, result: ContactResult, step: _Step
    ) -> list[Pose]:
        """The poses after the free motions of a result."""
        motion = system.motion
        if motion is None or result.motion is None or not np.any(motion.free):
            return poses
        change = result.motion - _labels(poses, step)
        found, k = list[Pose](), 0
        for o, pose in zip(step.now, poses, strict=True):
            own = slice(k, k + pose.motion.size)
            k = own.stop if isinstance(o, Rigid) else k
            found.append(pose.moved(change[own]) if isinstance(o, Rigid) else pose)
        return found

    def _change(
        self, system: ContactSystem, result: ContactResult, u: Array, label: Array
    ) -> float:
        """The largest motion of a point of the bodies, or of a tool where it is in contact."""
        largest, motion = float(system.body.largest_displacement(result.u - u)), system.motion
        if motion is None or result.motion is None or not np.any(motion.free):
            return largest
        w_n, felt = motion.normal @ (result.motion - label), result.mu > 0
        w_t = (motion.tangent @ (result.motion - label)).reshape(felt.size, -1)
        return max(largest, *(float(np.abs(w[felt]).max(initial=0.0)) for w in (w_n, w_t)))

    def _rounding(self, poses: list[Pose]) -> float:
        """Rounding of places."""
        dim = self._interfaces.bodies.dim
        far = max((float(np.abs(pose.motion[:dim]).max()) for pose in poses), default=0.0)
        return 20 * float(np.finfo(float).eps) * (self._interfaces.bodies.extent + far)

    def _newton(
        self,
        system: ContactSystem,
        here: Interfaces,
        condensed: CondensedContact,
        rest: Array,
        result: ContactResult | None,
        options: Options,
        step: _Step,
        label: Array,
    ) -> ContactResult | None:
        """The next iterate with the derivative of the projection; None if unavailable."""
        if result is None or options.method != "newton":
            return None
        change = here.in_motion(result.u, rest, result.mu, result.t, step.now)
        if change is None:
            return None
        if system.motion is not None:
            result = replace(result, motion=label)
        with suppress(NotConverged, LinAlgError), one_blas_thread(condensed.size):
            u, mu, t, motion = newton_step(system, condensed, change, result, options.tol)
            return replace(result, system=system, u=u, mu=mu, t=t, motion=motion)
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
        self, body: Any, u: Array, poses: list[Pose], last: ContactResult | None, step: _Step
    ) -> tuple[ContactSystem, Interfaces]:
        """The system of small sliding about the displacement u, and its projected rows."""
        problem, rest = self._problem, np.zeros(u.size) if last is None else last.u
        tools = [
            None if move is None else Tool.of(o, pose, was, move, flat(side))
            for o, pose, was, move, side in zip(
                step.now, poses, step.last, step.moves, self._interfaces.sides, strict=True
            )
        ]
        try:
            here = self._interfaces.displaced(u, tools, rest)
        except InputError:  # possibly due to a rotation
            refuse_large_rotations(self._interfaces, u, self._angle)
            raise
        rows = replace(here.rows, gap=here.gap(step.now))
        surface = self._surface(here, rows, last, step)
        friction = here.friction(problem.given_friction) if problem.pairs else problem.friction
        motion, slip_from = self._motion(here, rows, friction, u, poses, last, step)
        if problem.law == "tresca":
            friction = friction * rows.weights
        if not problem.pairs:  # as of one body
            none = np.zeros(0, dtype=np.int64)
            part = rows.part if len(here.sides) > 1 else none
            rows = replace(rows, owner=none, part=part, axes=np.zeros((0, 0, 0)))
        law, laws = problem.law, problem.overclosure
        several = problem.pairs or isinstance(problem.opposite, list | tuple)
        rigid = problem.rigid(step.now if several else step.now[0])
        if surface is not None:
            rows = replace(rows, gap=rows.gap + surface.lost)
        system = ContactSystem(
            body, rows, body.f, law, friction, slip_from, motion, laws, rigid, surface=surface
        )
        return system, here

    def _surface(
        self, here: Interfaces, rows: ContactRows, last: ContactResult | None, step: _Step
    ) -> SurfaceState | None:
        """What earlier steps took off the body at its points, and off tools opposite them now."""
        surface, dim = self._problem.surface, self._interfaces.bodies.dim
        if surface is not None and surface.adhesion is not None:
            kept = self._all_kept()
            if self._problem.pairs:
                kept = kept.touched_by(self._problem.body, rows)
            surface = surface.ramped(rows.weights * kept.point_scale**2)
        if surface is None or not surface.remembers:
            return surface and surface.after(np.zeros(rows.gap.size), np.zeros((2, rows.gap.size)))
        rest = np.tile(np.eye(dim, dim + 1), (len(step.moves), 1, 1))
        frames, tools = rest, np.zeros((dim + 2, 0))
        indented, worn, volume = surface.indented, surface.worn.copy(), np.zeros(2)
        if last is not None and (was := last.system.surface) is not None:
            frames, tools, volume = was.frames, was.tools, last.worn_volume
            indented, worn = last.indentation, last.worn.copy()
        each = zip(here.projected, here.points, step.moves, frames, strict=True)
        frames = frames.copy()
        for k, (found, own, move, frame) in enumerate(each):
            if isinstance(found, ToolRows) and move is not None:
                frames[k] = moved_frame(frame, move)
                worn[1, own] = found.worn(WornTools(self._cell, tools), k, frames[k])
        return replace(
            surface, indented=indented, worn=worn, volume=volume, tools=tools, frames=frames
        )

    @property
    def _cell(self) -> float:
        """Length of the cells that hold what is worn off tools."""
        return float(np.median(self._problem.rows.spacing))

    def _worn(self, result: ContactResult, here: Interfaces) -> ContactResult:
        """The result with what its step leaves of the tools."""
        surface = result.system.surface
        if surface is None or surface.tools is None or surface.wear is None:
            return result
        tools, lost = WornTools(self._cell, surface.tools), result.worn[1] - surface.worn[1]
        for k, (found, own) in enumerate(zip(here.projected, here.points, strict=True)):
            if isinstance(found, ToolRows) and lost[own].any():
                area = result.system.rows.weights[own]
                tools = found.wear(tools, k, surface.frames[k], lost[own], area)
        system = replace(result.system, surface=replace(surface, tools=tools.held))
        return replace(result, system=system)

    def _motion(
        self,
        here: Interfaces,
        rows: ContactRows,
        friction: Array,
        u: Array,
        poses: list[Pose],
        last: ContactResult | None,
        step: _Step,
    ) -> tuple[ObstacleMotion | None, Array | None]:
        """Current motions of rigid obstacles, and the displacement from which slip counts."""
        motion = here.motion(step.now)
        m, slips = rows.gap.size, rows.tangents.shape[1]
        travel, w, was = np.zeros((m, slips)), np.zeros((m, slips)), np.full(m, np.nan)
        at = self.rigid_points(rows)
        of = self.rigid_points(last.system.rows if last else self._problem.rows)
        was[at] = (last.system.given_gap if last else self._problem.rows.gap)[of]
        before = None if last is None else last.system.motion
        if before is not None and last is not None and last.motion is not None:
            w[at] = before.displacement(last.motion)[1][of]
            if before.travel is not None:
                travel[at] = before.travel[of]
        same = same_gaps(was, rows.gap)
        felt = friction if self._problem.wear is None else np.ones(m)
        travel = travel + here.travel(
            step.since, step.now, step.said, unchanged=same, felt=felt, first=last is None
        )
        from_last = None
        if last is not None:
            from_last = (rows.T @ last.u).reshape(m, slips) - w
            from_last[rows.ties] = 0.0
        if motion is not None:
            rigid = [p.turn for o, p in zip(step.now, poses, strict=True) if isinstance(o, Rigid)]
            motion = replace(motion, turns=np.array(rigid))
            w = (motion.tangent @ _labels(poses, step)).reshape(m, slips)
        else:
            w = np.zeros((m, slips))
        slip = (rows.T @ u).reshape(m, slips) - w
        for k, (found, own) in enumerate(zip(here.projected, here.points, strict=True)):
            if isinstance(found, ToolRows):  # total and increment of the slip are the true ones
                until = np.zeros((own.size, slips))
                if last is not None and from_last is not None:
                    mine = np.flatnonzero(last.system.rows.boundary == k)
                    until = from_last[own] = last.slip[mine]
                travel[own] = slip[own] - until - found.slip
        if np.any(travel):
            motion = ObstacleMotion.with_travel(motion, travel)
        return motion, from_last

    def rigid_points(self, rows: ContactRows) -> NDArray[np.int64]:
        """Contact points opposite rigid obstacles, in their order."""
        rigid = [isinstance(side, ContactBoundaries) for side in self._interfaces.sides]
        return np.flatnonzero(np.array(rigid)[rows.boundary])

    def _check_tools(self, result: ContactResult, here: Interfaces) -> None:
        """Raise if a tool has passed through a boundary, or overlaps the body beside it."""
        for found, own, side in zip(here.projected, here.points, here.sides, strict=True):
            if not isinstance(found, ToolRows) or not isinstance(side, ContactBoundaries):
                continue
            loaded = result.mu[own] > 1e-9 * result.mu.max(initial=0.0)
            wrong = np.flatnonzero(loaded & ~found.faces)
            if wrong.size:
                where = side.rows.x_nominal[:, wrong[0]].round(6).tolist()
                raise NotConverged(
                    f"finite sliding: the closest point of the obstacle to {where} lies behind the "
                    "boundary, as if it had passed through the body; take smaller steps"
                )
            refuse_overlap_beside(side, found.tool, result.u[self._slice(side)])

    def _slice(self, side: Any) -> slice:
        bodies = self._interfaces.bodies
        return bodies.slices[bodies.number_of_trace(side.body)]


def relaxed(part: float, before: Array, way: Array) -> float:
    """The part of a step that Aitken's rule takes after steps that were short by `before`, `way`.
    U. Kuettler and W. A. Wall, Comput. Mech. 43 (2008), 61-72."""
    turned = way - before
    size = float(turned @ turned) or 1.0
    return float(np.clip(-part * float(before @ turned) / size, 0.05, 0.99))


def between(part: float, result: ContactResult, u: Array, label: Array) -> ContactResult:
    """A result at a part of the way from the displacement u and the motions `label`."""
    if part == 1.0:
        return result
    motion = None if result.motion is None else label + part * (result.motion - label)
    return replace(result, u=u + part * (result.u - u), motion=motion)


def flat(side: Any) -> tuple[Array, Array] | None:
    """A point of a boundary opposite an obstacle, and its normals."""
    if not isinstance(side, ContactBoundaries):
        return None
    return side.points.x[:, 0], side.points.normals


def _labels(poses: list[Pose], step: _Step) -> Array:
    """Components of the motions of all `Rigid` obstacles."""
    each = zip(step.now, poses, strict=True)
    return np.concatenate([np.zeros(0), *(p.motion for o, p in each if isinstance(o, Rigid))])


def refuse_overlap_beside(side: ContactBoundaries, tool: Tool, u: Array) -> None:
    """Raise InputError where a tool overlaps vertices of the body beside the contact boundary.
    Planes and other open shapes often stand for a tool that ends where the boundary does."""
    rule, body = side.rules[0], side.body
    if isinstance(rule, ArcGap) or not tool.bounded:
        return
    assert rule.source is not None
    every = np.unique(body.mesh.facets[:, body.mesh.boundary_facets()])
    beside = np.setdiff1d(every, rule.source[0].corners)
    X = body.mesh.p[:, beside]
    with suppress(NotConverged):
        phi = tool.distance(X + _of_vertices(body, u)[:, beside])[0]
        worst = int(phi.argmin()) if phi.size else 0
        if phi.size and phi[worst] < -CHANGED * body.deformation(u):
            raise InputError(
                f"obstacle: it has left the contact boundary and overlaps the body by "
                f"{-phi[worst]:.3g} at {X[:, worst].round(6).tolist()}, where there are no contact "
                "points; let the contact boundary reach as far as the tool moves"
            )


def _line(k: int, result: ContactResult, change: float) -> Iteration:
    """History line of a projection; the residual is the relative change of the displacement."""
    open_, stick, slip = np.bincount(result.status, minlength=3)[: Status.SLIP + 1]
    active = result.mu.size - int(open_)
    return Iteration(k + 1, "projection", active, int(stick), int(slip), change)


@dataclass(frozen=True)
class Slide:
    """What the derivatives of a step need: its rows, obstacles, and the last displacement."""

    here: Interfaces
    opposites: list[Any]
    last: Array  # (ndofs,)
    kept: Any  # weak reference to the factors

    def condensed(self, system: ContactSystem) -> CondensedContact:
        """The factors for the rows of the step."""
        kept = self.kept()
        if kept is None:
            kept = CondensedContact(system.body, system.rows, keep=self.here.boundary_dofs)
        return kept.touched_by(system.body, system.rows)

    def change(self, result: ContactResult) -> RowsInMotion | None:
        """Derivatives of the rows at a result, that of this step."""
        return self.here.in_motion(result.u, self.last, result.mu, result.t, self.opposites)

    def equations(
        self, result: ContactResult, condensed: CondensedContact, change: RowsInMotion
    ) -> MovedRows:
        """The equations of small changes."""
        return MovedRows.of(result.system, condensed, change, result)

    def memory(self, system: ContactSystem, tangent: Array) -> dict[str, Array]:
        """Gradients by displacement and motions of the last step, from those by slips (m, dim -
        1)."""
        rows, motion, bodies = system.rows, system.motion, self.here.bodies
        kept, k, slips = tangent.copy(), 0, tangent.shape[1]
        w = np.zeros(0 if motion is None else motion.free.size)
        u = np.zeros(self.last.size)
        each = zip(
            self.here.projected, self.here.points, self.opposites, self.here.sides, strict=True
        )
        for found, own, o, side in each:
            size = w[k : k + bodies.dim * (bodies.dim + 1) // 2] if isinstance(o, Rigid) else w[:0]
            if isinstance(found, ToolRows) and isinstance(side, ContactBoundaries):
                by_u, by_pose = found.by_last()
                along, kept[own] = tangent[own].ravel(), 0.0
                u[bodies.slices[bodies.number_of_trace(side.body)]] += by_u.T @ along
                size += by_pose.T[: size.size] @ along
            k += size.size
        if motion is not None:
            w += motion.tangent.T @ kept.ravel()
        u -= rows.T.T @ kept.reshape(-1, slips).ravel()
        return {"u": u} if motion is None else {"u": u, "motion": w}


@dataclass(frozen=True)
class MovedRows:
    r"""The boundary problem of small changes about a state u whose rows follow the displacement.

    With free motions a of obstacles, derivatives E of the contact conditions and K of the forces,

    .. math::
        (S + K) \delta + K_a a + B^T l = f - S u, \qquad v = v(u) + (B + E) \delta + (E_a - R) a,
        \qquad -R^T l - L \delta - L_a a = q ,

    and the laws between v and l, on boundary dofs only. The amplitudes :math:`N^T \delta` of rigid
    motions N that no support resists are motions as well: :math:`S + \rho N N^T` replaces S, with
    :math:`K_a = -\rho N`, :math:`L = \rho N^T`, :math:`L_a = -\rho`."""

    problem: BoundaryProblem
    factor: Any  # of S + K
    condensed: CondensedContact
    rows: Array  # B + E, (n, nb)
    K_a: Array  # (nb, k)
    L: Array  # (k, nb)
    response: Array  # of the boundary to f - S u, K_a and B, (nb, 1 + k + n)
    of_rows: Array  # displacements of the rows are divided by it, (n,)
    unit: Array  # free motions are divided by it, (k,)

    @classmethod
    def of(
        cls,
        system: ContactSystem,
        condensed: CondensedContact,
        change: RowsInMotion,
        last: ContactResult,
    ) -> MovedRows:
        """About the state `last`."""
        u, points, motion = last.u, condensed.points, system.motion
        live_n = points.normal >= 0
        live_t = (points.tangent >= 0).ravel()
        E = sparse.vstack([change.normal[live_n], change.tangential[live_t]], format="csr")
        B, rows = condensed.B.toarray(), condensed.restrict(sparse.csr_array(E))
        rows[int(live_n.sum()) :] += change.swing[live_t] @ condensed.restrict(change.turning)
        K = condensed.restrict(sparse.csr_array(condensed.restricted_columns(change.force)))
        free = np.zeros(0, dtype=bool) if motion is None else motion.free
        R = np.zeros((len(B), int(free.sum())))
        if motion is not None:
            R = np.vstack((motion.normal[live_n], motion.tangent[live_t]))[:, free]
        push, pull = (sparse.csr_array(v) for v in (change.push[:, free], change.pull[free]))
        S, N = condensed.stiffness, condensed.N / np.linalg.norm(condensed.N, axis=0)
        rho = np.diag(S) @ N**2
        K_a = np.hstack((condensed.restricted_columns(push).toarray(), -rho * N))
        L = np.vstack((condensed.restrict(pull), (rho * N).T))
        lean = block_diag(change.lean[np.ix_(free, free)], -np.diag(rho))
        R = np.pad(R, ((0, 0), (0, rho.size)))
        factor = lu_factor(S + (rho * N) @ N.T + K, check_finite=False)
        left = condensed.carried(system.load - system.body.internal(u))
        response = lu_solve(factor, np.column_stack((left, K_a, B.T)), check_finite=False)
        k = 1 + R.shape[1]
        moved, pulled = (B + rows) @ response, L @ response
        u_n, u_t = system.relative(u, last.motion)
        v = points.stacked(u_n, system.slip_increment(u_t)) + moved[:, 0]
        scale = condensed.point_scale
        of_rows = points.stacked(scale, np.repeat(scale[:, None], u_t.shape[1], axis=1))
        E_a = np.zeros_like(R)
        E_a[int(live_n.sum()) :, : push.shape[1]] = change.slip[live_t][:, free]
        C = (E_a - R - moved[:, 1:k]) / of_rows[:, None]
        D = (pulled[:, k:].T - R) / of_rows[:, None]
        size = np.abs(D).max(axis=0, initial=0.0)
        unit = 1.0 / np.where(size > 0, size, 1.0)  # so that motions and displacements are alike
        force = np.zeros(k - 1)
        if motion is not None:
            force[: push.shape[1]] = motion.force[free]
        problem = replace(
            condensed.boundary_problem(system.load, system.rows.gap, system.slip_from, motion),
            W=moved[:, k:] / of_rows / of_rows[:, None],
            v0=v / of_rows,
            C=C * unit,
            D=D * unit if k > 1 else None,
            K=(pulled[:, 1:k] - lean) * unit * unit[:, None] if k > 1 else None,
            s=unit * (force + pulled[:, 0]),
            compliance=system.compliance(scale),
        )
        return cls(problem, factor, condensed, B + rows, K_a, L, response, of_rows, unit)

    def yielded(self, forces: Array) -> tuple[Array, Array]:
        """What forces on all dofs do, by the transposed S + K, on displacements by unit forces of
        rows, and minus that by unit motions; both scaled."""
        carried = self.condensed.carried(forces)
        z = lu_solve(self.factor, carried, trans=1, check_finite=False)
        return self.condensed.B @ z / self.of_rows, -self.unit * (self.K_a.T @ z)

    def transposed(self, forces: Array, of_rows: Array, a: Array) -> Array:
        """Displacement of all dofs by the transposed system under forces on them, of rows, and of
        motions, the latter scaled."""
        right = self.condensed.carried(forces) + self.rows.T @ (of_rows / self.of_rows)
        right = right + self.L.T @ (self.unit * a)
        z_b = lu_solve(self.factor, right, trans=1, check_finite=False)
        return self.condensed.moved(forces, z_b)


def newton_step(
    system: ContactSystem,
    condensed: CondensedContact,
    change: RowsInMotion,
    last: ContactResult,
    tol: float,
) -> tuple[Array, Array, Array, Array | None]:
    """The next iterate (u, mu, t, w) by Newton's method with the derivative of the projection.
    Raises NotConverged, or LinAlgError."""
    u, motion = last.u, system.motion
    moved = MovedRows.of(system, condensed, change, last)
    problem, response, k = moved.problem, moved.response, 1 + moved.unit.size
    scale = condensed.point_scale
    friction = system.scaled_friction(scale) or Tresca(np.zeros(scale.size))
    start = Forces(last.mu * scale, last.t * scale[:, None], np.zeros(k - 1))
    forces = _equilibrium(Condensed(problem, friction), start, LIMITS.inner * tol)
    l, a = problem.forces(forces.mu, forces.t) / moved.of_rows, moved.unit * forces.a
    free = np.zeros(0, dtype=bool) if motion is None else motion.free
    of_tools = a[: int(free.sum())]
    left = system.load - system.body.internal(u) - change.push[:, free] @ of_tools
    du = condensed.moved(left, response[:, 0] - response[:, 1:k] @ a - response[:, k:] @ l)
    u, mu, w = u + du, forces.mu / scale, last.motion
    if w is not None:
        w = w.copy()
        w[free] += of_tools
    return u, mu, system.with_held_points(u, mu, forces.t / scale[:, None], w), w


def _equilibrium(laws: Condensed, start: Forces, tol: float) -> Forces:
    """Forces that solve the laws, with adhesion those near the start."""
    surface = laws.problem.compliance
    if surface is not None and surface.softens:
        return followed(laws, start, is_stable, tol=tol, max_iterations=50)
    return newton(laws, start, tol=tol)


def refuse_large_rotations(interfaces: Interfaces, u: Array, largest: float) -> None:
    r"""Raise InputError if a body or a contact boundary turns by more than `largest` (radians).
    Small strains give a rotation by :math:`\theta` a strain of :math:`\cos\theta - 1`, which must
    be negligible (P. Wriggers, Computational Contact Mechanics, 2006, section 3.1)."""
    bodies = interfaces.bodies
    for side in interfaces.sides:
        for outline in side.outlines:
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
    """Angle in radians of the rotation that takes places X closest to X + u, both (dim, n)."""
    R = closest_rotation(X, X + u, weight)
    if len(R) == 2:
        return float(abs(np.arctan2(R[1, 0] - R[0, 1], np.trace(R))))
    turn = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arctan2(turn, np.trace(R) - 1.0))
