"""The result of a linear-quadratic problem, with its certificate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gpu.errors import GpuError, InputError, NotConverged
from gpu.riccati.methods import newton_kleinman
from gpu.riccati.problem.candidate import Found, LowRankValue
from gpu.riccati.problem.lqr_problem import LQRProblem, cost_of
from gpu.riccati.problem.units import in_moderate_units, power_of_two
from gpu.riccati.proof.closed_loop import LIMITS as LOOP
from gpu.riccati.proof.closed_loop import dense_loop, nearest_poles, unstable_pole
from gpu.riccati.proof.refinement import judge
from skfem_adini.ground.arrays import namespace


@dataclass(frozen=True)
class LQRResult:
    r"""The optimal feedback :math:`u = -K x`; unpacks as ``K, S, E``.

    `lqr` and `lqe` return it.

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
        Whether the poles lie left of the imaginary axis by more than round-off: shown for every
        pole, or proved by `bound`; where `bound` is NaN, shown for the poles in E only.
    abscissa : float
        The largest real part of a pole in E, recomputed from A, B and K; `bound` where E is empty.
    bound : float
        No pole lies right of it: the abscissa where all poles are known, else proved by
        Lyapunov's inequality with bounds of all round-off; 0 where stability is proved without a
        rate. NaN where nothing is proved: for large sparse problems that are not symmetric, or
        whose weight is no multiple of the matrix E.
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
        How many systems with A, a shifted A or their transposes were solved.
    info : dict
        Further numbers, by method.
    problem : LQRProblem
        What was solved; `cost` and `refined` need it. A copied or pickled result has None here if
        A or Q is a LinearOperator, whose functions cannot be copied.

    Examples
    --------
    >>> from gpu import lqr
    >>> result = lqr([[1.0]], [[1.0]], [[3.0]], 1.0)
    >>> result.K.tolist(), result.stable, result.cost([2.0])  # S = 3, and 3 * 2**2
    ([[3.0]], True, 12.0)
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

        Parameters
        ----------
        x0 : array, shape (n,)

        Returns
        -------
        float
            The least value of the integral that `lqr` minimises.

        Raises
        ------
        InputError
            The method gave a gain without a value, or `x0` is no vector of n numbers.
        """
        if self.S is None:
            raise InputError("S is unknown: the method gave a gain alone")
        return cost_of(self._whole(), self.S, x0)

    def refined(self, *, steps: int = 200, tol: float = 1e-12) -> LQRResult:
        """The optimal gain by Newton-Kleinman, starting from this or another stabilising gain.

        Parameters
        ----------
        steps : int
            Most Newton steps.
        tol : float
            Relative change of the gain at which they end.

        Returns
        -------
        LQRResult

        Raises
        ------
        gpu.NotSupported
            A is not dense, and too large to be stored densely.
        gpu.RiccatiError
            No gain stabilises.
        """
        start = self.K if self.stable else None
        problem = self._whole()
        moderate = in_moderate_units(problem)
        if moderate is not problem and start is not None:
            start = power_of_two(start, -moderate.units.gain)
        found = newton_kleinman.solve(moderate, start=start, steps=steps, tol=tol)
        return in_given_units(certified(moderate, found, "newton"), problem)


def certified(problem: LQRProblem, found: Found, method: str) -> LQRResult:
    """Recompute poles and residual from the data and assemble the result."""
    info = dict(found.info)
    residual = float(info.pop("residual", np.nan))
    xp, error = problem.xp, np.nan
    if found.verdict is not None or (problem.dense and isinstance(found.value, xp.ndarray)):
        verdict = found.verdict or judge(problem, found.value)
        residual, error = verdict.residual, verdict.error
        loop = verdict.loop
    elif problem.dense or problem.n <= (LOOP.proved if found.proved else LOOP.dense):
        loop = dense_loop(problem.entries(), found.gain)
    else:
        loop = None
    if loop is None:
        poles, stable = nearest(problem, found.gain, found.proved)
        abscissa, bound = float(poles[0].real) if len(poles) else np.nan, np.nan
        if found.proved and stable:
            bound = 0.0
    else:
        poles, stable, abscissa, bound = loop.poles, loop.is_stable(), loop.abscissa, loop.bound
        info["pole_tolerance"] = loop.tolerance
    return LQRResult(
        K=found.gain,
        S=found.value,
        E=poles,
        stable=bool(stable),
        abscissa=abscissa,
        bound=bound,
        residual=residual,
        error=error,
        method=method,
        iterations=int(info.pop("iterations", 0)),
        solves=int(info.pop("solves", 0)),
        info=info,
        problem=problem,
    )


def in_given_units(result: LQRResult, problem: LQRProblem) -> LQRResult:
    """The result in the original units of the problem, from that in the units of
    `in_moderate_units`. Raises `NotConverged` if K, S or the poles are out of the range of double
    precision."""
    moderate = result.problem
    if moderate is problem:
        return result
    units, info = moderate.units, dict(result.info)
    K, S = power_of_two(result.K, units.gain), result.S
    if isinstance(S, LowRankValue):
        S = replace(S, M=power_of_two(S.M, units.value))
    elif S is not None:
        S = power_of_two(S, units.value)
    E = power_of_two(result.E, units.rate)
    abscissa, bound = (power_of_two(float(v), units.rate) for v in (result.abscissa, result.bound))
    if "pole_tolerance" in info:
        info["pole_tolerance"] = power_of_two(float(info["pole_tolerance"]), units.rate)
    largest = [K, E, S.M if isinstance(S, LowRankValue) else S]
    fits = all(bool(namespace(M).isfinite(M).all()) for M in largest if M is not None)
    if fits and isinstance(S, moderate.xp.ndarray):
        # The least numbers, below 2^-1000, lose digits.
        weighed = bool((problem.weight.apply(problem.xp.eye(problem.n)) != 0.0).any())
        moved = moderate.N is None and bool((moderate.B.T @ result.S != 0.0).any())
        for M, counts in ((result.S, weighed), (result.K, moved)):
            fits = fits and not (counts and float(abs(M).max()) < 2.0**-1000)
    if fits and result.stable:
        rounded = power_of_two(K, -units.gain)
        same = bool((rounded == result.K).all())
        fits = abscissa < 0.0 and (same or dense_loop(moderate, rounded).is_stable())
    if not fits:
        raise NotConverged(
            "the gain, the cost or the poles are beyond the range of double precision: measure "
            "time, states, inputs or costs in other units"
        )
    return replace(
        result, K=K, S=S, E=E, abscissa=abscissa, bound=bound, info=info, problem=problem
    )


def nearest(problem: LQRProblem, K: Any, proved: bool) -> tuple[np.ndarray, bool]:
    """The poles nearest to zero, with one right of the axis if found, and whether all are left."""
    try:
        poles = nearest_poles(problem.state, problem.B, K)
    except GpuError:
        return np.zeros(0, dtype=complex), proved
    stable = bool(poles[0].real < 0.0)
    if stable and not proved:
        other = unstable_pole(problem.state, problem.B, K, float(np.abs(poles).min()))
        if other is not None:
            poles, stable = np.concatenate([[other], poles]), False
    return poles, stable
