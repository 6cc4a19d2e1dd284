"""The inverse of the Hamiltonian of a linear-quadratic problem, applied by two solves with A."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from gpu.errors import InputError, RiccatiError
from gpu.riccati.problem.lqr_problem import check_lqr
from gpu.riccati.problem.state_matrix import (
    EPS,
    Factors,
    StateMatrix,
    as_sparse,
    factor,
    linear_operator,
    vanishing,
)
from gpu.riccati.problem.weights import Weight
from skfem_adini.ground.arguments import is_finite_number
from skfem_adini.ground.arrays import to_host


class _Limits(NamedTuple):  # relative residuals of the inverse, and the action above each
    rounded: float = 4e-13  # refine by two more solves
    few_digits: float = 1e-9  # factor the whole Hamiltonian
    several_digits: float = 1e-6  # report a mode at zero that no feedback moves
    no_digits: float = 0.1  # no digit is right


LIMITS = _Limits()


def hamiltonian_inverse(
    A: Any, B: Any, Q: Any, R: Any = None, E: Any = None, *, inverse: Any = None, scale: float = 1.0
) -> Any:
    r"""Return :math:`\mathcal H^{-1}\,\mathrm{diag}(E, E^T)` as a linear operator.

    .. math::
        \mathcal H = \begin{pmatrix} A & -\rho B R^{-1} B^T \\ -Q/\rho & -A^T \end{pmatrix}

    (``scale`` is :math:`\rho`, which does not move the eigenvalues). With :math:`B R^{-1/2}` for B,
    :math:`(x, y) = \mathcal H^{-1}(f, g)` is computed in the five steps of the dissertation's
    page 68, whose p is s,

    .. math::
        s = A^{-1} f,\quad C = A^{-1} B,\quad t = I + C^T Q C,\quad
        u = -t^{-1} C^T (g + Q s),\quad x = s + C u,\quad y = -A^{-T}(g + Q x);

    C and t are computed once, so an application takes one solve with A and one with its transpose.
    If A is singular or nearly so, the similarity :math:`y = z + X_0 E x`, :math:`X_0 = Z S Z^T`
    with null vectors Z of A, replaces A and Q by :math:`A - B B^T X_0 E` and

    .. math::
        Q + A^T X_0 E + E^T X_0 A - E^T X_0 B B^T X_0 E:

    a feedback that moves the zero modes, whose rank is their number. If it leaves too few correct
    digits, the whole of :math:`\mathcal H` is factored instead (on the host, and if the entries of
    A and Q are stored).

    Parameters
    ----------
    A : array, shape (n,) or (n, n), sparse matrix, or LinearOperator
        1-D is a diagonal. A LinearOperator needs ``inverse``.
    B : array, shape (n, m) or (n,)
    Q : float, array, shape (n,) or (n, n), sparse matrix, or LinearOperator
        A number is a multiple of the identity, a 1-D array a diagonal.
    R : float, array, shape (m,) or (m, m), or sparse matrix, optional
        Symmetric positive definite, a 1-D array a diagonal; identity by default.
    E : array or sparse matrix, optional
        Invertible; identity by default.
    inverse : LinearOperator, shape (n, n), optional
        For an operator A: ``matvec`` applies :math:`A^{-1}`, ``rmatvec`` its transpose.
    scale : float
        Positive.

    Returns
    -------
    LinearOperator, shape (2 n, 2 n)
        With its transpose (``rmatvec``); of CuPy where A is. Copies and pickles factor anew.

    Raises
    ------
    InputError
        An argument is malformed.
    RiccatiError
        The Hamiltonian is singular, exactly or to working precision: a mode at zero cannot be
        stabilised or is not seen by Q.

    References
    ----------
    K. Ito and X. Xiong's inverse Hamiltonian, in section 6.2.1 of the dissertation.

    Examples
    --------
    >>> import numpy as np
    >>> from gpu import hamiltonian_inverse
    >>> A, B = np.array([0.0, -1.0]), np.ones((2, 1))
    >>> H = np.block([[np.diag(A), -B @ B.T], [-np.eye(2), -np.diag(A)]])
    >>> v = np.arange(1.0, 5.0)
    >>> (H @ hamiltonian_inverse(A, B, 1.0).matvec(v)).round(12)
    array([1., 2., 3., 4.])
    """
    problem = check_lqr(A, B, Q, R, E=E, inverse=inverse)
    return InverseHamiltonian(problem.state, problem.input, problem.weight, scale).operator()


class InverseHamiltonian:
    """The operator of `hamiltonian_inverse`, from checked arguments; `solves` counts solves with A
    and its transpose. It uses `factors` of A, or of ``A - B B^T X0 E`` if A is singular; they are
    None if the null vectors of A are unknown; then the Hamiltonian is factored as a whole."""

    def __init__(self, state: StateMatrix, B: Any, weight: Weight, scale: float = 1.0) -> None:
        if not is_finite_number(scale) or np.iscomplexobj(scale) or not scale > 0.0:
            raise InputError("scale: expected one positive number")
        self.state, self.solves = state, 0
        self._arguments = state, B, weight, scale
        self._B, self._Q, self._scale = B * np.sqrt(scale), weight, scale
        self._refine = False
        self._feedback: _Feedback | None = None
        self.factors: Factors | None = None
        self._whole: Factors | None = None
        unmoved: Exception | None = None
        factors = state.factor()
        if factors is None or _nearly_singular(state, factors):
            try:
                self._feed_back()
            except np.linalg.LinAlgError as error:
                self.factors, unmoved = None, error
        else:
            self._prepare(factors)
            # Digits are lost if A is much closer to singular than H is.
            lost = self._probe()
            if not lost < LIMITS.rounded and state.kind in ("dense", "sparse"):
                kept = dict(self.__dict__)
                try:
                    self._feed_back()
                except np.linalg.LinAlgError:
                    lost = 0.0
                if not self._probe() < lost:
                    self.__dict__.update(kept)
        lost = np.inf if self.factors is None else self._probe()
        if not lost < LIMITS.few_digits and state.xp is np:
            # Without distinguishable null vectors, factor the whole Hamiltonian.
            self._whole = _factor_whole(state, self._B, weight, scale)
            if self._whole is not None and not self._probe() < lost:
                self._whole = None
        if self.factors is None and self._whole is None:
            raise unmoved if isinstance(unmoved, RiccatiError) else RiccatiError(_SINGULAR)
        lost = self._probe()
        if isinstance(unmoved, RiccatiError) and not lost < LIMITS.several_digits:
            raise unmoved
        self._refine = not lost < LIMITS.rounded
        if not lost < LIMITS.no_digits:
            raise RiccatiError(
                "the Hamiltonian has an eigenvalue that is zero to working precision: give that "
                "mode an input and a weight, or take it out of the model"
            )
        self.solves = 0

    def __reduce__(self) -> Any:
        # Factors cannot be copied: a copy is factored anew.
        return type(self), self._arguments

    @property
    def moved(self) -> list[Any]:
        """A list with the matrix Z of the feedback that makes A regular; empty if there is none."""
        return [] if self._feedback is None else [self._feedback.Z]

    def _feed_back(self) -> None:
        self._feedback = _Feedback.over_zero_modes(self.state, self._B, self._weigh)
        assert self._feedback.factors is not None
        self._prepare(self._feedback.factors)

    def _prepare(self, factors: Factors) -> None:
        self.factors = factors
        self._C = self._solve(self._B)
        self._QC = self._weigh_fed_back(self._C)
        t = to_host(self._C.T @ self._QC)
        t = np.eye(len(t)) + (t + t.T) / 2
        values = np.abs(np.linalg.eigvalsh(t))
        if not values.min() > 1e3 * EPS * values.max():
            raise RiccatiError(_SINGULAR)
        self._t_inverse = self.state.xp.asarray(np.linalg.inv(t))

    def residual(self, x: Any, y: Any, f: Any, g: Any) -> tuple[Any, Any]:
        """``(f, g) - H (x, y)``."""
        state = self.state
        first = f - state.apply(x) + self._B @ (self._B.T @ y)
        return first, g + self._weigh(x) + state.apply_transposed(y)

    def _probe(self) -> float:
        """The largest relative residual of a few applications."""
        xp, n = self.state.xp, self.state.n
        f, g = xp.asarray(np.random.default_rng(2).standard_normal((2, n, 3)))
        first, second = self.residual(*self.solve(f, g), f, g)
        left = (first * first + second * second).sum(axis=0) / (f * f + g * g).sum(axis=0)
        return float(left.max()) ** 0.5

    def solve(self, f: Any, g: Any) -> tuple[Any, Any]:
        """Return (x, y), shapes of f and g, with ``H (x, y) = (f, g)``."""
        x, y = self._solve_once(f, g)
        if self._refine:
            dx, dy = self._solve_once(*self.residual(x, y, f, g))
            x, y = x + dx, y + dy
        return x, y

    def _solve_once(self, f: Any, g: Any) -> tuple[Any, Any]:
        if self._whole is not None:
            return self._solve_whole(self._whole, f, g)
        fed = self._feedback
        if fed is not None:
            g = g - fed.right(f)
        s = self._solve(f)
        right = g + self._weigh_fed_back(s)
        u = self._t_inverse @ (self._C.T @ right)
        x = s - self._C @ u
        y = -self._solve_transposed(right - self._QC @ u)
        return x, y if fed is None else y + fed.left(x)

    def _solve_whole(self, whole: Factors, f: Any, g: Any) -> tuple[Any, Any]:
        n, xp = self.state.n, self.state.xp
        self.solves += 2
        padding = xp.zeros((self._B.shape[1], *f.shape[1:]))
        z = whole.solve(xp.concatenate([f, g, padding]))
        return z[:n], z[n : 2 * n]

    def apply(self, v: Any) -> Any:
        """``H^-1 diag(E, E^T) v``, v of shape (2 n,)."""
        n = self.state.n
        x, y = self.solve(self.state.mass(v[:n]), self.state.mass_transposed(v[n:]))
        return self.state.xp.concatenate([x, y])

    def apply_transposed(self, v: Any) -> Any:
        """The transpose: H^-T = J H^-1 J with J (f, g) = (g, -f)."""
        n = self.state.n
        x, y = self.solve(v[n:], -v[:n])
        return self.state.xp.concatenate([self.state.mass_transposed(y), self.state.mass(-x)])

    def operator(self) -> Any:
        """This inverse as a LinearOperator of SciPy or CuPy."""
        return linear_operator(self.state.xp, 2 * self.state.n, self.apply, self.apply_transposed)

    def _weigh(self, x: Any) -> Any:
        return self._Q.apply(x) / self._scale

    def _weigh_fed_back(self, x: Any) -> Any:
        return self._weigh(x) if self._feedback is None else self._feedback.weigh(x, self._weigh(x))

    def _solve(self, f: Any) -> Any:
        self.solves += 1
        assert self.factors is not None
        return self.factors.solve(f)

    def _solve_transposed(self, g: Any) -> Any:
        self.solves += 1
        assert self.factors is not None
        return self.factors.solve_transposed(g)


class _Feedback:
    """The similarity with ``X0 = Z S Z^T``: solves with ``A - B B^T X0 E``, and the new weight."""

    def __init__(self, state: StateMatrix, B: Any, Z: Any, S: Any) -> None:
        xp, d = state.xp, Z.shape[1]
        self.Z, self.S = Z, xp.asarray(S)
        self.EZ = state.mass_transposed(Z)
        BZ = B.T @ Z
        # The change of Q is symmetric, with the columns of A^T Z and E^T Z as its range.
        self._sides = xp.concatenate([state.apply_transposed(Z), self.EZ], axis=1)
        self._core = xp.zeros((2 * d, 2 * d))
        self._core[:d, d:] = self._core[d:, :d] = self.S
        self._core[d:, d:] = -self.S @ (BZ.T @ BZ) @ self.S
        self.factors = state.factor_updated(B @ (BZ @ self.S), self.EZ)

    @classmethod
    def over_zero_modes(cls, state: StateMatrix, B: Any, weigh: Any) -> _Feedback:
        left, right = null_vectors(state, limit=B.shape[1] + 1)
        # If the zero eigenvalue has a Jordan block, left null vectors alone do not move it.
        for Z in (left, left + right):
            Z = state.xp.linalg.qr(Z)[0]
            reach = to_host(B.T @ Z)
            values, vectors = np.linalg.eigh(reach.T @ reach)
            if not values.size or values[0] <= (1e2 * EPS) ** 2 * float((B * B).sum()):
                raise RiccatiError(
                    f"{_SINGULAR} ({Z.shape[1]} null vectors of A, of which B^T keeps "
                    f"{int(np.sum(values > EPS))})"
                )
            cost = float(np.linalg.norm(to_host(Z.T @ weigh(Z))))
            S = vectors / np.sqrt(values) @ vectors.T * np.sqrt(cost or 1.0)
            candidate = cls(state, B, Z, S)
            if candidate.factors is not None:
                return candidate
        raise RiccatiError(_SINGULAR)

    def right(self, f: Any) -> Any:
        """``E^T X0 f``."""
        return self.EZ @ (self.S @ (self.Z.T @ f))

    def left(self, x: Any) -> Any:
        """``X0 E x``."""
        return self.Z @ (self.S @ (self.EZ.T @ x))

    def weigh(self, x: Any, Qx: Any) -> Any:
        """The new weight times x, given ``Qx = Q x``."""
        return Qx + self._sides @ (self._core @ (self._sides.T @ x))


def null_vectors(state: StateMatrix, limit: int) -> tuple[Any, Any]:
    """Orthonormal left and right null vectors of A, shapes (n, d), at most ``limit``."""
    xp, n = state.xp, state.n
    if state.kind == "diagonal":
        places = xp.flatnonzero(vanishing(state.A))[:limit]
        unit = xp.zeros((n, len(places)))
        unit[places, xp.arange(len(places))] = 1.0
        return unit, unit
    size = state.size() or 1.0
    moved = None
    for digits in (-11, -10, -9):
        moved = state.factor(1.3 * 10.0**digits * size / _unit(state), explicit=False)
        if moved is not None:
            break
    if moved is None:
        raise np.linalg.LinAlgError("A - s E is singular for every s that was tried")
    rng = np.random.default_rng(0)
    X = xp.asarray(rng.standard_normal((n, min(limit, n))))
    Y = X.copy()
    for _ in range(3):
        X = xp.linalg.qr(moved.solve(state.mass(X)))[0]
        Y = xp.linalg.qr(moved.solve_transposed(state.mass_transposed(Y)))[0]
    # Singular values of A on both spaces, compared with the size of A: its scaling is irrelevant.
    _, seen, V = np.linalg.svd(to_host(state.apply(X)), full_matrices=False)
    _, told, W = np.linalg.svd(to_host(state.apply_transposed(Y)), full_matrices=False)
    d = max(1, int(np.sum(seen <= 1e-9 * size)), int(np.sum(told <= 1e-9 * size)))
    right, left = X @ xp.asarray(V[-d:].T), Y @ xp.asarray(W[-d:].T)
    # Rotate the right basis as close as possible to the left one, so that their sum is a basis too.
    P, _, S = np.linalg.svd(to_host(right.T @ left))
    return left, right @ xp.asarray(P @ S)


def _factor_whole(state: StateMatrix, B: Any, weight: Weight, scale: float) -> Factors | None:
    """Factors of ``[[A, 0, -B], [-Q/rho, -A^T, 0], [0, B^T, -I]]``, if entries are stored."""
    Q = weight.C.T @ weight.C if weight.C is not None else weight.entries
    if state.kind == "operator" or Q is None:
        return None
    A, Q = as_sparse(state.A, np), as_sparse(Q, np)
    m = B.shape[1]
    if state.kind == "dense":
        n = state.n
        Q = Q.toarray() if hasattr(Q, "toarray") else Q
        zero, tall = np.zeros((n, n)), np.zeros((n, m))
        return factor(
            np.block([[A, zero, -B], [-Q / scale, -A.T, tall], [tall.T, B.T, -np.eye(m)]])
        )
    B = sparse.csr_array(B)
    Q = sparse.csr_array(Q)
    rows = [[A, None, -B], [-Q / scale, -A.T, None], [None, B.T, -sparse.eye_array(m)]]
    return factor(sparse.csr_array(sparse.block_array(rows)))


def _nearly_singular(state: StateMatrix, factors: Factors) -> bool:
    """Whether solves with A would lose nearly all digits; with a diagonal A they never do."""
    if state.kind in ("diagonal", "operator"):
        return False
    x = state.xp.asarray(np.random.default_rng(1).standard_normal(state.n))
    grown = 0.0
    for solve in (factors.solve, factors.solve_transposed, factors.solve):
        x = solve(x / state.xp.linalg.norm(x))
        grown = float(state.xp.linalg.norm(x))
    return not grown * state.size() < 1e11


def _unit(state: StateMatrix) -> float:
    if state.E is None:
        return 1.0
    return float(abs(state.E.data if hasattr(state.E, "tocsr") else state.E).max())


_SINGULAR = (
    "the Hamiltonian is singular: an eigenvalue 0 of A cannot be moved by B or is not seen by Q; "
    "give that mode an input and a weight, or take it out of the model"
)
