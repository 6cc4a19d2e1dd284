"""The Riccati equation of a dense problem by structure-preserving doubling."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from gpu.errors import InputError, NotConverged
from gpu.riccati.methods import newton_kleinman
from gpu.riccati.problem.candidate import Found
from gpu.riccati.problem.lqr_problem import (
    DenseProblem,
    LQRProblem,
    check_lqr,
    scaled_hamiltonian,
)
from gpu.riccati.problem.lqr_problem import solve as solve_linear
from gpu.riccati.problem.state_matrix import EPS
from gpu.riccati.proof.discrete import refined
from gpu.riccati.proof.lyapunov import cayley_shift, filled
from gpu.riccati.proof.refinement import LIMITS as EXACT
from gpu.riccati.proof.refinement import finished, refine
from skfem_adini.ground.arrays import namespace, to_host


class _Limits(NamedTuple):  # limits of the method
    iterations: int = 60  # most doublings: 2^60 steps of the transformed loop
    best_shift: int = 100  # order up to which the shift is chosen from all eigenvalues
    qz: int = 600  # order up to which QZ is tried if doubling fails
    announced: int = 500  # order from which the log says beforehand how long it may take
    operations: float = 250.0  # over n^3, measured: two thirds to one and a half of this


LIMITS = _Limits()


logger = logging.getLogger(__name__)


Candidate = Callable[[LQRProblem, DenseProblem], tuple[Any, dict[str, Any]]]


class Doubled(NamedTuple):
    """The last iterate X of the doubling, and whether it converged."""

    X: Any
    iterations: int
    converged: bool


def solve(problem: LQRProblem, *, newton: int = 12, fallback: bool = True) -> Found:
    """Solve a dense problem by doubling, then refine by at most `newton` Newton steps on the
    residual. With `fallback`, failing a certified solution, try doubling of a stabilised problem,
    then QZ (on the host, up to 600 states) and Newton-Kleinman."""
    _announce(problem)
    standard = problem.standard()
    candidates: list[Candidate] = [_by_doubling]
    if fallback:
        small = [_by_qz] if problem.n <= LIMITS.qz else []
        if isinstance(problem.signs, float):
            small = [partial(_by_doubling, moved=True), *small, _by_newton]
        candidates += small

    def polished(S: Any, info: dict[str, Any], exact: bool = False) -> Found:
        S, steps = refine(problem, S, newton, exact)
        return finished(problem, S, {**info, "newton_steps": steps}, exact)

    found = _first_certified(problem, standard, candidates, polished)
    verdict, small_enough = found.verdict, problem.n <= EXACT.exact and problem.xp is np
    if verdict.certified or verdict.residual > EXACT.residual or not small_enough:
        return found
    # Poles nearly on the axis take more digits of the residual.
    return polished(found.value, found.info, exact=True)


def _first_certified(
    problem: LQRProblem,
    standard: DenseProblem,
    candidates: list[Candidate],
    polished: Callable[[Any, dict[str, Any]], Found],
) -> Found:
    """The first candidate that is certified once it is polished, or that of least residual."""
    best: Found | None = None
    for candidate in candidates:
        try:
            with np.errstate(all="ignore"):  # overflow shows in a result that is not finite
                S, info = candidate(problem, standard)
            if not bool(problem.xp.isfinite(S).all()):
                continue
            found = polished(S, info)
        except (np.linalg.LinAlgError, NotConverged):
            continue
        if found.verdict.certified:
            return found
        if best is None or found.verdict.residual < best.verdict.residual:
            best = found
    if best is None:
        raise NotConverged("neither doubling nor what stands in for it found a Riccati solution")
    return best


def _announce(problem: LQRProblem) -> None:
    """Log how long a large problem may take, by the time of a small product."""
    n, xp = problem.n, problem.xp
    if n < LIMITS.announced:
        return
    M = xp.ones((256, 256))
    for _ in range(2):  # the first one may load libraries
        begin = perf_counter()
        float((M @ M @ M @ M).sum())
        spent = perf_counter() - begin
    seconds = spent / (6 * 256.0**3) * LIMITS.operations * n**3
    size = 20 * 8 * n * n / 2**30
    logger.info("doubling with all entries of %d states: about %.1g s, %.1g GiB", n, seconds, size)


def _by_doubling(
    problem: LQRProblem, standard: DenseProblem, moved: bool = False
) -> tuple[Any, dict[str, Any]]:
    """Solve by `double`; if `moved`, for ``X - X_0``, where the feedback of X_0 stabilises:
    unstable modes with a very small weight in Q would make the G_k grow without bound."""
    A, G, Q = scaled_hamiltonian(standard, problem.unit)
    X0 = 0.0
    if moved:
        X0 = newton_kleinman.stabilising_value(standard.scaled(problem.unit))
        half = X0 @ A
        left = half + half.T - X0 @ G @ X0 + Q
        A, Q = A - G @ X0, (left + left.T) / 2
    found = double(A, G, Q)
    if not found.converged:
        raise np.linalg.LinAlgError("doubling did not converge")
    info = {"iterations": found.iterations, "path": "moved doubling" if moved else "doubling"}
    return problem.value_of(X0 + found.X), info


def _by_qz(problem: LQRProblem, standard: DenseProblem) -> tuple[Any, dict[str, Any]]:
    xp = problem.xp
    A, E, Q, N = (None if M is None else to_host(M) for M in problem.full())
    qz: Any = linalg.solve_discrete_are if problem.discrete else linalg.solve_continuous_are
    try:
        S = qz(A, to_host(problem.B), Q, problem.R, e=E, s=N)
    except ValueError as error:
        raise np.linalg.LinAlgError(str(error)) from None
    return xp.asarray((S + S.T) / 2), {"iterations": 1, "path": "qz"}


def _by_newton(problem: LQRProblem, standard: DenseProblem) -> tuple[Any, dict[str, Any]]:
    found = newton_kleinman.solve(problem)
    return found.value, {**found.info, "path": "newton"}


def double(A: Any, G: Any, Q: Any, gamma: float | None = None) -> Doubled:
    r"""Iterate the doubling of :math:`A^T X + X A - X G X + Q = 0` (Chu, Fan and Lin 2005) from the
    Cayley transform of the Hamiltonian with shift :math:`\gamma`, their algorithm 2.1: :math:`H_k
    \to X` quadratically, :math:`A_k \to 0` like the transformed loop to the power :math:`2^k`."""
    xp, n = namespace(A), len(A)
    A, G, Q = (filled(M) for M in (A, G, Q))
    if gamma is None:
        gamma = _shift(A, G, Q)
    eye, places = xp.eye(n), xp.arange(n)
    moved = A.copy()
    moved[places, places] -= gamma
    inverse = solve_linear(moved, eye)
    reach = inverse @ G
    half = 2.0 * gamma * solve_linear(moved.T + Q @ reach, eye)
    H = half @ (Q @ inverse)
    G = reach @ half
    # `half` solves with the transposed matrix, as G and Q are symmetric.
    A = half.T.copy()
    A[places, places] += 1.0
    del moved, inverse, reach, half
    return double_discrete(A, (G + G.T) / 2, (H + H.T) / 2)


def double_discrete(A: Any, G: Any, H: Any) -> Doubled:
    r"""The same iteration for :math:`A^T X (I + G X)^{-1} A - X + H = 0` itself (Chu, Fan, Lin and
    Wang 2004)."""
    xp, n = namespace(A), len(A)
    places = xp.arange(n)
    converged, iteration = False, 0
    while iteration < LIMITS.iterations and not converged:
        iteration += 1
        W = G @ H
        W[places, places] += 1.0
        both = solve_linear(W, xp.concatenate([A, G], axis=1))
        W1, W2 = both[:, :n], both[:, n:]
        step = A.T @ (H @ W1)
        G = G + A @ W2 @ A.T
        A = A @ W1
        H = H + step
        G, H = (G + G.T) / 2, (H + H.T) / 2
        size = float(xp.linalg.norm(H))
        if not np.isfinite(size) or not np.isfinite(float(xp.linalg.norm(G))):
            break
        left = float(xp.linalg.norm(A))
        converged = float(xp.linalg.norm(step)) <= 4 * EPS * size and left < 1e-3
        # If G and H are semidefinite, the next step is at most |A|^2 times H.
        converged |= n > LIMITS.best_shift and left * left <= EPS
    return Doubled(H, iteration, converged)


def _shift(A: Any, G: Any, Q: Any) -> float:
    xp, n = namespace(A), len(A)
    H = xp.empty((2 * n, 2 * n))
    H[:n, :n], H[:n, n:], H[n:, :n], H[n:, n:] = A, -G, -Q, -A.T
    if n > LIMITS.best_shift:
        return cayley_shift(H)
    values = np.linalg.eigvals(to_host(H))
    values = values[values.real < 0.0]
    size = np.abs(values)
    if not size.size or not size.max() > 0.0:
        return 1.0
    low = max(size.min(), 1e-12 * size.max())  # smaller eigenvalues may be rounding
    trials = np.geomspace(low / 2, 2 * size.max(), 41)[:, None]
    rate = np.abs((values + trials) / (values - trials)).max(axis=1)
    # The Cayley transform does not exist if the shift is an eigenvalue; near one, digits are lost.
    distance = np.abs((values + trials) / (values - trials)).min(axis=1)
    own = np.linalg.eigvals(to_host(A))
    distance = np.minimum(distance, np.abs((own - trials) / (np.abs(own) + trials)).min(axis=1))
    clear = distance >= min(0.05, distance.max())
    return float(trials[clear][rate[clear].argmin(), 0])


def solve_discrete(problem: LQRProblem) -> Found:
    """The first certified solution of a discrete problem, or that of least residual: by doubling;
    by doubling of a shifted problem; by QZ (on the host, up to 600 states). Each is refined."""
    candidates: list[Candidate] = [
        _by_discrete_doubling,
        partial(_by_discrete_doubling, moved=True),
    ]
    candidates += [_by_qz] if problem.n <= LIMITS.qz else []
    _announce(problem)
    first, _ = regular(problem)
    return _first_certified(
        problem, first.standard(), candidates, partial(refined, problem, first.unit)
    )


def regular(problem: LQRProblem, moved: bool = False) -> tuple[LQRProblem, float]:
    """The problem of ``S - c I``, and c: zero unless `moved` or R is singular. `InputError` if
    ``R + c B^T B``, its cost of inputs, is singular."""
    if problem.root is not None and not moved:
        return problem, 0.0
    A, E, Q, N = problem.full()
    B, xp = problem.B, problem.xp
    mass = xp.eye(problem.n) if E is None else E.T @ E
    size = float(xp.linalg.norm(Q)) / float(xp.linalg.norm(mass))
    c = size if size > 0.0 else 1.0
    cross = c * (A.T @ B) if N is None else N + c * (A.T @ B)
    cost = Q + c * (A.T @ A - mass)
    inner = to_host(xp.asarray(problem.R) + c * (B.T @ B))
    cost, inner = (cost + cost.T) / 2, (inner + inner.T) / 2
    shifted = check_lqr(A, B, cost, inner, cross, E, definite=False, discrete=True)
    if shifted.root is None:
        raise InputError("R is singular for inputs without effect: each needs a cost or an effect")
    return shifted, c


def _by_discrete_doubling(
    problem: LQRProblem, standard: DenseProblem, moved: bool = False
) -> tuple[Any, dict[str, Any]]:
    """``S = c I + X`` with the solution X of a problem with a regular R."""
    problem, shift = regular(problem, moved)
    standard = problem.standard() if shift else standard
    found = double_discrete(*scaled_hamiltonian(standard, problem.unit))
    if not found.converged:
        raise np.linalg.LinAlgError("doubling did not converge")
    S = problem.value_of(found.X) + shift * problem.xp.eye(problem.n)
    path = "shifted doubling" if shift else "doubling"
    return S, {"iterations": found.iterations, "path": path}
