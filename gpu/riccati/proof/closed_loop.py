"""The closed loop of a gain: its matrix in balanced units, its poles and its stability."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from gpu.arrays.dense import cholesky
from gpu.errors import GpuError, InputError, NotConverged, RiccatiError
from gpu.riccati.problem.lqr_problem import (
    DenseProblem,
    LQRProblem,
    balance,
    scaled_hamiltonian,
    solve,
)
from gpu.riccati.problem.state_matrix import EPS, Factors, StateMatrix, woodbury
from gpu.riccati.proof.lyapunov import SCHUR, LyapunovSolver, cayley_shift, lyapunov_solver
from skfem_adini.ground.arrays import namespace, to_host


class _Limits(NamedTuple):  # limits of poles and of bounds for them
    poles: int = 12  # number of poles nearest to zero that are computed, if not all
    large: int = 100_000  # order from which products with the basis cost more than applications
    restarts: int = 30  # at most, for these poles
    tolerances: tuple[float, float] = (1e-8, 1e-4)  # the second number for poles in a cluster
    left: float = 1e-3  # relative to the matrix: no eigenvalues so far left meet on the axis
    outside: float = 1e-6  # distance from the unit circle beyond which an eigenvalue lies outside
    roundings: float = 1e2  # error of a pole in rounding errors times its condition
    squares: float = 0.05  # second order of a Newton step over the first if it converges
    fractions: tuple[float, ...] = (1 - 1e-3, 0.9, 0.5, 0.1, 1e-2, 1e-4, 0.0)  # of `likely`
    dense: int = 1500  # order up to which all poles are computed
    proved: int = 600  # the same if stability is proved without them
    examined: int = 1500  # order up to which modes are examined
    named: int = 200  # order up to which the dense method names the mode that causes a failure
    worst: int = 24  # number of modes examined, beginning with the least stable
    condition: float = 1e10  # of the small matrix by which a feedback changes solves with A
    singular: float = 1e-12  # singular value in Hautus' test, over the matrix, that counts as zero
    axis: float = 1e-6  # distance from the axis, over the matrix, of a mode that may lie on it
    moved: float = 10.0  # rounding errors of the matrix that may move such a mode to the axis


LIMITS = _Limits()


@dataclass(frozen=True)
class DenseLoop:
    """``E^-1 (A - B K)`` in balanced units."""

    matrix: Any  # shape (n, n)
    rounding: float  # error of an entry from round-off of A and of the feedback
    value: Any = None  # (n, n): the Riccati solution in the same units, if known
    doubt: Any = None  # (B, W, T): inputs, bound of the Riccati residual, size of its terms
    parts: Any = None  # (A, B, K), the matrix being A - B K

    @cached_property
    def poles(self) -> np.ndarray:
        """Eigenvalues, rightmost first: all of a small or symmetric matrix, else those of the few
        nearest to zero that converge (poles in a cluster may have fewer digits, or be missing).
        """
        return self._poles_and_tolerance[0]

    @property
    def tolerance(self) -> float:
        """Relative distance of a matrix of which the poles are exact."""
        return self._poles_and_tolerance[1]

    @cached_property
    def _poles_and_tolerance(self) -> tuple[np.ndarray, float]:
        n, tolerance = len(self.matrix), EPS
        if n <= SCHUR and isinstance(self.matrix, np.ndarray):
            values = self.lyapunov.poles
            assert values is not None
        elif n <= LIMITS.dense:
            values = np.linalg.eigvals(to_host(self.matrix))
        elif self._symmetric:
            values = to_host(namespace(self.matrix).linalg.eigvalsh(self.matrix)) + 0j
        else:
            values = np.zeros(0, dtype=complex)
            for tolerance in LIMITS.tolerances:
                try:
                    values = _nearest(self.matrix, sigma=0.0, k=LIMITS.poles, tol=tolerance)
                except GpuError:
                    continue
                break
        return values[np.argsort(-values.real, kind="stable")], tolerance

    @property
    def whole(self) -> bool:
        """Whether all poles are known."""
        return len(self.poles) == len(self.matrix)

    @cached_property
    def _symmetric(self) -> bool:
        xp = namespace(self.matrix)
        return float(xp.linalg.norm(self.matrix - self.matrix.T)) <= EPS * float(
            xp.linalg.norm(self.matrix)
        )

    @cached_property
    def lyapunov(self) -> LyapunovSolver:
        """Lyapunov equations of this matrix."""
        return lyapunov_solver(self.matrix)

    @property
    def abscissa(self) -> float:
        """The largest real part of a known pole; if none is known, the bound."""
        return float(self.poles[0].real) if len(self.poles) else self.bound

    @cached_property
    def bound(self) -> float:
        """A number right of which no pole lies, proved unless all are known; else infinity."""
        if self.whole:
            return self.abscissa
        likely = float(self.poles[0].real) if len(self.poles) else -np.inf
        if not likely < 0.0:
            return np.inf
        magnitude = self._magnitude()
        bound = np.inf
        if self.value is not None:
            bound = proven_bound(self.matrix, self.value, magnitude, likely)
        if not bound < 0.0:
            # Fast and slow modes have equal weight in the Lyapunov function with this derivative.
            A, xp = self.matrix, namespace(self.matrix)
            W, places = A.T @ A, xp.arange(len(A))
            W[places, places] += cayley_shift(A) ** 2
            try:
                bound = proven_bound(A, self.lyapunov(W), magnitude, likely)
            except np.linalg.LinAlgError:
                return np.inf
        return bound

    def _magnitude(self) -> Any:
        """Products with a matrix whose entries are no smaller than those of |A| + |B| |K|."""
        if self.parts is None:
            M = abs(self.matrix)
            return (lambda v: M @ v), (lambda v: M.T @ v)
        A, B, K = (abs(M) for M in self.parts)
        return (lambda v: A @ v + B @ (K @ v)), (lambda v: A.T @ v + K.T @ (B.T @ v))

    def is_stable(self) -> bool:
        """Whether every pole lies left of the imaginary axis, beyond round-off."""
        if self.whole:
            if not np.isfinite(self.poles).all():
                return False
            return self.abscissa < -self.rounding and not self._on_the_axis()
        return self.bound < 0.0

    @cached_property
    def newton(self) -> tuple[float, float]:
        """Relative size of Newton's next step, and the ratio of the step after it to this one."""
        if self.doubt is None or len(self.matrix) > SCHUR:
            return np.nan, 0.0
        return self._step(self.doubt[1])

    def _step(self, W: Any) -> tuple[float, float]:
        norm, B = namespace(self.matrix).linalg.norm, self.doubt[0]
        first = self.lyapunov(W)
        reach = first @ B
        second = self.lyapunov(reach @ reach.T)
        size = float(norm(first))
        return size / (float(norm(self.value)) or 1.0), float(norm(second)) / (size or 1.0)

    def _on_the_axis(self) -> bool:
        """Whether a Riccati solution of this accuracy may have a pole on the axis. If eigenvalues
        of the Hamiltonian meet there, a Newton step is half of the one before instead of its
        square, and the second order of a step is a quarter of it."""
        return self._near() and not self.newton[1] <= LIMITS.squares

    def is_sensitive(self) -> bool:
        """Whether rounding of the data may put a pole on the axis, even for an exact value."""
        return self._near() and not self._step(EPS * self.doubt[2])[1] <= LIMITS.squares

    def _near(self) -> bool:
        if self.doubt is None or len(self.matrix) > SCHUR:
            return False
        return self.abscissa >= -LIMITS.left * float(
            namespace(self.matrix).linalg.norm(self.matrix)
        )


def closed_loop_of(
    problem: LQRProblem,
    standard: DenseProblem,
    unit: Any,
    S: Any = None,
    K: Any = None,
    residual: Any = None,
    extended: bool = False,
) -> DenseLoop:
    """The closed loop of a dense problem with S, or with the gain K, in the given units.
    `residual`, shape (n, n), is that of S in the equation; `extended`: its own rounding does not
    matter."""
    xp = problem.xp
    value = doubt = None
    if K is None:
        E = problem.full()[1]
        Y = S if E is None else E.T @ S @ E
        gain = (standard.B * standard.signs).T @ Y
        value = Y * unit * unit[:, None]
    else:
        gain = problem.of_unit_cost(K)
    (A, B, Q, _), gain = standard.scaled(unit), gain * unit
    if value is not None and len(A) <= LIMITS.dense:
        W: Any = xp.zeros((1, 1)) if residual is None else residual * unit * unit[:, None]
        half = abs(value @ A)
        terms = half + half.T + abs(gain.T @ gain) + abs(Q)
        doubt = (B, W if extended else EPS * terms + abs(W), terms)
    loop = A - B @ gain
    if loop.dtype != np.float64:
        loop, gain = loop.astype(float), gain.astype(float)
        value = None if value is None else value.astype(float)
        doubt = None if doubt is None else tuple(M.astype(float) for M in doubt)
    rounding = 4 * EPS * float(xp.linalg.norm(A) + xp.linalg.norm(B) * xp.linalg.norm(gain))
    return DenseLoop(loop, rounding, value, doubt, (A, B, gain))


def dense_loop(problem: LQRProblem, K: Any) -> DenseLoop:
    """The closed loop of any problem whose entries can be stored, with the gain K."""
    standard = problem.standard()
    return closed_loop_of(problem, standard, problem.unit, K=K)


def nearest_poles(state: StateMatrix, B: Any, K: Any) -> np.ndarray:
    """The poles of ``E^-1 (A - B K)`` nearest to zero, rightmost first, by solves with A alone."""
    shift, factors = 0.0, state.factor()
    for digits in (None, -8, -6, -4):
        if factors is not None:
            closed = woodbury(factors, B, K.T, LIMITS.condition)
            if closed is not None:
                return _poles_by(closed, state, shift)
        if state.kind == "operator":
            raise GpuError("the closed loop of an operator with a pole at zero is not examined")
        if digits is None:
            # A has a mode at zero that the feedback has moved: factor the closed loop itself.
            closed = state.factor_updated(B, K.T)
            if closed is not None:
                return _poles_by(closed, state, 0.0)
            continue
        shift = 10.0**digits * (state.size() or 1.0)
        factors = state.factor(shift)
    raise GpuError("the closed loop could not be factored near zero")


def unstable_pole(state: StateMatrix, B: Any, K: Any, nearest: float) -> complex | None:
    r"""A pole of the loop right of the axis, by more than rounding can move it, if Arnoldi steps
    find one. Eigenvalues :math:`(\lambda + s) / (\lambda - s)` of :math:`(A_c + s E)(A_c - s
    E)^{-1}`, s > 0, outside the unit circle belong to such poles; `nearest` is the modulus of a
    slow pole.
    """
    xp, n = state.xp, state.n
    x = xp.asarray(np.random.default_rng(1).standard_normal(n))
    fast = float(xp.linalg.norm(state.apply(x)) / xp.linalg.norm(state.mass(x)))
    slow = min(max(nearest, 1e-8 * fast), fast)
    if state.kind == "operator" or not slow > 0.0:
        return None
    for part in (1 / 3, 2 / 3):
        s = slow * (fast / slow) ** part
        factors = state.factor(s)
        closed = None if factors is None else woodbury(factors, B, K.T, LIMITS.condition)
        if closed is None:
            continue
        theta = _outermost(_inverse(closed, state), s, x)
        if theta is None or not abs(theta) > 1.0 + LIMITS.outside:
            continue
        pole = s * (theta + 1.0) / (theta - 1.0)
        if pole.real > _doubt(state, B, K, pole):
            return complex(pole)
    return None


def _outermost(inverse: Any, s: float, x: Any) -> complex | None:
    """The eigenvalue of largest modulus of ``I + 2 s inverse``, if it converges at once."""
    from gpu.eigenvalues.eigs import eigs

    try:
        found = eigs(
            lambda v: v + 2.0 * s * inverse(v),
            k=2, ncv=24, v0=x, tol=1e-8, maxiter=2, return_eigenvectors=False,
        )  # fmt: skip
    except NotConverged as error:
        found = error.eigenvalues
    except GpuError:
        return None
    found = np.zeros(0) if found is None else to_host(found)
    return found[np.argmax(np.abs(found))] if len(found) else None


def _doubt(state: StateMatrix, B: Any, K: Any, pole: complex) -> float:
    """A bound of the shift of a pole by rounding: its condition, from left and right vectors."""
    xp, n = state.xp, state.n
    factors = state.factor(pole * (1.0 + 1e-9))
    closed = None if factors is None else woodbury(factors, B, K.T, LIMITS.condition)
    if closed is None:
        return 0.0
    x = y = xp.asarray(np.random.default_rng(1).standard_normal(n)) + 0j
    for _ in range(3):
        x, y = closed.solve(state.mass(x)), closed.solve_transposed(state.mass_transposed(y))
        x, y = x / xp.linalg.norm(x), y / xp.linalg.norm(y)
    size = (state.size() + float(abs(B).max()) * float(abs(K).max())) * n**0.5
    cosine = abs(complex((y * state.mass(x)).sum()))
    return LIMITS.roundings * EPS * size / max(cosine, 1e-300)


def _inverse(closed: Factors, state: StateMatrix) -> Any:
    """``x -> (A - B K - s E)^-1 E x`` by factors of the first."""
    return lambda x: closed.solve(state.mass(x))


def _poles_by(closed: Factors, state: StateMatrix, shift: float) -> np.ndarray:
    """Poles nearest to `shift`, of a loop by the factors of its shifted matrix."""
    n = state.n
    start = state.xp.asarray(np.random.default_rng(0).standard_normal(n))
    few = LIMITS.poles // 3
    options = {"k": few, "ncv": 4 * few} if n >= LIMITS.large else {"k": min(LIMITS.poles, n)}
    theta = _nearest(_inverse(closed, state), v0=start, **options)
    poles = shift + 1.0 / theta
    return poles[np.argsort(-poles.real, kind="stable")]


def _nearest(matrix: Any, tol: float = LIMITS.tolerances[0], **options: Any) -> np.ndarray:
    """The requested eigenvalues that converge in a few restarts. Copies of a repeated one may never
    converge, and the missing one may be the nearest: so those found with a looser tolerance are
    added."""
    from gpu.eigenvalues.eigs import eigs

    found = np.zeros(0, dtype=complex)
    for looser in (tol, *(other for other in LIMITS.tolerances if other > tol)):
        try:
            more = eigs(
                matrix, return_eigenvectors=False, maxiter=LIMITS.restarts, tol=looser, **options
            )
        except NotConverged as error:
            if error.eigenvalues is None or not len(error.eigenvalues):
                if looser == LIMITS.tolerances[-1] and not len(found):
                    raise
                continue
            more, complete = to_host(error.eigenvalues), False
        else:
            more, complete = to_host(more), True
        known = np.abs(more[:, None] - found).min(axis=1, initial=np.inf)
        found = np.concatenate([found, more[known > 10 * looser * np.abs(more)]])
        if complete:
            break
    return found


def proven_bound(A: Any, P: Any, magnitude: Any, likely: float) -> float:
    r"""A number right of which no eigenvalue of A lies; infinity if symmetric P proves none.

    If P and :math:`-(A^T P + P A) - 2\mu P` are positive definite, every real part is below
    :math:`-\mu` (Lyapunov). Both are shown by Cholesky factorisations after bounds of all rounding
    errors are subtracted (Demmel 1989, Rump 2006). `magnitude` multiplies by M and M^T, ``|A| <=
    M``; A is known to ``n EPS M``. :math:`\mu` is a fraction of `likely`, an estimate of the
    abscissa.
    """
    xp, n = namespace(A), len(A)
    half = P @ A
    M = -(half + half.T)
    del half
    diagonal, own = M.diagonal(), P.diagonal()
    if not bool((diagonal > 0.0).all()) or not bool((own > 0.0).all()):
        return np.inf
    if not _definite(P, xp.sqrt(own), 0.0):
        return np.inf
    unit = xp.sqrt(diagonal)
    v, size = 1.0 / unit, abs(P)
    rows = size @ magnitude[0](v) + magnitude[1](size @ v)
    error = 2.0 * (n + 2) * EPS * float((rows / unit).max())
    del size
    steepest = float((diagonal / own).min()) / 2.0
    steepest = min(steepest, -likely) if likely < 0.0 else steepest
    for fraction in LIMITS.fractions:
        mu = fraction * steepest
        if _definite(M - 2.0 * mu * P if mu else M, unit, error):
            return -mu
    return np.inf


def _definite(M: Any, unit: Any, error: float) -> bool:
    """Whether M is positive definite, although ``M / unit / unit^T`` is wrong by ``error``."""
    xp, n = namespace(M), len(M)
    if not np.isfinite(error):
        return False
    scaled = M / unit / unit[:, None]
    places = xp.arange(n)
    # Cholesky factors are those of a matrix within (n + 2) EPS times the diagonal, entry by entry.
    scaled[places, places] -= error + n * (n + 2) * EPS
    try:
        L = cholesky(xp.ascontiguousarray(scaled))
    except np.linalg.LinAlgError:
        return False
    return bool(xp.isfinite(L.diagonal()).all())


def explain(problem: LQRProblem) -> RiccatiError | None:
    """The error of `named`, or that of an eigenvalue on the imaginary axis, or None."""
    found = named(problem)
    standard = _standard(problem)
    if found is not None or standard is None:
        return found
    values, size = _of_the_pencil(problem, standard)
    distance = np.abs(_beyond(problem, values))
    place = int(np.argmin(distance))
    reach = 1.0 if problem.discrete else abs(values[place])
    if distance[place] > max(LIMITS.axis * reach, 1e3 * EPS * size):
        return None
    value, off = problem.rate(values[place]), abs(problem.rate(distance[place]))
    value = complex(value.real if problem.discrete else 0.0, abs(value.imag))
    return RiccatiError(
        f"the {'symplectic pencil' if problem.discrete else 'Hamiltonian'} has the eigenvalue "
        f"{_shown(value)} on the {_border(problem)} (to {off:.1e}): there is no stabilising "
        "solution, or none that double precision can tell",
        eigenvalue=value,
    )


def _of_the_pencil(problem: LQRProblem, standard: DenseProblem) -> tuple[np.ndarray, float]:
    """The eigenvalues of the Hamiltonian, or of the symplectic pencil, and the size of either."""
    A, G, Q = (to_host(M) for M in scaled_hamiltonian(standard, balance(standard)))
    if not problem.discrete:
        H = np.block([[A, -G], [-Q, -A.T]])
        return np.linalg.eigvals(H), float(np.linalg.norm(H))
    eye, zero = np.eye(len(A)), np.zeros_like(A)
    values = linalg.eigvals(np.block([[A, zero], [-Q, eye]]), np.block([[eye, G], [zero, A.T]]))
    return values[np.isfinite(values)], 1.0


def _beyond(problem: LQRProblem, values: np.ndarray) -> np.ndarray:
    """How far eigenvalues lie right of the imaginary axis, or outside of the unit circle."""
    return np.asarray(np.abs(values) - 1.0 if problem.discrete else values.real)


def _border(problem: LQRProblem) -> str:
    return "unit circle" if problem.discrete else "imaginary axis"


def named(problem: LQRProblem) -> RiccatiError | None:
    r"""The error that names a mode not stabilisable, as :math:`(A - \lambda E, B)` loses rank, or
    on the imaginary axis not detectable, as :math:`(A - \lambda E; Q)` does (Hautus 1969)."""
    standard = _standard(problem)
    if standard is None:
        return None
    A, B, Q = (to_host(M) for M in standard[:3])
    return _not_stabilisable(problem.entries(), B) or _not_detectable(problem, A, Q)


def _standard(problem: LQRProblem) -> DenseProblem | None:
    if problem.n > LIMITS.examined:
        return None
    try:
        return problem.entries().standard()
    except (InputError, np.linalg.LinAlgError):
        return None


def _not_stabilisable(problem: LQRProblem, B: np.ndarray) -> RiccatiError | None:
    # Feedback does not change this, so N is omitted: eliminating it could hide A in round-off.
    A, E, _, _ = problem.full()
    A = to_host(A if E is None else solve(E, A))
    A, own = _balanced(A)
    B = B / own[:, None]
    for value, size, _ in _unstable(problem, A):
        if _loses_rank(A - value * np.eye(len(A)), B, size):
            value = problem.rate(value)
            return RiccatiError(
                f"the mode {_shown(value)} of A is not stabilisable: no input moves it; give it "
                "an input, or take it out of the model",
                eigenvalue=complex(value),
                cause="not stabilisable",
            )
    return None


def _not_detectable(problem: LQRProblem, A: np.ndarray, Q: np.ndarray) -> RiccatiError | None:
    A, own = _balanced(A)
    Q = Q * own * own[:, None]
    for value, size, doubt in _unstable(problem, A):
        away = abs(_beyond(problem, np.asarray(value)))
        if away > min(LIMITS.axis * max(abs(value), 0.1 * size), doubt):
            continue
        if _loses_rank((A - value * np.eye(len(A))).T, Q, size):
            value = problem.rate(value)
            return RiccatiError(
                f"the mode {_shown(value)} of A lies on the {_border(problem)} and is not "
                "detectable: Q does not see it, so no optimal feedback moves it; give it a weight",
                eigenvalue=complex(value),
                cause="not detectable",
            )
    return None


def _balanced(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A in units that balance only A; units that also balance Q and B B^T could hide a mode."""
    own = np.diag(linalg.matrix_balance(A, permute=False)[1])
    return A * own / own[:, None], own


def _unstable(problem: LQRProblem, A: np.ndarray) -> list[tuple[complex, float, float]]:
    """The eigenvalues not clearly left of the axis (inside of the circle), the outermost first, the
    size of A, and how far rounding of A may move each eigenvalue: its condition is 1 / cos of the
    angle between its left and right vectors (Wilkinson 1965)."""
    size = max(float(np.linalg.norm(A)), np.finfo(float).tiny)
    values = np.linalg.eigvals(A)
    if not np.any(_beyond(problem, values) >= -LIMITS.axis * size):
        return []
    values, left, right = linalg.eig(A, left=True)
    cosines = np.abs((left.conj() * right).sum(axis=0))
    doubts = LIMITS.moved * EPS * size / np.maximum(cosines, np.finfo(float).tiny)
    beyond = _beyond(problem, values)
    order = np.argsort(-beyond, kind="stable")
    order = order[(values.imag >= 0.0)[order]]
    order = order[(beyond >= -np.minimum(LIMITS.axis * size, doubts))[order]][: LIMITS.worst]
    return [(complex(values[i]), size, float(doubts[i])) for i in order]


def _loses_rank(M: np.ndarray, extra: np.ndarray, size: float) -> bool:
    norm = float(np.linalg.norm(extra))
    scaled = extra * (size / norm) if norm > 0.0 else extra
    smallest = np.linalg.svd(np.hstack([M, scaled]), compute_uv=False)[-1]
    return bool(smallest <= LIMITS.singular * size)


def _shown(value: complex) -> str:
    if value.imag == 0.0:
        return f"{value.real:.6g}"
    return f"{value.real:.6g} +- {abs(value.imag):.6g}i"
