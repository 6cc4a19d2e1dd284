"""The problem with given friction that a solution must also solve, as an optimisation in z."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cholesky, eigh, qr, solve_triangular

from contact.checks.surface_slacks import SurfaceSlacks
from contact.laws.qp_peers import solve_with
from skfem_adini.ground.errors import optional

if TYPE_CHECKING:
    from contact.condensation.condensed_contact import CondensedContact
    from contact.result.contact_result import ContactResult

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Answer:
    """The solution that a solver of another package found."""

    z: Array | None  # shape (n,), None if it found none
    mu: Array  # normal forces of all contact points, shape (m,)
    t: Array  # tangential forces, shape (m, dim - 1)
    seconds: float


@dataclass(frozen=True)
class FrozenProblem:
    r"""Friction with the bound g, and the obstacles' positions, frozen at those of a solution.

    .. math::
        \min_z \tfrac12 z^T S z - f^T z + \sum_i g_i |R_i z + o_i| \quad
        \text{s.t.} \quad G z \le d, \; E z = e ."""

    S: Any  # stiffness of free or boundary unknowns, then slacks, shape (n, n)
    f: Array  # load, shape (n,)
    G: Any  # rows of points that can touch, then limits of slacks, shape (j, n)
    gap: Array  # d, shape (j,)
    R: Any  # rows of points with friction, point by point, shape (k * slips, n)
    offset: Array  # o, shape (k * slips,)
    E: Any  # rows of bonded points, shape (l, n)
    closed: Array  # e, shape (l,)
    bound: Array  # g, shape (k,)
    pressing: Index  # indices of the first rows of G among the forces (mu, t)
    rubbing: Index  # indices of the rows of R, shape (k * slips,)
    bonded: Index  # indices of the rows of E, shape (l,)
    shape: tuple[int, int]  # of the tangential forces t, (m, dim - 1)
    cones: bool  # friction terms are cones, as in three dimensions
    unknowns: int  # n without the slacks

    @classmethod
    def of(cls, result: ContactResult, boundary: CondensedContact | None, cones: bool) -> Self:
        """Freeze friction and obstacles at a result, in the unknowns of a contact boundary.
        Without `boundary`, in all free unknowns of the body."""
        system = result.system
        rows, (P, u0) = system.rows, system.body.constraint
        m, columns = result.t.shape
        ties, bound = rows.ties, system.bound(result.mu)
        rubs = (bound > 0) & ~ties
        # Friction of points whose whole slip is prescribed acts on supports only.
        rubs &= system.body.unconstrained(rows.T).reshape(m, columns).any(axis=1)
        normal, tangential = _targets(result)
        all_rows: Any = sparse.vstack((rows.G, rows.T), format="csr")
        targets = np.concatenate((normal, tangential.ravel())) - all_rows @ u0
        pressing = np.flatnonzero(np.isfinite(rows.gap) & ~ties)
        rubbing = m + np.flatnonzero(np.repeat(rubs, columns))
        bonded = np.flatnonzero(np.concatenate((ties, np.repeat(ties, columns))))
        S: Any
        if boundary is not None:
            S, f = boundary.stiffness, boundary.reduce(system.load)
            parts: list[Any] = [
                boundary.restrict(all_rows[at]) for at in (pressing, rubbing, bonded)
            ]
        else:
            S = sparse.csr_array(P.T @ system.body.stiffness @ P)
            f = P.T @ (system.load - system.body.stiffness @ u0)
            parts = [sparse.csr_array(all_rows[at] @ P) for at in (pressing, rubbing, bonded)]
        G, R, E = parts
        g, live = bound[rubs], [_nonzero_rows(part) for part in parts]
        if cones:
            live[1] = np.arange(R.shape[0])  # a fixed row still belongs to its cone
        else:
            g = g[live[1]]
        G, R, E = (part[at] for part, at in zip(parts, live, strict=True))
        at = [
            numbers[kept] for numbers, kept in zip((pressing, rubbing, bonded), live, strict=True)
        ]
        found = cls(
            *(S, f, G, targets[at[0]], R, -targets[at[1]], E, targets[at[2]]),
            *(g, *at, (m, columns), cones, f.size),
        )
        return found._with(SurfaceSlacks.of(system))

    def _with(self, slacks: SurfaceSlacks) -> Self:
        """The program with the slacks of compliant surfaces after its unknowns."""
        total, own = slacks.among(self.pressing)
        count = own.point.size
        if count == 0:
            return self
        soft, begin = own.start
        gap = self.gap.copy()
        gap[np.searchsorted(self.pressing, soft)] += begin
        ended = np.isfinite(own.length)
        one = sparse.eye_array(count, format="csr")
        limits: Any = sparse.vstack((-one, one[ended]))
        none = [sparse.csr_array((part.shape[0], count)) for part in (self.S, self.R, self.E)]
        dense = not sparse.issparse(self.S)
        return replace(
            self,
            S=_blocks([[self.S, none[0]], [none[0].T, sparse.diags_array(own.stiffness)]], dense),
            f=np.concatenate((self.f, -own.force)),
            G=_blocks([[self.G, -total], [None, limits]], dense),
            gap=np.concatenate((gap, np.zeros(count), own.length[ended])),
            R=_blocks([[self.R, none[1]]], dense),
            E=_blocks([[self.E, none[2]]], dense),
        )

    @property
    def size(self) -> int:
        """Number of unknowns, including the slacks."""
        return self.f.size + self.bound.size

    def solved_by(self, solver: str) -> Answer:
        """Solve the program, in variables of unit size, with another package.
        Raises InputError for a name unknown to qpsolvers, MissingDependency if it is not
        installed."""
        if self.bonded.size and not sparse.issparse(self.S):
            return self._without_ties(solver)
        k = self.bound.size
        slips = self.R.shape[0] // k if k else 1  # rows per point
        unit = UnitProgram.of(self.S, self.f, self.G, self.R, slips, self.E)
        gap, g = self.gap / unit.normal, self.bound * unit.tangential
        closed = self.closed / unit.tied
        offset = self.offset.reshape(k, slips) / unit.tangential[:, None]
        found: tuple[Array | None, Array, Array, Array, float]
        if self.cones:
            found = solve_cones(unit, gap, offset, g, closed)
        else:
            found = solve_split(solver, unit, gap, offset.ravel(), g, closed)
        w, pressed, pushed, pulled, seconds = found
        m, columns = self.shape
        forces = np.zeros(m * (1 + columns))
        forces[self.pressing] = (pressed / unit.normal)[: self.pressing.size]
        forces[self.rubbing] = (pushed.reshape(k, slips) / unit.tangential[:, None]).ravel()
        forces[self.bonded] = pulled / unit.tied
        z = None if w is None else (unit.back @ w)[: self.unknowns]
        return Answer(z, forces[:m], forces[m:].reshape(self.shape), seconds)

    def _without_ties(self, solver: str) -> Answer:
        """The answer in unknowns that satisfy the equations of bonded points exactly."""
        unit = 1.0 / np.sqrt(self.S.diagonal())
        ties = TieElimination.of(self.E, self.closed, unit)
        start, free = ties.start, ties.free
        G, R = self.G @ free, self.R @ free
        touches = _kept(G, self.G * unit)  # the equations determine the others
        touches[self.pressing.size :] = True  # limits of slacks
        slides = np.ones(R.shape[0], dtype=bool) if self.cones else _kept(R, self.R * unit)
        reduced = replace(
            self,
            S=free.T @ self.S @ free,
            f=free.T @ (self.f - self.S @ start),
            G=G[touches],
            gap=(self.gap - self.G @ start)[touches],
            R=R[slides],
            offset=(self.offset + self.R @ start)[slides],
            E=np.zeros((0, free.shape[1])),
            closed=np.zeros(0),
            bound=self.bound if self.cones else self.bound[slides],
            pressing=self.pressing[touches[: self.pressing.size]],
            rubbing=self.rubbing[slides],
            bonded=self.bonded[:0],
            unknowns=free.shape[1],
        )
        m = self.shape[0]
        answer = Answer(np.zeros(0), np.zeros(m), np.zeros(self.shape), 0.0)
        if free.shape[1]:  # otherwise the equations determine all
            answer = reduced.solved_by(solver)
        if answer.z is None:
            return answer
        z = start + free @ answer.z
        forces = np.concatenate((answer.mu, answer.t.ravel()))
        pressed = self.G[: self.pressing.size].T @ forces[self.pressing]
        left = self.f - self.S @ z - pressed - self.R.T @ forces[self.rubbing]
        forces[self.bonded] = ties.forces(left, self.bonded.size)
        mu, t = forces[:m], forces[m:].reshape(self.shape)
        return Answer(z[: self.unknowns], mu, t, answer.seconds)


def _targets(result: ContactResult) -> tuple[Array, Array]:
    """Gap of each point, and the tangential displacement of zero slip, including obstacles."""
    system = result.system
    normal, tangential = system.rows.gap, np.zeros(result.t.shape)
    if system.slip_from is not None:
        tangential = tangential + system.slip_from
    if system.motion is not None and result.motion is not None:
        w_n, w_t = system.motion.displacement(result.motion)
        normal, tangential = normal + w_n, tangential + w_t
    return normal, tangential


def _blocks(parts: list[list[Any]], dense: bool) -> Any:
    """A matrix of blocks; None is zero."""
    found = sparse.block_array(parts, format="csr")
    return found.toarray() if dense else found


def _kept(rows: Array, before: Array) -> NDArray[np.bool_]:
    """Mask of rows that an elimination has not reduced to rounding."""
    left, size = (np.linalg.norm(part, axis=1) for part in (rows, before))
    return np.asarray(left > 1e-10 * size)


def _nonzero_rows(rows: Any) -> Index:
    size = np.asarray((rows * rows).sum(axis=1)).ravel()
    # Squared, relative to the largest: prescribed rows vanish up to rounding, 1e-12.
    return np.flatnonzero(size > 1e-24 * size.max(initial=0.0))


def solve_split(
    solver: str, unit: UnitProgram, gap: Array, offset: Array, g: Array, closed: Array
) -> tuple[Array | None, Array, Array, Array, float]:
    """Solve a QP with a slack for the modulus of each slip.
    Returns w, the forces of the rows G, R and E, and seconds."""
    n, k = unit.f.size, g.size
    if sparse.issparse(unit.P):
        one: Any = sparse.eye_array(k, format="csr")
        none: Any = sparse.csr_array((n, k))
        S: Any = unit.P
        P: Any = sparse.vstack((sparse.hstack((S, none)), sparse.csr_array((k, n + k))))
        A: Any = sparse.hstack((unit.E, sparse.csr_array((closed.size, k))))
        H: Any = sparse.block_array(
            [[unit.G, sparse.csr_array((gap.size, k))], [unit.R, -one], [-unit.R, -one]]
        )
    else:
        one, none = np.eye(k), np.zeros((n, k))
        P = np.block([[unit.P, none], [none.T, 0.0 * one]])
        A = np.zeros((0, n + k))  # equations are eliminated
        H = np.block([[unit.G, np.zeros((gap.size, k))], [unit.R, -one], [-unit.R, -one]])
    h = np.concatenate((gap, -offset, offset))
    equal = (A, closed) if closed.size else (None, None)
    solution, seconds = solve_with(solver, P, np.r_[-unit.f, g], H, h, *equal)
    if solution.x is None or solution.z is None:
        mu, t, r = (np.full(size, np.nan) for size in (gap.size, k, closed.size))
        return None, mu, t, r, seconds
    pushed = solution.z[gap.size : gap.size + k] - solution.z[gap.size + k :]
    pulled = np.asarray(solution.y) if closed.size else np.zeros(0)
    return solution.x[:n], solution.z[: gap.size], pushed, pulled, seconds


@dataclass(frozen=True)
class TieElimination:
    """The solutions ``z = start + free y`` of ``E z = e``, and the forces of these equations.
    QR with column pivoting of E^T in units of z: other packages lose digits on nearly dependent
    equations (Golub, Van Loan, Matrix Computations, 2013, 5.4.2 and 6.2)."""

    start: Array  # shape (n,)
    free: Array  # shape (n, n - rank)
    _unit: Array
    _own: Array
    _triangle: Array
    _order: Index

    @classmethod
    def of(cls, E: Array, closed: Array, unit: Array) -> Self:
        """Eliminate ``E z = closed``; unit: the size of each unknown, shape (n,)."""
        factors: Any = qr((E * unit).T, pivoting=True)
        Q, R, order = factors
        pivots = np.abs(np.diag(R))
        # Equations with smaller pivots are redundant.
        rank = int(np.sum(pivots > 1e-10 * pivots.max(initial=0.0)))
        own, triangle, order = Q[:, :rank], R[:rank, :rank], order[:rank]
        start = own @ solve_triangular(triangle, closed[order], trans="T")
        return cls(unit * start, unit[:, None] * Q[:, rank:], unit, own, triangle, order)

    def forces(self, load: Array, count: int) -> Array:
        """Forces r (count,) with ``E^T r = load`` in their span; dependent equations have none.
        `load`, (n,), is the residual of the other forces."""
        found = np.zeros(count)
        found[self._order] = solve_triangular(self._triangle, self._own.T @ (self._unit * load))
        return found


def solve_cones(
    unit: UnitProgram, gap: Array, offset: Array, bound: Array, closed: Array
) -> tuple[Array, Array, Array, Array, float]:
    r"""Minimise ``z^T S z / 2 - f^T z + sum_i g_i |R_i z + o_i|`` with ``G z <= d``, ``E z = e``.
    Clarabel, cones :math:`s_i \ge |R_i z + o_i|`. Returns z, mu (m,), t (k, dim_t) and r (l,) of
    ``S z + G^T mu + R^T t + E^T r = f``, and seconds, converged or not: check the residuals."""
    clarabel = optional("clarabel", "cones need Clarabel: pip install clarabel")
    S, f = unit.P, unit.f
    n, m, e, (k, dim_t) = f.size, gap.size, closed.size, offset.shape
    scale = float(abs(S).max()) or 1.0
    size = float(np.abs(f).max(initial=0.0)) / scale or float(np.abs(gap).max(initial=0.0)) or 1.0
    # Rows (s_i, R_i z + o_i) of each point one after the other, as b - A x in the cone.
    slack = sparse.coo_array(
        (-np.ones(k), ((1 + dim_t) * np.arange(k), np.arange(k))), shape=((1 + dim_t) * k, k)
    )
    spread = (1 + dim_t) * np.arange(k)[:, None] + 1 + np.arange(dim_t)
    place = sparse.coo_array(
        (-np.ones(k * dim_t), (spread.ravel(), np.arange(k * dim_t))),
        shape=((1 + dim_t) * k, k * dim_t),
    )
    A = sparse.block_array([[unit.E, None], [unit.G, None], [place @ unit.R, slack]], format="csc")
    b = np.concatenate((closed, gap, np.insert(offset, 0, 0.0, axis=1).ravel())) / size
    P = sparse.block_diag((S / scale, sparse.csc_array((k, k))), format="csc")
    q = np.concatenate((-f, bound)) / (scale * size)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # Its default stops these at 1e-13, at which a dense program is only accurate to 1e-11.
    settings.iterative_refinement_reltol = settings.iterative_refinement_abstol = 1e-16
    settings.iterative_refinement_max_iter = 50
    cones = [clarabel.ZeroConeT(e)] if e else []
    cones += [clarabel.NonnegativeConeT(m)] if m else []
    cones += [clarabel.SecondOrderConeT(1 + dim_t)] * k
    begin = time.perf_counter()
    upper, rows = sparse.triu(sparse.csc_matrix(P), format="csc"), sparse.csc_matrix(A)
    for tol in (1e-13, 1e-12, 1e-11, 1e-10):  # the tightest that rounding permits
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tol
        # If rounding stops it within 100 times the tolerance, that iterate is accepted.
        settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = 100 * tol
        settings.reduced_tol_feas = 100 * tol
        solution = clarabel.DefaultSolver(upper, q, rows, b, cones, settings).solve()
        if str(solution.status) in ("Solved", "AlmostSolved"):
            break
    seconds = time.perf_counter() - begin
    y = scale * size * np.array(solution.z)
    t = -y[e + m :].reshape(k, 1 + dim_t)[:, 1:]
    return size * np.array(solution.x[:n]), y[e : e + m], t, y[:e], seconds


@dataclass(frozen=True)
class UnitProgram:
    """The program ``min z^T S z / 2 - f^T z`` with rows G, R, E in w of unit size, z = M w.
    Dense ``S = L L^T`` has :math:`M = L^{-T}`, sparse S a diagonal M; rows are divided by their
    lengths, those of a point by one: tolerances of other packages are absolute."""

    P: Any  # M^T S M, shape (n, n)
    f: Array  # shape (n,)
    G: Any  # shape (m, n)
    R: Any  # shape (k * dim_t, n)
    E: Any  # shape (l, n)
    normal: Array  # lengths of the rows of G, shape (m,)
    tangential: Array  # lengths of the rows of R, shape (k,): caller's value = value * length
    tied: Array  # lengths of the rows of E, shape (l,)
    back: Any  # M, shape (n, n)

    @classmethod
    def of(cls, S: Any, f: Array, G: Any, R: Any, dim_t: int, E: Any) -> Self:
        """Change variables of S, dense or sparse, semidefinite with a positive diagonal.
        `dim_t` rows of R belong to one contact point."""
        unit = 1.0 / np.sqrt(S.diagonal())
        back: Any
        P: Any
        if sparse.issparse(S):
            back = sparse.diags_array(unit)
            P = sparse.csr_array(back @ S @ back)
        else:
            back, P = _unit_form(unit[:, None] * S * unit)
            back = unit[:, None] * back
        G, R, E = G @ back, R @ back, E @ back
        normal = np.sqrt(_squares(G))
        tangential = np.sqrt(_squares(R).reshape(-1, dim_t).sum(axis=1))
        normal, tangential, tied = (
            np.where(size > 0, size, 1.0) for size in (normal, tangential, np.sqrt(_squares(E)))
        )
        return cls(
            P,
            back.T @ f,
            _divided(G, normal),
            _divided(R, np.repeat(tangential, dim_t)),
            _divided(E, tied),
            normal,
            tangential,
            tied,
            back,
        )


def _unit_form(A: Array) -> tuple[Array, Array]:
    """M and ``M^T A M``, which is the identity with zeros in the rows of rigid motions."""
    try:
        rigid = 1e-10  # motions with less stiffness, relative to the diagonal, are rigid
        L = cholesky(A, lower=True)
        if np.all(np.diag(L) ** 2 > rigid):
            return solve_triangular(L, np.eye(A.shape[0]), lower=True).T, np.eye(A.shape[0])
    except np.linalg.LinAlgError:
        pass
    stiffness, V = eigh(A)
    elastic = stiffness > rigid
    return V / np.sqrt(np.where(elastic, stiffness, 1.0)), np.diag(elastic.astype(float))


def _squares(rows: Any) -> Array:
    return np.asarray((rows * rows).sum(axis=1)).ravel()


def _divided(rows: Any, size: Array) -> Any:
    if sparse.issparse(rows):
        by: Any = sparse.diags_array(1.0 / size)
        return sparse.csr_array(by @ rows)
    return rows / size[:, None]
