"""Newton-Kleinman: the Riccati equation as a sequence of Lyapunov equations of closed loops."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpu.eigenvalues.schur import ordered_schur
from gpu.errors import InputError, NotConverged, NotSupported
from gpu.riccati.problem.candidate import Found
from gpu.riccati.problem.lqr_problem import DenseProblem, LQRProblem
from gpu.riccati.problem.state_matrix import EPS
from gpu.riccati.proof.closed_loop import LIMITS as LOOP
from gpu.riccati.proof.closed_loop import DenseLoop
from gpu.riccati.proof.lyapunov import lyapunov_solver
from gpu.riccati.proof.refinement import finished, refine
from skfem_adini.ground.arrays import namespace, to_host


def solve(problem: LQRProblem, *, start: Any = None, steps: int = 200, tol: float = 1e-12) -> Found:
    """Improve a stabilising gain `start`, shape (m, n), until the value changes by less than `tol`.

    With :math:`A_k = A - B K_k` solve :math:`A_k^T X_k + X_k A_k + Q + K_k^T K_k = 0`,
    :math:`K_{k+1} = B^T X_k` (Kleinman 1968): every gain stabilises, convergence is quadratic in
    the end. The first step may overshoot; in later ones the step length minimises the residual
    (Benner and Byers 1998). Default start: zero if A is stable, else Bass' gain (Armstrong 1975).
    """
    if problem.state.kind == "operator" or (not problem.dense and problem.n > LOOP.dense):
        raise NotSupported(
            f"Newton-Kleinman needs a dense A, or at most {LOOP.dense} states: here {problem.n}"
        )
    standard = problem.standard()
    unit = problem.unit
    balanced = A, B, *_ = standard.scaled(unit)
    if start is None:
        K = stabilising_gain(balanced)
    else:
        K = _starting_point(problem, start) * unit
        if not DenseLoop(A - B @ K, _rounding(A, B, K)).is_stable():
            raise InputError("start does not stabilise: a pole of A - B start is not left of 0")
    X, history = _iterate(balanced, K, steps, tol)
    S = problem.value_of(X)
    S, polished = refine(problem, S, 4)
    info = {"iterations": len(history), "history": tuple(history), "newton_steps": polished}
    return finished(problem, S, info)


def stabilising_gain(problem: DenseProblem) -> Any:
    """A gain that stabilises a dense problem in standard form: zero, or Bass' gain. Raises
    `NotConverged` if none was found, usually because there is none.
    """
    A, B, *_ = problem
    if DenseLoop(A, 4 * EPS * float(namespace(A).linalg.norm(A))).is_stable():
        return namespace(A).zeros((B.shape[1], len(A)))
    return B.T @ stabilising_value(problem)


def stabilising_value(problem: DenseProblem) -> Any:
    r"""A symmetric :math:`X_0` for which ``A - B B^T X_0`` is stable, else raise `NotConverged`.

    :math:`U Y^{-1} U^T` with :math:`(F + \beta I) Y + Y (F + \beta I)^T = 2 G G^T`, :math:`G = U^T
    B` and :math:`U^T A = F U^T` of all modes that are not stable: Bass' construction, restricted to
    them. For a problem too large for a Schur form U is the identity.
    """
    A, B, *_ = problem
    xp = namespace(A)
    U, F = _not_stable_part(A)
    # The norm of F vanishes for modes at zero: take at least 1 % of the norm of A.
    size = max(float(xp.linalg.norm(F)), 1e-2 * float(xp.linalg.norm(A))) or 1.0
    reach = U.T @ B
    places = xp.arange(len(F))
    # Trial values of beta; Bass needs F + beta I to have its spectrum in the right half plane.
    for factor in (0.3, 1.0, 0.1, 0.03, 3.0) if len(F) < len(A) else (1.0, 1.1, 0.3, 0.1):
        # The Lyapunov solver requires a stable matrix: -(F + beta I)^T.
        moved = -F.T.copy()
        moved[places, places] -= factor * size
        try:
            Y = to_host(lyapunov_solver(moved)(2.0 * reach @ reach.T))
        except np.linalg.LinAlgError:
            continue
        if not np.isfinite(Y).all():
            continue
        values, vectors = np.linalg.eigh(Y)
        # Truncate eigenvalues of Y near rounding, at several thresholds: their inverses in X would
        # be wrong.
        for cut in (1e-14, 1e-11, 1e-8):
            kept = values > cut * values[-1]
            left = U @ xp.asarray(vectors[:, kept] / np.sqrt(values[kept]))
            X = left @ left.T
            K = B.T @ X
            if DenseLoop(A - B @ K, _rounding(A, B, K)).is_stable():
                return X
    raise NotConverged("no stabilising gain was found: pass one as start, if there is one")


def _not_stable_part(A: Any) -> tuple[Any, Any]:
    """U and F with ``U^T A = F U^T``, F with all eigenvalues not left of the imaginary axis. Those
    closer to the axis than 1e-8 of the norm of A count as unstable; F has at least one.
    """
    xp, n = namespace(A), len(A)
    if n > LOOP.dense:
        return xp.eye(n), A
    host = to_host(A).T
    T, U, values = ordered_schur(host, lambda values: values.real, n)
    margin = 1e-8 * float(np.linalg.norm(host))
    count = int(np.sum(values.real >= -margin))
    if 0 < count < n and T[count, count - 1] != 0.0:
        count += 1
    count = max(count, 1 + int(n > 1 and T[1, 0] != 0.0))
    return xp.asarray(U[:, :count]), xp.asarray(T[:count, :count].T)


def _iterate(problem: DenseProblem, K: Any, steps: int, tol: float) -> tuple[Any, list[float]]:
    A, B, Q, _ = problem
    xp = namespace(A)
    X = lyapunov_solver(A - B @ K)(Q + K.T @ K)
    history: list[float] = []
    for _ in range(steps):
        G = X @ B
        half = X @ A
        residual = half + half.T + Q - G @ G.T
        loop = A - B @ G.T
        D = lyapunov_solver(loop)((residual + residual.T) / 2)
        change, size = float(xp.linalg.norm(D)), float(xp.linalg.norm(X))
        if not np.isfinite(change):
            raise NotConverged("Newton-Kleinman left the finite numbers: scale the problem")
        history.append(change / size if size > 0.0 else 0.0)
        DB = D @ B
        X = X + _step_length(residual, DB @ DB.T, xp) * D
        X = (X + X.T) / 2
        if history[-1] <= tol:
            return X, history
        # For an ill-conditioned equation rounding ends the quadratic convergence early.
        if len(history) > 2 and history[-1] < 1e-6 and history[-1] > 0.5 * history[-2]:
            return X, history
    raise NotConverged(
        f"Newton-Kleinman: the value still changes by {history[-1]:.1e} after {steps} steps"
    )


def _step_length(residual: Any, curvature: Any, xp: Any) -> float:
    """The t in (0, 2] that minimises |(1 - t) residual - t^2 curvature|; 1 near the solution."""
    a = float(xp.sum(residual * residual))
    b = float(xp.sum(residual * curvature))
    c = float(xp.sum(curvature * curvature))
    # With so small a curvature the minimum is at t = 1 up to 1e-4.
    if not c > 1e-8 * a or not np.isfinite(a + c):
        return 1.0
    roots = np.roots([4 * c, 6 * b, 2 * (a - 2 * b), -2 * a])
    roots = roots[np.abs(roots.imag) <= 1e-8 * np.abs(roots)].real
    trials = [*(float(t) for t in roots if 0.0 < t < 2.0), 2.0]

    def square(t: float) -> float:
        return (1 - t) ** 2 * a - 2 * (1 - t) * t * t * b + t**4 * c

    return min(trials, key=square)


def _starting_point(problem: LQRProblem, start: Any) -> Any:
    xp = problem.xp
    start = xp.asarray(start, dtype=float)
    m = problem.B.shape[1]
    if start.shape != (m, problem.n) or not bool(xp.isfinite(start).all()):
        raise InputError(f"start has shape {start.shape}: expected ({m}, {problem.n}), finite")
    return problem.of_unit_cost(start)


def _rounding(A: Any, B: Any, K: Any) -> float:
    norm = namespace(A).linalg.norm
    return 4 * EPS * float(norm(A) + norm(B) * norm(K))
