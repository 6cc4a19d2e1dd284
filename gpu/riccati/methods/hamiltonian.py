"""Method "hamiltonian": the gain from some eigenvectors of the inverse Hamiltonian."""

from __future__ import annotations

from copy import copy
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from gpu.eigenvalues.krylov.krylov_schur import Limits, Wanted, krylov_schur
from gpu.eigenvalues.schur import best_first
from gpu.errors import InputError, NotConverged, RiccatiError
from gpu.riccati.methods.hamiltonian_inverse import InverseHamiltonian
from gpu.riccati.problem.candidate import Found, LowRankValue
from gpu.riccati.problem.cross_term import without_cross_term
from gpu.riccati.problem.lqr_problem import SINGULAR_MASS, LQRProblem
from gpu.riccati.problem.state_matrix import EPS, StateMatrix, factor
from gpu.riccati.problem.weights import Weight
from skfem_adini.ground.arguments import choice, integer
from skfem_adini.ground.arrays import namespace, to_host


class _Limits(NamedTuple):  # limits of the method
    copies: int = 100  # most eigenvalues computed instead of those that no input reaches
    extra: int = 6  # eigenvalues beyond those wanted, so that no +- or conjugate pair is split
    all: int = 128  # order of the Hamiltonian up to which all eigenvalues are computed
    restarts: int = 300  # most restarts of Krylov-Schur; usually a few dozen suffice
    unreached: float = 1e-8  # least |B^T y| / (|B| |y|) of a vector that contributes to the gain
    same: float = 1e-6  # relative difference of moduli up to which eigenvalues are grouped


LIMITS = _Limits()


def solve(
    problem: LQRProblem,
    *,
    modes: int = 100,
    pi: str = "symmetric",
    start: str | None = None,
    inner: Any = None,
    tol: float = 1e-8,
) -> Found:
    """The gain and, for ``pi="symmetric"``, a factor of the value, of a reduced model.

    V, Y is a real basis of the invariant subspace of the stable ones among the `modes` eigenvalues
    of the Hamiltonian nearest to zero. "printed": :math:`K = R^{-1} B^T Y (V^T M V)^{-1} V^T M`
    (dissertation, Algorithm 5, M is `inner`); "symmetric": :math:`K = R^{-1} B^T Y (Y^T E V)^{-1}
    Y^T E` (Amodei and Buchot 2010), more accurate. The Krylov space starts at "random" to find all
    modes, or at "inputs".
    """
    state, B, weight = problem.state, problem.input, problem.weight
    choice("pi", pi, ("printed", "symmetric"))
    default = "random" if pi == "printed" else "inputs"
    start = default if start is None else choice("start", start, ("random", "inputs"))
    integer("modes", modes, 2)
    if inner is not None and pi != "printed":
        raise InputError('inner: only pi="printed" has an inner product')
    if state.E is not None and factor(state.E) is None:
        raise InputError(SINGULAR_MASS)
    if problem.N is not None:
        plain = without_cross_term(problem)
        found = solve(plain, modes=modes, pi=pi, start=start, inner=inner, tol=tol)
        return found._replace(gain=problem.gain(found.gain))
    V, Y, solves = stable_subspace(state, B, weight, min(int(modes), 2 * state.n), tol, start)
    xp = state.xp
    info = {"rank": int(V.shape[1]), "solves": solves}
    if pi == "printed":
        # With V = U T: otherwise the condition number of V^T M V would be the square of that of V.
        U, T = xp.linalg.qr(V)
        MU = U if inner is None else Weight(state, inner).apply(U)
        gram = to_host(U.T @ MU)
        solved = linalg.solve_triangular(to_host(T), to_host(Y.T @ B), trans="T")
        solved = linalg.solve((gram + gram.T) / 2, solved, assume_a="pos").T
        return Found(problem.gain(xp.asarray(solved) @ MU.T), None, info)
    return of_subspace(problem, V, Y, info)


def of_subspace(problem: LQRProblem, V: Any, Y: Any, info: dict[str, Any]) -> Found:
    """The value ``F F^T = Y (Y^T E V)^-1 Y^T``, without eigenvectors of Y^T E V whose eigenvalues
    are rounding, below 1e-13 of the largest, and its gain."""
    state, xp = problem.state, problem.xp
    gram = to_host(Y.T @ state.mass(V))
    values, vectors = np.linalg.eigh((gram + gram.T) / 2)
    kept = values > 1e-13 * values.max(initial=0.0)
    F = Y @ xp.asarray(vectors[:, kept] / np.sqrt(values[kept]))
    gain = problem.gain((problem.input.T @ F) @ state.mass_transposed(F).T)
    return Found(gain, LowRankValue(F, xp.eye(F.shape[1])), info)


def stable_subspace(
    state: StateMatrix, B: Any, weight: Weight, modes: int, tol: float, start: str
) -> tuple[Any, Any, int]:
    """V and Y, shapes (n, r), of the stable ones among the wanted eigenvalues; number of solves."""
    # rho makes the off-diagonal blocks equally large. Otherwise x or y would be so small in every
    # vector (x, y) that it would consist of rounding.
    cost = weight.scale()
    reach = float((B * B).sum()) ** 0.5
    rho = cost**0.5 / reach if cost > 0.0 and reach > 0.0 else 1.0
    state = copy(state)
    state.explicit = True
    inverse = InverseHamiltonian(state, B, weight, scale=rho)
    n, xp = state.n, state.xp
    wanted, limit = modes, min(modes + LIMITS.copies, 2 * n)
    if start == "inputs" and state.kind == "dense":
        wanted = min(2 * modes, limit)
    while True:
        w, z = _largest(inverse, B, wanted, tol, start)
        reached = _reached(B, z[n:]) if start == "inputs" else np.ones(len(w), dtype=bool)
        counted = int(reached.sum())
        if counted >= modes or wanted >= limit or len(w) >= 2 * n:
            break
        # Rounding adds eigenvectors that no input reaches: they are kept, but not counted.
        more = wanted * (modes / max(counted, 1)) ** 1.5
        wanted = min(limit, int(max(more, wanted)) + LIMITS.extra)
    size = np.abs(w)
    taken = np.ones(len(w), dtype=bool)
    if counted > modes:
        taken = size >= size[np.flatnonzero(reached)[modes - 1]] * (1.0 - LIMITS.same)
    axis = np.abs(w.real) <= 1e-9 * size
    # Eigenvalues that are zero up to rounding: single ones, then double ones, which rounding splits
    # into a pair of the size of its square root. For an operator, whose size is NaN, no test.
    scale = EPS * state.size() / (1.0 if state.E is None else StateMatrix(state.E).size())
    axis |= size * 10.0 * scale >= 1.0
    axis |= (size**2 * 10.0 * scale >= size.min()) & (np.abs(w.real) <= 1e-6 * size)
    if np.any(axis & taken):
        raise RiccatiError(
            f"the Hamiltonian has an eigenvalue {1 / w[axis & taken][0]:.6g} on the imaginary "
            "axis: that mode cannot be stabilised or is not seen by Q"
        )
    # The matrix is real, so pairs are exactly conjugate, however small their imaginary parts.
    upper, real = taken & (w.real < 0.0) & (w.imag >= 0.0), w.imag == 0.0
    basis = xp.concatenate(
        [
            z[:, xp.asarray(np.flatnonzero(upper))].real,
            z[:, xp.asarray(np.flatnonzero(upper & ~real))].imag,
        ],
        axis=1,
    )
    if basis.shape[1] == 0:
        raise NotConverged(f"none of {modes} eigenvalues is stable: raise modes")
    basis = xp.linalg.qr(basis)[0]
    return basis[:n], rho * basis[n:], inverse.solves


def _reached(B: Any, Y: Any) -> np.ndarray:
    """A mask of the columns of Y that contribute to the gain ``B^T Y``."""
    norm = namespace(B).linalg.norm
    seen, size = norm(B.T @ Y, axis=0), float(norm(B)) * norm(Y, axis=0)
    return np.asarray(to_host(seen > LIMITS.unreached * size))


def _largest(
    inverse: InverseHamiltonian, B: Any, modes: int, tol: float, start: str
) -> tuple[Any, Any]:
    """Eigenvalues of largest modulus of the inverse and their vectors, a few more than `modes`."""
    n, xp = inverse.state.n, inverse.state.xp
    wanted = min(modes + LIMITS.extra, 2 * n)
    if 2 * n <= max(LIMITS.all, 2 * wanted + 23):
        return _all(inverse)
    rng = np.random.default_rng(0)
    seed = xp.asarray(rng.standard_normal(2 * n))
    if start == "inputs":
        driven = B @ xp.asarray(rng.standard_normal((B.shape[1], 2)))
        seed = xp.concatenate([driven[:, 0], inverse.state.mass_transposed(driven[:, 1])])
    found = krylov_schur(
        inverse.apply,
        2 * n,
        Wanted(wanted, np.abs, tol),
        Limits(2 * wanted + 20, maxiter=LIMITS.restarts, challenge=start == "random"),
        dtype=np.dtype(float),
        xp=xp,
        start=seed,
    )
    if len(found.values) < min(modes, 2 * n):
        raise NotConverged(
            f"{len(found.values)} of {modes} eigenvalues converged in {found.restarts} restarts: "
            "ask for fewer, or loosen tol"
        )
    w, y = linalg.eig(found.T)
    order = best_first(w, np.abs, len(w), True)
    return w[order], found.basis.combine(y[:, order])


def _all(inverse: InverseHamiltonian) -> tuple[Any, Any]:
    xp = inverse.state.xp
    full = to_host(inverse.apply(xp.eye(2 * inverse.state.n)))
    w, z = np.linalg.eig(full)
    order = best_first(w, np.abs, len(w), True)
    return w[order], xp.asarray(z[:, order])
