"""The checked data of a linear-quadratic problem, and its form without E, R and the cross term."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg, sparse

from gpu.arrays.dense import device_solver
from gpu.arrays.sparse_factor import is_positive_definite, structurally_regular
from gpu.errors import InputError, NotConverged
from gpu.riccati.problem.state_matrix import EPS, StateMatrix, stored, symmetric
from gpu.riccati.problem.weights import Weight
from skfem_adini.ground.arguments import is_finite_number, shown, unmasked
from skfem_adini.ground.arrays import namespace, to_host


class _Limits(NamedTuple):  # tolerances of the arguments
    asymmetry: float = 1e-12  # of R or Q, relative to the largest entry: rounding
    definiteness: float = 1e-12  # shift relative to the diagonal that makes Q definite
    largest: float = 1e150  # larger entries have squares or sums that overflow


LIMITS = _Limits()


NOT_SEMIDEFINITE = (
    "Q is not positive semidefinite (with N: [[Q, N], [N.T, R]] is not): some states would have a "
    "negative cost"
)

SINGULAR_MASS = "E is singular: descriptor systems are not solved here"


@dataclass(frozen=True)
class LQRProblem:
    """The integral of :math:`x^T Q x + 2 x^T N u + u^T R u` where :math:`E x' = A x + B u`."""

    state: StateMatrix  # A and E
    B: Any  # (n, m), as given
    input: Any  # (n, m): B L^-T, for inputs of unit cost (the sum of their squares)
    root: Any  # (m, m): L of R = L diag(signs) L^T, triangular for a definite R
    weight: Weight  # Q
    N: Any  # (n, m) or None
    R: np.ndarray  # (m, m)
    units: Any = None  # `Units` of the numbers, if different from the arguments'
    signs: Any = 1.0  # (m,), of -1 and 1, where R is indefinite
    discrete: bool = False  # x_{k+1} in place of x', a sum in place of the integral

    @property
    def n(self) -> int:
        """Number of states."""
        return self.state.n

    @property
    def xp(self) -> Any:
        """numpy or cupy."""
        return self.state.xp

    @property
    def dense(self) -> bool:
        """Whether A is stored as a full matrix."""
        return self.state.kind == "dense"

    @property
    def squares_fit(self) -> bool:
        """Whether squares of the entries of a dense A and of B stay in range."""
        return max(float(abs(M).max()) for M in (self.state.A, self.B)) <= LIMITS.largest

    @cached_property
    def unit(self) -> Any:
        """Scale factors of the states, shape (n,), that balance a dense problem's Hamiltonian."""
        return balance(self.standard())

    def gain(self, scaled: Any) -> Any:
        """``K = L^-T J (K~ + L^-1 N^T)``, shape (m, n), from K~, the gain for inputs of unit cost
        (without their signs J)."""
        inverse = self.xp.asarray(inverse_of(self.root))
        if self.N is not None:
            scaled = scaled + inverse @ self.N.T
        return (inverse * self.signs).T @ scaled

    def gain_of(self, value: Any) -> Any:
        """``K = R^-1 (B^T S E + N^T)``, shape (m, n), of a dense or low-rank S."""
        if not hasattr(value, "shape"):
            value = self.xp.asarray(value)
        return self.gain(self.state.mass_transposed(value.T @ self.input).T)

    def of_unit_cost(self, gain: Any) -> Any:
        """The gain K~ for inputs of unit cost, after the feedback R^-1 N^T of the standard form."""
        gain = self.xp.asarray(self.root.T) @ gain
        if self.N is not None:
            inverse = self.xp.asarray(np.linalg.inv(self.root))
            gain = gain - (inverse.T * self.signs).T @ self.N.T
        return gain

    def rate(self, value: complex) -> complex:
        """A pole, real or complex, in the units of the arguments."""
        exponent = 0 if self.units is None else self.units.rate
        half = exponent // 2
        return value * 2.0**half * 2.0 ** (exponent - half)

    def entries(self) -> LQRProblem:
        """The same problem, with a dense A if it is an operator."""
        if self.state.kind != "operator":
            return self
        E = None if self.state.E is None else _full(self.state.E)
        return replace(self, state=StateMatrix(self.state.apply(self.xp.eye(self.n)), E))

    def full(self) -> tuple[Any, Any, Any, Any]:
        """A, E, Q, N as dense arrays; E and N may be None."""
        A, E = _full(self.state.A), None if self.state.E is None else _full(self.state.E)
        C, Q = self.weight.C, self.weight.entries
        if C is not None:
            Q = C.T @ C
        else:
            Q = self.weight.apply(self.xp.eye(self.n)) if Q is None else _full(Q)
        return A, E, (Q + Q.T) / 2, self.N

    def standard(self) -> DenseProblem:
        """The equivalent problem without E, R and N, whose solution is :math:`E^T S E`; its A, B
        and Q are :math:`E^{-1}(A - B R^{-1} N^T)`, :math:`E^{-1} B R^{-1/2}` and :math:`Q - N
        R^{-1} N^T`."""
        A, E, Q, N = self.full()
        B = self.input
        if N is not None:
            crossed = N @ self.xp.asarray(inverse_of(self.root).T)
            A = A - (B * self.signs) @ crossed.T
            Q = Q - (crossed * self.signs) @ crossed.T
        if E is not None:
            try:
                moved = solve(E, self.xp.concatenate([A, B], axis=1))
            except np.linalg.LinAlgError:
                raise InputError(SINGULAR_MASS) from None
            A, B = moved[:, : self.n], moved[:, self.n :]
        return DenseProblem(A, B, (Q + Q.T) / 2, self.signs)

    def value_of(self, standard: Any, unit: Any = None) -> Any:
        """The value ``S = E^-T X E^-1`` from the solution X of the balanced standard form."""
        unit = self.unit if unit is None else unit
        standard = standard / unit / unit[:, None]
        if self.state.E is None:
            return standard
        E = _full(self.state.E)
        half = solve(E.T, standard)
        S = solve(E.T, half.T)
        return (S + S.T) / 2


def check_lqr(
    A: Any,
    B: Any,
    Q: Any,
    R: Any,
    N: Any = None,
    E: Any = None,
    *,
    factored: bool = False,
    inverse: Any = None,
    definite: bool = True,
    discrete: bool = False,
) -> LQRProblem:
    """Check the arguments of `gpu.lqr` and make them one problem. Without `definite` R may be any
    symmetric matrix that is not singular, and of a discrete problem any at all."""
    state = StateMatrix(numbers("A", A), numbers("E", E), inverse)
    n, xp = state.n, state.xp
    B = columns("B", B, n, xp)
    m = B.shape[1]
    scaled = state.kind == "dense" and not (hasattr(Q, "matvec") and not hasattr(Q, "tocsr"))
    if not scaled and not _size(state) <= LIMITS.largest:
        raise InputError("A is too large, its squares overflow: measure time in other units")
    if not scaled and float(abs(B).max()) > LIMITS.largest:
        raise InputError("B is too large, its squares overflow: measure inputs in other units")
    R_host = _input_cost(R, m)
    root, signs = _root(R_host, definite)
    if root is None and not discrete:
        raise InputError("R is singular to working precision: every input needs a cost")
    scaled_B = None if root is None else B @ xp.asarray(inverse_of(root).T)
    N = None if N is None else columns("N", N, n, xp)
    if N is not None and N.shape != B.shape:
        raise InputError(f"N has shape {N.shape}: expected {B.shape}, that of B")
    if N is not None and not bool(xp.any(N)):
        N = None
    if factored:
        weight = Weight(state, C=_factor("Q", Q, n, xp))
    else:
        weight = Weight(state, _weight_argument(Q, n))
    there = signs if isinstance(signs, float) else xp.asarray(signs)
    problem = LQRProblem(
        state, B, scaled_B, root, weight, N, R_host, signs=there, discrete=discrete
    )
    known = problem.dense or (state.E is not None and state.E.ndim == 1) or sparse.issparse(state.E)
    if state.E is not None and known and not _regular(state.E, xp, problem.dense):
        raise InputError(SINGULAR_MASS)
    return problem


def _root(R: np.ndarray, definite: bool) -> tuple[Any, Any]:
    """L and signs of ``R = L diag(signs) L^T``; None for L if R is singular."""
    m = len(R)
    try:
        root = np.linalg.cholesky(R)
        regular = np.diag(root).min() > m * EPS * np.diag(root).max()
        return (root if regular else None), 1.0
    except np.linalg.LinAlgError:
        if definite:
            raise InputError("R is not positive definite: every input needs a cost") from None
    values, vectors = np.linalg.eigh(R)
    size = np.abs(values)
    if not size.min() > m * EPS * size.max():
        return None, 1.0
    return vectors * np.sqrt(size), np.sign(values)


def inverse_of(root: np.ndarray) -> np.ndarray:
    """``L^-1``, by substitution where L is triangular."""
    if np.triu(root, 1).any():
        return np.asarray(np.linalg.inv(root))
    return np.asarray(linalg.solve_triangular(root, np.eye(len(root)), lower=True))


def _size(state: StateMatrix) -> float:
    """The largest entry of A; of an operator, of its product with a random vector."""
    if state.kind != "operator":
        return float(abs(state.A).max())
    vector = state.xp.asarray(np.random.default_rng(0).uniform(-1, 1, state.n))
    return float(abs(state.A.matvec(vector)).max())


def solver_of(M: Any) -> Callable[[Any], Any]:
    """The function ``right -> M^-1 right`` for dense arrays on host or device; `LinAlgError` if M
    is exactly singular."""
    if not isinstance(M, np.ndarray):
        return device_solver(M)
    lapack: Any = linalg.lapack
    lu, pivots, info = lapack.dgetrf(M)
    if info > 0:
        raise np.linalg.LinAlgError("singular matrix")
    return lambda right: lapack.dgetrs(lu, pivots, right)[0]


def solve(M: Any, right: Any) -> Any:
    """``M^-1 right``, see `solver_of`."""
    return solver_of(M)(right)


def _full(M: Any) -> Any:
    if hasattr(M, "toarray"):
        return M.toarray()
    if hasattr(M, "matvec"):
        raise InputError("A is an operator: this method needs its entries")
    return namespace(M).diag(M) if M.ndim == 1 else M


def numbers(name: str, value: Any, complex_too: bool = False) -> Any:
    """An argument as an array of real numbers; matrices and operators are returned as they are."""
    if value is None:
        if name not in ("E", "R"):
            raise InputError(f"{name} is None: expected an array of numbers")
        return None
    unmasked(name, value)
    if callable(value) and not hasattr(value, "shape"):
        raise InputError(f"{name} is a function: wrap it in a LinearOperator, which has a shape")
    if not hasattr(value, "shape") or isinstance(value, np.matrix):
        try:
            value = np.asarray(value)
        except ValueError as error:
            raise InputError(f"{name} is not an array of numbers: {error}") from None
        if value.dtype == object and value.ndim == 0:
            raise InputError(f"{name} is {value}: expected an array of numbers")
    if value.ndim == 0 and not hasattr(value, "matvec"):
        value = value.reshape(1, 1)
    if not hasattr(value, "matvec"):
        _check_kind(name, value, complex_too)
        if value.ndim not in (1, 2) or 0 in value.shape:
            raise InputError(
                f"{name} has shape {value.shape}: expected (n, n), or (n,) for a diagonal, n > 0"
            )
    return value


def _check_kind(name: str, value: Any, complex_too: bool) -> None:
    kind = np.dtype(value.dtype).kind
    if kind == "c" and not complex_too:
        raise InputError(
            f"{name} holds complex numbers: only gpu.care and gpu.dare solve complex problems"
        )
    if kind not in "buifc":
        raise InputError(f"{name} holds {value.dtype}: expected real numbers")


def columns(name: str, value: Any, n: int, xp: Any) -> Any:
    """A dense array with a row for each state, a vector as one column."""
    value = numbers(name, value)
    value = stored(name, value)
    if hasattr(value, "tocsr"):
        value = value.toarray()
    if value.ndim == 1:
        value = value[:, None]
    if value.shape[0] != n:
        raise InputError(f"{name} has shape {value.shape}: expected ({n}, m), a row for each state")
    if xp is not None and namespace(value) is not xp:
        raise InputError(f"{name} and A live on different sides: move one of them")
    return value


def _input_cost(R: Any, m: int) -> np.ndarray:
    if R is None:
        return np.eye(m)
    R = numbers("R", R)
    if hasattr(R, "toarray"):
        R = R.toarray()
    R = to_host(stored("R", R))
    if R.ndim == 1 and len(R) == m:
        R = np.diag(R)
    if R.shape == (1, 1) and m > 1:
        R = float(R[0, 0]) * np.eye(m)
    if R.shape != (m, m):
        raise InputError(f"R has shape {R.shape}: expected ({m}, {m}), a cost for each input")
    _check_symmetric("R", R)
    return (R + R.T) / 2


def _factor(name: str, value: Any, n: int, xp: Any) -> Any:
    C = stored(name, numbers(name, value))
    if C.ndim == 1:
        C = C[None, :]
    if C.shape[1] != n:
        raise InputError(f"{name} has shape {C.shape}: a factor must have {n} columns")
    if namespace(C) is not xp:
        raise InputError(f"{name} and A live on different sides: move one of them")
    return C.toarray() if hasattr(C, "toarray") else C


def _weight_argument(Q: Any, n: int) -> Any:
    if hasattr(Q, "matvec") and not hasattr(Q, "tocsr"):
        return Q
    if isinstance(Q, int | float | np.number) and not isinstance(Q, bool):
        if not is_finite_number(Q):
            raise InputError(f"Q is {shown(Q)}: expected a finite number")
        return Q
    Q = numbers("Q", Q)
    if Q.shape == (1, 1) and n > 1:
        raise InputError(f"Q has shape (1, 1): expected ({n}, {n}), or a number")
    if Q.shape == (n, n):
        Q = stored("Q", Q)
        _check_symmetric("Q", Q)
        if not symmetric(Q):
            Q = (Q + Q.T) / 2
    return Q


def _check_symmetric(name: str, M: Any) -> None:
    wrong = abs(M - M.T).max()
    if float(wrong) > LIMITS.asymmetry * float(abs(M).max()):
        raise InputError(
            f"{name} is not symmetric, |{name} - {name}'| reaches {float(wrong):.1e}: pass "
            f"({name} + {name}.T) / 2 if that is what is meant"
        )


def semidefinite(problem: LQRProblem, always: bool = False) -> bool:
    """Whether the cost of every state and input is nonnegative, as far as entries are stored. If
    `always`, raise `InputError` if not.
    """
    Q, xp = problem.weight.entries, problem.xp
    good = True
    if Q is not None:
        diagonal = Q if Q.ndim == 1 else Q.diagonal()
        good = bool((diagonal >= 0.0).all())
        if good and Q.ndim == 2:
            good = _sparse_semidefinite(Q) if hasattr(Q, "tocsr") else _semidefinite(Q, xp)
    if good and problem.N is not None and problem.dense:
        whole, R = problem.full()[2], xp.asarray(problem.R)
        rows = [[whole, problem.N], [problem.N.T, R]]
        good = _semidefinite(xp.concatenate([xp.concatenate(r, axis=1) for r in rows]), xp)
    if always and not good:
        raise InputError("Q is not positive semidefinite: some states would have a negative cost")
    return good


def check_cost(problem: LQRProblem, S: Any) -> None:
    """Raise if some states would have a negative cost by the dense value S."""
    values = np.linalg.eigvalsh(to_host(S))
    if values[0] >= -1e-9 * np.abs(values).max():
        return
    if semidefinite(problem):
        raise NotConverged(
            "the Riccati solution is not certified: round-off makes the cost of some states "
            f"negative ({values[0]:.1e} of {values[-1]:.1e}); the weights are too far apart"
        )
    raise InputError(
        f"{NOT_SEMIDEFINITE}, and the optimal cost is negative for some states; "
        f"gpu.{'dare' if problem.discrete else 'care'} finds the stabilising solution of its "
        "equation"
    )


def cost_of(problem: LQRProblem, S: Any, x0: Any) -> float:
    """``x0^T E^T S E x0``, for a dense or low-rank S."""
    x = stored("x0", x0)
    if x.shape != (problem.n,):
        raise InputError(f"x0 has shape {x.shape}: it must be {(problem.n,)}")
    z = problem.state.mass(problem.xp.asarray(x))
    return float(z @ (S @ z))


def _semidefinite(M: Any, xp: Any) -> bool:
    """Whether M, scaled to unit diagonal, is definite after a shift of the size of rounding."""
    diagonal = M.diagonal()
    unit = xp.sqrt(xp.where(diagonal > 0.0, diagonal, 1.0))
    scaled = M / unit / unit[:, None]
    places = xp.arange(len(M))
    scaled[places, places] += LIMITS.definiteness * max(1.0, len(M))
    try:
        L = xp.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        return False
    return bool(xp.isfinite(L.diagonal()).all())


def _sparse_semidefinite(Q: Any) -> bool:
    Q = Q if sparse.issparse(Q) else Q.get()
    diagonal = Q.diagonal()
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = sparse.csc_array(Q.multiply(unit).multiply(unit[:, None]))
    shift = LIMITS.definiteness * max(1.0, Q.shape[0])
    return is_positive_definite(scaled + shift * sparse.eye_array(Q.shape[0], format="csc"))


def _regular(E: Any, xp: Any, dense: bool) -> bool:
    if sparse.issparse(E) and not structurally_regular(E):
        return False
    if sparse.issparse(E) and not dense:
        return True
    if E.ndim == 1:
        return bool(xp.all(E != 0.0))
    if xp is not np:
        return True
    full = E.toarray() if hasattr(E, "toarray") else E
    lapack: Any = linalg.lapack
    pivots = np.abs(np.diag(lapack.dgetrf(full)[0]))
    return bool(pivots.min() > 0.0)


class DenseProblem(NamedTuple):
    r"""The standard form :math:`A^T X + X A - X B J B^T X + Q = 0`, dense; J holds the signs. The
    discrete one is :math:`A^T X (I + B J B^T X)^{-1} A - X + Q = 0`."""

    A: Any
    B: Any
    Q: Any
    signs: Any = 1.0

    @property
    def G(self) -> Any:
        """``B J B^T``, exactly symmetric."""
        if isinstance(self.signs, float):
            return self.B @ self.B.T
        G = (self.B * self.signs) @ self.B.T
        return (G + G.T) / 2

    def scaled(self, unit: Any) -> DenseProblem:
        """The same in states x' with ``x = diag(unit) x'``."""
        A, B, Q, signs = self
        both = unit * unit[:, None]
        return DenseProblem(A * unit / unit[:, None], B / unit[:, None], Q * both, signs)


def balance(standard: DenseProblem, sweeps: int = 12) -> Any:
    r"""Powers of two s, shape (n,), for which :math:`x = \mathrm{diag}(s) x'` balances the sums of
    rows and columns of the Hamiltonian (James, Langou and Lowery 2014). They include the diagonal,
    so that much smaller entries, mostly rounding, do not count."""
    A, _, Q, _ = standard
    xp = namespace(A)
    inner, G, Q = abs(A), abs(standard.G), abs(Q)
    log = xp.zeros(len(A))
    for _ in range(sweeps):
        s = xp.exp2(log)
        rising = (inner.T @ (1.0 / s)) * s + (Q @ s) * s
        falling = (inner @ s) / s + (G @ (1.0 / s)) / s
        known = (rising > 0.0) & (falling > 0.0)
        ratio = xp.where(known, falling, 1.0) / xp.where(known, rising, 1.0)
        log = xp.clip(log + 0.25 * xp.log2(ratio), -300.0, 300.0)
    return xp.exp2(xp.round(log))


def scaled_hamiltonian(standard: DenseProblem, unit: Any) -> tuple[Any, Any, Any]:
    """The blocks A, G, Q of the Hamiltonian balanced with the scale factors `unit`."""
    scaled = standard.scaled(unit)
    return scaled.A, scaled.G, scaled.Q
