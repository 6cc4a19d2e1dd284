r"""One step of Newton's method for bodies that slide, with the derivative of the projection.

With the derivatives E of the contact conditions and K of the contact forces with respect to the
displacement at which they were projected, the change :math:`\delta` of the displacement solves

.. math::
    (S + K) \delta + B^T l = f - S u, \qquad v = v(u) + (B + E) \delta ,

and the laws of contact between v and the forces l. Only dofs of the two boundaries occur in E and
K, so that the inner ones are eliminated by the factorisation of S alone, as ever.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import lu_factor, lu_solve

from contact.condensation.boundary_problem import Forces
from contact.laws.friction import Tresca
from contact.laws.methods import INNER
from contact.laws.semismooth_newton import semismooth_newton

if TYPE_CHECKING:
    from contact.condensation.condensed_contact import CondensedContact
    from contact.result.contact_result import ContactResult
    from contact.result.contact_system import ContactSystem
    from contact.rows.interfaces import RowsInMotion

Array = NDArray[np.float64]


def newton_step(
    system: ContactSystem,
    condensed: CondensedContact,
    change: RowsInMotion,
    last: ContactResult,
    tol: float,
) -> tuple[Array, Array, Array]:
    """Displacement and contact forces (u, mu, t) of the next iterate.

    Parameters
    ----------
    system : ContactSystem
        With the rows projected at the displacement of `last`.
    condensed : CondensedContact
        Of these rows; without free motions.
    change : RowsInMotion
        The derivatives.
    last : ContactResult
        The last iterate.
    tol : float

    Raises
    ------
    NotConverged, LinAlgError
        The laws of contact are not solved, or the matrix is singular.
    """
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
    forces = semismooth_newton(problem, start, friction, tol=INNER * tol)
    l = problem.forces(forces.mu, forces.t) / of_rows
    du = condensed.moved(left, response[:, 0] - response[:, 1:] @ l)
    u, mu = u + du, forces.mu / scale
    return u, mu, system.with_held_points(u, mu, forces.t / scale[:, None], last.motion)
