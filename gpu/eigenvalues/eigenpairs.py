"""Eigenvalues and vectors from a partial Schur form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gpu.eigenvalues.iteration_operator import EigenProblem
from gpu.eigenvalues.krylov.arnoldi import Arnoldi
from gpu.eigenvalues.operator import Matrix
from gpu.eigenvalues.schur.order import best_first
from gpu.eigenvalues.schur.ordered_schur import Rank


class Pairs(NamedTuple):
    """Eigenvalues, best first, with their vectors.

    Attributes
    ----------
    values : ndarray, shape (k,)
        On the host.
    there : array, shape (k,), or None
        The same in the array module of the matrix.
    vectors : array, shape (n, k)
    squares : array, shape (2, k), or None
        Squares of the norms of ``A x - lambda M x`` and of ``A x``, see `certify`.
    """

    values: np.ndarray
    there: Any
    vectors: Any
    squares: Any


@dataclass
class Eigenpairs:
    """Eigenpairs of a partial Schur form and its basis; the last result is cached.

    Attributes
    ----------
    matrix, mass : Matrix
        M may be None.
    problem : EigenProblem
        Whose eigenvalues T has.
    rank : callable
        Of eigenvalues; the larger, the more wanted.
    k : int
        Number of pairs.
    """

    matrix: Matrix
    mass: Matrix | None
    problem: EigenProblem
    rank: Rank
    k: int
    _T: Any = None
    _made: Pairs | None = None

    def of(self, T: np.ndarray, basis: Arnoldi) -> Pairs:
        """The pairs of T, the k best first; for the same T again, the cached ones."""
        if T is self._T and self._made is not None:
            return self._made
        theta, Y = np.linalg.eig(T)
        theta = theta.astype(complex)
        values = self.problem.values(theta)
        order = best_first(theta, self.rank, self.k, self.problem.dtype.kind == "f", values)
        values, Y = values[order], Y[:, order]
        if len(order) == self.k and self._fused():
            from gpu.eigenvalues.krylov.ritz_pairs import pairs_with_residuals

            mass = self.mass and self.mass.explicit
            V = basis.V[: len(Y)]
            made = Pairs(values, *pairs_with_residuals(V, Y, values, self.matrix.explicit, mass))
        else:
            made = Pairs(values, self.matrix.xp.asarray(values), basis.combine(Y), None)
        self._T, self._made = T, made
        return made

    def _fused(self) -> bool:
        """Whether vectors and residuals can be computed together, by real products on a device."""
        matrix, mass = self.matrix, self.mass
        return (
            matrix.xp is not np
            and matrix.explicit is not None
            and (mass is None or mass.explicit is not None)
            and self.problem.dtype.kind == "f"
            and matrix.unit == 1.0
        )
