"""Krylov-Schur iteration with a challenge that looks for eigenvalues it may have missed."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg

from gpu.eigenvalues.krylov.arnoldi import Arnoldi
from gpu.eigenvalues.krylov.challenge import INSIDE, unbeaten
from gpu.eigenvalues.krylov.implicit_restart import shifted_qr
from gpu.eigenvalues.schur.order import Edge
from gpu.eigenvalues.schur.ordered_schur import Rank, ordered_schur, whole

RESTARTS = ("krylov-schur", "implicit")
FLOOR = 100 * np.finfo(float).eps  # residuals below this times |A| are round-off
CLOSE = 1e-2  # residual of what a challenge leaves aside over the distance of the rest
PATIENCE = 6  # restarts before the space grows, if it may


@dataclass(frozen=True)
class PartialSchur:
    """The outcome: ``A U = U T`` up to the residual, U the leading basis vectors.

    Attributes
    ----------
    T : ndarray, shape (c, c)
        Of the converged part, best eigenvalues first.
    values : ndarray, shape (c,)
    basis : Arnoldi
    scale : float
        Norm of A on the spaces it was applied to: a lower bound of |A|.
    restarts, matvecs : int
    complete : bool
        Whether the wanted eigenvalues have converged and have stood the challenge.
    """

    T: np.ndarray
    values: np.ndarray
    basis: Arnoldi
    scale: float
    restarts: int
    matvecs: int
    complete: bool


def krylov_schur(
    apply: Callable[[Any], Any],
    n: int,
    k: int,
    rank: Rank,
    *,
    dtype: Any,
    xp: Any,
    ncv: int,
    grown: int = 0,
    start: Any = None,
    tol: float = 0.0,
    maxiter: int = 1000,
    restart: str = "krylov-schur",
    matrix: Any = None,
    challenge: bool = True,
    edge: Edge | None = None,
    inner: bool = False,
    meanwhile: Callable[[np.ndarray, Arnoldi], Any] | None = None,
) -> PartialSchur:
    r"""The k best eigenvalues of A, by rank, with their Schur basis.

    The decomposition

    .. math::
        A V_m = V_m S_m + v_{m+1} b^*

    is brought to Schur form with its wanted part in front. About half of the rest is cut off, down
    to a third as more converge, and Arnoldi steps fill the space up again. The leading c Schur
    vectors have converged when
    :math:`|b_{1..c}| \le \max(tol\,|\theta_c|,\ 100\,\epsilon\,|A|)`.

    A Krylov space of one vector holds one eigenvector of a repeated eigenvalue only, and may be
    blind to others. So the outcome is challenged from random vectors: see `challenge.unbeaten`.
    Aside are left, beside what has converged, the next Schur vectors as far as they are nearly
    invariant; then the challenger has less to compete with. Where it finds something better, the
    iteration goes on from that beside what has converged, with `ncv` vectors: near the edge of a
    disc full of eigenvalues a space of the few that would be left settles on a few of many moduli,
    blind to larger ones. Whatever is better comes in, and is challenged again.

    Parameters
    ----------
    apply : callable x -> A x
    n, k : int
    rank : callable
        Of eigenvalues; the larger, the more wanted. Must change by at most |d| when the eigenvalue
        moves by d.
    dtype, xp, matrix
        See `Arnoldi`.
    ncv : int
        Dimension m of the space, k + 3 <= ncv <= n - 1; a challenge adds what it keeps.
    grown : int
        Dimension after `PATIENCE` restarts in which fewer than k have converged, if larger.
    start : array, optional
    tol : float
    maxiter : int
        Of restarts.
    restart : {"krylov-schur", "implicit"}
        How the space shrinks until it is challenged; see `implicit_restart.shifted_qr`.
    challenge : bool
        Whether to look beyond the invariant subspace that the start vector reaches.
    edge : callable, optional
        Of `rank`, see `order.edge_of`: lets challenges end as soon as probability allows.
    inner : bool
        The wanted may lie inside the spectrum, where newcomers are slow to show: then nothing but
        probability ends a challenge.
    meanwhile : callable (T, basis), optional
        Called with what is the outcome unless it loses the challenge, of which a device has yet
        to finish the first products.

    References
    ----------
    G. W. Stewart, A Krylov-Schur algorithm for large eigenproblems, SIAM J. Matrix Anal. Appl. 23
    (2001).
    """

    def room_of(dimension: int) -> int:
        return min(n - 1, room_for(k, dimension)) if challenge else dimension

    room, most_room = ncv, room_of(ncv)
    basis = Arnoldi(apply, n, most_room, dtype, xp, matrix=matrix)
    basis.start(0, start)
    S = np.zeros((most_room, most_room), dtype=dtype)
    # Where products are quick; loading the compiler's work takes longer than most runs on the host.
    compiled = xp is not np
    kept, scale = 0, 0.0
    locked = 0  # rows that a challenge began with
    hessenberg = restart == "implicit"
    champions: np.ndarray | None = None  # ranks of the wanted that a challenge has to better
    # Sweeps are stopped where the wanted are expected to converge.
    count, goal = 1, ncv
    past = (0, 1.0)  # products, and residual of the wanted over |A|, at the last look
    while count <= maxiter:
        steps = basis.sweep(kept, goal)
        if not steps.finite:
            raise FloatingPointError(f"A v is not finite after {basis.matvecs} products")
        ended = steps.ended
        size = goal if ended is None else kept + ended + 1
        steps.project(S, kept, size)
        beta = 0.0 if ended is not None else float(steps.betas[-1])
        columns = S[:size, :size].T
        scale = max(scale, float(np.sqrt(np.vecdot(columns, columns).real.max())))
        most = min(size, max(k, locked) + ncv // 2 + 3)
        for leading in (most, size):
            T, Q, values = ordered_schur(S[:size, :size], rank, leading, compiled)
            spike = beta * Q[size - 1]
            moved = np.sqrt(np.cumsum(np.abs(spike) ** 2))  # residuals of the leading vectors
            converged = _leading(T, values, moved, tol, FLOOR * scale)
            if challenge:  # which needs room
                converged = whole(T, min(converged, most_room - max(ncv // 2, 4)))
            if converged + 2 < leading:
                break
        wanted = float(moved[whole(T, min(k, size)) - 1]) / scale if scale else 0.0
        need = _products_left(past, (basis.matvecs, wanted), max(tol, FLOOR))
        past = (basis.matvecs, wanted)
        lost, vector = False, None
        settled = T[:converged, :converged]
        if converged >= k:
            ranks = np.sort(rank(values[:converged]))[::-1][:k]
            if (
                champions is None
                or (inner and converged > locked)
                or _better(ranks, champions, T, values[:converged], rank, tol, FLOOR * scale)
            ):
                champions, aside = ranks, converged
                if challenge:
                    most = min(most, most_room - ncv // 2)
                    aside = _aside(T, rank(values), ranks[-1], moved, converged, most)
                basis.rotate(Q[:, :aside], size)
                if challenge:
                    won, more = unbeaten(
                        basis,
                        aside,
                        ranks[-1],
                        rank,
                        edge,
                        tol=tol,
                        floor=FLOOR * scale,
                        restarts=maxiter - count,
                        patience=np.inf if inner else basis.matvecs,
                        meanwhile=meanwhile and functools.partial(meanwhile, settled, basis),
                    )
                    count, lost = count + more, not won
                done = not lost
            else:
                done = not inner and _unbeaten(rank, T, values, spike, converged, locked, ranks[-1])
                if done:
                    basis.rotate(Q[:, :converged], size)
            if done:
                return PartialSchur(
                    settled, values[:converged], basis, scale, count, basis.matvecs, True
                )
        fresh = lost or ended is not None
        if not fresh and size < room:
            # Not settled half way: the space goes on growing.
            S[size, size - 1] = beta
            kept, goal = size, room
            continue
        if lost:
            keep = min(converged, max(whole(T, k), ncv // 2))
        elif fresh:
            keep = min(size, room - 1)
        elif champions is None:
            spare = ncv - k
            new = max(spare // 3, min(spare, 4))
            keep = k + min((spare + converged) // 2, spare - new)
        else:
            keep = max(k + converged // 2, (locked + room) // 2)
        keep = whole(T, min(keep, room - 2, size))
        projected, spike = T[:keep, :keep], spike[:keep]
        if fresh:
            if lost:
                # What beat them is among these, and what was aside has come far.
                vector = basis.V[keep : aside + 2].sum(axis=0)
            else:
                basis.rotate(Q[:, :keep], size)
            basis.start(keep, vector)
            hessenberg, spike, locked = False, np.zeros(keep), keep
        elif hessenberg:
            Q, projected, spike = shifted_qr(S[:size, :size], beta, values, keep)
            basis.rotate(Q, size)
        else:
            basis.rotate(Q[:, :keep], size)
            spike[: min(converged, keep)] = 0.0
        S[:] = 0.0
        if count >= PATIENCE and ncv < grown and champions is None:
            ncv = room = grown
            most_room = room_of(ncv)
            basis.enlarge(most_room, keep + 1)
            S = np.zeros((most_room, most_room), dtype=dtype)
        S[:keep, :keep], S[keep, :keep] = projected, spike
        kept, count = keep, count + 1
        if lost:
            room = min(kept + ncv, most_room)
            goal = min((kept + ncv + 1) // 2, room)
        else:
            goal = min(kept + need, room)
    converged = min(converged, kept)
    return PartialSchur(
        T[:converged, :converged],
        values[:converged],
        basis,
        scale,
        maxiter,
        basis.matvecs,
        False,
    )


def room_for(k: int, ncv: int) -> int:
    """Most vectors that a challenged iteration spans."""
    return ncv + max(k + 1, ncv // 2) + 1


def _leading(T: np.ndarray, values: np.ndarray, moved: np.ndarray, tol: float, floor: float) -> int:
    """How many leading Schur vectors have converged; conjugate pairs together."""
    beyond = (~(moved <= np.maximum(tol * np.abs(values), floor))).nonzero()[0]
    count = int(beyond[0]) if beyond.size else len(values)
    return count - 1 if whole(T, count) > count else count


def _aside(
    T: np.ndarray, ranks: np.ndarray, worst: float, moved: np.ndarray, converged: int, most: int
) -> int:
    """How many leading Schur vectors a challenge leaves aside: those nearly invariant too."""
    last = min(most, len(ranks) - 1) - 1
    if last <= converged:
        return converged
    counts = np.arange(converged + 1, min(whole(T, last), len(ranks) - 1) + 1)
    beyond = np.maximum.accumulate(ranks[::-1])[::-1]
    close = moved[counts - 1] <= CLOSE * (worst - beyond[counts])
    found = counts[close & (T[counts, counts - 1] == 0)]
    return int(found[-1]) if found.size else converged


def _products_left(past: tuple[int, float], now: tuple[int, float], limit: float) -> int:
    """How many products the wanted are from convergence if it goes on at the rate of the last."""
    (before, large), (products, small) = past, now
    if not limit < small < large:
        return 1 << 30
    rate = np.log(large / small) / (products - before)
    return max(3, int(np.ceil(np.log(small / limit) / rate)))


def _better(
    ranks: np.ndarray,
    champions: np.ndarray,
    T: np.ndarray,
    found: np.ndarray,
    rank: Rank,
    tol: float,
    floor: float,
) -> bool:
    r"""Whether ranks have risen by more than they may be off: residual times condition.

    A pair of residual r belongs to a matrix A + E, |E| = r, and its value is known to
    :math:`r \kappa`, :math:`\kappa = |x| |y| / |y^* x|`. Newcomers which are better by less are no
    evidence. The condition is that of the Ritz value in the whole space, y the nearest to x among
    the left vectors of all copies; where first order means nothing the cube root of the residual
    is the bound, as for Jordan blocks of three.
    """
    slack = 1e-9 * np.abs(ranks)
    if not np.any(ranks > champions + slack + floor):
        return False
    theta, left, right = linalg.eig(T, left=True)
    size = float(np.abs(theta).max())
    best = found[np.argsort(-rank(found), kind="stable")[: len(ranks)]]
    for place, value in enumerate(best):
        copies = np.abs(theta - value) <= 1e-6 * size
        copies[np.abs(theta - value).argmin()] = True
        overlap = np.linalg.norm(
            np.linalg.qr(left[:, copies])[0].conj().T @ right[:, copies], axis=0
        ).min()
        residual = max(tol * abs(value), floor)
        slack[place] += min(
            residual / max(overlap, 1e-16), np.cbrt(residual * max(size, residual) ** 2)
        )
    return bool(np.any(ranks > champions + slack))


def _unbeaten(
    rank: Rank,
    T: np.ndarray,
    values: np.ndarray,
    spike: np.ndarray,
    converged: int,
    locked: int,
    worst: float,
) -> bool:
    """Whether the best newcomer has converged or lies inside by far more than its residual."""
    if converged > locked or converged == len(values):
        return True
    following = whole(T, converged + 1)
    moved = float(np.linalg.norm(spike[converged:following]))
    return bool(moved < INSIDE * (worst - rank(values[converged : converged + 1])[0]))
