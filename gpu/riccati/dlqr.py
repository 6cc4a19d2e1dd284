"""Discrete linear-quadratic regulators and Riccati equations: the public entries."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gpu.errors import InputError, NotConverged
from gpu.riccati.methods.doubling import regular, solve_discrete
from gpu.riccati.problem.candidate import Found
from gpu.riccati.problem.complex_data import complex_among, through_reals
from gpu.riccati.problem.lqr_problem import (
    NOT_SEMIDEFINITE,
    LQRProblem,
    check_cost,
    check_lqr,
    cost_of,
    numbers,
    semidefinite,
)
from gpu.riccati.problem.units import within_range
from gpu.riccati.proof.closed_loop import explain


@dataclass(frozen=True)
class DLQRResult:
    r"""The optimal feedback :math:`u_k = -K x_k`; unpacks as ``K, S, E``.

    `dlqr` returns it.

    Attributes
    ----------
    K : array, shape (m, n)
        The gain.
    S : array, shape (n, n)
        The Riccati solution: :math:`x_0^T E^T S E x_0` is the cost from the state :math:`x_0`.
    E : numpy.ndarray of complex, shape (n,)
        Poles of the closed loop, the outermost first.
    stable : bool
        Whether all lie inside of the unit circle by more than round-off.
    radius : float
        The spectral radius of the closed loop, recomputed from A, B and K.
    residual : float
        Of the equation with S, relative to the size of its terms, recomputed from the data.
    error : float
        Distance of S to the solution, relative, by Newton's next step.
    iterations : int
        Doublings.
    info : dict
        "path" (doubling, shifted doubling, qz) and "newton_steps".
    problem : LQRProblem
        What was solved.

    Examples
    --------
    >>> from gpu import dlqr
    >>> result = dlqr([[2.0]], [[1.0]], [[0.0]], 1.0)
    >>> result.K.tolist(), result.radius, result.cost([2.0])  # S = 3, and 3 * 2**2
    ([[1.5]], 0.5, 12.0)
    """

    K: Any
    S: Any
    E: np.ndarray
    stable: bool
    radius: float
    residual: float
    error: float
    iterations: int
    info: dict[str, Any] = field(default_factory=dict)
    problem: Any = field(default=None, repr=False)

    def __repr__(self) -> str:
        stable = "stable" if self.stable else "not stable"
        return (
            f"DLQRResult(K of shape {self.K.shape}, {stable}, radius {self.radius:.6g}, residual "
            f"{self.residual:.1e}, {self.iterations} iterations)"
        )

    def __iter__(self) -> Iterator[Any]:
        return iter((self.K, self.S, self.E))

    def cost(self, x0: Any) -> float:
        """The optimal cost from the state ``x0``.

        Parameters
        ----------
        x0 : array, shape (n,)

        Returns
        -------
        float
            The least value of the sum that `dlqr` minimises.

        Raises
        ------
        InputError
            `x0` is no vector of n numbers.
        """
        return cost_of(self.problem, self.S, x0)


@within_range
def dlqr(A: Any, B: Any, Q: Any, R: Any = None, N: Any = None, E: Any = None) -> DLQRResult:
    r"""Find the feedback :math:`u = -K x` optimal for :math:`E x_{k+1} = A x_k + B u_k`.

    It minimises :math:`\sum_{k \ge 0} x_k^T Q x_k + 2 x_k^T N u_k + u_k^T R u_k`:

    .. math::
        A^T S A - E^T S E - K^T (R + B^T S B) K + Q = 0, \qquad
        K = (R + B^T S B)^{-1} (B^T S A + N^T),

    S the solution for which every eigenvalue of :math:`(A - B K, E)` lies inside of the unit
    circle. Results live where the matrices live, NumPy or CuPy.

    Parameters
    ----------
    A : array or sparse matrix, shape (n, n), or (n,) for a diagonal
        All entries are stored, as those of the others.
    B : array or sparse matrix, shape (n, m) or (n,)
    Q : float, array or sparse matrix, shape (n, n), or (n,) for a diagonal
        Symmetric.
    R : float or array, shape (m, m), or (m,) for a diagonal, optional
        Symmetric positive semidefinite, also zero; identity by default.
    N : array, shape (n, m), optional
        Cross term; ``[[Q, N], [N.T, R]]`` semidefinite.
    E : array or sparse matrix, shape (n, n), or (n,) for a diagonal, optional
        Invertible; identity by default.

    Returns
    -------
    DLQRResult
        Unpacks as ``K, S, E``: gain, Riccati solution, closed-loop poles.

    Raises
    ------
    InputError
        An argument is malformed, an input has neither cost nor effect, or the optimal cost is
        negative because the weights are not semidefinite.
    RiccatiError
        A `numpy.linalg.LinAlgError`: no stabilising solution; names the mode that no input moves,
        or that lies on the unit circle unseen by Q.
    NotConverged
        What was found could not be certified.

    Notes
    -----
    Structure-preserving doubling, of a problem with another cost of inputs where R is singular;
    where that fails, QZ on the host up to 600 states; then Newton steps with residuals in extended
    precision up to 128 states on the host. Certified means: the poles, computed again from A, B and
    K, lie inside of the unit circle beyond round-off; the residual of the equation is below 1e-9
    in balanced units, usually 1e-15; and Newton's next step would change S by less than 1e-4.

    References
    ----------
    E. K.-W. Chu, H.-Y. Fan, W.-W. Lin and C.-S. Wang, Structure-preserving algorithms for periodic
    discrete-time algebraic Riccati equations, Int. J. Control 77 (2004), 767-788. G. A. Hewer, IEEE
    Trans. Automat. Control 16 (1971), 382-384.

    Examples
    --------
    A mass that is pushed once a second:

    >>> import numpy as np
    >>> from gpu import dlqr
    >>> K, S, E = dlqr([[1.0, 1.0], [0.0, 1.0]], [0.5, 1.0], np.diag([1.0, 0.0]), 1.0)
    >>> K.round(4), abs(E).round(4)
    (array([[0.5, 1. ]]), array([0.5, 0.5]))
    """
    problem = _checked(A, B, Q, R, N, E)
    costs = np.linalg.eigvalsh(problem.R)
    if costs[0] < -1e-12 * np.abs(costs).max():
        raise InputError("R is not positive semidefinite: an input would have a negative cost")
    found = _solved(problem, indefinite=False)
    check_cost(problem, found.value)
    verdict, info = found.verdict, found.info
    loop = verdict.loop
    return DLQRResult(
        found.gain, found.value, loop.poles, True, loop.radius, verdict.residual, loop.error,
        info.pop("iterations"), info, problem,
    )  # fmt: skip


@within_range
def dare(a: Any, b: Any, q: Any, r: Any, e: Any = None, s: Any = None) -> Any:
    r"""Solve :math:`A^T X A - E^T X E - (A^T X B + S)(R + B^T X B)^{-1}(A^T X B + S)^T + Q = 0`.

    The signature is that of `scipy.linalg.solve_discrete_are`. The result is the certified
    stabilising solution; Q and R may be indefinite, and R singular, if there is one.

    Parameters
    ----------
    a : array, shape (n, n)
        Real or complex; if an argument is complex, transposes in the equation are adjoints.
    b : array, shape (n, m)
    q : array, shape (n, n)
        Symmetric or hermitian, as r.
    r : array, shape (m, m)
    e : array, shape (n, n), optional
        Invertible.
    s : array, shape (n, m), optional

    Returns
    -------
    x : array, shape (n, n)
        Symmetric or hermitian.

    Raises
    ------
    InputError
        An argument is malformed.
    RiccatiError
        There is no stabilising solution; names the mode in its way (of complex data, it or its
        conjugate).
    NotConverged
        What was found could not be certified.

    Notes
    -----
    See `dlqr`. Complex data are solved as real ones of twice the order.

    References
    ----------
    E. K.-W. Chu, H.-Y. Fan, W.-W. Lin and C.-S. Wang, Structure-preserving algorithms for periodic
    discrete-time algebraic Riccati equations, Int. J. Control 77 (2004), 767-788.

    Examples
    --------
    >>> from gpu import dare
    >>> float(dare([[2.0]], [[1.0]], [[0.0]], [[1.0]])[0, 0])
    3.0
    """
    given = {"a": a, "b": b, "q": q, "r": r, "e": e, "s": s}
    if complex_among(**given):
        return through_reals(dare, **given)
    return _solved(_checked(a, b, q, r, s, e), indefinite=True).value


__all__ = ["DLQRResult", "dare", "dlqr"]


def _checked(A: Any, B: Any, Q: Any, R: Any, N: Any, E: Any) -> LQRProblem:
    A = numbers("A", A)
    if hasattr(A, "matvec") and not hasattr(A, "tocsr"):
        raise InputError("A is an operator: discrete problems need its entries")
    problem = check_lqr(A, B, Q, R, N, E, definite=False, discrete=True)
    if problem.dense:
        return problem
    A, E = problem.full()[:2]
    return check_lqr(A, B, Q, R, N, E, definite=False, discrete=True)


def _solved(problem: LQRProblem, *, indefinite: bool) -> Found:
    """The certified solution; ``indefinite`` weights may make the cost negative."""
    try:
        found = solve_discrete(problem)
    except NotConverged as error:
        raise _explained(problem, error, indefinite) from None
    verdict = found.verdict
    if not verdict.certified:
        reached = f"residual {verdict.residual:.1e}, spectral radius {verdict.loop.radius:.6g}"
        message = f"not certified: {reached}, error {verdict.loop.error:.1e}"
        failure = NotConverged(f"the Riccati solution is {message}")
        raise _explained(problem, failure, indefinite)
    if verdict.loop.is_sensitive():
        inherent = explain(regular(problem)[0])
        if inherent is not None:
            raise inherent
    return found


def _explained(problem: LQRProblem, error: Exception, indefinite: bool) -> Exception:
    if not indefinite and not semidefinite(problem):
        return InputError(f"{NOT_SEMIDEFINITE}, and no stabilising feedback was found")
    return explain(regular(problem)[0]) or error
