"""Method "reduced" (Algorithm 7): the Riccati equation on a small basis that grows."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import linalg

from gpu.arguments import choice
from gpu.arrays.namespace import namespace, to_host
from gpu.errors import InputError, NotConverged, NotSupported, RiccatiError
from gpu.riccati.methods.hamiltonian import low_rank_value
from gpu.riccati.methods.hamiltonian_inverse import InverseHamiltonian
from gpu.riccati.methods.reduced.gain_refinement import kleinman
from gpu.riccati.methods.reduced.galerkin_riccati import Projected
from gpu.riccati.methods.reduced.rational_krylov import RationalKrylov
from gpu.riccati.methods.reduced.stability_proof import proves_stable
from gpu.riccati.problem.candidate import Found, LowRankValue
from gpu.riccati.problem.cross_term import without_cross_term
from gpu.riccati.problem.lqr_problem import SINGULAR_MASS, LQRProblem
from gpu.riccati.problem.state_matrix import Factors, StateMatrix, factor, stored, symmetric
from gpu.riccati.problem.weights import Weight, low_rank_factor

COMPRESSIONS = ("galerkin", "printed")
START = 8  # blocks before the first Newton step
STEPS = 30  # of Newton on the gain; quadratic once the first have settled
MISSES = 16  # spaces without a stabilising solution, one after the other, that end the search
STRIDE = 2  # blocks between two looks at the projected equation
SHIFTS = 6  # of the Krylov space for values of low rank; each is factored once
QUADRATIC = 1e-6  # a Newton step of this size leaves an error of its square


def solve(
    problem: LQRProblem,
    *,
    basis: Any = None,
    compression: str = "galerkin",
    tol: float = 1e-10,
    rank: int | None = None,
    refine: bool | None = None,
) -> Found:
    r"""Solve on a basis W: prescribed, or a rational Krylov space grown until the gain is right.

    .. math::
        K = R^{-1} B^T W P W^T E,\qquad
        \hat A^T P \hat E + \hat E^T P \hat A - \hat E^T P \hat B \hat B^T P \hat E + \hat Q = 0

    with :math:`\hat A = W^T A W` and so on. The dissertation's Algorithm 7 takes the eigenvectors
    of :math:`\mathrm{diag}(W, W)^T \mathcal H^{-1} \mathrm{diag}(W, W)` instead
    (``compression="printed"``), which is far less accurate on the same basis.

    Where Q has low rank, W is the space of :math:`A^T` and the factor of Q, the value has low rank
    too, and the space grows until the residual of the whole equation, computed exactly, is below
    ``tol``. Where Q has full rank the value is no low-rank matrix; W is the space of A and B, and
    grows until the gain stands still. That suffices where A is symmetric and Q a multiple of E;
    elsewhere Newton steps on the gain follow (see `gain_refinement.kleinman`).

    Parameters
    ----------
    basis : array, shape (n, r), optional
        Prescribed W of full rank.
    compression : {"galerkin", "printed"}
        "printed" needs ``basis``.
    tol : float
        Relative: of the residual, or of the gain.
    rank : int, optional
        Largest number of basis vectors, by default ``min(n, 400)``.
    refine : bool, optional
        Newton steps on the gain, by default where Q has full rank and the problem is not symmetric.

    Returns
    -------
    Found
        ``info`` holds ``rank``, ``solves``, and ``residual`` (low rank) or ``change`` (the last
        relative change of the gain).

    Raises
    ------
    InputError
    NotConverged
        The largest rank was reached.
    RiccatiError
    """
    choice("compression", compression, COMPRESSIONS)
    if not 0.0 < tol < 1.0:
        raise InputError(f"tol={tol}: expected a number between 0 and 1")
    if compression == "printed" and basis is None:
        raise InputError('compression="printed" needs a basis')
    if problem.N is not None:
        plain = without_cross_term(problem)
        found = solve(
            plain, basis=basis, compression=compression, tol=tol, rank=rank, refine=refine
        )
        return found._replace(gain=problem.gain(found.gain))
    if basis is not None:
        return _prescribed(problem, basis, compression)
    limit = min(problem.n, 400) if rank is None else rank
    C = low_rank_factor(problem.weight)
    return (
        _low_rank(problem, C, tol, limit) if C is not None else _full(problem, tol, limit, refine)
    )


def takes_newton(problem: LQRProblem) -> bool:
    """Whether a projection alone does not find the gain, and Newton steps have to follow."""
    if low_rank_factor(problem.weight) is not None:
        return False
    return problem.N is not None or _multiple(problem) is None


def _prescribed(problem: LQRProblem, basis: Any, compression: str) -> Found:
    xp = problem.xp
    W = stored("basis", basis)
    W = W.toarray() if hasattr(W, "toarray") else W
    if W.ndim != 2 or W.shape[0] != problem.n or not 0 < W.shape[1] <= problem.n:
        raise InputError(f"basis has shape {W.shape}: expected ({problem.n}, r), r > 0")
    if namespace(W) is not xp:
        raise InputError("basis and A live on different sides: move one of them")
    W, triangle = xp.linalg.qr(W)
    sizes = np.abs(np.diag(to_host(triangle)))
    if not sizes.min() > 1e-13 * sizes.max():
        raise InputError("basis: its columns are linearly dependent")
    if compression == "printed":
        return _printed(problem, W)
    projected = Projected.of(problem, W)
    P = projected.solve()
    info = {"rank": W.shape[1], "solves": 0}
    return Found(problem.gain(projected.gain(P)), LowRankValue(W, xp.asarray(P)), info)


def _printed(problem: LQRProblem, W: Any) -> Found:
    """The stable invariant subspace of the compressed inverse Hamiltonian."""
    state, xp, r = problem.state, problem.xp, W.shape[1]
    inverse = InverseHamiltonian(state, problem.input, problem.weight)
    zero = xp.zeros_like(W)
    blocks = [inverse.solve(state.mass(W), zero), inverse.solve(zero, state.mass_transposed(W))]
    small = np.block([[to_host(W.T @ column[i]) for column in blocks] for i in (0, 1)])
    _, Z, stable = linalg.schur(small, output="real", sort="lhp")
    if stable != r:
        raise RiccatiError(f"the compressed Hamiltonian has {stable} stable eigenvalues, not {r}")
    V, Y = W @ xp.asarray(Z[:r, :r]), W @ xp.asarray(Z[r:, :r])
    F = low_rank_value(state, V, Y)
    gain = problem.gain((problem.input.T @ F) @ state.mass_transposed(F).T)
    info = {"rank": r, "solves": inverse.solves}
    return Found(gain, LowRankValue(F, xp.eye(F.shape[1])), info)


def _low_rank(problem: LQRProblem, C: Any, tol: float, limit: int) -> Found:
    state, xp = problem.state, problem.xp
    shifts, moved = _shifts(problem, C.T, SHIFTS)
    # The value is that of A E^-1 and C E^-1; a feedback that makes A regular must lie in its space.
    seed = xp.concatenate([_mass(state).solve_transposed(C.T), *moved], axis=1)
    space = RationalKrylov(state, seed, shifts, transposed=True)
    projected, residual, history, misses = None, np.inf, [], 0
    while True:
        for _ in range(2 * STRIDE):
            space.grow()
        projected = Projected.of(problem, space.W, projected)
        try:
            P = projected.solve()
            residual = projected.residual(P, C)
        except RiccatiError:
            # The smaller problem need not be stabilisable where the whole one is.
            misses += 1
            if space.exhausted or space.rank >= limit or (misses > MISSES and limit < problem.n):
                raise
            continue
        misses = 0
        history.append((space.rank, residual))
        if residual <= tol:
            break
        stalled = len(history) > 8 and residual > 0.5 * min(r for _, r in history[:-6])
        if space.exhausted or space.rank >= limit or stalled:
            if residual <= 1e3 * tol and (space.exhausted or stalled):
                break  # rounding: what is left is reported with the result
            raise NotConverged(
                f"the residual is {residual:.1e} with {space.rank} basis vectors: raise rank, "
                "loosen tol, or use method='doubling' with dense matrices"
            )
    info = {
        "rank": space.rank,
        "solves": space.solves,
        "iterations": len(history),
        "residual": residual,
        "history": history,
    }
    return Found(problem.gain(projected.gain(P)), LowRankValue(space.W, xp.asarray(P)), info)


def _full(problem: LQRProblem, tol: float, limit: int, refine: bool | None) -> Found:
    state, ratio = problem.state, _multiple(problem)
    refine = ratio is None if refine is None else refine
    if refine and state.kind == "operator":
        raise NotSupported(
            "A is an operator that is not symmetric, or Q of full rank no multiple of E: Newton "
            "steps on the gain need shifted solves; pass A sparse, or Q by a factor of few rows, "
            "or refine=False for the gain of the projection, which is not optimal"
        )
    B = problem.input
    space = RationalKrylov(state, _mass(state).solve(B), _shifts(problem, B, 2)[0])
    if refine:
        return _newton(problem, space, tol, limit)
    history: list[tuple[int, float]] = []
    projected, P, change = None, None, np.inf
    while not change <= tol and not (space.exhausted and history):
        if space.rank >= limit and not space.exhausted:
            raise NotConverged(
                f"the gain still changes by {change:.1e} with {space.rank} basis vectors: raise "
                "rank, loosen tol, or set refine=True"
            )
        for _ in range(STRIDE):
            space.grow()
        projected = Projected.of(problem, space.W, projected)
        try:
            following = projected.solve()
        except RiccatiError:
            if space.exhausted or space.rank >= limit:
                raise
            continue
        if P is not None:
            change = projected.change(following, P)
            history.append((space.rank, change))
        elif space.exhausted:
            change = 0.0
        P = following
    info = {
        "rank": space.rank,
        "solves": space.solves,
        "change": change,
        "iterations": len(history) + 1,
        "history": history,
    }
    assert projected is not None
    assert P is not None
    proved = ratio is not None and ratio > 0.0 and proves_stable(problem, projected, P, ratio)
    return Found(problem.gain(projected.gain(P)), None, info, proved=proved)


def _newton(problem: LQRProblem, space: RationalKrylov, tol: float, limit: int) -> Found:
    """Newton steps on the gain to convergence; then a larger space must tell the same."""
    xp, factored, history = problem.xp, 0, []
    K, before, change = None, None, np.inf
    while True:
        for _ in range(START if before is None else 2 * STRIDE):
            space.grow()
        if K is None:
            try:
                projected = Projected.of(problem, space.W)
                K, U = kleinman(problem, space.W, projected.gain(projected.solve()))
                # With what the value makes of W the projected equation comes close.
                both = xp.linalg.qr(xp.concatenate([space.W, U], axis=1)[:, : problem.n])[0]
                projected = Projected.of(problem, both)
                K = projected.gain(projected.solve())
            except RiccatiError:
                if K is None and (space.exhausted or space.rank >= limit):
                    raise
                if K is None:
                    continue
            factored += space.rank
        for _ in range(STEPS):
            following, _ = kleinman(problem, space.W, K)
            factored += space.rank
            step, K = _difference(following, K), following
            history.append((space.rank, step))
            if step <= QUADRATIC:
                break
        else:
            raise NotConverged(f"Newton steps on the gain still change it by {step:.1e}")
        change = np.inf if before is None else _difference(K, before)
        if change <= tol or space.exhausted:
            break
        if space.rank >= limit:
            raise NotConverged(
                f"the gain still changes by {change:.1e} with {space.rank} basis vectors: raise "
                "rank or loosen tol"
            )
        before = K
    info = {
        "rank": space.rank,
        "solves": space.solves + factored,
        "change": min(change, step),
        "iterations": len(history),
        "history": history,
    }
    return Found(problem.gain(K), None, info)


def _mass(state: StateMatrix) -> Factors:
    """Solves with E."""
    if state.E is None:
        return Factors(lambda x: x, lambda x: x)
    mass = factor(state.E)
    if mass is None:
        raise InputError(SINGULAR_MASS)
    return mass


def _difference(new: Any, old: Any) -> float:
    """Relative, of two gains."""
    xp = namespace(new)
    return float(xp.linalg.norm(new - old) / (float(xp.linalg.norm(new)) or 1.0))


def _multiple(problem: LQRProblem) -> float | None:
    """q where A and E are symmetric and ``Q = q E``: then W of A and B holds it all; else None."""
    state, Q = problem.state, problem.weight.Q
    n, xp = state.n, state.xp
    probe = xp.asarray(np.random.default_rng(4).standard_normal((n, 2)))
    if state.kind == "operator":
        moved = state.apply(probe)
        apart = float(xp.linalg.norm(moved - state.apply_transposed(probe)))
        alike = apart <= 1e-12 * float(xp.linalg.norm(moved))
        alike = alike and (state.E is None or symmetric(state.E))
    else:
        alike = state.is_symmetric()
    if not alike or Q is None or hasattr(Q, "matvec"):
        return None
    cost, mass = Weight(state, Q).apply(probe), state.mass(probe)
    ratio = float((cost * mass).sum() / (mass * mass).sum())
    apart = float(xp.linalg.norm(cost - ratio * mass))
    return ratio if apart <= 1e-10 * float(xp.linalg.norm(cost)) else None


def _shifts(problem: LQRProblem, seed: Any, count: int) -> tuple[list[Factors], list[Any]]:
    """Factors of A and of A - s E, s log-spaced up to the fastest modes; see `moved` for a
    singular A.
    """
    state, xp = problem.state, problem.xp
    inverse = InverseHamiltonian(state, problem.input, problem.weight)
    slow_factors = inverse.factors
    if slow_factors is None:
        raise NotConverged("no feedback was found that makes A regular: use method='doubling'")
    if state.kind == "operator":
        return [slow_factors], inverse.moved
    block = xp.linalg.qr(seed)[0][:, :4]
    fast = float(xp.linalg.norm(state.apply(block)) / xp.linalg.norm(state.mass(block)))
    x, slow = block, fast
    for _ in range(4):
        x = x / xp.linalg.norm(x)
        y = slow_factors.solve(state.mass(x))
        slow, x = 1.0 / max(float(xp.linalg.norm(y)), 1e-300), y
    # Discontinuous seeds excite modes faster than they are on the average.
    top = 10.0 * fast
    ladder = slow * (top / slow) ** (np.arange(1, count) / (count - 1))
    if count == 2:
        ladder = np.array([(slow * fast) ** 0.5])
    shifts = [slow_factors]
    for shift in ladder:
        for move in (1.0, 1.37, 0.71):
            factors = state.factor(float(move * shift))
            if factors is not None:
                shifts.append(factors)
                break
    return shifts, inverse.moved
