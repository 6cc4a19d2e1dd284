"""Method "reduced" (Algorithm 7): the Riccati equation on a small basis that grows."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from gpu.arrays.sparse_factor import SuperLUFactor
from gpu.errors import InputError, NotConverged, NotSupported, RiccatiError
from gpu.riccati.methods.doubling import double
from gpu.riccati.methods.hamiltonian import of_subspace
from gpu.riccati.methods.hamiltonian_inverse import InverseHamiltonian
from gpu.riccati.problem.candidate import Found, LowRankValue
from gpu.riccati.problem.cross_term import without_cross_term
from gpu.riccati.problem.lqr_problem import SINGULAR_MASS, LQRProblem
from gpu.riccati.problem.state_matrix import (
    EPS,
    Factors,
    StateMatrix,
    factor,
    sparse_of,
    stored,
    symmetric,
    times,
    vanishing,
)
from gpu.riccati.problem.weights import low_rank_factor
from gpu.riccati.proof.lyapunov import lyapunov_solver
from skfem_adini.ground.arguments import choice
from skfem_adini.ground.arrays import namespace, to_host


class _Limits(NamedTuple):  # limits of the method
    start: int = 8  # blocks in the basis before the first Newton step
    steps: int = 30  # most Newton steps on the gain, which converge quadratically
    misses: int = 16  # most successive bases without a stabilising solution
    stride: int = 2  # blocks added between two solutions of the projected equation
    shifts: int = 6  # of the Krylov space for values of low rank; each is factored once
    quadratic: float = 1e-6  # relative size of a Newton step after which the error is its square
    condition: float = 1e8  # condition above which half of the digits or more are lost
    drop: float = 1e-11  # least part of a unit vector outside the space that is not rounding
    outside: float = 1e-14  # least part of a unit vector outside a basis that is followed
    margin: float = 1e-2  # least eigenvalue in `proves_stable`, which is one for the exact P


LIMITS = _Limits()


def solve(
    problem: LQRProblem,
    *,
    basis: Any = None,
    compression: str = "galerkin",
    tol: float = 1e-10,
    rank: int | None = None,
    refine: bool | None = None,
) -> Found:
    """The gain :math:`K = R^{-1} B^T W P W^T E` on a basis W, given or grown; P solves it there.

    For Q of low rank W spans the space of :math:`A^T` and the factor of Q, up to a residual of
    `tol`; for full rank that of A and B, until the gain changes by less than `tol`, and unless A is
    symmetric and Q a multiple of E, Newton steps on the gain follow. "printed" takes eigenvectors
    of the projected inverse Hamiltonian (dissertation, Algorithm 7): far less accurate.
    """
    choice("compression", compression, ("galerkin", "printed"))
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
    """Whether `solve` takes Newton steps because a projection alone does not give the gain."""
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
    if not sizes.min() > 1e-13 * sizes.max():  # dependent up to rounding
        raise InputError("basis: its columns are linearly dependent")
    if compression == "printed":
        return _printed(problem, W)
    projected = Projected.of(problem, W)
    P = projected.solve()
    info = {"rank": W.shape[1], "solves": 0}
    return Found(problem.gain(projected.gain(P)), LowRankValue(W, xp.asarray(P)), info)


def _printed(problem: LQRProblem, W: Any) -> Found:
    """The gain from the stable invariant subspace of the projected inverse Hamiltonian."""
    state, xp, r = problem.state, problem.xp, W.shape[1]
    inverse = InverseHamiltonian(state, problem.input, problem.weight)
    zero = xp.zeros_like(W)
    blocks = [inverse.solve(state.mass(W), zero), inverse.solve(zero, state.mass_transposed(W))]
    small = np.block([[to_host(W.T @ column[i]) for column in blocks] for i in (0, 1)])
    _, Z, stable = linalg.schur(small, output="real", sort="lhp")
    if stable != r:
        raise RiccatiError(f"the compressed Hamiltonian has {stable} stable eigenvalues, not {r}")
    V, Y = W @ xp.asarray(Z[:r, :r]), W @ xp.asarray(Z[r:, :r])
    return of_subspace(problem, V, Y, {"rank": r, "solves": inverse.solves})


def _low_rank(problem: LQRProblem, C: Any, tol: float, limit: int) -> Found:
    state, xp = problem.state, problem.xp
    shifts, moved = _shifts(problem, C.T, LIMITS.shifts)
    # The value is that of A E^-1 and C E^-1; a feedback that makes A regular must lie in its space.
    seed = xp.concatenate([_mass(state).solve_transposed(C.T), *moved], axis=1)
    space = RationalKrylov(state, seed, shifts, transposed=True)
    projected, residual, history, misses = None, np.inf, [], 0
    terms = Terms(problem, C)
    while True:
        for _ in range(2 * LIMITS.stride):
            space.grow()
        projected = Projected.of(problem, space.W, projected)
        terms.grow(space.W)
        try:
            P = projected.solve()
            residual = terms.residual(P, projected.B)
        except RiccatiError:
            # The projected problem need not be stabilisable even if the whole one is.
            misses += 1
            stuck = misses > LIMITS.misses and limit < problem.n
            if space.exhausted or space.rank >= limit or stuck:
                raise
            continue
        misses = 0
        history.append((space.rank, residual))
        if residual <= tol:
            break
        stalled = len(history) > 8 and residual > 0.5 * min(r for _, r in history[:-6])
        if space.exhausted or space.rank >= limit or stalled:
            if residual <= 1e3 * tol and (space.exhausted or stalled):
                break  # limited by rounding: the residual is reported with the result
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
        for _ in range(LIMITS.stride):
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
    """Newton steps on the gain until they converge, on growing spaces until two results agree."""
    xp, factored, history = problem.xp, 0, []
    K, before, change = None, None, np.inf
    while True:
        for _ in range(LIMITS.start if before is None else 2 * LIMITS.stride):
            space.grow()
        if K is None:
            try:
                projected = Projected.of(problem, space.W)
                K, U = kleinman(problem, space.W, projected.gain(projected.solve()))
                # Projected on W and U = X E W the equation gives a good first gain.
                both = xp.linalg.qr(xp.concatenate([space.W, U], axis=1)[:, : problem.n])[0]
                projected = Projected.of(problem, both)
                K = projected.gain(projected.solve())
            except RiccatiError:
                if K is None and (space.exhausted or space.rank >= limit):
                    raise
                if K is None:
                    continue
            factored += space.rank
        for _ in range(LIMITS.steps):
            following, _ = kleinman(problem, space.W, K)
            factored += space.rank
            step, K = _difference(following, K), following
            history.append((space.rank, step))
            if step <= LIMITS.quadratic:
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
    """Relative difference of two gains."""
    xp = namespace(new)
    return float(xp.linalg.norm(new - old) / (float(xp.linalg.norm(new)) or 1.0))


def _multiple(problem: LQRProblem) -> float | None:
    """q if A and E are symmetric and ``Q = q E``, so the space of A and B suffices; else None."""
    state, Q = problem.state, problem.weight.entries
    n, xp = state.n, state.xp
    probe = xp.asarray(np.random.default_rng(4).standard_normal((n, 2)))
    if state.kind == "operator":
        moved = state.apply(probe)
        apart = float(xp.linalg.norm(moved - state.apply_transposed(probe)))
        alike = apart <= 1e-12 * float(xp.linalg.norm(moved))
        alike = alike and (state.E is None or symmetric(state.E))
    else:
        alike = state.is_symmetric()
    if not alike or Q is None:
        return None
    cost, mass = times(Q, probe), state.mass(probe)
    ratio = float((cost * mass).sum() / (mass * mass).sum())
    apart = float(xp.linalg.norm(cost - ratio * mass))
    return ratio if apart <= 1e-10 * float(xp.linalg.norm(cost)) else None


def _shifts(problem: LQRProblem, seed: Any, count: int) -> tuple[list[Factors], list[Any]]:
    """Factors of A and of A - s E, with s log-spaced up to the fastest modes. A singular A is
    replaced by A with a feedback, whose vectors are returned too (see `InverseHamiltonian.moved`).
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
    # A discontinuous seed contains modes that are faster than its average rate `fast`.
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


def kleinman(problem: LQRProblem, W: Any, K: Any) -> tuple[Any, Any]:
    """The next gain of Newton's method (Kleinman 1968), shape (m, n), and U = X E W, shape (n, r).

    X of :math:`A_K^T X E + E^T X A_K = -(Q + K^T K)`, :math:`A_K = A - B K`, has full rank if Q
    has, but only X B is needed. Let W, orthonormal, contain :math:`E^{-1} B` in its range and be
    nearly invariant, :math:`A_K W = E W H`. Then :math:`A_K^T U + E^T U H = -(Q + K^T K) W` takes
    one solve for each eigenvalue of H, and :math:`K_+^T = E^T U (W^+ E^{-1} B)`.
    """
    state, B, xp = problem.state, problem.input, problem.xp
    Er = to_host(W.T @ state.mass(W))
    H = np.linalg.solve(Er, to_host(W.T @ (state.apply(W) - B @ (K @ W))))
    b = np.linalg.solve(Er, to_host(W.T @ B))
    T, Z = linalg.schur(H, output="complex")
    if not np.all(np.diag(T).real < 0.0):
        raise RiccatiError("the gain to be refined does not stabilise: start from a better one")
    F = (problem.weight.apply(W) + K.T @ (K @ W)) @ xp.asarray(Z)
    V = xp.zeros((state.n, len(T)), dtype=complex)
    Kt = K.T + 0j
    # For real eigenvalues the shift is made real, which saves complex solves.
    for j in range(len(T)):
        h = T[j, j]
        shift = -h if abs(h.imag) > 1e-13 * abs(h) else float(-h.real)
        right = -F[:, j]
        if j:
            right = right - state.mass_transposed(V[:, :j] @ xp.asarray(T[:j, j]))
        V[:, j] = _solve(state, shift, B, Kt, right)
    U = (V @ xp.asarray(Z.conj().T)).real
    return state.mass_transposed(U @ xp.asarray(b)).T, U


def _solve(state: StateMatrix, shift: complex, B: Any, Kt: Any, right: Any) -> Any:
    """``(A - shift E - B K)^-T right``."""
    xp = state.xp
    factors = state.factor(shift)
    if factors is not None:
        solved = factors.solve_transposed(xp.concatenate([right[:, None], Kt], axis=1))
        u, G = solved[:, 0], solved[:, 1:]
        # By Sherman, Morrison and Woodbury.
        small = np.eye(B.shape[1]) - to_host(B.T @ G)
        if np.isfinite(small).all() and np.linalg.cond(small) < LIMITS.condition:
            return u + G @ xp.asarray(np.linalg.solve(small, to_host(B.T @ u)))
    # The optimal feedback reflects an unstable mode of A without cost at the imaginary axis; then
    # the shift is an eigenvalue of A itself.
    moved = copy(state)
    moved.A = state.shifted(shift)
    factors = None if state.kind == "operator" else moved.factor_updated(B, Kt.real)
    if factors is None:
        raise RiccatiError(f"A - B K - s E is singular at s = {shift}, the mirror of a pole")
    return factors.solve_transposed(right)


class RationalKrylov:
    r"""The space of :math:`G,\ (A - s_1 E)^{-1} G,\ (A - s_2 E)^{-1} E (A - s_1 E)^{-1} G,\ \dots`
    (Ruhe 1984), by orthonormal blocks from `seed` G, shape (n, p), with `shifts` (factors) used
    cyclically; `exhausted` if a block adds no direction or fills the space."""

    def __init__(
        self, state: StateMatrix, seed: Any, shifts: list[Factors], transposed: bool = False
    ) -> None:
        self._state, self._shifts, self._transposed = state, shifts, transposed
        self._turn, self.solves, self.exhausted = 0, 0, False
        self._kept = state.xp.empty((state.n, 4 * seed.shape[1]), order="F")
        self.rank = 0
        self._append(seed)

    @property
    def W(self) -> Any:
        """The basis, shape (n, rank)."""
        return self._kept[:, : self.rank]

    def grow(self) -> None:
        """Add a block: the last block multiplied by E and solved with the next shifted matrix."""
        if self.exhausted:
            return
        factors = self._shifts[self._turn % len(self._shifts)]
        self._turn += 1
        self.solves += 1
        if self._transposed:
            block = factors.solve_transposed(self._state.mass_transposed(self._last))
        else:
            block = factors.solve(self._state.mass(self._last))
        self._append(block)

    def _projected(self, block: Any) -> Any:
        """The part of a block orthogonal to the space. The second product is transposed, as it is
        twice as fast with rows as with columns.
        """
        inside = self.W.T @ block
        return block - (inside.T @ self.W.T).T

    def _append(self, block: Any) -> None:
        xp = self._state.xp
        size = xp.linalg.norm(block, axis=0)
        moving = xp.flatnonzero(size > 0.0)
        block = self._projected(block[:, moving] / size[moving])
        # Columns that are nearly parallel to each other or to the space are omitted.
        if block.shape[1]:
            gram = to_host(block.T @ block)
            values, vectors = np.linalg.eigh((gram + gram.T) / 2)
            kept = values > LIMITS.drop**2 + EPS * values.max()
            block = block @ xp.asarray(vectors[:, kept] / np.sqrt(values[kept]))
        if block.shape[1]:
            block = xp.linalg.qr(self._projected(block))[0]
        room = self._state.n - self.rank
        block = block[:, :room]
        self._last = block
        rank = self.rank + block.shape[1]
        if rank > self._kept.shape[1]:
            # Allocate twice as much: copying the basis for each block costs more than computing it.
            kept = xp.empty((self._state.n, min(2 * rank, self._state.n)), order="F")
            kept[:, : self.rank] = self.W
            self._kept = kept
        self._kept[:, self.rank : rank] = block
        self.rank = rank
        self.exhausted = block.shape[1] in (0, room)


def proves_stable(problem: LQRProblem, projected: Projected, P: np.ndarray, q: float) -> bool:
    r"""Whether Lyapunov's inequality holds for ``A - B K`` with an S near the Riccati solution. P,
    shape (r, r), solves the projected problem, which has no cross term, and gave the gain; q > 0.

    It needs A = A^T, E = E^T and Q = q E. Let :math:`A_s = A - \delta E Z Z^T E` be negative
    definite, Z of few columns. Then :math:`S_0 = -\frac q2 A_s^{-1}` solves the equation without
    the quadratic term and without :math:`\delta`. Its difference to the Riccati solution has low
    rank, and the Galerkin solution P on the basis W gives it:

    .. math:: S = S_0 + W Y W^T,\qquad Y = P + \tfrac q2 (W^T A_s W)^{-1}.

    S is positive definite if P is. In

    .. math:: M = -(A - B K)^T S E - E S (A - B K)

    the terms of :math:`S_0` give :math:`q E` up to terms in :math:`\delta`, and all other terms
    have low rank: :math:`M = q E + U D U^T`, whose definiteness is that of a matrix of the order of
    D. No poles are computed or estimated.
    """
    state, xp, W = problem.state, problem.xp, projected.W
    found = _shifted(problem)
    if found is None or not _definite(P):
        return False
    Z, delta, solve = found
    EW, EZ, AW = state.mass(W), state.mass(Z), state.apply(W)
    ZW = to_host(EZ.T @ W)
    inner = projected.A - delta * ZW.T @ ZW
    Y = P + q / 2.0 * np.linalg.inv((inner + inner.T) / 2.0)
    BZ = solve(xp.concatenate([problem.input, EZ], axis=1))
    S0BZ = -q / 2.0 * state.mass(BZ)
    K = projected.gain(P)
    m, d, r = problem.input.shape[1], Z.shape[1], len(P)
    U = xp.concatenate([AW, EW, K.T, S0BZ, EZ], axis=1)
    size = xp.linalg.norm(U, axis=0)
    U = U / xp.where(size > 0.0, size, 1.0)
    D = np.zeros((U.shape[1],) * 2)
    at = np.cumsum([0, r, r, m, m, d, d])
    aw, ew, k, b, z, e = (slice(*pair) for pair in pairwise(at))
    D[aw, ew] = -Y
    D[k, ew] = projected.B.T @ Y
    D[k, b] = np.eye(m)
    D[z, e] = -delta * np.eye(d)
    lengths = to_host(size)
    D = (D + D.T) * lengths * lengths[:, None] / q
    gram = to_host(U.T @ _mass(state).solve(U))
    values, vectors = np.linalg.eigh((gram + gram.T) / 2.0)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    small = root.T @ D @ root
    if not np.isfinite(small).all():
        return False
    return bool(1.0 + np.linalg.eigvalsh((small + small.T) / 2.0)[0] >= LIMITS.margin)


def _shifted(problem: LQRProblem) -> Any:
    """Z, delta, and solves with ``A - delta E Z Z^T E`` where that is negative definite."""
    state, xp = problem.state, problem.xp
    n, unit = state.n, state.size() or 1.0
    if state.kind == "diagonal":
        E = xp.ones(n) if state.E is None else state.E
        if not bool((E > 0.0).all()):
            return None
        places = xp.flatnonzero(vanishing(state.A) | (state.A > 0.0))
        if len(places) > 16:  # Z must have few columns
            return None
        Z = xp.zeros((n, len(places)))
        Z[places, xp.arange(len(places))] = 1.0 / xp.sqrt(E[places])
        ratio = float((xp.abs(state.A) / E).max())
        A = state.A.copy()
        A[places] -= ratio * E[places]
        return (Z, ratio, lambda x: x / A[:, None]) if bool((A < 0.0).all()) else None
    if state.kind != "sparse" or xp is not np:
        return None
    Z = np.zeros((n, 0))
    if _inertia(-state.A, Z, 1.0) != 0:
        constant = np.ones((n, 1))
        # Only constants are tried as null vector, the most frequent one; otherwise no proof.
        if float(abs(state.A @ constant).max()) > 1e-10 * unit:
            return None
        Z = constant / np.sqrt(float((constant * state.mass(constant)).sum()))
    EZ = state.mass(Z)
    delta = unit / max(1e-300, float(abs(EZ).max()) ** 2) if EZ.size else 1.0
    if state.E is not None and _inertia(state.E, np.zeros((n, 0)), 1.0) != 0:
        return None
    if EZ.size and _inertia(-state.A, EZ, delta) != EZ.shape[1]:
        return None
    factors = state.factor_updated(delta * EZ, EZ) if EZ.size else factor(state.A)
    return None if factors is None else (Z, delta, factors.solve)


def _inertia(H: Any, V: Any, delta: float) -> int:
    """Number of pivots of ``[[H, V], [V^T, -I / delta]]`` that are not positive; -1 if it fails. It
    is the number of columns of V if and only if ``H + delta V V^T`` is positive definite
    (Haynsworth 1968)."""
    block = sparse_of(np)
    if V.shape[1]:
        H = block.bmat([[H, block.csr_matrix(V)], [V.T, -block.identity(V.shape[1]) / delta]])
    H = block.csc_array(H)
    lu, diagonal = SuperLUFactor(H), H.diagonal()
    # Shift the diagonal down by more than the rounding errors of the factors, so that a positive
    # pivot is not positive by rounding.
    rounding = max(1e-12, 4 * H.shape[0] * EPS)
    try:
        lu.factor(diagonal - rounding * np.abs(diagonal))
    except np.linalg.LinAlgError:
        return -1
    return int((~(lu.pivots() > 0.0)).sum())


def _definite(P: np.ndarray) -> bool:
    values = np.linalg.eigvalsh(P)
    return bool(values[0] > 1e-13 * values[-1])  # above the rounding of P


def _by_doubling(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> np.ndarray | None:
    """The stabilising solution of the small equation, or None."""
    with np.errstate(all="ignore"):
        found = double(A, B @ B.T, Q)
    if not found.converged or not np.isfinite(found.X).all():
        return None
    P, stable = _newton_step(found.X, A, B, Q)
    return P if stable else None


def _newton_step(
    P: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray
) -> tuple[np.ndarray, bool]:
    """P after a Newton step, which leaves rounding of the residual, and whether its gain
    stabilises."""
    gain = B.T @ P
    half = P @ A - gain.T @ gain / 2
    loop = lyapunov_solver(A - B @ gain)
    P = P + loop(half + half.T + Q)
    return P, loop.poles is None or bool(loop.poles.real.max() < 0.0)


@dataclass(frozen=True)
class Projected:
    """The problem on a basis W: :math:`W^T E W, W^T A W, W^T B, W^T Q W`, on the host."""

    problem: LQRProblem
    W: Any  # shape (n, r)
    E: np.ndarray  # shape (r, r), as A and Q
    A: np.ndarray
    B: np.ndarray  # shape (r, m)
    Q: np.ndarray

    @classmethod
    def of(cls, problem: LQRProblem, W: Any, before: Projected | None = None) -> Projected:
        """Project; if `before` is a projection on the first columns of W, only extend it."""
        state = problem.state
        known = 0 if before is None else before.W.shape[1]
        old, new = W[:, :known], W[:, known:]

        def grown(small: Any, right: Any, left: Any = None) -> np.ndarray:
            right = to_host(W.T @ right)
            if small is None:
                return right
            left = right[:known].T if left is None else to_host(left.T @ old)
            return np.block([[small, right[:known]], [left, right[known:]]])

        A, E, Q, B = (None,) * 4 if before is None else (before.A, before.E, before.Q, before.B)
        A = grown(A, state.apply(new), state.apply_transposed(new) if known else None)
        if state.E is None:
            E = np.eye(W.shape[1])
        else:
            E = grown(E, state.mass(new), state.mass_transposed(new) if known else None)
        Q = grown(Q, problem.weight.apply(new))
        fresh = to_host(new.T @ problem.input)
        B = fresh if B is None else np.concatenate([B, fresh])
        return cls(problem, W, E, A, B, (Q + Q.T) / 2)

    def solve(self) -> np.ndarray:
        """P of the projected equation, shape (r, r): the value is ``W P W^T``."""
        # Scale B and Q to equal size; P scales with rho.
        reach, cost = float(np.linalg.norm(self.B)), float(np.linalg.norm(self.Q))
        if cost == 0.0:
            cost = reach = 1.0
        rho = cost**0.5 / reach if reach > 0.0 else 1.0
        unit = np.eye(self.B.shape[1])
        try:
            # SciPy's argument e loses digits if it is not symmetric: solve for E^T P E instead.
            moved = np.linalg.solve(self.E, np.hstack([self.A, self.B * np.sqrt(rho)]))
            A, B = moved[:, : len(self.A)], moved[:, len(self.A) :]
            P = _by_doubling(A, B, self.Q / rho)
            if P is None:  # by QZ, which takes many times as long
                P = linalg.solve_continuous_are(A, B, self.Q / rho, unit)
                P, _ = _newton_step(P, A, B, self.Q / rho)
            P = np.linalg.solve(self.E.T, np.linalg.solve(self.E.T, P).T)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise RiccatiError(
                f"the problem on {len(self.A)} basis vectors has no stabilising solution "
                f"({error}); method='doubling' stores all entries and needs no projection"
            ) from error
        return rho * (P + P.T) / 2

    def gain(self, P: np.ndarray) -> Any:
        """The gain ``B^T W P W^T E`` for the inputs of unit cost, shape (m, n)."""
        return self.problem.xp.asarray(self.B.T @ P) @ self._EtW().T

    def change(self, P: np.ndarray, before: np.ndarray) -> float:
        """Relative change of the gain from the P of the first columns of W to this one."""
        new = self.B.T @ P
        moved = new.copy()
        moved[:, : len(before)] -= self.B[: len(before)].T @ before
        norm = np.linalg.norm
        if self.problem.state.E is not None:
            # The columns of E^T W are not orthonormal: measure the products with them.
            xp, EtW = self.problem.xp, self._EtW()
            new, moved = (EtW @ xp.asarray(D.T) for D in (new, moved))
            norm = xp.linalg.norm
        return float(norm(moved)) / (float(norm(new)) or 1.0)

    def _EtW(self) -> Any:
        return self.problem.state.mass_transposed(self.W)


class Terms:
    """The terms of the equation of ``X = W P W^T`` in an orthonormal basis of the columns of A^T W,
    E^T W and C^T, which span the range of its residual. The basis grows with W: a factorisation of
    all columns for each W takes most of the time of a large problem."""

    def __init__(self, problem: LQRProblem, C: Any) -> None:
        self._state, self._known = problem.state, 0
        self._blocks: list[Any] = []  # of the basis, each shape (n, few)
        self._C = self._coefficients(C.T)
        self._A = self._E = np.zeros((0, 0))

    def grow(self, W: Any) -> None:
        """Take the new columns of W into account."""
        new, state = W[:, self._known :], self._state
        self._known, few = W.shape[1], new.shape[1]
        columns = [state.mass_transposed(new), state.apply_transposed(new)]
        both = self._coefficients(state.xp.concatenate(columns, axis=1))
        self._E, self._A = _beside(self._E, both[:, :few]), _beside(self._A, both[:, few:])

    def residual(self, P: np.ndarray, B: np.ndarray) -> float:
        """``|A^T X E + E^T X A - E^T X B B^T X E + C^T C| / |C^T C|``, B that of the projection."""
        rows = sum(block.shape[1] for block in self._blocks)
        A, E, C = (_filled_up(M, rows) for M in (self._A, self._E, self._C))
        half, gain = A @ P @ E.T, E @ (P @ B)
        cost = C @ C.T
        left = half + half.T - gain @ gain.T + cost
        return float(np.linalg.norm(left) / (np.linalg.norm(cost) or 1.0))

    def _coefficients(self, X: Any) -> np.ndarray:
        """Those of the columns of X, after the basis is extended by what lies outside of it."""
        xp = self._state.xp
        size = xp.linalg.norm(X, axis=0)
        X = X / xp.where(size > 0.0, size, 1.0)
        inside: list[Any] = [0.0] * len(self._blocks)
        for _ in range(2):
            for place, block in enumerate(self._blocks):
                part = block.T @ X
                X = X - block @ part
                inside[place] = inside[place] + part
        Q, triangle = xp.linalg.qr(X)
        directions, left, _ = np.linalg.svd(to_host(triangle))
        new = Q @ xp.asarray(directions[:, left > LIMITS.outside])
        for block in self._blocks:  # once more: what was small has lost its orthogonality
            new = new - block @ (block.T @ new)
        if new.shape[1]:
            new = xp.linalg.qr(new)[0]
            inside.append(new.T @ X)
            self._blocks.append(new)
        rows = [to_host(part) for part in inside]
        return np.concatenate(rows) * to_host(size)


def _beside(known: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Coefficients of further columns beside those of fewer rows."""
    return np.concatenate([_filled_up(known, len(new)), new], axis=1)


def _filled_up(M: np.ndarray, rows: int) -> np.ndarray:
    """M with rows of zeros below."""
    return np.concatenate([M, np.zeros((rows - len(M), M.shape[1]))])
