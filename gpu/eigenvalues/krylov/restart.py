"""Parameters of Krylov-Schur iterations, and how many vectors are kept at a restart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpu.eigenvalues.schur.order import Edge
from gpu.eigenvalues.schur.ordered_schur import Rank, whole

RESTART_KINDS = ("krylov-schur", "implicit")


@dataclass(frozen=True)
class Wanted:
    """Which eigenvalues are wanted. Ranks change by at most |d| if the eigenvalue changes by d;
    with `edge` a challenge ends as soon as a missed eigenvalue is improbable (see
    `challenge.unbeaten`)."""

    k: int
    rank: Rank  # the larger, the more wanted
    tol: float = 0.0  # residual relative to the modulus of the eigenvalue
    edge: Edge | None = None  # of the wanted part of the plane, see `order.edge_of`
    inner: bool = False  # inside the spectrum too, where only probability ends a challenge


@dataclass(frozen=True)
class Limits:
    """Limits of the dimension of the space and of the number of restarts, and their kind."""

    ncv: int  # dimension, k + 3 to n - 1; after a challenge beside the vectors kept
    grown: int = 0  # dimension after several restarts in which fewer than k have converged
    maxiter: int = 1000  # most restarts
    restart: str = "krylov-schur"  # or "implicit", before the first challenge
    challenge: bool = True  # search outside the invariant subspace of the start vector


@dataclass(frozen=True)
class Look:
    """A Krylov space in Schur form, the wanted eigenvalues first."""

    T: np.ndarray  # Schur form of the projected matrix S = Q T Q^*, shape (size, size)
    Q: np.ndarray
    values: np.ndarray  # (size,): eigenvalues of T
    spike: np.ndarray  # (size,): coefficients of the residual vector
    moved: np.ndarray  # (size,): entry c - 1 is |b_{1..c}|, the residual of c Schur vectors
    converged: int  # number of leading Schur vectors that have converged
    settled: np.ndarray  # their block of T
    beta: float  # norm of the residual vector before the rotation by Q
    ended: bool  # the space is invariant
    products_left: int  # estimate until the wanted converge, from the last rate

    @property
    def size(self) -> int:
        """Dimension of the space."""
        return len(self.Q)


@dataclass(frozen=True)
class Standing:
    """The state of the iteration on which `vectors_kept` depends."""

    k: int
    ncv: int
    room: int  # present limit of the number of vectors
    locked: int  # vectors kept at the last new start (lost challenge, invariant space)
    challenged: bool  # there has been a challenge
    lost: bool  # a challenge has just found a better eigenvalue


def vectors_kept(look: Look, standing: Standing) -> int:
    """How many leading Schur vectors are kept at a restart; conjugate pairs stay together. Of the
    vectors not wanted half are kept, more as more have converged, but a third makes room; of an
    invariant space, which says nothing of the rest of the spectrum, all are kept."""
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
