r"""The transposed linearised contact problem.

With the points' zones at a solution the laws are equations. The implicit function theorem gives,
for a function J with derivatives :math:`\bar u, \bar\mu, \bar t, \bar w`, the adjoint displacement
:math:`\lambda` and adjoint displacements :math:`\bar v` of the contact rows :math:`B = (G, T)`,

.. math::
    S \lambda = \bar u + B^T \bar v, \qquad
    A^T \eta = \bar l - B S^{-1} \bar u, \qquad \bar v = V^T \eta

where A is the matrix of the last Newton step (`contact.laws.condensed_newton`) and V its part that
multiplies displacements of rows: the identity, or at slipping points the derivative of radial
return. :math:`\lambda` is the gradient by the loads, :math:`\bar v` that by displacements of the
obstacle. One substitution with the factors of S is needed.

References
----------
K. Ito and K. Kunisch, Lagrange Multiplier Approach to Variational Problems and Applications, SIAM
2008, chapter 8. F. Mignot, J. Funct. Anal. 22 (1976), 130-185: directional derivatives where points
touch without force.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import LinAlgError

from contact.body.rigid_modes import rigid_field
from contact.condensation.boundary_problem import BoundaryProblem
from contact.condensation.condensed_contact import CondensedContact
from contact.derivatives.of_pairs import of_pairs
from contact.errors import InputError, NotConverged
from contact.laws.condensed_newton import Condensed, SlipRows, Used
from contact.laws.friction import Tresca, lengths
from contact.laws.law import State, Zones
from contact.rows.tool_rows import RowsInMotion
from skfem_adini.ground.arguments import finite_numbers

Array = NDArray[np.float64]


class _Limits(NamedTuple):
    weak: float = 1e-8  # of the largest force: nothing tells open from closed, stick from slip
    solved: float = 1e-7  # residual of the transposed system over its terms


LIMITS = _Limits()


@dataclass(frozen=True)
class Cotangents:
    """Derivatives of a function by the parts of a result, in the form of the unknowns."""

    u: Array  # (ndofs,)
    mu: Array  # (m,)
    t: Array  # (m, dim - 1)
    motion: Array  # (k,)
    slip: Array  # (m, dim - 1), part of u and motion
    forces: Array  # (ndofs,), part of mu and t
    resultant: Array  # (dim,), part of mu and t
    pressure: Array  # (m,), part of mu
    shear: Array  # (m, dim - 1), part of t

    @classmethod
    def checked(cls, result: Any, given: dict[str, Any]) -> Cotangents:
        """Read the arguments of `ContactResult.vjp`; raises InputError for wrong shapes."""
        system, rows = result.system, result.system.rows
        m, slips = result.t.shape
        k = 0 if system.motion is None else system.motion.prescribed.size
        shapes = {
            "u": result.u.shape, "pressure": (m,), "shear": (m, slips), "slip": (m, slips),
            "contact_forces": result.u.shape, "resultant": (system.body.dim,), "motion": (k,),
        }  # fmt: skip
        read = {
            name: np.zeros(shape)
            if given.get(name) is None
            else np.asarray(finite_numbers(name, given[name], shape))
            for name, shape in shapes.items()
        }
        free, forces = ~rows.ties, read["contact_forces"]
        pressure, shear = read["pressure"] * free, read["shear"] * free[:, None]
        axes, resultant = axes_of(system.body, rows), read["resultant"]
        if system.body.is_ring:
            resultant = resultant * [0.0, 1.0]  # radial forces cancel around the ring
        along = axes @ resultant
        mu = rows.G @ forces - along[:, 0]
        t = (rows.T @ forces).reshape(m, slips) - along[:, 1:]
        mu = mu * free + pressure / rows.weights
        t = t * free[:, None] - shear / rows.weights[:, None]
        slip, motion = read["slip"], read["motion"]
        u = read["u"] + rows.T.T @ slip.ravel()
        if system.motion is not None:
            motion = motion - system.motion.tangent.T @ slip.ravel()
        return cls(u, mu, t, motion, slip, forces, resultant, pressure, shear)


def axes_of(body: Any, rows: Any) -> Array:
    """Directions of unit contact forces, normal first, shape (m, dim, dim)."""
    if rows.axes.size:
        return np.asarray(rows.axes)
    dim = body.dim
    unit = sparse.csr_array(rigid_field(body.trace, np.zeros(dim))[:, :dim].T)
    shifts = body.embed(unit).toarray().T
    along = (rows.T @ shifts).reshape(rows.gap.size, dim - 1, dim)
    return np.concatenate(((rows.G @ shifts)[:, None], along), axis=1)


@dataclass(frozen=True)
class Adjoint:
    """Gradients that follow from the transposed system alone."""

    load: Array  # adjoint displacement, the gradient by loads, (ndofs,)
    normal: Array  # by a normal displacement of points beside that of u, (m,)
    tangent: Array  # by a tangential one, (m, dim - 1)
    force: Array  # by the force on obstacles, zero where the motion is prescribed, (k,)
    motion: Array  # by the motion of obstacles, zero where it is free, (k,)
    friction: Array  # by `ContactSystem.friction`, (m,)
    support: Array  # by prescribed displacements, zero at free dofs, (ndofs,)
    degenerate: NDArray[np.bool_]  # (m,)


def adjoint(result: Any, condensed: CondensedContact, given: Cotangents) -> Adjoint:
    """Solve the transposed system of a result on a condensation of its body.
    Raises InputError for bodies on devices or of many processes, NotConverged if it is singular."""
    system, change, moved = result.system, None, None
    if result.origin is not None and result.origin.slide is not None:
        given, change, moved = _sliding(result, condensed, given)
    problem, laws, zones, state = _linearised(result, condensed, moved)
    given, friction, tangent = _of_held_points(result, given, problem)
    scale, motion, m = condensed.point_scale, system.motion, result.mu.size
    used = Used.of(problem, zones)
    linear = used.laws(laws.law, zones, state, "radial")  # without laws of surfaces: of slip
    added = np.full(used.rows.size, 1e-13)  # as in a Newton step, for dependent rows
    added[: used.count] += (zones.slope + np.zeros(m))[zones.active]
    free = np.zeros(0, dtype=bool) if motion is None else motion.free
    per_unit = condensed.per_unit(motion) if moved is None else moved.unit
    equations: Any = condensed if moved is None else moved
    of_forces, work = equations.yielded(given.u)
    right = problem.forces(given.mu / scale, given.t / scale[:, None]) - of_forces
    of_motions = np.concatenate(
        (work if moved is None else work[:0], per_unit * given.motion[free])
    )
    if moved is not None:
        of_motions = of_motions + work
    eta = _solved(
        laws, used, added, problem, linear, np.concatenate((right[used.rows], of_motions))
    )
    n = used.rows.size
    of_used = eta[:n].copy()
    for slip in linear:
        at = np.where(slip.at >= 0, slip.at, 0)
        of_law = np.where(slip.at >= 0, eta[at], 0.0)
        of_used[slip.rows] = np.einsum("pij,pi->pj", slip.of_v, of_law)[slip.at >= 0]
    of_rows = np.zeros(problem.v0.size)
    of_rows[used.rows] = of_used
    load = equations.transposed(given.u, of_rows, eta[n:])
    normal = np.zeros(m)
    normal[zones.active] = of_used[: used.count] / scale[zones.active]
    place = used.rubbing.nonzero()
    tangent[place] += of_used[used.count :] / scale[place[0]]
    if linear:
        at_bound = np.flatnonzero(zones.slip)
        b = (zones.q / np.where(zones.slip, lengths(zones.q), 1.0))[:, at_bound].T
        along = np.sum(of_law * b, axis=1)
        size = scale if system.law == "tresca" else state.mu
        friction[at_bound] += along * size[at_bound]
    force = np.zeros(free.size)
    force[free] = per_unit * eta[eta.size - per_unit.size :]
    left, pushed = _on_bodies(system, given, (load, normal, tangent.ravel(), force), change)
    _certify(*system.body.equilibrium(load, np.zeros(load.size), left))
    reactions = left - system.body.internal(load)
    pairs = zip(system.body.bodies, system.body.slices, strict=True)
    support = np.concatenate([np.asarray(one.at_supports(reactions[own])) for one, own in pairs])
    return Adjoint(
        load, normal, tangent, force, np.where(free, 0.0, pushed), friction, support,
        _degenerate(laws, zones, state, problem, result),
    )  # fmt: skip


def _on_bodies(
    system: Any, given: Cotangents, found: tuple[Array, ...], change: RowsInMotion | None
) -> tuple[Array, Array]:
    """Forces of the adjoint system on all dofs and on motions of obstacles, which S and supports
    balance; `found` are the adjoint load, normal, tangent and force."""
    (load, normal, tangent, force), motion = found, system.motion
    left = given.u + system.rows.G.T @ normal + system.rows.T.T @ tangent
    pushed = np.zeros(force.size)
    if motion is not None:
        pushed = given.motion - motion.normal.T @ normal - motion.tangent.T @ tangent
    if change is not None:
        left = left + change.normal.T @ normal + change.tangential.T @ tangent
        left = left + change.turning.T @ (change.swing.T @ tangent)
        left = left + change.pull.T @ force - change.force.T @ load
        pushed = pushed + change.slip.T @ tangent - change.push.T @ load + change.lean.T @ force
    return left, pushed


def _sliding(
    result: Any, condensed: CondensedContact, given: Cotangents
) -> tuple[Cotangents, RowsInMotion, Any]:
    """Derivatives and equations of finite sliding, and what follows for displacement and motions
    as contact forces, their resultant, and areas depend on these."""
    slide, system = result.origin.slide, result.system
    change = slide.change(result)
    if change is None or condensed.N.shape[1]:
        raise InputError(
            "vjp: in finite sliding bodies have derivatives if they are held by supports, not by "
            "contact alone"
        )
    if np.any(given.slip):
        raise InputError("slip: in finite sliding it has no cotangent; take u, or forces")
    change, of_areas = of_pairs(slide, change, result)
    forces, body, rows = given.forces.copy(), system.body, system.rows
    owners = np.unique(rows.owner) if rows.owner.size else [0]
    if len(owners) > 1 and np.any(given.resultant):
        raise InputError("resultant: of sliding pairs of several bodies, take contact_forces")
    for k in owners:
        shifts = rigid_field(body.bodies[k].trace, np.zeros(body.dim))[:, : body.dim]
        forces[body.slices[k]] -= shifts @ given.resultant
    by_area = np.sum(given.shear * result.t, axis=1) - given.pressure * result.mu
    u = given.u + change.force.T @ forces + of_areas.T @ (by_area / rows.weights**2)
    motion = given.motion + change.push.T @ forces if given.motion.size else given.motion
    given = replace(given, u=u, motion=motion)
    return given, change, slide.equations(result, condensed, change)


def _certify(left: float, terms: float) -> None:
    missed = left / (terms or 1.0)
    if not missed <= LIMITS.solved:
        raise NotConverged(
            f"vjp: the transposed system leaves a residual of {missed:.1e}, above "
            f"{LIMITS.solved:.0e}; cells or bodies are too slender for the digits of the factors, "
            "or the solution is at the limit of friction"
        )


def _linearised(
    result: Any, condensed: CondensedContact, moved: Any
) -> tuple[BoundaryProblem, Condensed, Zones, State]:
    """The scaled boundary problem without loads, its laws, and zones and state of the solution."""
    system, scale, rows = result.system, condensed.point_scale, result.system.rows
    condensed = condensed.under(system.body)
    problem = condensed.boundary_problem(None, rows.gap, system.slip_from, system.motion)
    problem = replace(problem, compliance=system.compliance(scale))
    if moved is not None:
        problem = moved.problem
    laws = Condensed(problem, system.scaled_friction(scale) or Tresca(np.zeros(scale.size)))
    t = np.where(problem.tangent >= 0, result.t * scale[:, None], 0.0)
    u_n, u_t = system.relative(result.u, result.motion)
    touch = problem.can_touch
    through = np.where(touch, (u_n - np.where(touch, rows.gap, 0.0)) / scale, -np.inf)
    v = system.slip_increment(u_t) / scale[:, None]
    state = State(None, result.mu * scale, t.T, through, v.T)
    return problem, laws, laws.law.zones(state), state


def _of_held_points(
    result: Any, given: Cotangents, problem: BoundaryProblem
) -> tuple[Cotangents, Array, Array]:
    """Where the whole slip is prescribed, t = g b is a function of mu and of the slip: what follows
    for mu, and gradients by friction (m,) and slip (m, dim - 1)."""
    system, t = result.system, result.t
    friction, tangent = np.zeros(t.shape[0]), np.zeros(t.shape)
    size = np.linalg.norm(t, axis=1)
    held = (problem.tangent < 0).all(axis=1) & (size > 0) & ~system.rows.ties
    if held.any():
        b = t / np.where(held, size, 1.0)[:, None] * held[:, None]
        along = np.sum(b * given.t, axis=1)
        coulomb = system.law == "coulomb"
        friction = along * (result.mu if coulomb else 1.0)
        slip = np.linalg.norm(result.slip_increment, axis=1)
        ratio = np.where(held, size / np.where(slip > 0, slip, 1.0), 0.0)
        tangent = ratio[:, None] * (given.t * held[:, None] - along[:, None] * b)
        more = along * system.friction if coulomb else 0.0
        given = replace(given, mu=given.mu + more)
    return given, friction, tangent


def _solved(
    laws: Condensed, used: Used, added: Array, problem: Any, linear: list[SlipRows], right: Array
) -> Array:
    if not right.size:
        return right
    system = laws.linear(used.rows, added, problem.C[used.rows], linear)
    n, k = used.rows.size, problem.s.size
    try:
        eta = system.solve_transposed(right)
        for _ in range(2 if k else 0):  # without the springs on free motions
            held = np.concatenate((np.zeros(n), laws.springs * eta[n:]))
            eta = system.solve_transposed(right + held)
        return eta
    except LinAlgError as error:
        raise NotConverged(
            "vjp: the linearised laws are singular at this solution, which is at a limit of "
            "friction or has contact forces that are not determined; no derivative exists there"
        ) from error


def _degenerate(
    laws: Condensed, zones: Zones, state: State, problem: BoundaryProblem, result: Any
) -> NDArray[np.bool_]:
    """Points whose forces have different derivatives on two sides, (m,)."""
    size = max(float(state.mu.max(initial=0.0)), float(np.abs(state.t).max(initial=0.0)))
    near = max(LIMITS.weak, 10.0 * (result.tol or 0.0)) * (size or 1.0)
    trial = state.mu + state.through

    def force(q: Array) -> Array:
        surface = problem.compliance
        none = np.zeros_like(q)
        return np.maximum(q, 0.0) if surface is None else surface.at(none, q, none).mu

    bend = force(trial + near) - 2.0 * force(trial) + force(trial - near)
    kink = problem.can_touch & ~problem.ties & (bend > 1e-3 * near)
    rubs = (zones.stick | zones.slip) & ~problem.ties
    length = lengths(laws.law._moving(zones.q))
    bound = rubs & (np.abs(length - np.where(rubs, zones.g, 0.0)) <= near)
    return np.asarray(kink | bound)
