"""Which eigenvalues come first: the six meanings of ``which``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gpu.eigenvalues.schur.ordered_schur import Rank
from gpu.errors import InputError

# Maps a rank and values of lower rank to points of the curve of this rank: see `edge_of`.
Edge = Callable[[float, np.ndarray], np.ndarray]

EVENLY = 32  # number of equidistant points on the curve, which do not depend on the values
RANK_ROUNDING = 1e-14  # relative: ranks that differ by less count as equal
CIRCLE = np.exp(2j * np.pi * np.arange(EVENLY) / EVENLY)
ALONG = np.linspace(-1.0, 1.0, EVENLY + 1)
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
    nearest to the values, which rank lower, and `EVENLY` equidistant ones. Unbounded curves end at
    the largest modulus of the values."""
    sign = 1.0 if which[0] == "L" else -1.0

    def edge(worst: float, values: np.ndarray) -> np.ndarray:
        size = np.abs(values)
        if which[1] == "M":
            return abs(worst) * np.concatenate((values[size > 0] / size[size > 0], CIRCLE))
        along = ALONG * size.max(initial=0.0)
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
