r"""Linear systems of the interior point and of the polish.

.. math:: \begin{pmatrix} P + D & C^T \\ C & -E \end{pmatrix}
          \begin{pmatrix} u \\ v \end{pmatrix} = \begin{pmatrix} r \\ s \end{pmatrix}

with positive diagonal D and E that change from step to step: symmetric quasidefinite. A sparse one
is factored as it stands. A dense one is condensed: inequality rows go into
:math:`H = P + D + G^TE_G^{-1}G`, equality rows into the Schur complement
:math:`AH^{-1}A^T + E_A`, both by Cholesky's method, which runs at the speed of a matrix product on
a device. Two steps of refinement against the matrix itself follow in both cases.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.linalg.lapack import dsytrf, dsytrs

from gpu.dense import cholesky, cholesky_solve, lower_solve
from gpu.program import Array, Program
from gpu.sparse_factor import quasidefinite

REFINEMENT = 3


class SparseSystem:
    """The system of sparse P and C."""

    def __init__(self, program: Program, solver: str = "auto") -> None:
        self.P, self.C = sparse.csr_array(program.P), sparse.csr_array(program.C)
        self.Ct = sparse.csr_array(self.C.T)
        self.n, m = program.q.size, program.row_low.size
        full = sparse.eye_array(self.n)
        K = sparse.block_array(
            [[self.P + full, self.Ct], [self.C, -sparse.eye_array(m)]] if m else [[self.P + full]],
            format="csc",
        )
        self.diagonal = self.P.diagonal()
        # P + I may have cancelled an entry of the diagonal, or stored none.
        self.factors = quasidefinite(K, solver)

    def factor(self, D: Array, E: Array) -> None:
        """Factor for these diagonals; raises `LinAlgError`."""
        self.D, self.E = D, E
        self.factors.factor(np.concatenate([self.diagonal + D, -E]))

    def solve(self, r: Array, s: Array) -> tuple[Array, Array]:
        """Solve for (u, v), refined."""
        n = self.n
        right = np.concatenate([r, s])
        w, best = self.factors.solve(right), np.inf
        kept = w
        for _ in range(REFINEMENT + 1):
            u, v = w[:n], w[n:]
            left = right - np.concatenate(
                [self.P @ u + self.D * u + self.Ct @ v, self.C @ u - self.E * v]
            )
            error = float(np.abs(left).max())
            if not error < 0.5 * best:
                break
            kept, best = w, error
            w = w + self.factors.solve(left)
        size = float(np.abs(right).max())
        self.accuracy = best / size if size else 0.0
        return kept[:n], kept[n:]


class DenseSystem:
    """The system of dense P and C, of either namespace."""

    def __init__(self, program: Program) -> None:
        self.program, self.xp = program, program.xp
        xp = self.xp
        self.eq = xp.flatnonzero(program.equality)
        self.ineq = xp.flatnonzero(~program.equality)
        self.A, self.G = program.C[self.eq], program.C[self.ineq]

    def factor(self, D: Array, E: Array) -> None:
        """Factor for these diagonals; raises `LinAlgError`."""
        self.D, self.E = D, E
        H = self.program.P.copy()
        if self.ineq.size:
            root = 1.0 / self.xp.sqrt(E[self.ineq])
            weighted = self.G * root[:, None]
            H += weighted.T @ weighted
        i = self.xp.arange(len(H))
        H[i, i] += D
        self.L = cholesky(H)
        if self.eq.size:
            self.X = lower_solve(self.L, self.A.T)
            S = self.X.T @ self.X
            j = self.xp.arange(len(S))
            S[j, j] += E[self.eq]
            self.S = cholesky(S)

    def _once(self, r: Array, s: Array) -> tuple[Array, Array]:
        v = self.xp.empty_like(s)
        if self.ineq.size:
            e = self.E[self.ineq]
            r = r + self.G.T @ (s[self.ineq] / e)
        t = lower_solve(self.L, r)
        if self.eq.size:
            v[self.eq] = cholesky_solve(self.S, self.X.T @ t - s[self.eq])
            t = t - self.X @ v[self.eq]
        u = lower_solve(self.L, t, transposed=True)
        if self.ineq.size:
            v[self.ineq] = (self.G @ u - s[self.ineq]) / e
        return u, v

    def solve(self, r: Array, s: Array) -> tuple[Array, Array]:
        """Solve for (u, v), refined."""
        p = self.program
        u, v = self._once(r, s)
        kept, best = (u, v), np.inf
        for _ in range(REFINEMENT + 1):
            top = r - p.P @ u - self.D * u - p.C.T @ v
            low = s - p.C @ u + self.E * v
            error = max(float(abs(top).max()), float(abs(low).max() if low.size else 0.0))
            if not error < 0.5 * best:
                break
            kept, best = (u, v), error
            du, dv = self._once(top, low)
            u, v = u + du, v + dv
        size = max(float(abs(r).max()), float(abs(s).max() if s.size else 0.0))
        self.accuracy = best / size if size else 0.0
        return kept


class IndefiniteSystem:
    """The system of dense P and C on the host, factored as it stands with symmetric pivoting.

    Slower than the condensed one, and safe where entries of D and E differ by many orders.
    """

    def __init__(self, program: Program) -> None:
        n, m = program.q.size, program.row_low.size
        self.n, self.K = n, np.zeros((n + m, n + m))
        self.K[:n, :n] = program.P
        self.K[n:, :n] = program.C
        self.K[:n, n:] = program.C.T
        self.diagonal = program.P.diagonal()

    def factor(self, D: Array, E: Array) -> None:
        """Factor for these diagonals; raises `LinAlgError`."""
        i = np.arange(len(self.K))
        self.K[i, i] = np.concatenate([self.diagonal + D, -E])
        # Rows of size one: pivots are chosen by size.
        self.root = 1.0 / np.sqrt(np.abs(self.K).max(axis=1))
        M = self.K * self.root * self.root[:, None]
        self.factors, self.pivots, info = dsytrf(M.T, lower=1, overwrite_a=1)
        if info:
            raise np.linalg.LinAlgError(f"pivot {info} vanishes")

    def solve(self, r: Array, s: Array) -> tuple[Array, Array]:
        """Solve for (u, v), refined."""
        right = np.concatenate([r, s])
        w = kept = self._once(right)
        best = np.inf
        for _ in range(REFINEMENT + 1):
            left = right - self.K @ w
            error = float(np.abs(left).max())
            if not error < 0.5 * best:
                break
            kept, best = w, error
            w = w + self._once(left)
        size = float(np.abs(right).max())
        self.accuracy = best / size if size else 0.0
        return kept[: self.n], kept[self.n :]

    def _once(self, r: Array) -> Array:
        return self.root * dsytrs(self.factors, self.pivots, self.root * r, lower=1)[0]


System = SparseSystem | DenseSystem | IndefiniteSystem


def kkt_system(program: Program, solver: str = "auto", safe: bool = False) -> System:
    """The system of a program, by the storage of its matrices."""
    if program.is_sparse:
        return SparseSystem(program, solver)
    if safe and program.xp is np:
        return IndefiniteSystem(program)
    return DenseSystem(program)
