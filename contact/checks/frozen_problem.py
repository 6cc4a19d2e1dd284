"""The problem with given friction that a solution must also solve, as an optimisation in z."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from contact.checks.cone_program import solve_cones
from contact.checks.split_program import solve_split
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
        \text{s.t.} \quad G z \le d .

    Attributes
    ----------
    S, f : array or sparse array, shape (n, n), and ndarray, shape (n,)
        Stiffness and load of the body's free unknowns, or of those of the contact boundary.
    G, gap : array or sparse array, shape (j, n), and ndarray, shape (j,)
        Rows of points that can touch, and their gaps d.
    R, offset : array or sparse array, shape (k * slips, n), and ndarray, shape (k * slips,)
        Rows of points with friction, those of one point consecutive, and their offsets o.
    bound : ndarray, shape (k,)
        The bounds g.
    pressing, rubbing : ndarray of int, shapes (j,) and (k * slips,)
        Contact point of each row of G, and entry of the tangential forces t of each row of R.
    shape : (int, int)
        The shape of t, (m, dim - 1).
    cones : bool
        The friction terms are cones, as in three dimensions.
    """

    S: Any
    f: Array
    G: Any
    gap: Array
    R: Any
    offset: Array
    bound: Array
    pressing: Index
    rubbing: Index
    shape: tuple[int, int]
    cones: bool

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
        usable, bound = np.isfinite(rows.gap), system.bound(result.mu)
        rubs = bound > 0
        if cones:  # friction of points whose whole slip is prescribed acts on supports alone
            rubs &= system.body.live(rows.T).reshape(m, columns).any(axis=1)
        pressing, rubbing = np.flatnonzero(usable), np.flatnonzero(np.repeat(rubs, columns))
        G: Any = rows.G[usable]
        R: Any = rows.T[rubbing]
        gap, g, offset = rows.gap[usable] - G @ u0, bound[rubs], R @ u0
        if system.slip_from is not None:
            offset = offset - system.slip_from.ravel()[rubbing]
        if system.motion is not None and result.motion is not None:
            w_n, w_t = system.motion.displacement(result.motion)
            gap, offset = gap + w_n[usable], offset - w_t.ravel()[rubbing]
        S: Any
        if boundary is not None:
            S, f = boundary.stiffness, boundary.reduce(system.load)
            G, R = boundary.restrict(G), boundary.restrict(R)
        else:
            S = sparse.csr_array(P.T @ system.body.stiffness @ P)
            f = P.T @ (system.load - system.body.stiffness @ u0)
            G, R = sparse.csr_array(G @ P), sparse.csr_array(R @ P)
        keep_n, keep_t = _nonzero_rows(G), _nonzero_rows(R)
        if cones:
            keep_t = np.arange(R.shape[0])  # a row that supports hold still belongs to its cone
        else:
            g = g[keep_t]
        pressing, rubbing = pressing[keep_n], rubbing[keep_t]
        parts = G[keep_n], gap[keep_n], R[keep_t], offset[keep_t]
        return cls(S, f, *parts, g, pressing, rubbing, (m, columns), cones)

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
        k = self.bound.size
        slips = self.R.shape[0] // k if k else 1  # of one point
        unit = UnitProgram.of(self.S, self.f, self.G, self.R, slips)
        gap, g = self.gap / unit.normal, self.bound * unit.tangential
        offset = self.offset.reshape(k, slips) / unit.tangential[:, None]
        w: Any
        if self.cones:
            w, pressed, pushed, seconds = solve_cones(
                unit.P, unit.f, unit.G, gap, unit.R, offset, g
            )
        else:
            w, pressed, pushed, seconds = solve_split(solver, unit, gap, offset.ravel(), g)
        mu, t = np.zeros(self.shape[0]), np.zeros(self.shape[0] * self.shape[1])
        mu[self.pressing] = pressed / unit.normal
        t[self.rubbing] = (pushed.reshape(k, slips) / unit.tangential[:, None]).ravel()
        z = None if w is None else unit.back @ w
        return Answer(z, mu, t.reshape(self.shape), seconds)


def _nonzero_rows(rows: Any) -> Index:
    size = np.asarray((rows * rows).sum(axis=1)).ravel()
    # Squared, relative to the largest: rows that supports prescribe vanish up to rounding, 1e-12.
    return np.flatnonzero(size > 1e-24 * size.max(initial=0.0))
