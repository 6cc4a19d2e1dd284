"""The answer of a linear-quadratic problem, with what proves it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from gpu.arrays.namespace import array_module
from gpu.errors import InputError


class Found(NamedTuple):
    """What a method hands to `gpu.lqr`.

    Attributes
    ----------
    gain : array, shape (m, n)
    value : array, shape (n, n), LowRankValue or None
    info : dict
        ``iterations``, ``solves``, ``residual``, ``path``, whatever the method has to tell.
    verdict : Verdict or None
        Of a dense solution: its recomputed residual and closed loop.
    proved : bool
        Whether the closed loop has been proved stable without its poles.
    """

    gain: Any
    value: Any
    info: dict[str, Any]
    verdict: Any = None
    proved: bool = False


@dataclass(frozen=True)
class LowRankValue:
    """``S = Z M Z^T``, never formed unless asked for.

    Attributes
    ----------
    Z : array, shape (n, r)
    M : array, shape (r, r)
        Symmetric.

    Examples
    --------
    >>> import numpy as np
    >>> from gpu.riccati.lqr_result import LowRankValue
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
        """The diagonal of S, shape (n,)."""
        return ((self.Z @ self.M) * self.Z).sum(axis=1)

    def toarray(self) -> Any:
        """S with all its entries."""
        return self.Z @ self.M @ self.Z.T


@dataclass(frozen=True)
class LQRResult:
    r"""The optimal feedback :math:`u = -K x`; unpacks as ``K, S, E``.

    Attributes
    ----------
    K : array, shape (m, n)
        The gain, where B lives.
    S : array, shape (n, n), LowRankValue or None
        The Riccati solution: :math:`x_0^T E^T S E x_0` is the cost from the state :math:`x_0`.
    E : numpy.ndarray of complex
        Poles of the closed loop, rightmost first: all of them up to 1500 states (600 where a
        proof of stability needs none), or where it is dense and symmetric; else those that
        converged of the 12 nearest to zero (6 from 100,000 states on), and none where they stand
        too close for that.
    stable : bool
        Whether every pole lies left of the imaginary axis beyond round-off: all poles were
        computed, or `bound` proves it. Where that is NaN only the poles of E are known to.
    abscissa : float
        The largest real part of a pole in E, recomputed from A, B and K; `bound` where E is empty.
    bound : float
        No pole lies right of it: the abscissa where all poles are known, else proved by
        Lyapunov's inequality with bounds of all round-off; 0 where stability is proved without a
        rate. NaN where nothing is: of large sparse problems that are not symmetric, or whose
        weight is no multiple of E.
    residual : float
        Of the Riccati equation with S, relative to the size of its terms, recomputed from the
        data; NaN where S is low-rank or unknown, and the method has no measure of its own.
    error : float
        Distance of S to the solution, relative, by Newton's next step with a residual in
        extended precision; computed where the residual is above 1e-9, as it is for the rounded
        solution itself where the terms of S A cancel. Elsewhere NaN.
    method : str
    iterations : int
    solves : int
        With A or a shifted A, and with transposes.
    info : dict
        What else the method tells.
    problem : LQRProblem
        What was solved. Of a LinearOperator it stays behind where the result is copied or
        pickled, for its functions cannot go along; `cost` and `refined` need it.
    """

    K: Any
    S: Any
    E: Any
    stable: bool
    abscissa: float
    residual: float
    method: str
    bound: float = float("nan")
    error: float = float("nan")
    iterations: int = 0
    solves: int = 0
    info: dict[str, Any] = field(default_factory=dict)
    problem: Any = field(default=None, repr=False)

    def __repr__(self) -> str:
        stable = "stable" if self.stable else "not stable"
        return (
            f"{type(self).__name__}({self.method!r}, K of shape {self.K.shape}, {stable}, abscissa "
            f"{self.abscissa:.6g}, residual {self.residual:.1e}, {self.iterations} iterations)"
        )

    def __getstate__(self) -> dict[str, Any]:
        given = () if self.problem is None else (self.problem.state.A, self.problem.weight.Q)
        operators = any(hasattr(M, "matvec") and not hasattr(M, "tocsr") for M in given)
        return self.__dict__ | ({"problem": None} if operators else {})

    def _whole(self) -> Any:
        if self.problem is None:
            raise InputError(
                "problem: it was not copied with the result, since it has operators; solve it again"
            )
        return self.problem

    def __iter__(self) -> Iterator[Any]:
        return iter((self.K, self.S, self.E))

    def __len__(self) -> int:
        return 3

    def __getitem__(self, place: int) -> Any:
        return (self.K, self.S, self.E)[place]

    @property
    def converged(self) -> bool:
        """Whether the gain stabilises and the residual, where known, is certified."""
        return self.stable and (not self.residual > 1e-9 or self.error <= 1e-12)

    def cost(self, x0: Any) -> float:
        """The optimal cost from the state ``x0``, shape (n,).

        Raises
        ------
        ValueError
            The method gave a gain without a value.
        """
        if self.S is None:
            raise ValueError("S is unknown: the method gave a gain alone")
        z = self._whole().state.mass(array_module(self.K).asarray(x0))
        return float(z @ (self.S @ z))

    def refined(self, *, steps: int = 200, tol: float = 1e-12) -> LQRResult:
        """The optimal gain by Newton-Kleinman from this one, or from one that stabilises.

        Raises
        ------
        gpu.NotSupported
            A is not dense, and too large to be stored densely.
        gpu.RiccatiError
            No gain stabilises.
        """
        from gpu.riccati.lqr import certified
        from gpu.riccati.methods.newton_kleinman import solve

        start = self.K if self.stable else None
        problem = self._whole()
        found = solve(problem, start=start, steps=steps, tol=tol)
        return certified(problem, found, "newton")
