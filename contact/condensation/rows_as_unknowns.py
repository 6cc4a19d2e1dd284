"""The change of unknowns that makes contact rows some of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import min_weight_full_bipartite_matching
from scipy.sparse.linalg import splu

from contact.errors import InputError

_FILL = 60.0  # entries in a row of the change of unknowns, beyond which it is no longer sparse


def rows_as_unknowns(
    B: sparse.csr_array,
) -> tuple[NDArray[np.int64], sparse.csr_array, sparse.csr_array]:
    """Take the place of one unknown of each row by the row's value.

    Parameters
    ----------
    B : csr_array, shape (n, nb)

    Returns
    -------
    pivots : ndarray, shape (n,)
        The unknown of each row.
    change : csr_array, shape (nb, nb)
        T of ``z = T x`` with ``x[pivots] = B z``.
    back : csr_array, shape (nb, nb)
        Its inverse.

    Raises
    ------
    InputError
        Rows depend on each other, or the change of unknowns is not sparse.
    """
    n, nb = B.shape
    B.eliminate_zeros()
    largest = abs(B).max(axis=1).toarray().ravel()
    # The product of the entries is to be as large as possible; weights must be positive.
    weight = sparse.csr_array(
        (1.0 - np.log(np.abs(B.data) / np.repeat(largest, np.diff(B.indptr))), B.indices, B.indptr),
        B.shape,
    )
    try:
        row, column = min_weight_full_bipartite_matching(weight)
    except ValueError:
        row = column = np.zeros(0, dtype=np.int64)
    if row.size < n:
        raise InputError(
            "functional: its contact rows are linearly dependent and cannot be unknowns; take "
            "another functional, or DistributedBody(..., backend='mumps')"
        )
    pivots = np.empty(n, dtype=np.int64)
    pivots[row] = column
    kept = np.ones(nb)
    kept[pivots] = 0.0
    place = sparse.csr_array((np.ones(n), (pivots, np.arange(n))), shape=(nb, n))
    back = sparse.csr_array(sparse.diags_array(kept) + place @ B)
    factor = splu(sparse.csc_array(back), permc_spec="COLAMD")
    # The inverse is sparse where each row touches the unknowns of few others.
    blocks = []
    for start in range(0, nb, 256):
        some = np.arange(start, min(start + 256, nb))
        unit = np.zeros((nb, some.size))
        unit[some, some - start] = 1.0
        solved = factor.solve(unit)
        solved[np.abs(solved) < 1e-14 * np.abs(solved).max(axis=0)] = 0.0
        blocks.append(sparse.csc_array(solved))
        if blocks[-1].nnz > _FILL * some.size:
            raise InputError(
                "functional: each of its contact rows depends on all others, so that they cannot "
                "be unknowns; take another functional, or DistributedBody(..., backend='mumps')"
            )
    return pivots, sparse.csr_array(sparse.hstack(blocks, format="csr")), back
