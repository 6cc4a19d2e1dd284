"""Schur form of the small projected matrix, its leading blocks in a wanted order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg.lapack import dgees, dtrexc, zgees, ztrexc

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
        # Move the first of the best here, unless this one is as good: equal ones keep their order.
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
