"""Which eigenvalues come first: the six meanings of ``which``."""

from __future__ import annotations

import numpy as np

from gpu.errors import InputError
from gpu.ordered_schur import Rank

ORDERS = ("LM", "SM", "LR", "SR", "LI", "SI")


def rank_of(which: str, real: bool) -> Rank:
    """The rank function of `which`; equal for the two of a conjugate pair of a real matrix.

    As in ARPACK, LI and SI go by the modulus of the imaginary part where A is real and by its sign
    where A is complex.

    Raises
    ------
    InputError
    """
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


def best_first(
    values: np.ndarray, rank: Rank, k: int, paired: bool, shown: np.ndarray | None = None
) -> np.ndarray:
    """Places of the k best, best first; a conjugate pair stays together, plus before minus.

    Parameters
    ----------
    values : ndarray
        What `rank` speaks of.
    rank : callable
    k : int
    paired : bool
        Whether complex values come as conjugate pairs.
    shown : ndarray, optional
        The eigenvalues themselves, where `values` are transformed.
    """
    shown = values if shown is None else shown
    if not paired:
        return np.argsort(-rank(values), kind="stable")[:k]
    order = np.lexsort((-shown.imag, -np.abs(shown.imag), -shown.real, _place(rank(values))))
    return order[:k]


def _place(rank: np.ndarray) -> np.ndarray:
    """Descending places; ranks apart by round-off share one, so that pairs meet."""
    order = np.argsort(-rank, kind="stable")
    ranked = rank[order]
    # Relative to the rank itself: beside an inverse of rounding all others would look equal.
    apart = 1e-14 * np.abs(ranked[:-1])
    place = np.empty(rank.size, dtype=np.int64)
    place[order] = np.concatenate(([0], np.cumsum(-np.diff(ranked) > apart)))[: rank.size]
    return place
