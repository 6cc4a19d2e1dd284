"""The weights of a linear-quadratic cost: Q as a number, diagonal, matrix or operator."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np

from gpu.errors import InputError
from gpu.riccati.problem.state_matrix import StateMatrix, stored, symmetric, times
from skfem_adini.ground.arguments import is_finite_number
from skfem_adini.ground.arrays import namespace, to_host


class Weight:
    """``Q - F F^T``, symmetric, applied to vectors and columns. Q is a number (times the identity),
    a diagonal (1-D), a dense or sparse matrix, a LinearOperator, or ``C^T C``; F is None or
    the cross term's part.
    """

    def __init__(self, state: StateMatrix, Q: Any = None, *, C: Any = None) -> None:
        n, xp = state.n, state.xp
        self.state, self.Q, self._C, self._F = state, None, C, None
        if C is not None:
            return
        if hasattr(Q, "matvec") and not hasattr(Q, "tocsr"):
            self.Q, shape = Q, Q.shape
        else:
            if is_finite_number(Q) and not isinstance(Q, complex | np.complexfloating):
                Q = xp.full(n, float(Q))
            self.Q = Q = stored("Q", Q)
            shape = Q.shape
            if shape in ((n,), (n, n)) and namespace(Q) is not xp:
                raise InputError("Q and A live on different sides: move one of them")
            if shape == (n, n) and not symmetric(Q):
                raise InputError("Q is not symmetric: pass (Q + Q.T) / 2")
        if tuple(shape) not in ((n,), (n, n)):
            raise InputError(f"Q has shape {tuple(shape)}: expected ({n},) or ({n}, {n})")

    @property
    def C(self) -> Any:
        """The factor C if the weight is ``C^T C``, else None."""
        return self._C if self._F is None else None

    @property
    def entries(self) -> Any:
        """Q if its entries are stored and there is no F, else None."""
        return None if self._F is not None or hasattr(self.Q, "matvec") else self.Q

    def less(self, F: Any) -> Weight:
        """This weight minus ``F F^T``."""
        other = copy(self)
        other._F = F
        return other

    def apply(self, x: Any) -> Any:
        """The product with a vector or a matrix of columns."""
        product = times(self.Q, x) if self._C is None else self._C.T @ (self._C @ x)
        return product if self._F is None else product - self._F @ (self._F.T @ x)

    def scale(self) -> float:
        """A lower estimate of the spectral norm of Q, by three steps of the power method."""
        x = self.state.xp.asarray(np.random.default_rng(0).standard_normal(self.state.n))
        size = 0.0
        for _ in range(3):
            size = float(self.state.xp.linalg.norm(x))
            if size == 0.0:
                break
            x = self.apply(x / size)
        return size


def low_rank_factor(weight: Weight) -> Any:
    """C with at most 64 rows and ``Q = C^T C``, or None: the given factor, or one computed
    if only few rows of Q are not zero.
    """
    n, xp, Q = weight.state.n, weight.state.xp, weight.entries
    few = min(64, n // 2)
    if weight.C is not None:
        return weight.C if len(weight.C) <= few else None
    if Q is None:
        return None
    if Q.ndim == 1:
        places = np.flatnonzero(to_host(Q))
        core = np.diag(to_host(Q)[places[:few]])
    else:
        rows = abs(Q).sum(axis=1)
        places = np.flatnonzero(np.asarray(to_host(rows)).ravel())
        if len(places) > few:
            return None
        core = Q[places][:, places]
        core = to_host(core.toarray() if hasattr(core, "toarray") else core)
    if len(places) > few or not len(places):
        return None
    values, vectors = np.linalg.eigh(core)
    kept = values > 1e-15 * values.max()  # the others are zero or negative by rounding
    C = np.zeros((int(kept.sum()), n))
    C[:, places] = (vectors[:, kept] * np.sqrt(values[kept])).T
    return xp.asarray(C)
