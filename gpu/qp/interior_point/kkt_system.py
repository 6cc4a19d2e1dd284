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

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg.lapack import dsytrf, dsytrs

from gpu.arrays.dense import add_gram, cholesky, cholesky_solve, lower_solve
from gpu.arrays.sparse_factor import quasidefinite
from gpu.qp.data.standard_qp import Array, StandardQP


class _Limits(NamedTuple):  # limits of refinement
    refinements: int = 3  # most; they end when a step does not halve the residual
    fine: float = 1e-12  # relative residual at which refinement ends, unless less is needed
    poor: float = 1e-9  # relative residual above which refinement has failed
    directions: int = 20  # of GMRES, all kept: one for each perturbed pivot
    dense: int = 600  # most unknowns and rows for symmetric pivoting, if need be
    single: int = 200  # least unknowns for which factors in single precision are tried
    digits: float = 1e7  # most largest diagonal entry over that without rows, for the same
    few: float = 1e-3  # relative residual that is asked of them
    nothing: float = 1e15  # entries of E from which on rows weigh nothing in the condensed system
    pivoted: int = 30_000  # the same for a sparse factor with pivots by size: it fills more


LIMITS = _Limits()


class System:
    """Refinement against the matrix, for any way to factor it."""

    n: int
    xp: Any = np
    accuracy = 0.0  # relative residual of the last solution that was looked at
    exact = False  # whether it needed no refinement with the present factors
    rough = 0.0  # least relative residual that the present factors are asked for

    def factor(self, D: Array, E: Array, rough: bool = False) -> None:
        """Factor for these diagonals, if `rough` perhaps to a few digits only; raises
        `LinAlgError`."""
        raise NotImplementedError

    def _once(self, right: Array) -> Array:
        """Solve by the factors."""
        raise NotImplementedError

    def _product(self, w: Array) -> Array:
        """The matrix times w."""
        raise NotImplementedError

    def solve(
        self,
        r: Array,
        s: Array,
        fine: float = LIMITS.fine,
        thorough: bool = False,
        trusted: bool = False,
    ) -> tuple[Array, Array]:
        """Solve for (u, v), refined until the residual is `fine`; if `thorough`, by GMRES where
        refinement fails; if `trusted`, without a look at the residual where the last was `exact`.
        """
        right = self.xp.concatenate([r, s])
        first = w = kept = self._once(right)
        if trusted and self.exact:
            return w[: self.n], w[self.n :]
        size, best, fine = float(abs(right).max()), np.inf, max(fine, self.rough)
        for _ in range(LIMITS.refinements + 1):
            left = right - self._product(w)
            error = float(abs(left).max())
            if not error < 0.5 * best:
                break
            kept, best = w, error
            if error <= fine * size:
                break
            w = w + self._once(left)
        if thorough and best > LIMITS.poor * size and np.isfinite(kept).all():
            w = self._minimal_residual(right, kept)
            error = float(np.abs(right - self._product(w)).max())
            if error < best:
                kept, best = w, error
        if self.rough and not best <= fine * size:
            self._sharpen()
            return self.solve(r, s, fine, thorough)
        self.exact = kept is first and best <= fine * size
        self.accuracy = best / size if size and not self.rough else 0.0
        return kept[: self.n], kept[self.n :]

    def _sharpen(self) -> None:
        """Factor again to all digits."""
        raise NotImplementedError

    def _minimal_residual(self, right: Array, w: Array) -> Array:
        """GMRES from w on, preconditioned by factors with perturbed pivots [1]_. Refinement
        diverges if a few pivots were perturbed; for GMRES they are a few directions.
        """
        basis = [self._once(right - self._product(w))]
        length = float(np.linalg.norm(basis[0]))
        if not 0.0 < length < np.inf:
            return w
        basis[0] /= length
        H = np.zeros((LIMITS.directions + 1, LIMITS.directions))
        goal = np.zeros(LIMITS.directions + 1)
        goal[0] = length
        for j in range(LIMITS.directions):
            q = self._once(self._product(basis[j]))
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


class SparseSystem(System):
    """The system of sparse P and C."""

    def __init__(self, program: StandardQP, solver: str = "auto") -> None:
        P, C = sparse.triu(program.P, 1, format="csc"), sparse.csr_array(program.C)
        self.n, m = program.q.size, program.row_low.size
        parts = (P.data, C.data), (P.indices, C.indices), (P.indptr, P.nnz + C.indptr[1:])
        data, indices, indptr = (np.concatenate(part) for part in parts)
        self.upper = sparse.csc_array((data, indices, indptr), shape=(self.n + m, self.n + m))
        self.lower = self.upper.T
        self.own = program.P.diagonal()
        self.factors = quasidefinite(self.upper, solver)

    def factor(self, D: Array, E: Array, rough: bool = False) -> None:
        """See `System`."""
        self.exact, self.diagonal = False, np.concatenate([self.own + D, -E])
        self.factors.factor(self.diagonal)

    def _once(self, right: Array) -> Array:
        return self.factors.solve(right)

    def _product(self, w: Array) -> Array:
        return self.upper @ w + self.lower @ w + self.diagonal * w


class DenseSystem(System):
    """The system of dense P and C, of either namespace."""

    def __init__(self, program: StandardQP) -> None:
        self.program, self.xp, self.n = program, program.xp, program.q.size
        xp = self.xp
        self.eq = xp.flatnonzero(program.equality)
        self.ineq = xp.flatnonzero(~program.equality)
        self.A, self.G = program.C[self.eq], program.C[self.ineq]
        self.weighted = xp.empty_like(self.G)  # memory that is there is faster than a new one
        self.H = xp.empty_like(program.P)
        many = LIMITS.single <= self.n <= self.ineq.size and not self.eq.size
        self.half = [self.G.astype(np.float32), None] if many and xp is np else []

    def factor(self, D: Array, E: Array, rough: bool = False) -> None:
        """See `System`."""
        self.D, self.E, self.exact, self.rough = D, E, False, 0.0
        if rough and self.half and self._rough():
            return
        xp, H, weighted = self.xp, self.H, self.weighted
        H[...] = self.program.P
        if self.ineq.size:
            e = E[self.ineq]
            used = xp.flatnonzero(e < LIMITS.nothing)  # others weigh nothing beside the rounding
            rows = self.G if used.size == e.size else self.G[used]
            if used.size:
                root = 1.0 / xp.sqrt(e[used])
                H = add_gram(H, xp.multiply(rows, root[:, None], out=weighted[: used.size]))
        i = xp.arange(self.n)
        H[i, i] += D
        self.L = cholesky(H)
        if self.eq.size:
            self.X = lower_solve(self.L, self.A.T)
            S = self.X.T @ self.X
            j = xp.arange(len(S))
            S[j, j] += E[self.eq]
            self.S = cholesky(S)

    def _rough(self) -> bool:
        """Factor in single precision, at half the price, while that leaves a few digits."""
        G, weighted = self.half
        root = (1.0 / np.sqrt(self.E)).astype(np.float32)
        self.half[1] = np.multiply(G, root[:, None], out=weighted)
        H = add_gram(self.program.P.astype(np.float32), self.half[1])
        i, P = np.arange(self.n), self.program.P
        H[i, i] += self.D
        if H[i, i].max() <= LIMITS.digits * (P[i, i] + self.D).min():
            with suppress(np.linalg.LinAlgError):
                self.L, self.rough = cholesky(H), LIMITS.few
                return True
        self.half = []  # later ones are worse
        return False

    def _sharpen(self) -> None:
        """Factor in double precision, from now on."""
        self.half = []
        self.factor(self.D, self.E)

    def _once(self, right: Array) -> Array:
        r, s = right[: self.n], right[self.n :]
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
        return self.xp.concatenate([u, v])

    def _product(self, w: Array) -> Array:
        p, u, v = self.program, w[: self.n], w[self.n :]
        top = p.P @ u + self.D * u + p.C.T @ v
        return self.xp.concatenate([top, p.C @ u - self.E * v])


class IndefiniteSystem(System):
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

    def factor(self, D: Array, E: Array, rough: bool = False) -> None:
        """See `System`."""
        self.exact = False
        i = np.arange(len(self.K))
        self.K[i, i] = np.concatenate([self.diagonal + D, -E])
        # Rows of size one: pivots are chosen by size.
        self.root = 1.0 / np.sqrt(np.abs(self.K).max(axis=1))
        M = self.K * self.root * self.root[:, None]
        self.factors, self.pivots, info = dsytrf(M.T, lower=1, overwrite_a=1)
        if info:
            raise np.linalg.LinAlgError(f"pivot {info} vanishes")

    def _once(self, right: Array) -> Array:
        return self.root * dsytrs(self.factors, self.pivots, self.root * right, lower=1)[0]

    def _product(self, w: Array) -> Array:
        return self.K @ w


def kkt_system(program: StandardQP) -> System:
    """The system of a program, by the storage of its matrices."""
    return SparseSystem(program) if program.is_sparse else DenseSystem(program)


def safe_system(program: StandardQP) -> System | None:
    """The slower, safer system if that of `kkt_system` failed, with pivots chosen by size; None if
    it is too large."""
    size = program.q.size + program.row_low.size
    if program.xp is np and (size <= LIMITS.dense or not program.is_sparse):
        return IndefiniteSystem(program)
    if program.is_sparse and size <= LIMITS.pivoted:
        return SparseSystem(program, "pivoted")
    return None
