"""The problem with given friction that a solution must also solve, as an optimisation in z."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.checks.cone_program import solve_cones
from contact.checks.split_program import solve_split
from contact.checks.surface_slacks import SurfaceSlacks
from contact.checks.tie_elimination import TieElimination
from contact.checks.unit_program import UnitProgram

if TYPE_CHECKING:
    from contact.condensation.condensed_contact import CondensedContact
    from contact.result.contact_result import ContactResult

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Answer:
    """The solution that a solver of another package found.

    Attributes
    ----------
    z : ndarray, shape (n,), or None
        None if it found none.
    mu, t : ndarray, shapes (m,) and (m, dim - 1)
        Contact forces of all contact points.
    seconds : float
    """

    z: Array | None
    mu: Array
    t: Array
    seconds: float


@dataclass(frozen=True)
class FrozenProblem:
    r"""Friction with the bound g, and the obstacles' positions, frozen at those of a solution.

    .. math::
        \min_z \tfrac12 z^T S z - f^T z + \sum_i g_i |R_i z + o_i| \quad
        \text{s.t.} \quad G z \le d, \; E z = e .

    Attributes
    ----------
    S, f : array or sparse array, shape (n, n), and ndarray, shape (n,)
        Stiffness and load of the body's free unknowns, or of those of the contact boundary, then
        of the slacks of compliant surfaces.
    G, gap : array or sparse array, shape (j, n), and ndarray, shape (j,)
        Rows of points that can touch, and their gaps d; then the limits of the slacks.
    R, offset : array or sparse array, shape (k * slips, n), and ndarray, shape (k * slips,)
        Rows of points with friction, those of one point consecutive, and their offsets o.
    E, closed : array or sparse array, shape (l, n), and ndarray, shape (l,)
        Rows of bonded points, and their values e.
    bound : ndarray, shape (k,)
        The bounds g.
    pressing, rubbing, bonded : ndarray of int, shapes (i,), (k * slips,) and (l,)
        Entry of each of the first rows of G, of each row of R and of E among the contact forces,
        the normal ones of all points and then the tangential ones.
    shape : (int, int)
        The shape of the tangential forces t, (m, dim - 1).
    cones : bool
        The friction terms are cones, as in three dimensions.
    unknowns : int
        How many of the unknowns are not slacks.
    """

    S: Any
    f: Array
    G: Any
    gap: Array
    R: Any
    offset: Array
    E: Any
    closed: Array
    bound: Array
    pressing: Index
    rubbing: Index
    bonded: Index
    shape: tuple[int, int]
    cones: bool
    unknowns: int

    @classmethod
    def of(cls, result: ContactResult, boundary: CondensedContact | None, cones: bool) -> Self:
        """Freeze friction and obstacles at a result.

        Parameters
        ----------
        result : ContactResult
        boundary : CondensedContact or None
            Use the unknowns of its contact boundary; None for all free ones of the body.
        cones : bool
        """
        system = result.system
        rows, (P, u0) = system.rows, system.body.constraint
        m, columns = result.t.shape
        ties, bound = rows.ties, system.bound(result.mu)
        rubs = (bound > 0) & ~ties
        # Friction of points whose whole slip is prescribed acts on supports alone.
        rubs &= system.body.live(rows.T).reshape(m, columns).any(axis=1)
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
            live[1] = np.arange(R.shape[0])  # a row that supports hold still belongs to its cone
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

        Raises
        ------
        InputError
            qpsolvers has no such solver.
        MissingDependency
            The solver is not installed.
        """
        if self.bonded.size and not sparse.issparse(self.S):
            return self._without_ties(solver)
        k = self.bound.size
        slips = self.R.shape[0] // k if k else 1  # of one point
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
        touches = _kept(G, self.G * unit)  # the others are decided by the equations
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
        if free.shape[1]:  # else the equations alone decide
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
    """Gap of each point, and the tangential displacement that is no slip, obstacles included."""
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
    """Which rows an elimination has not reduced to the rounding of what they were before."""
    left, size = (np.linalg.norm(part, axis=1) for part in (rows, before))
    return np.asarray(left > 1e-10 * size)


def _nonzero_rows(rows: Any) -> Index:
    size = np.asarray((rows * rows).sum(axis=1)).ravel()
    # Squared, relative to the largest: rows that supports prescribe vanish up to rounding, 1e-12.
    return np.flatnonzero(size > 1e-24 * size.max(initial=0.0))
