"""Linear-quadratic regulators, estimators and Riccati equations: the public entries."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from gpu.errors import GpuError, InputError, NotConverged, NotSupported, RiccatiError
from gpu.riccati.lqr_result import LQRResult, certified, in_given_units
from gpu.riccati.methods import doubling, hamiltonian, newton_kleinman, reduced
from gpu.riccati.problem.candidate import Found
from gpu.riccati.problem.complex_data import complex_among, through_reals
from gpu.riccati.problem.lqr_problem import (
    NOT_SEMIDEFINITE,
    LQRProblem,
    check_cost,
    check_lqr,
    columns,
    numbers,
    semidefinite,
)
from gpu.riccati.problem.state_matrix import EPS, stored
from gpu.riccati.problem.units import in_moderate_units, within_range
from gpu.riccati.proof.closed_loop import LIMITS as LOOP
from gpu.riccati.proof.closed_loop import explain, named
from skfem_adini.ground.arguments import choice, flag
from skfem_adini.ground.arrays import namespace, to_host
from skfem_adini.ground.errors import warn


@within_range
def lqr(
    A: Any,
    B: Any,
    Q: Any,
    R: Any = None,
    N: Any = None,
    E: Any = None,
    method: str = "auto",
    *,
    factored: bool = False,
    inverse: Any = None,
    unstable: str = "warn",
    **options: Any,
) -> LQRResult:
    r"""Find the feedback :math:`u = -K x` that is optimal for :math:`E x' = A x + B u`.

    It minimises :math:`\int_0^\infty x^T Q x + 2 x^T N u + u^T R u \, dt`:

    .. math::
        E^T S A + A^T S E - (E^T S B + N) R^{-1} (E^T S B + N)^T + Q = 0, \qquad
        K = R^{-1} (B^T S E + N^T),

    S the solution for which every eigenvalue of :math:`(A - B K, E)` has a negative real part.
    Results live where the matrices live, NumPy or CuPy.

    Parameters
    ----------
    A : array, shape (n, n), or (n,) for a diagonal, sparse matrix, or LinearOperator
        An operator needs `inverse`.
    B : array or sparse matrix, shape (n, m) or (n,)
    Q : float, array, shape (n, n), or (n,) for a diagonal, sparse matrix, or LinearOperator
        Symmetric; with ``factored=True`` the factor C of ``Q = C^T C``, shape (p, n).
    R : float or array, shape (m, m), or (m,) for a diagonal, optional
        Symmetric positive definite; identity by default.
    N : array, shape (n, m), optional
        Cross term; ``[[Q, N], [N.T, R]]`` semidefinite. A sparse A stays sparse.
    E : array, shape (n, n), or (n,) for a diagonal, or sparse matrix, optional
        Invertible; identity by default.
    method : {"auto", "doubling", "newton", "hamiltonian", "reduced"}
        "doubling": structured doubling of a dense problem, Newton correction, QZ where it fails.
        "newton": Newton-Kleinman from a stabilising gain. "hamiltonian": the eigenvectors of the
        inverse Hamiltonian, Algorithm 5 of the dissertation. "reduced": Galerkin on a rational
        Krylov space. "auto": doubling where A is dense; else reduced, but doubling with all
        entries where that fails for at most 1500 states, or takes longer (at most 400 states and
        a Q of full rank that is no multiple of E, or a nonsymmetric A).
    factored : bool
        Q is the factor C of ``Q = C^T C``.
    inverse : LinearOperator, optional
        ``A^-1`` of an operator A, with ``rmatvec``.
    unstable : {"warn", "raise", "ignore"}
        What to do where the gain of a reduced method does not stabilise. The result says so in
        ``stable`` in any case, and its ``refined()`` finds the optimal gain.
    **options
        Of the method: see ``gpu.riccati.methods.doubling.solve`` and its kind.

    Returns
    -------
    LQRResult
        Unpacks as ``K, S, E``: gain, Riccati solution, closed-loop poles.

    Raises
    ------
    InputError
        An argument is malformed, or the optimal cost is negative because Q is not semidefinite.
    RiccatiError
        A `numpy.linalg.LinAlgError`: no stabilising solution; names the mode that no input moves,
        or that lies on the imaginary axis unseen by Q.
    NotConverged
        What was found could not be certified.

    Notes
    -----
    Certified means: the closed loop's poles were computed again from A, B and K and lie left of
    the axis beyond round-off, or, of more than 1500 states, Lyapunov's inequality proves that
    they do; and for dense methods the residual of the equation, in units that balance the
    Hamiltonian, is below 1e-9 (usually 1e-15), or S is the solution to 1e-12. Of large sparse or
    diagonal problems with symmetric A and E and Q a multiple of E the stability is proved by
    Lyapunov's inequality too (see `gpu.riccati.methods.reduced.proves_stable`); of
    others that are as large the poles nearest to zero are examined, one right of the axis is looked
    for, and nothing is proved: ``bound`` says which.

    References
    ----------
    E. K.-W. Chu, H.-Y. Fan and W.-W. Lin, Linear Algebra Appl. 396 (2005); D. L. Kleinman, IEEE
    Trans. Automat. Control 13 (1968).

    Examples
    --------
    A double integrator:

    >>> import numpy as np
    >>> from gpu import lqr
    >>> K, S, E = lqr([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.diag([1.0, 2.0]), 1.0)
    >>> K.round(12), S.round(12)
    (array([[1., 2.]]), array([[2., 1.],
           [1., 2.]]))
    """
    choice("unstable", unstable, ("warn", "raise", "ignore"))
    factored = flag("factored", factored)
    problem = check_lqr(A, B, Q, R, N, E, factored=factored, inverse=inverse)
    return solve_problem(problem, method, unstable, options, indefinite=False)


@within_range
def care(a: Any, b: Any, q: Any, r: Any, e: Any = None, s: Any = None) -> Any:
    r"""Solve :math:`A^T X E + E^T X A - (E^T X B + S) R^{-1} (E^T X B + S)^T + Q = 0`.

    The signature is that of `scipy.linalg.solve_continuous_are`. The result is the certified
    stabilising solution, for which every eigenvalue of :math:`(A - B R^{-1} (B^T X E + S^T), E)`
    has a negative real part; Q and R may be indefinite if there is one, as in H-infinity problems.

    Parameters
    ----------
    a : array, shape (n, n)
        Real or complex; if an argument is complex, transposes in the equation are adjoints.
    b : array, shape (n, m)
    q : array, shape (n, n)
        Symmetric or hermitian, as r.
    r : array, shape (m, m)
        Not singular.
    e : array, shape (n, n), optional
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
    Complex data are solved as real ones of twice the order.

    References
    ----------
    E. K.-W. Chu, H.-Y. Fan and W.-W. Lin, Linear Algebra Appl. 396 (2005), 55-80.

    Examples
    --------
    >>> from gpu import care
    >>> float(care([[1.0]], [[1.0]], [[3.0]], [[1.0]])[0, 0])
    3.0

    A disturbance beside the input, :math:`X^2 (1 - 1/4) - 2 X - 3 = 0` (of H-infinity type):

    >>> import numpy as np
    >>> X = care([[1.0]], [[1.0, 1.0]], [[3.0]], np.diag([1.0, -4.0]))
    >>> bool(abs(X[0, 0] - (4 + 52**0.5) / 3) < 1e-14)
    True
    """
    given = {"a": a, "b": b, "q": q, "r": r, "e": e, "s": s}
    if complex_among(**given):
        return through_reals(care, **given)
    problem = check_lqr(a, b, q, r, s, e, definite=False)
    if not problem.dense:
        A, E = problem.full()[:2]
        problem = check_lqr(A, b, q, r, s, E, definite=False)
    return solve_problem(problem, "doubling", "raise", {}, indefinite=True).S


@within_range
def lqe(
    A: Any,
    G: Any,
    C: Any,
    W: Any,
    V: Any,
    N: Any = None,
    E: Any = None,
    method: str = "auto",
    *,
    factored: bool = False,
    **options: Any,
) -> LQRResult:
    r"""Find the gain L of the stationary Kalman-Bucy filter, the dual of `lqr`.

    For :math:`E x' = A x + G w`, :math:`y = C x + v` with white noises of intensities W, V and
    cross intensity N, the estimate :math:`E \hat x' = A \hat x + L (y - C \hat x)` has the least
    covariance P of errors:

    .. math::
        A P E^T + E P A^T - L V L^T + G W G^T = 0, \qquad L = (E P C^T + G N) V^{-1}.

    Parameters
    ----------
    A : array or sparse matrix, shape (n, n), or (n,) for a diagonal
    G : array, shape (n, q)
    C : array, shape (p, n)
    W : array, shape (q, q)
        Symmetric positive semidefinite.
    V : array, shape (p, p)
        Symmetric positive definite.
    N : array, shape (q, p), optional
    E, method, options
        As in `lqr`.
    factored : bool
        W is a factor F, shape (q, l), of the intensity F F^T.

    Returns
    -------
    LQRResult
        Unpacks as ``L, P, E``: the gain, shape (n, p), the covariance, the poles of the filter.

    Raises
    ------
    InputError
        An argument is malformed, or W is not positive semidefinite.
    RiccatiError
        There is no stable filter; names the mode that C does not see, or that no noise excites.
    NotConverged
        What was found could not be certified.

    References
    ----------
    R. E. Kalman and R. S. Bucy, New results in linear filtering and prediction theory, J. Basic
    Eng. 83 (1961), 95-108.

    Examples
    --------
    >>> from gpu import lqe
    >>> L, P, E = lqe([[1.0]], [[1.0]], [[1.0]], 3.0, 1.0)
    >>> float(L[0, 0]), float(P[0, 0]), float(E[0].real)
    (3.0, 3.0, -2.0)
    """
    problem = dual_problem(A, G, C, W, V, N, E, flag("factored", factored))
    return transposed(solve_problem(problem, method, "raise", options, indefinite=False))


__all__ = ["care", "lqe", "lqr"]


def dual_problem(
    A: Any, G: Any, C: Any, W: Any, V: Any, N: Any, E: Any, factored: bool
) -> LQRProblem:
    """The regulator problem of ``(A^T, C^T, G W G^T, V, G N, E^T)``."""
    A, E = numbers("A", A), numbers("E", E)
    n = A.shape[0]
    G = stored("G", numbers("G", G))
    if G.ndim == 1:
        G = G[:, None]
    if G.shape[0] != n:
        raise InputError(f"G has shape {G.shape}: expected ({n}, q), a row for each state")
    G = G.toarray() if hasattr(G, "toarray") else G
    C = numbers("C", C)
    if C.ndim == 1:
        C = C[None, :]
    if C.shape[1] != n:
        raise InputError(f"C has shape {C.shape}: expected (p, {n}), a column for each state")
    factor = G @ _noise_factor(W, G, factored)
    V = None if V is None else stored("V", numbers("V", V))
    cross = None
    if N is not None:
        N = stored("N", numbers("N", N))
        N = N[:, None] if N.ndim == 1 else N
        if N.shape != (G.shape[1], C.shape[0]):
            raise InputError(f"N has shape {N.shape}: expected {(G.shape[1], C.shape[0])}")
        cross = G @ N
    dense = A.ndim == 2 and not hasattr(A, "tocsr") and not hasattr(A, "matvec")
    return check_lqr(
        _transposed(A),
        columns("C", C.T, n, None),
        factor @ factor.T if dense else factor.T,
        V,
        cross,
        _transposed(E),
        factored=not dense,
    )


@dataclass(frozen=True, repr=False)
class FilterResult(LQRResult):
    """The gain L of a filter, shape (n, p), in place of K, and the covariance in place of S."""

    def refined(self, *, steps: int = 200, tol: float = 1e-12) -> LQRResult:
        """The optimal gain by Newton-Kleinman starting from this one; see `LQRResult.refined`."""
        return transposed(LQRResult(**_turned(self)).refined(steps=steps, tol=tol))


def transposed(result: LQRResult) -> FilterResult:
    """The result of the dual problem as that of the filter, whose gain is the transposed one."""
    return FilterResult(**_turned(result))


def _turned(result: LQRResult) -> dict[str, Any]:
    return {f.name: getattr(result, f.name) for f in fields(result)} | {"K": result.K.T}


def _noise_factor(W: Any, G: Any, factored: bool) -> Any:
    q = G.shape[1]
    W = stored("W", numbers("W", W))
    if factored:
        W = W[:, None] if W.ndim == 1 else W
        if W.shape[0] != q:
            raise InputError(f"W has shape {W.shape}: a factor must have {q} rows")
        return W
    W = to_host(W.toarray() if hasattr(W, "toarray") else W)
    if W.shape == (1, 1) and q > 1:
        W = W[0, 0] * np.eye(q)
    if W.ndim == 1 and len(W) == q:
        W = np.diag(W)
    if W.shape != (q, q):
        raise InputError(f"W has shape {W.shape}: expected ({q}, {q}), an intensity for each noise")
    if not np.allclose(W, W.T, rtol=0.0, atol=1e-12 * np.abs(W).max()):
        raise InputError("W is not symmetric: pass (W + W.T) / 2 if that is what is meant")
    values, vectors = np.linalg.eigh((W + W.T) / 2)
    if values[0] < -1e-12 * q * max(values[-1], 0.0):
        raise InputError(f"W is not positive semidefinite: an eigenvalue is {values[0]:.3g}")
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return namespace(G).asarray(root)


def _transposed(M: Any) -> Any:
    if M is None or getattr(M, "ndim", 2) == 1:
        return M
    return M.T


METHODS: dict[str, Callable[..., Found]] = {
    "doubling": doubling.solve,
    "newton": newton_kleinman.solve,
    "hamiltonian": hamiltonian.solve,
    "reduced": reduced.solve,
}


def automatic(problem: LQRProblem, may_store: bool) -> tuple[LQRProblem, str]:
    """The method that ``method="auto"`` selects, and the problem in the form that it requires:
    doubling if dense, else a projection, unless a projection alone does not find the gain and the
    entries are few enough to be stored (`may_store`)."""
    if problem.dense:
        return problem, "doubling"
    # For few states a dense solver is quicker than Newton steps with shifted solves.
    if may_store and problem.n <= 400 and reduced.takes_newton(problem):
        return problem.entries(), "doubling"
    return problem, "reduced"


def solve_problem(
    problem: LQRProblem, method: str, unstable: str, options: dict[str, Any], *, indefinite: bool
) -> LQRResult:
    """Choose the method, solve, certify; ``indefinite`` weights may make the cost negative."""
    method = choice("method", method, ("auto", *METHODS))
    moderate = in_moderate_units(problem)
    if moderate is problem:
        return _solved(problem, method, unstable, options, indefinite=indefinite)
    if problem.squares_fit:
        try:
            return _solved(problem, method, unstable, options, indefinite=indefinite)
        except (GpuError, ValueError):  # perhaps in these units only
            pass
    result = _solved(moderate, method, unstable, options, indefinite=indefinite)
    return in_given_units(result, problem)


def _solved(
    problem: LQRProblem, method: str, unstable: str, options: dict[str, Any], *, indefinite: bool
) -> LQRResult:
    # Whether the dense problem can be solved if the automatic method fails.
    chosen = method == "auto" and not problem.dense and problem.n <= LOOP.dense and not options
    if method == "auto":
        problem, method = automatic(problem, chosen)
    solve = _solver(method, options)
    if not indefinite and not problem.dense:
        semidefinite(problem, always=True)
    try:
        found = solve(problem, **options)
    except (NotConverged, NotSupported, np.linalg.LinAlgError) as error:
        if chosen:
            return _by_entries(problem, unstable, indefinite)
        if isinstance(error, NotSupported):
            raise
        if not isinstance(error, NotConverged | RiccatiError):
            error = NotConverged(str(error))
        raise _explained(problem, error, indefinite) from None
    result = certified(problem, found, method)
    if method in ("doubling", "newton"):  # they find a solution of the equation, others a gain
        _check_solution(problem, found, result, indefinite)
        return result
    # Up to the rounding that splits a double root on the axis.
    if not found.proved and not result.abscissa < -(EPS**0.5) * problem.state.size():
        # If a pole remains that no feedback moves, no other method finds a better gain.
        inherent = named(problem)
        if inherent is not None:
            if chosen and problem.n <= LOOP.named:
                return _by_entries(problem, unstable, indefinite)
            raise inherent
    if not result.stable and chosen:
        # Modes that neither Q nor a projection detects, but that must be moved.
        return _by_entries(problem, unstable, indefinite)
    if not result.stable and unstable != "ignore":
        message = (
            f"the gain of method {method!r} does not stabilise: a pole has the real part "
            f"{problem.rate(result.abscissa):.3g}; {_remedy(problem)}"
        )
        if unstable == "raise":
            raise NotConverged(message)
        warn(message, RuntimeWarning)
    return result


def _solver(method: str, options: dict[str, Any]) -> Callable[..., Found]:
    """The function of the method, called with all options."""
    solve = METHODS[method]
    known = list(inspect.signature(solve).parameters)[1:]
    for name in options:
        if name not in known:
            raise InputError(f"{name}: method {method!r} knows {', '.join(known) or 'no options'}")
    return solve


def _check_solution(problem: LQRProblem, found: Found, result: LQRResult, indefinite: bool) -> None:
    """Raise if the equation is not solved, or has a stabilising solution only by rounding."""
    if not result.converged:
        raise _explained(
            problem,
            NotConverged(
                f"the Riccati solution is not certified: residual {result.residual:.1e}, "
                f"abscissa {problem.rate(result.abscissa):.1e}"
            ),
            indefinite,
        )
    if found.verdict is not None and found.verdict.loop.is_sensitive():
        inherent = explain(problem)
        if inherent is not None:
            raise inherent
    if not indefinite and problem.n <= LOOP.dense and isinstance(result.S, problem.xp.ndarray):
        check_cost(problem, result.S)


def _remedy(problem: LQRProblem) -> str:
    if problem.dense or problem.n <= LOOP.dense:
        return "use result.refined(), or method='newton'"
    return "give its mode an input and a weight, or use method='doubling' with all entries"


def _by_entries(problem: LQRProblem, unstable: str, indefinite: bool) -> LQRResult:
    """The solution with all entries stored, if no projection finds it and memory allows."""
    inherent = named(problem) if problem.n > LOOP.named else None
    if inherent is not None:
        raise inherent
    return solve_problem(problem.entries(), "doubling", unstable, {}, indefinite=indefinite)


def _explained(problem: LQRProblem, error: Exception, indefinite: bool) -> Exception:
    if isinstance(error, RiccatiError) and error.cause:
        return error
    if not indefinite and not semidefinite(problem):
        return InputError(
            f"{NOT_SEMIDEFINITE}, and no stabilising feedback was found that is optimal"
        )
    return explain(problem) or error
