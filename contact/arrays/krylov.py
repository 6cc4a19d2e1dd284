"""Krylov methods on grid arrays of NumPy or CuPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.ground.arrays import host, namespace

Operator = Callable[[Any], Any]


def gmres(
    product: Operator, right: Any, precondition: Operator, tol: float, most: int, restart: int = 40
) -> tuple[Any, int]:
    r"""Solve A x = b by restarted GMRES with right preconditioner: A M^-1 y = b, x = M^-1 y.
    Returns x with :math:`|b - A x| \le` tol |b|, or the best after `most` products, and their
    number. Y. Saad and M. H. Schultz, SIAM J. Sci. Stat. Comput. 7 (1986) 856."""
    xp = namespace(right)
    x, residual, used = xp.zeros_like(right), right, 0
    goal = tol * float(xp.linalg.norm(right))
    while used < most:
        size = float(xp.linalg.norm(residual))
        if size <= goal or size == 0.0:
            break
        basis = _Basis(residual / size)
        H = np.zeros((restart + 1, restart))
        least: NDArray[np.float64] = np.zeros(0)
        for j in range(min(restart, most - used)):
            w, H[: j + 2, j] = basis.orthogonal(product(precondition(basis[j])))
            used += 1
            e = np.zeros(j + 2)
            e[0] = size
            least = np.asarray(np.linalg.lstsq(H[: j + 2, : j + 1], e, rcond=None)[0], dtype=float)
            left = float(np.linalg.norm(e - H[: j + 2, : j + 1] @ least))
            if left <= goal or H[j + 1, j] <= 1e-14 * np.linalg.norm(H[: j + 2, j]):
                break
            basis.append(w / H[j + 1, j])
        step = basis.combined(least)
        x = x + precondition(step)
        residual = right - product(x)
        used += 1
    return x, used


class _Basis:
    """Orthonormal vectors, in blocks that are allocated when needed."""

    rows = 8  # vectors per block, multiplied at once

    def __init__(self, first: Any) -> None:
        self._xp, self._size = namespace(first), 0
        self._blocks: list[Any] = []
        self.append(first)

    def __getitem__(self, k: int) -> Any:
        return self._blocks[k // self.rows][k % self.rows]

    def append(self, vector: Any) -> None:
        if self._size % self.rows == 0:
            self._blocks.append(self._xp.zeros((self.rows, vector.size)))
        self._blocks[-1][self._size % self.rows] = vector
        self._size += 1

    def orthogonal(self, w: Any) -> tuple[Any, Any]:
        """w orthogonalised to the vectors; on the host the coefficients and the norm of the
        rest."""
        parts = 0.0
        for _ in range(2):  # twice is enough (Giraud, Langou and Rozloznik 2005)
            along = [block @ w for block in self._blocks]
            for block, part in zip(self._blocks, along, strict=True):
                w = w - part @ block
            parts = parts + self._xp.concatenate(along)[: self._size]
        return w, host(self._xp.append(parts, self._xp.linalg.norm(w)))

    def combined(self, weights: NDArray[np.float64]) -> Any:
        """The sum of weights times the first vectors."""
        padded = np.zeros(self.rows * len(self._blocks))
        padded[: weights.size] = weights
        parts = self._xp.asarray(padded).reshape(-1, self.rows)
        return sum(part @ block for part, block in zip(parts, self._blocks, strict=True))
