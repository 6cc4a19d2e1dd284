"""Parameters of Krylov-Schur iterations, and how many vectors are kept at a restart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpu.eigenvalues.schur.order import Edge
from gpu.eigenvalues.schur.ordered_schur import Rank, whole

RESTART_KINDS = ("krylov-schur", "implicit")


@dataclass(frozen=True)
class Wanted:
    """The wanted eigenvalues.

    Attributes
    ----------
    k : int
    rank : callable
        Rank function of eigenvalues; the larger, the more wanted. It must change by at most |d| if
        the eigenvalue changes by d.
    tol : float
        Residual relative to the modulus of the eigenvalue.
    edge : callable, optional
        For `rank`, see `order.edge_of`. With it a challenge (see `challenge.unbeaten`) can end as
        soon as the probability of a missed eigenvalue is small enough.
    inner : bool
        Whether wanted values may lie inside the spectrum. Krylov spaces are slow to find better
        ones there, so only the probability may end a challenge.
    """

    k: int
    rank: Rank
    tol: float = 0.0
    edge: Edge | None = None
    inner: bool = False


@dataclass(frozen=True)
class Limits:
    """Limits of the dimension of the space and of the number of restarts, and their kind.

    Attributes
    ----------
    ncv : int
        Dimension m of the space, k + 3 <= ncv <= n - 1; after a challenge, in addition to the
        vectors that it keeps.
    grown : int
        Dimension after several restarts in which fewer than k have converged, if larger.
    maxiter : int
        Most restarts.
    restart : {"krylov-schur", "implicit"}
        How the space is reduced before the first challenge; see `implicit_restart.shifted_qr`.
    challenge : bool
        Whether to search for eigenvalues outside the invariant subspace of the start vector.
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
        The Schur form of the projected matrix, S = Q T Q^*.
    values : ndarray, shape (size,)
        Eigenvalues of T.
    spike : ndarray, shape (size,)
        Coefficients of the residual vector.
    moved : ndarray, shape (size,)
        Entry c - 1: the residual norm of the first c Schur vectors, :math:`|b_{1..c}|`.
    converged : int
        Number of leading Schur vectors that have converged.
    settled : ndarray, shape (converged, converged)
        Their block of T.
    beta : float
        Norm of the residual vector before the rotation by Q.
    ended : bool
        Whether the space is invariant.
    products_left : int
        Estimated number of products until the wanted ones converge, from the rate since the last
        look.
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
    """The state of the iteration on which `vectors_kept` depends.

    Attributes
    ----------
    k, ncv : int
    room : int
        Present limit of the number of vectors.
    locked : int
        Number of vectors with which the iteration began again, after a lost challenge or an
        invariant space.
    challenged : bool
        Whether there has been a challenge.
    lost : bool
        Whether a challenge has just found a better eigenvalue.
    """

    k: int
    ncv: int
    room: int
    locked: int
    challenged: bool
    lost: bool


def vectors_kept(look: Look, standing: Standing) -> int:
    """How many leading Schur vectors are kept at a restart; conjugate pairs stay together.

    Besides the wanted, half of the other vectors are kept, and more as more have converged, but at
    least a third of them make room for new ones. Of an invariant space, which has no information on
    the rest of the spectrum, all vectors are kept.
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
    """Largest dimension of the space in an iteration with challenges."""
    return ncv + max(k + 1, ncv // 2) + 1
