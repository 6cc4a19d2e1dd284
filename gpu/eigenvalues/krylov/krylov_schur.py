"""Krylov-Schur iteration with a challenge: a search for missed eigenvalues."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from gpu.eigenvalues.krylov.arnoldi import Arnoldi
from gpu.eigenvalues.schur import Edge, Rank, ordered_schur, whole


class _Limits(NamedTuple):  # tolerances of the iteration and of the challenge
    residual: float = 100 * float(np.finfo(float).eps)  # over |A|, for a hundred vectors
    aside: float = 1e-2  # residual over the gap of ranks, for vectors that a challenge excludes
    restarts: int = 6  # number of restarts before the space grows, if it may
    inside: float = 0.03  # residual over the gap of ranks at which a newcomer counts as worse
    thick: float = 0.5  # fraction of the vectors of the search that is kept at a restart
    first: int = 3  # products before the first test: few are enough for separated eigenvalues
    sure: float = 0.01  # t: the probability of a missed eigenvalue is at most .8 t
    likely: float = 0.1  # t that suffices if the found eigenvalue is also worse than the wanted


LIMITS = _Limits()


@dataclass(frozen=True)
class PartialSchur:
    """The outcome: ``A U = U T`` up to the residual, U the leading basis vectors."""

    T: np.ndarray  # (c, c): Schur form of the converged part, best eigenvalues first
    values: np.ndarray  # (c,): its eigenvalues
    basis: Arnoldi
    scale: float  # largest column norm of the projected matrices: a lower bound of |A|
    restarts: int
    matvecs: int
    complete: bool  # whether all wanted eigenvalues converged and no better one was found


def krylov_schur(
    apply: Callable[[Any], Any],
    n: int,
    wanted: Wanted,
    limits: Limits,
    *,
    dtype: Any,
    xp: Any,
    start: Any = None,
    matrix: Any = None,
    meanwhile: Callable[[np.ndarray, Arnoldi], Any] | None = None,
) -> PartialSchur:
    r"""The k best eigenvalues of A, by rank, with their Schur basis (Stewart 2001).

    :math:`A V_m = V_m S_m + v_{m+1} b^*` is brought to Schur form, the wanted eigenvalues first.
    The first c Schur vectors have converged if :math:`|b_{1..c}| \le \max(tol\,|\theta_c|,\
    100\,\epsilon\,|A|)`. As a Krylov space holds one vector of a repeated eigenvalue only, a
    challenge then searches the rest of the space. `meanwhile` (T, basis) runs on the host during
    its first products.
    """
    iteration = _Iteration(
        wanted, limits, n, lambda size: Arnoldi(apply, n, size, dtype, xp, matrix=matrix)
    )
    iteration.basis.start(0, start)
    while iteration.count <= limits.maxiter:
        look = iteration.look()
        if look.converged >= wanted.k and iteration.stands(look, meanwhile):
            return iteration.outcome(look, look.converged, look.settled, complete=True)
        iteration.restart(look)
    converged = min(look.converged, iteration.kept)
    return iteration.outcome(look, converged, look.T[:converged, :converged], complete=False)


class _Iteration:
    """The Krylov space, its projected matrix and the counts that restarts depend on."""

    def __init__(
        self, wanted: Wanted, limits: Limits, n: int, space: Callable[[int], Arnoldi]
    ) -> None:
        self.wanted, self.limits, self.n = wanted, limits, n
        self.ncv = self.room = self.goal = limits.ncv
        self.most_room = self._most_room()
        self.basis = space(self.most_room)
        self.S = np.zeros((self.most_room, self.most_room), dtype=self.basis.V.dtype)
        self.kept, self.scale, self.count = 0, 0.0, 1
        self.locked = 0  # rows kept when the iteration last restarted from a new vector
        self.hessenberg = limits.restart == "implicit"
        # Ranks of the wanted eigenvalues at the last challenge.
        self.champions: np.ndarray | None = None
        # Number of rows excluded in a challenge that has just found a better eigenvalue, else None.
        self.aside: int | None = None
        # Products, and residual of the wanted over |A|, at the last test: they predict the end of
        # the next sweep.
        self.past = (0, 1.0)

    def _most_room(self) -> int:
        if not self.limits.challenge:
            return self.ncv
        return min(self.n - 1, room_for(self.wanted.k, self.ncv))

    def _most_leading(self, size: int) -> int:
        """Number of Schur vectors to be ordered: the wanted, and those that a restart may keep."""
        return min(size, max(self.wanted.k, self.locked) + self.ncv // 2 + 3)

    def look(self) -> Look:
        """Expand the space up to `goal`, and bring the projected matrix to ordered Schur form."""
        wanted, basis, S = self.wanted, self.basis, self.S
        steps = basis.sweep(self.kept, self.goal)
        if not steps.finite:
            raise FloatingPointError(f"A v is not finite after {basis.matvecs} products")
        ended = steps.ended is not None
        size = self.goal if steps.ended is None else self.kept + steps.ended + 1
        steps.project(S, self.kept, size)
        beta = 0.0 if ended else float(steps.betas[-1])
        columns = S[:size, :size].T
        self.scale = max(self.scale, float(np.sqrt(np.vecdot(columns, columns).real.max())))
        for leading in (self._most_leading(size), size):
            T, Q, values = ordered_schur(S[:size, :size], wanted.rank, leading)
            spike = beta * Q[size - 1]
            moved = np.sqrt(np.cumsum(np.abs(spike) ** 2))
            converged = _leading(T, values, moved, wanted.tol, LIMITS.residual * self.scale)
            if self.limits.challenge:  # reserve rows for the vectors of a challenge
                converged = whole(T, min(converged, self.most_room - max(self.ncv // 2, 4)))
            if converged + 2 < leading:
                break
        residual = float(moved[whole(T, min(wanted.k, size)) - 1])
        now = (basis.matvecs, residual / self.scale if self.scale else 0.0)
        left = _products_left(self.past, now, max(wanted.tol, LIMITS.residual))
        self.past = now
        settled = T[:converged, :converged]
        return Look(T, Q, values, spike, moved, converged, settled, beta, ended, left)

    def stands(self, look: Look, meanwhile: Callable[..., Any] | None) -> bool:
        """Whether the converged eigenvalues are the wanted ones; then their vectors come first."""
        wanted, rank, converged = self.wanted, self.wanted.rank, look.converged
        floor = LIMITS.residual * self.scale
        found = look.values[:converged]
        ranks = np.sort(rank(found))[::-1][: wanted.k]
        if (
            self.champions is None
            or (wanted.inner and converged > self.locked)
            or _better(ranks, self.champions, look.T, found, rank, wanted.tol, floor)
        ):
            self.champions = ranks
            return self._challenged(look, float(ranks[-1]), meanwhile)
        if wanted.inner or not _unbeaten(
            rank, look.T, look.values, look.spike, converged, self.locked, ranks[-1]
        ):
            return False
        self.basis.rotate(look.Q[:, :converged], look.size)
        return True

    def _challenged(self, look: Look, worst: float, meanwhile: Callable[..., Any] | None) -> bool:
        """Search again from random vectors for a missed eigenvalue better than `worst`; True if
        none.
        """
        wanted, basis, aside = self.wanted, self.basis, look.converged
        if self.limits.challenge:
            most = min(self._most_leading(look.size), self.most_room - self.ncv // 2)
            ranks = wanted.rank(look.values)
            aside = _aside(look.T, ranks, worst, look.moved, look.converged, most)
        basis.rotate(look.Q[:, :aside], look.size)
        if not self.limits.challenge:
            return True
        won, more = unbeaten(
            basis,
            aside,
            worst,
            wanted.rank,
            wanted.edge,
            tol=wanted.tol,
            floor=LIMITS.residual * self.scale,
            restarts=self.limits.maxiter - self.count,
            patience=np.inf if wanted.inner else basis.matvecs,
            meanwhile=meanwhile and functools.partial(meanwhile, look.settled, basis),
        )
        self.count += more
        self.aside = None if won else aside
        return won

    def restart(self, look: Look) -> None:
        """Shrink the space, unless it has not been filled yet."""
        basis, size, lost = self.basis, look.size, self.aside is not None
        if not lost and not look.ended and size < self.room:
            # Not converged with a partly filled space: continue to expand it instead of restarting.
            self.S[size, size - 1] = look.beta
            self.kept, self.goal = size, self.room
            return
        challenged = self.champions is not None
        keep = self._vectors_kept(look)
        projected, spike = look.T[:keep, :keep], look.spike[:keep]
        if lost or look.ended:
            vector = None
            if self.aside is not None:
                # These rows contain the newcomer and the nearly converged vectors excluded.
                vector = basis.V[keep : self.aside + 2].sum(axis=0)
            else:
                basis.rotate(look.Q[:, :keep], size)
            basis.start(keep, vector)
            self.hessenberg, spike, self.locked = False, np.zeros(keep), keep
        elif self.hessenberg:
            Q, projected, spike = shifted_qr(self.S[:size, :size], look.beta, look.values, keep)
            basis.rotate(Q, size)
        else:
            basis.rotate(look.Q[:, :keep], size)
            spike[: min(look.converged, keep)] = 0.0
        self.S[:] = 0.0
        if self.count >= LIMITS.restarts and self.ncv < self.limits.grown and not challenged:
            self._grow(keep)
        self.S[:keep, :keep], self.S[keep, :keep] = projected, spike
        self.kept, self.count, self.aside = keep, self.count + 1, None
        if lost:
            self.room = min(keep + self.ncv, self.most_room)
            self.goal = min((keep + self.ncv + 1) // 2, self.room)
        else:
            self.goal = min(keep + look.products_left, self.room)

    def _vectors_kept(self, look: Look) -> int:
        """How many leading Schur vectors are kept at a restart; conjugate pairs stay together. Half
        of the unwanted are kept, more as more have converged, but at most two thirds; all are kept
        of an invariant space, which has no information on the rest of the spectrum."""
        k, ncv, converged = self.wanted.k, self.ncv, look.converged
        if self.aside is not None:  # a challenge has just found a better eigenvalue
            keep = min(converged, max(whole(look.T, k), ncv // 2))
        elif look.ended:
            keep = min(look.size, self.room - 1)
        elif self.champions is not None:
            keep = max(k + converged // 2, (self.locked + self.room) // 2)
        else:
            spare = ncv - k
            new = max(spare // 3, min(spare, 4))
            keep = k + min((spare + converged) // 2, spare - new)
        return whole(look.T, min(keep, self.room - 2, look.size))

    def _grow(self, keep: int) -> None:
        """Enlarge the space; its first `keep` rows and the residual vector are kept."""
        self.ncv = self.room = self.limits.grown
        self.most_room = self._most_room()
        self.basis.enlarge(self.most_room, keep + 1)
        self.S = np.zeros((self.most_room, self.most_room), dtype=self.S.dtype)

    def outcome(self, look: Look, converged: int, T: np.ndarray, *, complete: bool) -> PartialSchur:
        """The result; if the iteration is not complete, its number of restarts is the limit."""
        values, basis = look.values[:converged], self.basis
        count = self.count if complete else self.limits.maxiter
        return PartialSchur(T, values, basis, self.scale, count, basis.matvecs, complete)


def _leading(T: np.ndarray, values: np.ndarray, moved: np.ndarray, tol: float, floor: float) -> int:
    """Number of leading Schur vectors that have converged, without splitting a conjugate pair."""
    beyond = (~(moved <= np.maximum(tol * np.abs(values), floor))).nonzero()[0]
    count = int(beyond[0]) if beyond.size else len(values)
    return count - 1 if whole(T, count) > count else count


def _aside(
    T: np.ndarray, ranks: np.ndarray, worst: float, moved: np.ndarray, converged: int, most: int
) -> int:
    """Number of leading Schur vectors that a challenge excludes: the converged ones and following
    ones that are nearly invariant, at most `most`.
    """
    last = min(most, len(ranks) - 1) - 1
    if last <= converged:
        return converged
    counts = np.arange(converged + 1, min(whole(T, last), len(ranks) - 1) + 1)
    beyond = np.maximum.accumulate(ranks[::-1])[::-1]
    close = moved[counts - 1] <= LIMITS.aside * (worst - beyond[counts])
    found = counts[close & (T[counts, counts - 1] == 0)]
    return int(found[-1]) if found.size else converged


def _products_left(past: tuple[int, float], now: tuple[int, float], limit: float) -> int:
    """Estimated products until the wanted eigenvalues converge at the last rate."""
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
    r"""Whether ranks have risen by more than their uncertainty, residual times condition.

    A pair of residual r is exact for a matrix A + E, |E| = r, and the condition is :math:`\kappa =
    |x| |y| / |y^* x|` with the left eigenvector y nearest to x. For defective eigenvalues
    :math:`\kappa` is infinite: their error is estimated by the cube root of r, as for Jordan blocks
    of order three.
    """
    slack = 1e-9 * np.abs(ranks)
    if not np.any(ranks > champions + slack + floor):
        return False
    theta, left, right = linalg.eig(T, left=True)
    size = float(np.abs(theta).max())
    best = found[np.argsort(-rank(found), kind="stable")[: len(ranks)]]
    for place, value in enumerate(best):
        copies = np.abs(theta - value) <= 1e-6 * size  # values this close count as repeated
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
    """Whether the best eigenvalue that has not converged is worse than the wanted, by a gap that is
    far larger than its residual (by the ratio `LIMITS.inside`).
    """
    if converged > locked or converged == len(values):
        return True
    following = whole(T, converged + 1)
    moved = float(np.linalg.norm(spike[converged:following]))
    return bool(moved < LIMITS.inside * (worst - rank(values[converged : converged + 1])[0]))


Array = np.ndarray


def shifted_qr(H: Array, beta: float, values: Array, keep: int) -> tuple[Array, Array, Array]:
    r"""Reduce ``A V = V H + \beta v e_m^T`` to `keep` columns by shifted QR steps (Sorensen 1992).

    The shifts are the unwanted values; a pair of a real H takes :math:`H^2 - 2 \mathrm{Re}(\mu) H +
    |\mu|^2 I = Q R`. Returns Q, the projected matrix and the coefficients of v in the residual; its
    other term, ``V Q[:, keep] H[keep, keep-1]``, is rounding for exact shifts and neglected, which
    is why Krylov-Schur is the default.
    """
    m = len(H)
    H, Q, unit = H.copy(), np.eye(m, dtype=H.dtype), np.eye(m)
    j = keep
    while j < m:
        shift = values[j]
        if np.isrealobj(H) and shift.imag != 0:
            polynomial = H @ H - 2 * shift.real * H + abs(shift) ** 2 * unit
            j += 2
        else:
            polynomial = H - (shift.real if np.isrealobj(H) else shift) * unit
            j += 1
        factor = np.linalg.qr(polynomial)[0]
        H = np.triu(factor.conj().T @ H @ factor, -1)
        Q = Q @ factor
    return Q[:, :keep], H[:keep, :keep], beta * Q[m - 1, :keep]


def unbeaten(
    basis: Arnoldi,
    locked: int,
    worst: float,
    rank: Rank,
    edge: Edge | None,
    *,
    tol: float,
    floor: float,
    restarts: int,
    patience: float,
    meanwhile: Callable[[], Any] | None = None,
) -> tuple[bool, int]:
    r"""Whether no eigenvalue outside the `locked` rows beats `worst`; number of restarts.

    If a better one is found, row `locked` (and for a pair the next) spans its space; rows beyond
    are overwritten. A newcomer that has converged (residual below `tol` times its modulus, or
    `floor`) and ranks below the wanted is locked, and the search begins again. After `patience`
    products the search ends if the newcomer ranks below the wanted.

    Let U be the locked rows and B the compression of A to their orthogonal complement. Arnoldi
    steps from a random unit vector r orthogonal to U give norms :math:`\beta_j` with :math:`|p(B)
    r| = \prod_j \beta_j`, p the monic polynomial whose roots are the Ritz values, including those
    dropped by restarts. An eigenvalue :math:`\mu` of B with left unit eigenvector y has :math:`|y^*
    p(B) r| = |p(\mu)|\,|y^* r|`, whence

    .. math::
        |y^* r| \le \prod_j \beta_j \,/\, |p(\mu)| .

    Once the right-hand side is below :math:`t / \sqrt n` wherever an eigenvalue would be wanted, a
    missed one requires :math:`|y^* r| \le t / \sqrt n`, which for a random r has the probability
    :math:`\sqrt{2 / \pi}\,t`, however far from normal A is. As :math:`|p|` grows outwards from its
    roots, it suffices to look at the edge of the wanted part of the plane.

    The best Ritz value of the search is called the newcomer.
    """
    first, room, n, part = locked, basis.size - locked, basis.V.shape[1], LIMITS.inside
    basis.start(locked)
    S = np.zeros((room, room), dtype=basis.V.dtype)
    kept, goal, made = 0, min(LIMITS.first, room), 0
    begun = searched = basis.matvecs  # products before the search, and before this random vector
    # Log of the product of the betas; Ritz values dropped; products and residual at the last test.
    betas, dropped, past = 0.0, np.zeros(0, dtype=complex), (0, 1.0)
    enough, likely = (0.5 * np.log(n) - np.log(chance) for chance in (LIMITS.sure, LIMITS.likely))
    rounding = 1e-9 * abs(worst) + floor
    while True:
        aside = meanwhile if basis.matvecs == begun else None
        steps = basis.sweep(locked + kept, locked + goal, aside)
        if not steps.finite:
            raise FloatingPointError(f"A v is not finite after {basis.matvecs} products")
        ended = steps.ended
        size = goal if ended is None else kept + ended + 1
        steps.project(S, kept, size, locked)
        beta = 0.0 if ended is not None else float(steps.betas[-1])
        leading = int(LIMITS.thick * room) + 1 if size == room else 1
        T, Q, values = ordered_schur(S[:size, :size], rank, leading)
        best, products = whole(T, 1), basis.matvecs - searched
        residual = beta * float(np.linalg.norm(Q[size - 1, :best]))
        distance = worst - float(rank(values[:1])[0])
        evidence = np.inf if distance >= -rounding else 0.0
        if ended is None:
            betas += float(np.log(steps.betas).sum())
            roots = np.concatenate((values, dropped))
            evidence = _evidence(worst, roots, edge) - betas if distance > 0 else 0.0
        converged = residual <= max(tol * float(np.abs(values[0])), floor)
        inside = residual < part * distance or (converged and distance >= -rounding)
        tired = basis.matvecs - begun >= patience
        copy = converged and distance <= 1e-6 * abs(worst) and patience < np.inf
        if evidence >= enough or (inside and (evidence >= likely or tired or copy)):
            return True, made
        beaten = not inside and (converged or residual < -part * distance)
        if beaten or made >= restarts:
            basis.rotate(Q[:, :best], size, locked)
            basis.V[first : first + best] = basis.V[locked : locked + best]
            return False, made
        if inside and converged and evidence <= 0.0 and 2 * (room - best) > basis.size - first:
            # Converged and worse than the wanted, without evidence on the rest: lock it, restart.
            basis.rotate(Q[:, :best], size, locked)
            locked, room = locked + best, room - best
            basis.start(locked)
            S[:] = 0.0
            kept, goal, made, searched = 0, min(LIMITS.first, room), made + 1, basis.matvecs
            betas, dropped, past = 0.0, np.zeros(0, dtype=complex), (0, 1.0)
            continue
        need = _search_products_left(products, evidence, enough, past, residual, part * distance)
        past = (products, residual)
        if size < room:
            S[size, size - 1] = beta
            kept, goal = size, min(room, size + need)
            continue
        keep = whole(T, min(int(LIMITS.thick * room), room - 2))
        basis.rotate(Q[:, :keep], size, locked)
        dropped = np.concatenate((dropped, values[keep:]))
        S[:] = 0.0
        S[:keep, :keep], S[keep, :keep] = T[:keep, :keep], beta * Q[size - 1, :keep]
        kept, made, goal = keep, made + 1, min(keep + need, room)


def _evidence(worst: float, roots: np.ndarray, edge: Edge | None) -> float:
    r"""Logarithm of the least \|p\| on the boundary of the wanted part of the plane."""
    if edge is None:
        return np.inf
    apart = np.abs(edge(worst, roots)[:, None] - roots)
    with np.errstate(divide="ignore"):
        return float(np.log(apart).sum(axis=1).min())


def _search_products_left(
    products: int,
    evidence: float,
    enough: float,
    past: tuple[int, float],
    residual: float,
    target: float,
) -> int:
    """Estimated products until the search ends, by evidence or by residual, at the rates so far."""
    needs: list[Any] = []
    if evidence > 0:
        needs.append((enough - evidence) * products / evidence)
    if past[0] and past[1] > residual > target > 0:
        rate = np.log(past[1] / residual) / (products - past[0])
        needs.append(np.log(residual / target) / rate)
    return max(3, int(np.ceil(min(min(needs, default=np.inf), 1e9))))


@dataclass(frozen=True)
class Wanted:
    """Which eigenvalues are wanted. Ranks change by at most |d| if the eigenvalue changes by d;
    with `edge` a challenge ends as soon as a missed eigenvalue is improbable (see
    `unbeaten`)."""

    k: int
    rank: Rank  # rank of eigenvalues: the larger, the more wanted
    tol: float = 0.0  # residual relative to the modulus of the eigenvalue
    edge: Edge | None = None  # boundary of the wanted part of the plane, see `schur.edge_of`
    inner: bool = False  # inside the spectrum too, where only probability ends a challenge


@dataclass(frozen=True)
class Limits:
    """Limits of the dimension of the space and of the number of restarts, and their kind."""

    ncv: int  # dimension, k + 3 to n - 1; after a challenge, in addition to the vectors kept
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
    products_left: int  # estimated products until the wanted converge, from the last rate

    @property
    def size(self) -> int:
        """Dimension of the space."""
        return len(self.Q)


def room_for(k: int, ncv: int) -> int:
    """Largest dimension of the space in an iteration with challenges."""
    return ncv + max(k + 1, ncv // 2) + 1
