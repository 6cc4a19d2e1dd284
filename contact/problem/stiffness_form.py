r"""The condensed problem with the boundary stiffness instead of the compliance.

Thin bodies supported by contact alone are far softer in bending than in compression: in ``v = v_0 -
W l + C a`` large bending displacements cancel and digits are lost. Here the boundary unknowns z are
kept in addition to the forces, with the same Newton method,

.. math:: v = v_0 + B z + B N a, \qquad B^T l + S_b z = f_b, \qquad N^T B^T l = s ."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import LinAlgError, block_diag

from contact.condensation.boundary_problem import Array, BoundaryProblem, Forces
from contact.condensation.solved_body import DENSE_ORDER
from contact.errors import NotConverged
from contact.laws.condensed_newton import Condensed
from contact.laws.friction import Tresca
from contact.laws.iteration import Iteration, Report
from contact.laws.newton import LIMITS, newton, proximal_point
from contact.laws.options import Options
from contact.result.certify import certify
from contact.result.contact_result import ContactResult

if TYPE_CHECKING:
    from contact.condensation.condensed_contact import CondensedContact
    from contact.result.contact_system import ContactSystem


class StiffnessForm:
    """A condensation of moderate size in its stiffness form, for one system.
    Raises NotConverged if its matrix is too large for a second attempt."""

    def __init__(self, condensed: CondensedContact, system: ContactSystem) -> None:
        if not fits(condensed):
            raise NotConverged(f"stiffness form: more than {DENSE_ORDER} unknowns")
        self._condensed, self._system = condensed, system
        S, B, N = condensed.stiffness, condensed.B.toarray(), condensed.N
        self._unit = unit = N / np.linalg.norm(N, axis=0)
        B_z = B - (B @ unit) @ unit.T
        if N.shape[1]:  # rigid motions have only rounding stiffness in S_b: project them out
            S = S - unit @ (unit.T @ S)
            S = S - (S @ unit) @ unit.T + S.diagonal().mean() * unit @ unit.T
        # Each point is scaled by its own compliance with all other unknowns fixed.
        points = condensed.points
        scale = points.lengths((B**2) @ (1.0 / S.diagonal()))
        self._scale, self._N = scale, N
        self.point_scale = points.of_points(scale)
        moved = B @ N / scale[:, None]
        self._turn = 1.0 / np.maximum(np.abs(moved).max(axis=0, initial=0.0), 1e-300)
        R, self._per_unit = condensed.driven(system.motion, scale)
        self._elastic = S.shape[0]
        rigid = moved.shape[1] + R.shape[1]
        motion = system.motion
        force = np.zeros(0) if motion is None else motion.force[motion.free]
        _, fixed_t = condensed.prescribed(system.rows.gap, system.slip_from, motion)
        self._resting = np.concatenate(
            (self._turn * condensed.resultants(system.load), self._per_unit * force)
        )
        tangent = condensed.rubbing(fixed_t, motion)
        self.problem = BoundaryProblem(
            W=np.zeros((scale.size, scale.size)),
            v0=np.zeros(scale.size),
            C=np.hstack((B_z / scale[:, None], moved * self._turn, R)),
            s=np.zeros(S.shape[0] + rigid),
            gap=system.rows.gap / self.point_scale,
            normal=points.normal,
            tangent=tangent,
            prescribed_slip=fixed_t / self.point_scale[:, None],
            K=block_diag(S, np.zeros((rigid, rigid))),
            compliance=system.compliance(self.point_scale),
            bonded=system.rows.ties if system.rows.bonded.size else None,
            swept=condensed.swept(tangent, fixed_t, motion),
        )

    def solve(
        self, near: ContactResult | None, tol: float, report: Report
    ) -> tuple[Any, Array | None]:
        """Displacement and forces (u, mu, t), and the obstacles' motions, near those of a result.
        Iterative refinement: each step solves for a change; with slender cells the residual comes
        from strains. Raises NotConverged, or LinAlgError for a singular system."""
        system, scale = self._system, self.point_scale
        # A free motion has the prescribed value NaN; here it starts from zero.
        motion = None if system.motion is None else np.nan_to_num(system.motion.prescribed)
        u, last = self._condensed.body.constraint[1], np.inf
        mu, t = self.problem.zeros()
        if near is not None:
            u, mu, t = near.u, near.mu, near.t
            motion = None if near.motion is None else near.motion.copy()
        problem, left = self._about(u, motion)
        now = Forces(mu * scale, t * scale[:, None], np.zeros(problem.s.size))
        if near is None:
            now = replace(now, a=self._motions(problem, now.mu, now.t))
        for _ in range(10):  # each step adds the digits of the factorisation
            # The next step reduces the residual.
            now = self._change(problem, now, max(tol, 1e-8), report)
            du = self._condensed.moved(left, self._of_boundary(now.a))
            u = u + du
            if motion is not None and system.motion is not None:
                found = self._per_unit * now.a[self._elastic + self._N.shape[1] :]
                motion[system.motion.free] += found
            size = system.body.largest_displacement(du)
            # Converged at the rounding of the displacements, or at that of an assembled matrix,
            # where the change is no longer halved.
            reach = system.body.largest_displacement(u)
            if size <= np.finfo(float).eps * reach or size > 0.5 * last:
                break
            last = size
            problem, left = self._about(u, motion)
            now = replace(now, a=np.zeros(now.a.size))
        if self._condensed.slender and size > 1e-6 * reach:  # less than six reliable digits
            raise NotConverged(
                f"refinement of the displacement ended with a change of {size / reach:.1e} of it: "
                "the cells are too slender for the digits of their stiffness; make them squarer"
            )
        return (u, now.mu / scale, now.t / scale[:, None]), motion

    def _about(self, u: Array, w: Array | None) -> tuple[BoundaryProblem, Array]:
        """The problem for the change of a displacement u, and the load minus the forces of u."""
        system, condensed = self._system, self._condensed
        left = system.load - system.body.internal(u)
        reduced = self._without_rigid(condensed.carried(left))
        u_n, u_t = system.relative(u, w)
        v0 = condensed.points.stacked(u_n, system.slip_increment(u_t))
        s = np.concatenate((reduced, self._resting))
        return replace(self.problem, v0=v0 / self._scale, s=s), left

    def _change(self, problem: BoundaryProblem, start: Forces, tol: float, note: Report) -> Forces:
        scale = self.point_scale
        friction = self._system.scaled_friction(scale) or Tresca(np.zeros(scale.size))
        laws = Condensed(problem, friction)
        for form in ("switched", "damped", "radial"):
            with suppress(NotConverged, LinAlgError):
                return newton(laws, start, form=form, tol=tol, phase="stiff newton", report=note)
        return proximal_point(laws, start, tol=tol, report=note)

    def _of_boundary(self, a: Array) -> Array:
        """The boundary's unknowns z of the motions a, elastic and rigid."""
        rigid = a[self._elastic : self._elastic + self._N.shape[1]]
        return self._without_rigid(a[: self._elastic]) + self._N @ (self._turn * rigid)

    def _without_rigid(self, z: Array) -> Array:
        return z - self._unit @ (self._unit.T @ z)

    def _motions(self, problem: BoundaryProblem, mu: Array, t: Array) -> Array:
        """Motions a under given forces; rigid ones such that loaded points touch."""
        n = self._elastic
        assert problem.K is not None
        a = np.zeros(problem.s.size)
        left = problem.s - problem.C.T @ problem.forces(mu, t)
        # Rank tolerances: rounding of a stiffness, 1e-14, and of coordinates, 1e-9.
        a[:n] = np.linalg.lstsq(problem.K[:n, :n], left[:n], rcond=1e-14)[0]
        if a.size > n:
            u_n, _ = problem.displacements(np.zeros_like(mu), np.zeros_like(t), a)
            loaded = problem.can_touch & ((mu > 0) | problem.ties)
            at = problem.normal[loaded]
            off = (problem.gap - u_n)[loaded]
            a[n:] = np.linalg.lstsq(problem.C[at, n:], off, rcond=1e-9)[0]
        return a


def fits(condensed: CondensedContact) -> bool:
    """Whether the matrix of the stiffness form is of moderate size."""
    return sum(condensed.B.shape) <= DENSE_ORDER


def solved_stiffly(
    system: ContactSystem,
    condensed: CondensedContact,
    options: Options,
    near: ContactResult | None,
    report: Report,
    history: list[Iteration],
) -> ContactResult:
    """Solve and certify in the stiffness form, starting from a result or from rest.
    Raises as `StiffnessForm.solve`, and NotConverged if the certificate fails."""
    form = StiffnessForm(condensed, system)
    (u, mu, t), motion = form.solve(near, LIMITS.inner * options.tol, report)
    t = system.with_held_points(u, mu, t, motion)
    result = ContactResult(system, u, mu, t, options.method, tuple(history), motion, options.tol)
    certify(result, options.tol, 0.0)
    return result


def refined(
    system: ContactSystem,
    condensed: CondensedContact,
    options: Options,
    result: ContactResult,
    report: Report,
    history: list[Iteration],
) -> ContactResult:
    """The result for a body with slender cells after iterative refinement.
    Raises NotConverged if it has too few reliable digits, or fails its certificate."""
    try:
        return solved_stiffly(system, condensed, options, result, report, history)
    except (NotConverged, LinAlgError) as error:
        remedy = (
            ""
            if "slender" in str(error)
            else (
                "; the cells are too slender for the digits of their stiffness, make them squarer"
            )
        )
        raise NotConverged(f"{error}{remedy}", tuple(history)) from error
