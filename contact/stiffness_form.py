r"""The condensed problem with the stiffness of its boundary in place of the compliance.

Thin bodies that contact alone holds bend far more easily than they are compressed: in
``v = v_0 - W l + C a`` displacements of bending cancel to those of compression, and with them the
digits. Here the boundary's own unknowns z are kept beside the forces,

.. math:: v = v_0 + B z + B N a, \qquad B^T l + S_b z = f_b, \qquad N^T B^T l = s ,

so that what is in contact is held by equations and nothing cancels. The same Newton's method solves
it, with a larger matrix.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import LinAlgError, block_diag

from contact.boundary import Array, BoundaryProblem, Friction
from contact.errors import NotConverged
from contact.methods import INNER, Options
from contact.newton import Forces, Iteration, Report, semismooth_newton
from contact.proximal_point import proximal_point
from contact.result import ContactResult, certify

if TYPE_CHECKING:
    from contact.condense import CondensedContact
    from contact.system import ContactSystem


_LARGEST = 8000  # order of a matrix that takes 20 s and half a gigabyte to factor


class StiffnessForm:
    """A condensation of moderate size in its stiffness form.

    Parameters
    ----------
    condensed : CondensedContact
    system : ContactSystem
        What is to be solved.

    Raises
    ------
    NotConverged
        Its matrix would be too large for a second attempt.
    """

    def __init__(self, condensed: CondensedContact, system: ContactSystem) -> None:
        if sum(condensed._B.shape) > _LARGEST:
            raise NotConverged(f"stiffness form: more than {_LARGEST} unknowns")
        self._condensed, self._system = condensed, system
        S, B = condensed.stiffness, condensed._B.toarray()
        N = condensed._N
        if N.shape[1]:  # no rounding of S_b resists rigid motions
            unit = N / np.linalg.norm(N, axis=0)
            B_z = B - (B @ unit) @ unit.T
            S = S - unit @ (unit.T @ S)
            S = S - (S @ unit) @ unit.T + S.diagonal().mean() * unit @ unit.T
        else:
            B_z = B
        # Each point in units of its own compliance, all other unknowns held.
        own, scale = (B**2) @ (1.0 / S.diagonal()), np.ones(B.shape[0])
        for rows in np.column_stack((condensed._normal, condensed._tangent)):
            live = rows[rows >= 0]
            if np.any(own[live] > 0):
                scale[live] = np.sqrt(own[live][own[live] > 0].mean())
        self._scale, self._N = scale, N
        first = np.maximum(condensed._normal, condensed._tangent.max(axis=1))
        self.point_scale = np.where(first >= 0, scale[np.maximum(first, 0)], 1.0)
        moved = B @ N / scale[:, None]
        self._turn = 1.0 / np.maximum(np.abs(moved).max(axis=0, initial=0.0), 1e-300)
        R, self._per_unit = condensed._driven(system.motion, scale)
        self._elastic = S.shape[0]
        rigid = moved.shape[1] + R.shape[1]
        reduced, motion = condensed.reduce(system.load), system.motion
        force = np.zeros(0) if motion is None else motion.force[motion.free]
        fixed_n, fixed_t = condensed._given(system.rows.gap, system.slip_from, motion)
        v0 = np.zeros(B.shape[0])
        live_n, live_t = condensed._normal >= 0, condensed._tangent >= 0
        v0[condensed._normal[live_n]] = fixed_n[live_n]
        v0[condensed._tangent[live_t]] = fixed_t[live_t]
        if N.shape[1]:
            reduced = reduced - unit @ (unit.T @ reduced)
        self.problem = BoundaryProblem(
            W=np.zeros((scale.size, scale.size)),
            v0=v0 / scale,
            C=np.hstack((B_z / scale[:, None], moved * self._turn, R)),
            s=np.concatenate(
                (reduced, self._turn * condensed._resultants(system.load), self._per_unit * force)
            ),
            gap=system.rows.gap / self.point_scale,
            normal=condensed._normal,
            tangent=condensed._tangent,
            held=fixed_t / self.point_scale[:, None],
            K=block_diag(S, np.zeros((rigid, rigid))),
        )

    def solve(self, mu: Array, t: Array, tol: float, report: Report) -> tuple[Any, Array | None]:
        """Displacement and forces (u, mu, t), and the obstacles' motions, near given forces.

        Raises
        ------
        NotConverged, LinAlgError
        """
        system, problem, scale = self._system, self.problem, self.point_scale
        law = system.scaled_friction(scale) or Friction(np.zeros(scale.size), coulomb=False)
        start = Forces(
            mu * scale, t * scale[:, None], self._motions(mu * scale, t * scale[:, None])
        )
        try:
            forces = semismooth_newton(
                problem, start, law, tol=tol, max_iterations=50, phase="stiff newton", report=report
            )
        except (NotConverged, LinAlgError):
            forces = proximal_point(problem, law, start, tol=tol, report=report)
        rigid = self._elastic + self._N.shape[1]
        z = forces.a[: self._elastic]
        if self._N.shape[1]:
            unit = self._N / np.linalg.norm(self._N, axis=0)
            z = z - unit @ (unit.T @ z)
            z = z + self._N @ (self._turn * forces.a[self._elastic : rigid])
        u = self._condensed.expand(system.load, z)
        motion = None
        if system.motion is not None:
            motion = system.motion.prescribed.copy()
            motion[system.motion.free] = self._per_unit * forces.a[rigid:]
        return (u, forces.mu / scale, forces.t / scale[:, None]), motion

    def _motions(self, mu: Array, t: Array) -> Array:
        """Motions a that given forces cause; rigid ones such that loaded points touch."""
        problem, n = self.problem, self._elastic
        assert problem.K is not None
        a = np.zeros(problem.s.size)
        left = problem.s - problem.C.T @ problem.forces(mu, t)
        a[:n] = np.linalg.lstsq(problem.K[:n, :n], left[:n], rcond=1e-14)[0]
        if a.size > n:
            u_n, _ = problem.displacements(np.zeros_like(mu), np.zeros_like(t), a)
            loaded = problem.can_touch & (mu > 0)
            at = problem.normal[loaded]
            off = (problem.gap - u_n)[loaded]
            a[n:] = np.linalg.lstsq(problem.C[at, n:], off, rcond=1e-9)[0]
        return a


def solved_stiffly(
    system: ContactSystem,
    condensed: CondensedContact,
    options: Options,
    near: ContactResult | None,
    report: Report,
    history: list[Iteration],
) -> ContactResult:
    """Solve and certify in the stiffness form, near a result or from rest.

    Raises
    ------
    NotConverged, LinAlgError
    """
    form = StiffnessForm(condensed, system)
    mu, t = form.problem.zeros() if near is None else (near.mu, near.t)
    (u, mu, t), motion = form.solve(mu, t, INNER * options.tol, report)
    result = ContactResult(system, u, mu, t, options.method, tuple(history), motion, options.tol)
    certify(result, options.tol, 0.0)
    return result
