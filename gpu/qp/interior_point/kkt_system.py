r"""Linear systems of the interior point and of the polish.

.. math:: \begin{pmatrix} P + D & C^T \\ C & -E \end{pmatrix}
          \begin{pmatrix} u \\ v \end{pmatrix} = \begin{pmatrix} r \\ s \end{pmatrix}

with positive diagonal D and E that change from step to step: symmetric quasidefinite. A sparse one
is factored as it stands. A dense one is condensed: inequality rows go into
:math:`H = P + D + G^TE_G^{-1}G`, equality rows into the Schur complement
:math:`AH^{-1}A^T + E_A`, both by Cholesky's method, which runs at the speed of a matrix product on
a device. Refinement against the matrix itself follows in both cases; where pivots of the sparse
factor were perturbed too much for it, GMRES.

References
----------
.. [1] M. Arioli, I. S. Duff, S. Gratton, S. Pralet, "A note on GMRES preconditioned by a perturbed
   LDL' decomposition with static pivoting", SIAM J. Sci. Comput. 29 (2007) 2024-2044.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg.lapack import dsytrf, dsytrs

from gpu.arrays.dense import cholesky, cholesky_solve, lower_solve
from gpu.arrays.sparse_factor import quasidefinite
from gpu.qp.data.standard_qp import Array, StandardQP, largest


class _Limits(NamedTuple):  # limits of refinement
    refinements: int = 3  # most; they end when a step does not halve the residual
    fine: float = 1e-12  # relative residual at which refinement ends, unless less is needed
    poor: float = 1e-9  # relative residual above which refinement has failed
    directions: int = 20  # of GMRES, all kept: one for each perturbed pivot
    dense: int = 600  # most unknowns and rows for symmetric pivoting, if need be
    pivoted: int = 30_000  # the same for a sparse factor with pivots by size: it fills more


LIMITS = _Limits()


class SparseSystem:
    """The system of sparse P and C."""

    def __init__(self, program: StandardQP, solver: str = "auto") -> None:
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

    def solve(
        self, r: Array, s: Array, thorough: bool = False, fine: float = LIMITS.fine
    ) -> tuple[Array, Array]:
        """Solve for (u, v), refined until the residual is `fine`; if `thorough`, by GMRES where
        refinement fails."""
        right = np.concatenate([r, s])
        size = float(np.abs(right).max())
        w, best = self.factors.solve(right), np.inf
        kept = w
        for _ in range(LIMITS.refinements + 1):
            left = right - self._product(w)
            error = float(np.abs(left).max())
            if not error < 0.5 * best:
                break
            kept, best = w, error
            if error <= fine * size:
                break
            w = w + self.factors.solve(left)
        if thorough and best > LIMITS.poor * size and np.isfinite(kept).all():
            w = self._minimal_residual(right, kept)
            error = float(np.abs(right - self._product(w)).max())
            if error < best:
                kept, best = w, error
        self.accuracy = best / size if size else 0.0
        return kept[: self.n], kept[self.n :]

    def _product(self, w: Array) -> Array:
        u, v = w[: self.n], w[self.n :]
        return np.concatenate([self.P @ u + self.D * u + self.Ct @ v, self.C @ u - self.E * v])

    def _minimal_residual(self, right: Array, w: Array) -> Array:
        """GMRES from w on, preconditioned by factors with perturbed pivots [1]_. Refinement
        diverges if a few pivots were perturbed; for GMRES they are a few directions.
        """
        basis = [self.factors.solve(right - self._product(w))]
        length = float(np.linalg.norm(basis[0]))
        if not 0.0 < length < np.inf:
            return w
        basis[0] /= length
        H = np.zeros((LIMITS.directions + 1, LIMITS.directions))
        goal = np.zeros(LIMITS.directions + 1)
        goal[0] = length
        for j in range(LIMITS.directions):
            q = self.factors.solve(self._product(basis[j]))
            for _ in range(2):
                for i, b in enumerate(basis):
                    h = float(b @ q)
                    H[i, j] += h
                    q -= h * b
            H[j + 1, j] = np.linalg.norm(q)
            if not np.isfinite(H[: j + 2, j]).all():
                return w
            y, *_ = np.linalg.lstsq(H[: j + 2, : j + 1], goal[: j + 2])
            rest = np.linalg.norm(goal[: j + 2] - H[: j + 2, : j + 1] @ y)
            if rest <= 1e-12 * length or not H[j + 1, j]:
                break
            basis.append(q / H[j + 1, j])
        change: Array = sum(yi * b for yi, b in zip(y, basis, strict=False))
        return w + change


class DenseSystem:
    """The system of dense P and C, of either namespace."""

    def __init__(self, program: StandardQP) -> None:
        self.program, self.xp = program, program.xp
        xp = self.xp
        self.eq = xp.flatnonzero(program.equality)
        self.ineq = xp.flatnonzero(~program.equality)
        self.A, self.G = program.C[self.eq], program.C[self.ineq]
        self.weighted = xp.empty_like(self.G)  # memory that is there is faster than a new one

    def factor(self, D: Array, E: Array) -> None:
        """Factor for these diagonals; raises `LinAlgError`."""
        self.D, self.E = D, E
        H = self.program.P.copy()
        if self.ineq.size:
            root = 1.0 / self.xp.sqrt(E[self.ineq])
            weighted = self.xp.multiply(self.G, root[:, None], out=self.weighted)
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

    def solve(self, r: Array, s: Array, fine: float = LIMITS.fine) -> tuple[Array, Array]:
        """Solve for (u, v), refined."""
        p = self.program
        size = max(float(abs(r).max()), float(abs(s).max() if s.size else 0.0))
        u, v = self._once(r, s)
        kept, best = (u, v), np.inf
        for _ in range(LIMITS.refinements + 1):
            top = r - p.P @ u - self.D * u - p.C.T @ v
            low = s - p.C @ u + self.E * v
            error = largest(float(abs(top).max()), float(abs(low).max() if low.size else 0.0))
            if not error < 0.5 * best:
                break
            kept, best = (u, v), error
            if error <= fine * size:
                break
            du, dv = self._once(top, low)
            u, v = u + du, v + dv
        self.accuracy = best / size if size else 0.0
        return kept


class IndefiniteSystem:
    """The full system on the host, factored as it stands with symmetric pivoting. Slower than the
    condensed one, and safe if entries of D and E differ by many orders.
    """

    def __init__(self, program: StandardQP) -> None:
        n, m = program.q.size, program.row_low.size
        P, C = program.P, program.C
        if program.is_sparse:
            P, C = P.toarray(), C.toarray()
        self.n, self.K = n, np.zeros((n + m, n + m))
        self.K[:n, :n] = P
        self.K[n:, :n] = C
        self.K[:n, n:] = C.T
        self.diagonal = P.diagonal()

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

    def solve(self, r: Array, s: Array, fine: float = LIMITS.fine) -> tuple[Array, Array]:
        """Solve for (u, v), refined."""
        right = np.concatenate([r, s])
        size, best = float(np.abs(right).max()), np.inf
        w = kept = self._once(right)
        for _ in range(LIMITS.refinements + 1):
            left = right - self.K @ w
            error = float(np.abs(left).max())
            if not error < 0.5 * best:
                break
            kept, best = w, error
            if error <= fine * size:
                break
            w = w + self._once(left)
        self.accuracy = best / size if size else 0.0
        return kept[: self.n], kept[self.n :]

    def _once(self, r: Array) -> Array:
        return self.root * dsytrs(self.factors, self.pivots, self.root * r, lower=1)[0]


System = SparseSystem | DenseSystem | IndefiniteSystem


def kkt_system(program: StandardQP, solver: str = "auto") -> System:
    """The system of a program, by the storage of its matrices."""
    if program.is_sparse:
        return SparseSystem(program, solver)
    return DenseSystem(program)


def safe_system(program: StandardQP) -> System | None:
    """The slower, safer system if that of `kkt_system` failed, with pivots chosen by size; None if
    it is too large."""
    size = program.q.size + program.row_low.size
    if program.xp is np and (size <= LIMITS.dense or not program.is_sparse):
        return IndefiniteSystem(program)
    if program.is_sparse and size <= LIMITS.pivoted:
        return SparseSystem(program, "pivoted")
    return None
