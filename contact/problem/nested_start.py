"""Initial guess from the solution for other loads or on another mesh (nested iteration)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from contact.condensation.boundary_problem import BoundaryProblem, Forces
from contact.errors import InputError
from contact.laws.friction import Friction
from contact.laws.status import Status

if TYPE_CHECKING:
    from contact.result.contact_result import ContactResult
    from contact.result.contact_system import ContactSystem

Array = NDArray[np.float64]


def start_forces(
    result: ContactResult, system: ContactSystem, problem: BoundaryProblem, scale: Array
) -> Forces:
    """Contact forces near a solution, in the scale of a problem: physical = scaled / scale.
    Tractions of another mesh are interpolated; rigid motions bring loaded points closest to the
    obstacle and sticking ones to zero slip. Raises InputError for another dimension."""
    dims = result.x.shape[0], system.rows.x.shape[0]
    if dims[0] != dims[1]:
        raise InputError(
            f"start: a result in {dims[0]} dimensions for a problem in {dims[1]}; start from a "
            "solution of the same part"
        )
    rows, theirs = system.rows, result.system.rows
    # Meshes are equal if their contact points differ by rounding only.
    x, there = rows.x_nominal, theirs.x_nominal
    same = there is x or (
        there.shape == x.shape and np.allclose(there, x, rtol=0.0, atol=1e-9 * float(np.ptp(x)))
    )
    mu, t = (result.mu, result.t) if same else _interpolated(result, system)
    mu, t = mu * scale, t * scale[:, None]
    motion = np.zeros(problem.s.size)
    if motion.size:
        closed = problem.can_touch & ((mu > 1e-9 * mu.max(initial=0.0)) | problem.ties)
        if same and problem.compliance is not None and problem.compliance.softens:
            closed |= problem.can_touch & (result.status != Status.OPEN)  # under tension, too
        motion = _motion(problem, mu, t, system.scaled_friction(scale), closed)
    return Forces(mu, t, motion)


def _interpolated(result: ContactResult, system: ContactSystem) -> tuple[Array, Array]:
    """Forces (mu, t) on the contact points of a system from the tractions of a result.
    Each point takes the mean of the dim nearest ones on its boundary, weighted by inverse
    distances: linear interpolation in two dimensions."""
    rows, theirs = system.rows, result.system.rows
    shear = np.einsum("djm,mj->dm", theirs.tangents, result.shear + result.tie_shear)
    traction = np.vstack((result.pressure + result.tie_pressure, shear))
    part = rows.boundary
    if part.max() != result.part.max():  # other boundaries: match points by position only
        pairs = [(np.full(part.size, True), np.full(result.part.size, True))]
    else:
        pairs = [(part == k, result.part == k) for k in range(part.max() + 1)]
    found = np.zeros((traction.shape[0], rows.gap.size))
    for here, there in pairs:
        near = min(rows.x.shape[0], int(there.sum()))
        distance, index = scipy.spatial.cKDTree(theirs.x[:, there].T).query(
            rows.x[:, here].T, k=range(1, near + 1)
        )
        # The lower bound of the distance avoids a division by zero at coinciding points.
        share = 1.0 / np.maximum(distance, 1e-12 * float(np.ptp(theirs.x)))
        share /= share.sum(axis=1, keepdims=True)
        found[:, here] = np.sum(traction[:, there][:, index] * share, axis=2)
    mu = found[0] * rows.weights
    t = -np.einsum("djm,dm->mj", rows.tangents, found[1:]) * rows.weights[:, None]
    return mu, t


def _motion(
    problem: BoundaryProblem, mu: Array, t: Array, friction: Friction | None, loaded: Any
) -> Array:
    """Free rigid motions of the body and its obstacles by least squares over the points in contact,
    shape (k,)."""
    u_n, u_t = problem.displacements(mu, t, np.zeros(problem.s.size))
    # Smaller forces are rounding; a force within a thousandth of its bound counts as slip.
    g = problem.bound(np.zeros(mu.size) if friction is None else friction.bound(mu))
    sticks = (problem.tangent >= 0) & (np.linalg.norm(t, axis=1) < 0.999 * g)[:, None]
    at = np.concatenate((problem.normal[loaded], problem.tangent[sticks]))
    off = np.concatenate(((problem.gap - u_n)[loaded], -u_t[sticks]))
    # Drop motions that these points determine only up to rounding, 1e-9.
    return np.asarray(np.linalg.lstsq(problem.C[at], off, rcond=1e-9)[0])
