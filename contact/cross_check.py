"""The same contact problem, solved by an independent QP solver and compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.cones import solve_cones
from contact.errors import InputError
from contact.peers import solve_with
from contact.result import ContactResult

if TYPE_CHECKING:
    from contact.problem import ContactProblem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CrossCheck:
    """How far an independent solver's answer is from ours.

    Attributes
    ----------
    solver : str
    size : int
        Unknowns of the QP that was handed over.
    displacement : float
        Largest difference of u over the largest displacement.
    multipliers : float
        Largest difference of a contact force over the largest contact force.
    objective : float
        Difference of the energies over the size of the larger.
    seconds : float
        Time of the peer.
    """

    solver: str
    size: int
    displacement: float
    multipliers: float
    objective: float
    seconds: float

    def __str__(self) -> str:
        return (
            f"{self.solver:>9} on {self.size} unknowns: displacement {self.displacement:.1e}, "
            f"multipliers {self.multipliers:.1e}, objective {self.objective:.1e} "
            f"({self.seconds:.2f} s)"
        )


def cross_check(
    problem: ContactProblem,
    result: ContactResult,
    solver: str = "osqp",
    *,
    condensed: bool | None = None,
) -> CrossCheck:
    r"""Solve the problem again with another package and compare.

    The peer gets, with free unknowns z and one slack s per friction row,

    .. math::
        \min_{z, s} \tfrac12 z^T S z - f^T z + g^T s \quad
        \text{s.t.} \quad G z \le d, \; -s \le T z \le s .

    A Coulomb problem is checked at its solution: with the bound frozen at g = F mu it is the
    given-friction problem that the solution must also solve.

    Parameters
    ----------
    problem : ContactProblem
    result : ContactResult
    solver : str
        A solver of qpsolvers: "osqp" (polished), "proxqp", "piqp", "clarabel", ...
    condensed : bool, optional
        Hand over the dense problem on the contact boundary instead of the full sparse one.
        Default: from 30,000 unknowns on.

    In 3-D the friction terms are cones, s_i >= |T_i z|, and the peer is Clarabel.

    Returns
    -------
    CrossCheck

    Raises
    ------
    InputError
        Friction in three dimensions and not Clarabel, or a solver that qpsolvers does not know.
    MissingDependency
        The solver is not installed.
    NotConverged
        The peer gave up.
    """
    system, dim = result.system, result.system.body.dim
    cones = dim == 3 and system.law is not None
    if cones and solver != "clarabel":
        raise InputError(
            "cross_check: friction in 3-D is a cone problem, not a QP; use solver='clarabel'"
        )
    if result.u.size != problem.body.basis.N or result.mu.size != problem.rows.gap.size:
        raise InputError(
            f"result: has {result.u.size} unknowns and {result.mu.size} contact points, the "
            f"problem {problem.body.basis.N} and {problem.rows.gap.size}"
        )
    rows, (T, u0) = system.rows, system.body.constraint
    if condensed is None:
        condensed = T.shape[1] > 30_000
    usable = np.isfinite(rows.gap)
    bound = system.bound(result.mu)
    rubbing = bound > 0
    if cones:  # friction of points whose whole slip is prescribed acts on supports alone
        rubbing &= system.body.live(rows.T).reshape(result.t.shape).any(axis=1)
    rubs = np.repeat(rubbing, dim - 1)
    G, R = rows.G[usable], rows.T[rubs]
    gap, g, offset = rows.gap[usable] - G @ u0, bound[rubbing], R @ u0
    if system.slip_from is not None:
        offset = offset - system.slip_from.ravel()[rubs]
    if system.motion is not None and result.motion is not None:  # checked at the motion found
        w_n, w_t = system.motion.displacement(result.motion)
        gap, offset = gap + w_n[usable], offset - w_t.ravel()[rubs]
    if condensed:
        boundary = problem.condense().under(system.body)
        S, f = sparse.csr_array(boundary.stiffness), boundary.reduce(system.load)
        G, R = (sparse.csr_array(boundary.restrict(rows_)) for rows_ in (G, R))
    else:
        S = sparse.csr_array(T.T @ system.body.stiffness @ T)
        f = T.T @ (system.load - system.body.stiffness @ u0)
        G, R = sparse.csr_array(G @ T), sparse.csr_array(R @ T)
    keep_n, keep_t = _nonzero_rows(G), _nonzero_rows(R)
    if cones:
        keep_t = np.arange(R.shape[0])  # a row that supports hold still belongs to its cone
    else:
        g = g[keep_t]
    G, gap, R, offset = G[keep_n], gap[keep_n], R[keep_t], offset[keep_t]

    n, k = f.size, g.size
    mu, t = np.zeros(result.mu.size), np.zeros(result.t.size)
    if cones:
        z, pressing, pushed, seconds = solve_cones(S, f, G, gap, R, offset.reshape(k, -1), g)
    else:
        one = sparse.eye_array(k, format="csr")
        P = sparse.block_diag((S, sparse.csr_array((k, k))), format="csr")
        H = sparse.block_array([[G, sparse.csr_array((gap.size, k))], [R, -one], [-R, -one]])
        h = np.concatenate((gap, -offset, offset))
        matrices = (P.toarray(), H.toarray()) if condensed else (P, H)
        solution, seconds = solve_with(solver, matrices[0], np.r_[-f, g], matrices[1], h)
        z, pressing = solution.x[:n], solution.z[: gap.size]
        pushed = solution.z[gap.size : gap.size + k] - solution.z[gap.size + k :]
    mu[np.flatnonzero(usable)[keep_n]] = pressing
    t[np.flatnonzero(rubs)[keep_t]] = pushed.ravel()
    u = boundary.expand(system.load, z) if condensed else T @ z + u0

    def energy(u: Array) -> float:
        slip = np.linalg.norm(system.slip_increment(system.relative(u, result.motion)[1]), axis=1)
        return system.energy(u) + float(system.bound(result.mu) @ slip)

    ours, theirs = energy(result.u), energy(u)
    force = max(np.abs(result.mu).max(initial=0.0), np.abs(result.t).max(initial=0.0)) or 1.0
    difference = max(
        np.abs(mu - result.mu).max(initial=0.0), np.abs(t - result.t.ravel()).max(initial=0.0)
    )
    return CrossCheck(
        solver=solver,
        size=n + k,
        displacement=float(np.abs(u - result.u).max() / (np.abs(result.u).max() or 1.0)),
        multipliers=float(difference / force),
        objective=abs(ours - theirs) / max(abs(ours), abs(theirs), np.finfo(float).tiny),
        seconds=seconds,
    )


def _nonzero_rows(rows: sparse.csr_array) -> NDArray[np.int64]:
    size = np.asarray(rows.multiply(rows).sum(axis=1)).ravel()
    return np.flatnonzero(size > 1e-24 * size.max(initial=0.0))
