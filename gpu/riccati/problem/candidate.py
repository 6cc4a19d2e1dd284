"""The result of a method before certification: a gain and a value, dense or of low rank."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple


class Found(NamedTuple):
    """The result of a method of `gpu.lqr`, before certification."""

    gain: Any  # shape (m, n)
    value: Any  # shape (n, n), or a LowRankValue, or None
    info: dict[str, Any]  # by method: "iterations", "solves", "residual", "path", ...
    verdict: Any = None  # of a dense solution: recomputed residual and closed loop
    proved: bool = False  # stable, without computing poles


@dataclass(frozen=True)
class LowRankValue:
    """``S = Z M Z^T``, formed only on request.

    Attributes
    ----------
    Z : array, shape (n, r)
    M : array, shape (r, r)
        Symmetric.

    References
    ----------
    P. Benner, J.-R. Li and T. Penzl, Numerical solution of large-scale Lyapunov equations, Riccati
    equations, and linear-quadratic optimal control problems, Numer. Linear Algebra Appl. 15 (2008),
    755-777.

    Examples
    --------
    >>> import numpy as np
    >>> from gpu.riccati.problem.candidate import LowRankValue
    >>> S = LowRankValue(np.ones((3, 1)), np.array([[2.0]]))
    >>> S @ np.array([1.0, 0.0, 0.0])
    array([2., 2., 2.])
    """

    Z: Any
    M: Any

    def __repr__(self) -> str:
        return f"LowRankValue(shape {self.shape}, rank {self.rank})"

    @property
    def shape(self) -> tuple[int, int]:
        """(n, n)."""
        return (len(self.Z), len(self.Z))

    @property
    def rank(self) -> int:
        """Columns of Z."""
        return int(self.Z.shape[1])

    @property
    def T(self) -> LowRankValue:
        """The same: S is symmetric."""
        return self

    def __matmul__(self, x: Any) -> Any:
        return self.Z @ (self.M @ (self.Z.T @ x))

    def diagonal(self) -> Any:
        """The diagonal of S, shape (n,).

        Returns
        -------
        array, shape (n,)
        """
        return ((self.Z @ self.M) * self.Z).sum(axis=1)

    def toarray(self) -> Any:
        """S with all its entries.

        Returns
        -------
        array, shape (n, n)
        """
        return self.Z @ self.M @ self.Z.T
