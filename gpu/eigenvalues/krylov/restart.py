"""What is wanted of a Krylov space, how large it may grow, and what of it outlives a restart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpu.eigenvalues.schur.order import Edge
from gpu.eigenvalues.schur.ordered_schur import Rank, whole

RESTART_KINDS = ("krylov-schur", "implicit")


@dataclass(frozen=True)
class Wanted:
    """Which eigenvalues are looked for.

    Attributes
    ----------
    k : int
    rank : callable
        Of eigenvalues; the larger, the more wanted. Must change by at most |d| when the eigenvalue
        moves by d.
    tol : float
        Residual relative to the modulus of the eigenvalue.
    edge : callable, optional
        Of `rank`, see `order.edge_of`: lets challenges end as soon as probability allows.
    inner : bool
        The wanted may lie inside the spectrum, where a Krylov space is slow to see others that are
        better: then only the probability ends a challenge.
    """

    k: int
    rank: Rank
    tol: float = 0.0
    edge: Edge | None = None
    inner: bool = False


@dataclass(frozen=True)
class Limits:
    """How large the space grows, and for how long.

    Attributes
    ----------
    ncv : int
        Dimension m of the space, k + 3 <= ncv <= n - 1; a challenge adds what it keeps.
    grown : int
        Dimension after several restarts in which fewer than k have converged, if larger.
    maxiter : int
        Of restarts.
    restart : {"krylov-schur", "implicit"}
        How the space shrinks until it is challenged; see `implicit_restart.shifted_qr`.
    challenge : bool
        Whether to look beyond the invariant subspace that the start vector reaches.
    """

    ncv: int
    grown: int = 0
    maxiter: int = 1000
    restart: str = "krylov-schur"
    challenge: bool = True


@dataclass(frozen=True)
class Look:
    """A Krylov space in Schur form, the wanted eigenvalues first.

    Attributes
    ----------
    T, Q : ndarray, shape (size, size)
    values : ndarray, shape (size,)
        Eigenvalues of T.
    spike : ndarray, shape (size,)
        Coefficients of the residual vector.
    moved : ndarray, shape (size,)
        Entry c - 1: the residual norm of the first c Schur vectors, :math:`|b_{1..c}|`.
    converged : int
        How many leading vectors have.
    settled : ndarray, shape (converged, converged)
        Their part of T.
    beta : float
        Norm of the residual vector before the rotation by Q.
    ended : bool
        Whether the space is invariant.
    products_left : int
        To the convergence of the wanted, at the rate since the last look.
    """

    T: np.ndarray
    Q: np.ndarray
    values: np.ndarray
    spike: np.ndarray
    moved: np.ndarray
    converged: int
    settled: np.ndarray
    beta: float
    ended: bool
    products_left: int

    @property
    def size(self) -> int:
        """Dimension of the space."""
        return len(self.Q)


@dataclass(frozen=True)
class Standing:
    """What `vectors_kept` has to know about the iteration.

    Attributes
    ----------
    k, ncv : int
    room : int
        Most vectors at present.
    locked : int
        Vectors that the last challenge began with.
    challenged : bool
        Whether there has been one.
    lost : bool
        Whether the last challenge has just been lost.
    """

    k: int
    ncv: int
    room: int
    locked: int
    challenged: bool
    lost: bool


def vectors_kept(look: Look, standing: Standing) -> int:
    """How many leading Schur vectors outlive a restart; conjugate pairs together.

    Half of what is not wanted stays too, and more as more has converged, but a third of it gives
    room to new vectors. Of an invariant space, which says nothing about the rest, all stay.
    """
    k, ncv, room, converged = standing.k, standing.ncv, standing.room, look.converged
    if standing.lost:
        keep = min(converged, max(whole(look.T, k), ncv // 2))
    elif look.ended:
        keep = min(look.size, room - 1)
    elif standing.challenged:
        keep = max(k + converged // 2, (standing.locked + room) // 2)
    else:
        spare = ncv - k
        new = max(spare // 3, min(spare, 4))
        keep = k + min((spare + converged) // 2, spare - new)
    return whole(look.T, min(keep, room - 2, look.size))


def room_for(k: int, ncv: int) -> int:
    """Most vectors that a challenged iteration spans."""
    return ncv + max(k + 1, ncv // 2) + 1
