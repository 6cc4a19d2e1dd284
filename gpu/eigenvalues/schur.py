"""Schur form of the small projected matrix, with its leading blocks in a given order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg.lapack import dgees, dtrexc, zgees, ztrexc

from gpu.errors import InputError

Array = np.ndarray
Rank = Callable[[Array], Array]


def eigenvalues_of(T: Array) -> Array:
    """Diagonal eigenvalues of a Schur form, complex, in the order of its rows. A conjugate pair of
    a real form is a block of two rows, positive imaginary part first.
    """
    values = T.diagonal().astype(complex)
    if T.dtype.kind == "c":
        return values
    pair = T.diagonal(-1).nonzero()[0]
    if not pair.size:
        return values
    # LAPACK's standard block: equal diagonal entries, off-diagonal ones of opposite sign.
    imaginary = np.sqrt(np.abs(T[pair, pair + 1])) * np.sqrt(np.abs(T[pair + 1, pair]))
    values[pair] += 1j * imaginary
    values[pair + 1] -= 1j * imaginary
    return values


def ordered_schur(S: Array, rank: Rank, leading: int) -> tuple[Array, Array, Array]:
    """T, Q and eigenvalues of ``S = Q T Q^*``, the eigenvalues of largest rank first in `leading`
    rows. Blocks of two rows stay whole, the ranks of a conjugate pair are equal; by LAPACK's trexc
    (Bai and Demmel 1993)."""
    gees, trexc = (zgees, ztrexc) if S.dtype.kind == "c" else (dgees, dtrexc)
    T, *_, Q, _, info = gees(lambda *_: 0, S, sort_t=0)
    if info:
        raise np.linalg.LinAlgError(f"the QR iteration for the Schur form failed: info {info}")
    values = eigenvalues_of(T)
    ranks, widths = rank(values).tolist(), _widths(T)
    moved, place = False, 0
    while place < min(leading, len(S)):
        # Move the best block here, unless this one is as good: equal ones keep their order.
        following = ranks[place:]
        best = place + following.index(max(following))
        width = widths[best]
        if ranks[best] > ranks[place]:
            T, Q, failed = trexc(T, Q, best + 1, place + 1, overwrite_a=1, overwrite_q=1)
            moved = True
            for row in (ranks, widths):
                row[place:place] = row[best : best + width]
                del row[best + width : best + 2 * width]
            if failed or (width == 2 and not T[place + 1, place]):
                # The blocks were too close to be swapped, or rounding made a pair two real values.
                values = eigenvalues_of(T)
                ranks, widths = rank(values).tolist(), _widths(T)
                width = widths[place]
        place += width
    return T, Q, eigenvalues_of(T) if moved else values


def _widths(T: Array) -> list[int]:
    """For each row, the number of rows (1 or 2) of the diagonal block that begins there."""
    return [2 if below else 1 for below in T.diagonal(-1).tolist()] + [1]


def whole(T: Array, count: int) -> int:
    """The smallest number of rows from `count` on that splits no conjugate pair."""
    return count + (_block(T, count - 1) - 1 if 0 < count < len(T) else 0)


def _block(T: Array, place: int) -> int:
    """Number of rows (1 or 2) of the diagonal block that begins at this row."""
    return 2 if place + 1 < len(T) and T[place + 1, place] != 0 else 1


# Maps a rank and values of lower rank to points of the curve of this rank: see `edge_of`.
Edge = Callable[[float, np.ndarray], np.ndarray]

RANK_ROUNDING = 1e-14  # relative: ranks that differ by less count as equal
ORDERS = ("LM", "SM", "LR", "SR", "LI", "SI")


def rank_of(which: str, real: bool) -> Rank:
    """The rank function of `which`; equal for the two of a conjugate pair of a real matrix. As in
    ARPACK, LI and SI mean the modulus of the imaginary part if A is real, and the imaginary part
    itself if A is complex."""
    if which not in ORDERS:
        raise InputError(f"which={which!r}: expected one of {', '.join(ORDERS)}")
    sign = 1.0 if which[0] == "L" else -1.0
    if which[1] == "M":
        return lambda values: sign * np.abs(values)
    if which[1] == "R":
        return lambda values: sign * values.real
    if real:
        return lambda values: sign * np.abs(values.imag)
    return lambda values: sign * values.imag


def edge_of(which: str, real: bool) -> Edge:
    """A function (worst, values) -> points of the curve of all numbers of rank `worst`: those
    nearest to the values, which rank lower, and 32 equidistant ones. Unbounded curves end at
    the largest modulus of the values."""
    sign = 1.0 if which[0] == "L" else -1.0
    circle = np.exp(2j * np.pi * np.arange(32) / 32)
    line = np.linspace(-1.0, 1.0, 33)

    def edge(worst: float, values: np.ndarray) -> np.ndarray:
        size = np.abs(values)
        if which[1] == "M":
            return abs(worst) * np.concatenate((values[size > 0] / size[size > 0], circle))
        along = line * size.max(initial=0.0)
        if which[1] == "R":
            return sign * worst + 1j * np.concatenate((values.imag, along))
        along = np.concatenate((values.real, along))
        upper = along + 1j * sign * worst
        return np.concatenate((upper, upper.conj())) if real else upper

    return edge


def best_first(
    values: np.ndarray, rank: Rank, k: int, paired: bool, shown: np.ndarray | None = None
) -> np.ndarray:
    """Indices of the k best values, best first; of a conjugate pair the positive imaginary part
    first. `paired`: complex values come as adjacent pairs, as from LAPACK; `shown`: the
    eigenvalues, if `values` are those of a transformed problem."""
    shown = values if shown is None else shown
    if not paired:
        return np.argsort(-rank(values), kind="stable")[:k]
    first, ranks = np.arange(values.size), rank(values)
    members = values.imag.nonzero()[0]
    leaders = np.delete(ranks, members[1::2]) if members.size else ranks
    descend = leaders[:-1] - leaders[1:] > RANK_ROUNDING * np.abs(leaders[:-1])
    if descend.all() and (shown.imag[members[::2]] > 0).all():
        return first[:k]
    # Both members of a pair get the keys of the first, so that rounding does not separate them, and
    # its index, so that pairs of equal rank do not mix.
    first[members[1::2]] = members[::2]
    keys = (-np.abs(shown.imag), -shown.real, _place(ranks))
    return np.lexsort((-shown.imag, first, *(key[first] for key in keys)))[:k]


def _place(rank: np.ndarray) -> np.ndarray:
    """Position of each rank in descending order; ranks that differ by rounding share one."""
    order = np.argsort(-rank, kind="stable")
    ranked = rank[order]
    # Relative to each rank, not to the largest one: if this is the inverse of a rounding error, all
    # others would count as equal.
    apart = RANK_ROUNDING * np.abs(ranked[:-1])
    place = np.empty(rank.size, dtype=np.int64)
    place[order] = np.concatenate(([0], np.cumsum(-np.diff(ranked) > apart)))[: rank.size]
    return place
