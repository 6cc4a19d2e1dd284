"""Conjugate gradients preconditioned by smoothed aggregation, for large problems in 3-D."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from skfem_adini.errors import NotConverged
from skfem_adini.ground.errors import optional

Array = NDArray[np.float64]
Indices = NDArray[np.integer]


@dataclass(frozen=True)
class NearNullSpace:
    """Vectors that a matrix nearly annihilates, and the vertex that each unknown belongs to.

    Attributes
    ----------
    modes
        One vector a column, shape (unknowns, modes).
    vertex
        Vertex of each unknown, shape (unknowns,).

    Examples
    --------
    >>> import numpy as np
    >>> from skfem import Basis, MeshQuad
    >>> from skfem.models.poisson import laplace
    >>> from skfem_adini import ElementQuadAdini, near_null_space
    >>> basis = Basis(MeshQuad().refined(2), ElementQuadAdini())
    >>> space = near_null_space(basis)
    >>> bool(np.abs(laplace.assemble(basis) @ space.modes[:, 0]).max() < 1e-12)  # the constants
    True
    """

    modes: Array
    vertex: Indices

    def __repr__(self) -> str:
        return "NearNullSpace({1} modes of {0} unknowns)".format(*self.modes.shape)


class Multigrid:
    """Solver of A x = b for a symmetric positive definite matrix with unit diagonal.
    The unknowns of a vertex are aggregated and smoothed as one block; those that a vertex lacks
    are replaced by decoupled ones. Nothing is random: equal input gives equal output."""

    def __init__(self, A: Any, near_null: NearNullSpace, tol: float, max_iterations: int) -> None:
        """Aggregate A (n, n), scaled like its near-null space; `max_iterations` over all restarts.
        |b - A x| <= tol |b| must hold up to the rounding of A x: 2.2e-16 times the norm of
        abs(A) abs(x), at most 1e-6 |b|. It dominates in slender bodies."""
        self._given = A, near_null, tol, max_iterations
        self._A, self._tol, self._most = A, tol, max_iterations
        self.iterations = 0
        self._place, block, vertices = _slots(near_null.vertex)
        size = block * vertices
        # Slots without an unknown get a one on the diagonal and zeros in the modes.
        filled = sparse.csr_array(
            (np.ones(len(self._place)), self._place, np.arange(len(self._place) + 1)),
            shape=(len(self._place), size),
        )
        empty = np.ones(size)
        empty[self._place] = 0.0
        padded = filled.T @ A @ filled + sparse.diags_array(empty)
        pyamg = optional("pyamg", "solver='amg' needs pyamg: pip install 'skfem-adini[amg]'")
        with warnings.catch_warnings():
            # There are six rigid motions for twelve dofs of a vertex; the smoother reduces errors
            # in the others.
            warnings.filterwarnings("ignore", message="Having less target vectors")
            smoother = ("block_gauss_seidel", {"sweep": "symmetric"})
            hierarchy = pyamg.smoothed_aggregation_solver(
                sparse.bsr_matrix(padded, blocksize=(block, block)),
                filled.T @ near_null.modes,
                smooth=("jacobi", {"omega": 4 / 3, "weighting": "local"}),
                improve_candidates=None,
                presmoother=smoother,
                postsmoother=smoother,
                max_coarse=20,  # most blocks of a matrix that is solved as a dense one
            )
        cycle = hierarchy.aspreconditioner()

        def precondition(r: Array) -> Array:
            full = np.zeros(size)
            full[self._place] = np.ravel(r)
            return np.asarray(cycle @ full)[self._place]

        self._inverse = LinearOperator(A.shape, matvec=precondition, dtype=np.float64)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the arguments of a copy, which is the same because nothing is random."""
        return type(self), self._given

    def solve(self, b: Array) -> Array:
        """Return the solution for one load (n,) or several (n, loads).
        `iterations` is then the largest number for one load."""
        loads = b[:, None] if b.ndim == 1 else b
        columns = [self._solve_one(np.ascontiguousarray(column)) for column in loads.T]
        # Assigned once: threads that share the object never see an intermediate number.
        self.iterations = max((steps for _, steps in columns), default=0)
        return np.array([x for x, _ in columns]).reshape(loads.shape[::-1]).T.reshape(b.shape)

    def _solve_one(self, b: Array) -> tuple[Array, int]:
        x, bound, steps = np.zeros_like(b), self._tol * np.linalg.norm(b), 0

        def count(_: Array) -> None:
            nonlocal steps
            steps += 1

        residual = b
        # The residual that the iteration updates drifts from the true one: restart from the latter,
        # with half the bound to leave room for the drift.
        for _ in range(3):
            correction, _info = cg(
                self._A, residual, rtol=0.0, atol=0.5 * bound, maxiter=self._most - steps,
                M=self._inverse, callback=count,
            )  # fmt: skip
            x = x + correction
            residual = b - self._A @ x
            if np.linalg.norm(residual) <= bound or steps >= self._most:
                break
        reached = np.linalg.norm(residual)
        # Without supports x may be so large that any residual would count as rounding.
        rounding = min(self._rounding(x), 1e-6 * float(np.linalg.norm(b)))
        if not reached <= bound + rounding:
            raise NotConverged(
                f"multigrid: relative residual {reached / np.linalg.norm(b):.1e} after {steps} "
                f"iterations, asked for {self._tol:.0e}; is A definite and near_null that of its "
                "unknowns? Raise tol, or use a direct solver (solver='auto')"
            )
        return x, steps

    def _rounding(self, x: Array) -> float:
        """Return the norm of b - A x due to rounding, also present with a direct solver."""
        return float(np.finfo(float).eps * np.linalg.norm(abs(self._A) @ np.abs(x)))


def _slots(vertex: Indices) -> tuple[Indices, int, int]:
    """Return a slot for each unknown, the size of a block and the number of blocks.
    The slots of the unknowns of a vertex are consecutive, in one block."""
    _, block_of, count = np.unique(vertex, return_inverse=True, return_counts=True)
    order = np.argsort(block_of, kind="stable")
    first = np.cumsum(count) - count
    rank = np.empty(len(vertex), dtype=np.int64)
    rank[order] = np.arange(len(vertex)) - np.repeat(first, count)
    block = int(count.max())
    return block_of * block + rank, block, len(count)
