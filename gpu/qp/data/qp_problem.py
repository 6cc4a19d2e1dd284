"""Checked data of a quadratic program."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from gpu.arrays.dense import cholesky, scaled_symmetric, symmetric_and_finite
from gpu.arrays.sparse_factor import is_positive_definite
from gpu.errors import InputError, NotSupported
from gpu.qp.data.standard_qp import StandardQP, is_sparse
from skfem_adini.ground.arguments import flag, unmasked
from skfem_adini.ground.arrays import cupy, namespace


class _Limits(NamedTuple):  # what counts as rounding of P, and as infinite
    asymmetry: float = 1e-10  # largest |P_ij - P_ji| / sqrt(P_ii P_jj)
    convexity: float = 1e-10  # largest shift to make the scaled P definite, for 1000 unknowns
    nearly: float = 3e-5  # the same for entries of five digits, as of measured covariances
    infinite: float = 1e20  # numbers from here on count as infinite, as in file formats


LIMITS = _Limits()


class FactoredMatrix:
    """A symmetric positive semidefinite matrix, checked, scaled and factored once: `P`, `scaled`
    with its `scale`, the Cholesky factor `L` (None unless `definite`), and whether it is
    `nearly_convex`; see `gpu.qp.sequence.QPFactor`."""

    @np.errstate(all="ignore")
    def __init__(self, P: ArrayLike, *, semidefinite: bool = True) -> None:
        semidefinite = flag("semidefinite", semidefinite)
        matrix = real_array("P", P, 2)
        n = matrix.shape[0]
        if n == 0 or matrix.shape != (n, n):
            raise InputError(f"P has shape {matrix.shape}: it must be square and not empty")
        xp = namespace(matrix)
        if xp is np or is_sparse(matrix):  # on a device one pass checks all, see `_symmetric`
            _finite("P", matrix)
        diagonal = matrix.diagonal()
        if bool((diagonal < 0.0).any()) or (not semidefinite and bool((diagonal == 0.0).any())):
            i = int(diagonal.argmin())
            raise InputError(
                f"P is not positive {'semi' * semidefinite}definite, "
                f"P[{i}, {i}] = {float(diagonal[i]):.3g}: the problem has no convex objective"
            )
        self.scale = 1.0 / power_of_two(xp.sqrt(xp.where(diagonal > 0.0, diagonal, 1.0)))
        self.L: Any = None
        self.nearly_convex = False
        self.P = _symmetric(matrix, self._scaled)
        if xp is not np and not is_sparse(self.P) and bool((diagonal > 0.0).all()):
            self.scaled: Any = None
            if self._factor(scaled_symmetric(self.P, self.scale), n):
                return
            self.L = None
        self.scaled = self._scaled(self.P)
        if is_sparse(self.P):
            self.nearly_convex = _nearly_convex(self.scaled, 1)
            self.definite = False
            return
        self.definite = bool((diagonal > 0.0).all()) and self._factor(self.scaled.copy(), n)
        if self.definite:
            return
        self.L = None
        if not semidefinite:
            raise InputError("P is not positive definite to working precision")
        self.nearly_convex = _nearly_convex(self.scaled, n)

    def _factor(self, M: Any, n: int) -> bool:
        """Factor M, overwritten; whether it is definite beyond rounding."""
        self.definite = False
        try:
            self.L = cholesky(M)
        except np.linalg.LinAlgError:
            return False
        # Below this the rounding of the entries of P decides about definiteness.
        least = float(self.L.diagonal().min()) ** 2
        self.definite = bool(least > 10 * n * np.finfo(float).eps)
        return self.definite

    def _scaled(self, M: Any) -> Any:
        if is_sparse(M):
            D: Any = sparse.diags_array(self.scale)
            return sparse.csr_array(D @ M @ D)
        scaled = M * self.scale
        scaled *= self.scale[:, None]
        return scaled


def _symmetric(matrix: Any, scaled: Any) -> Any:
    """A symmetric copy; `InputError` where the asymmetry is more than rounding."""
    if is_sparse(matrix):
        twin = sparse.csr_array(matrix.T)
        difference = matrix - twin
        if not difference.nnz or not abs(difference).max():
            return matrix.copy()
        half, error = matrix / 2.0 + twin / 2.0, abs(scaled(difference)).max() / 2.0
    else:
        xp = namespace(matrix)
        if xp is not np:
            if symmetric_and_finite(matrix):
                return matrix
            _finite("P", matrix)
        elif np.array_equal(matrix, matrix.T):
            return np.array(matrix, order="C")
        half = matrix / 2.0 + matrix.T / 2.0  # a sum of the whole may overflow
        error = float(abs(scaled(matrix - half)).max())
    if not error <= LIMITS.asymmetry:
        raise InputError(
            f"P is not symmetric, |P - P'| reaches {2 * error:.1e} of its diagonal: "
            "only x'Px matters, so pass (P + P.T) / 2 if that is what is meant"
        )
    return half


def _nearly_convex(scaled: Any, n: int) -> bool:
    """Whether a scaled matrix is semidefinite but for a few digits; `InputError` if not even so."""
    if _definite_when_shifted(scaled, LIMITS.convexity * max(1.0, 1e-3 * n)):
        return False
    if _definite_when_shifted(scaled, LIMITS.nearly):
        return True
    raise InputError(
        "P is not positive semidefinite: the objective is not convex, and a minimum found "
        "near one point would prove nothing about the others"
    )


def _definite_when_shifted(scaled: Any, shift: float) -> bool:
    if is_sparse(scaled):
        diagonal = scaled.diagonal()
        if bool((abs(scaled).sum(axis=1) <= 2.0 * diagonal + shift).all()):
            return True  # Gershgorin
        K = sparse.csc_array(scaled + shift * sparse.eye_array(scaled.shape[0]))
        return is_positive_definite(K)
    M = scaled.copy()
    i = namespace(M).arange(len(M))
    M[i, i] += shift
    try:
        cholesky(M)
    except np.linalg.LinAlgError:
        return False
    return True


class QPProblem(NamedTuple):
    """Data of a quadratic program; `A` holds the equality rows, `G` the others."""

    factor: FactoredMatrix
    q: Any
    A: Any
    b: Any
    lb: Any
    ub: Any
    G: Any
    row_low: Any
    row_high: Any

    @property
    def boxes_only(self) -> bool:
        """Whether it is strictly convex, on the host, with bounds and few equality rows."""
        return (
            not self.row_low.size
            and self.b.size <= self.q.size
            and self.factor.definite
            and isinstance(self.q, np.ndarray)
        )

    @property
    def rows(self) -> Rows:
        """The same as `Rows`."""
        p, join = self.program, namespace(self.q).concatenate
        sides = (join([p.row_low, p.lb]), join([p.row_high, p.ub]))
        return Rows(p.P, p.C, p.q, *sides, self.b.size, self.row_low.size)

    @property
    def program(self) -> StandardQP:
        """The same, with one set of rows: those of A, then those of G."""
        xp = namespace(self.q)
        P = self.factor.P
        if is_sparse(P):
            C = sparse.csr_array(sparse.vstack([self.A, self.G], format="csr"))
        else:
            C = xp.concatenate([self.A, self.G])
        sides = (self.row_low, self.row_high)
        row_low, row_high = (xp.concatenate([self.b, side]) for side in sides)
        return StandardQP(P, self.q, C, row_low, row_high, self.lb, self.ub)


SOLVED, EMPTY, UNDECIDED = 0, 1, 2  # what a method that takes `Rows` found


class Rows(NamedTuple):
    """A problem with one set of rows, the first `equal` those of A; sides are those of rows, then
    of bounds."""

    P: Any
    C: Any
    q: Any
    low: Any
    high: Any
    equal: int
    general: int

    @property
    def boxes_only(self) -> bool:
        """Whether residuals are those of bounds and equality rows, see `KKT`."""
        return not self.general and self.equal <= len(self.P)


def check_problem(
    P: ArrayLike | FactoredMatrix,
    q: ArrayLike,
    G: ArrayLike | None,
    h: ArrayLike | None,
    A: ArrayLike | None,
    b: ArrayLike | None,
    lb: ArrayLike | None,
    ub: ArrayLike | None,
    h_low: ArrayLike | None,
) -> QPProblem:
    """The arguments of `solve_qp` as arrays; `InputError` names what is wrong with them."""
    factor = P if isinstance(P, FactoredMatrix) else FactoredMatrix(P)
    n = factor.P.shape[0]
    xp = namespace(factor.P, q, G, h, A, b, lb, ub, h_low)
    q = _finite("q", _shaped("q", q, (n,), xp))
    if (A is None) != (b is None):
        raise InputError("A and b must be given together: one of them is None")
    if G is None and (h is not None or h_low is not None):
        raise InputError("h or h_low is given without G")
    if G is not None and h is None and h_low is None:
        raise InputError("G is given without h and h_low: one of them must be")
    rows, general = _rows("A", A, n, xp), _rows("G", G, n, xp)
    m, l = rows.shape[0], general.shape[0]
    right = xp.zeros(0) if b is None else _finite("b", _shaped("b", b, (m,), xp))
    row_low = _bound("h_low", h_low, l, -np.inf, xp)
    row_high = _bound("h", h, l, np.inf, xp)
    if is_sparse(factor.P) or is_sparse(rows) or is_sparse(general):
        if xp is not np:
            raise NotSupported("sparse matrices with device arrays: move all to the host")
        rows, general = sparse.csr_array(rows), sparse.csr_array(general)
        if not is_sparse(factor.P):
            factor = _as_sparse(factor)
    return QPProblem(
        factor, q, rows, right,
        _bound("lb", lb, n, -np.inf, xp), _bound("ub", ub, n, np.inf, xp),
        general, row_low, row_high,
    )  # fmt: skip


def _as_sparse(factor: FactoredMatrix) -> FactoredMatrix:
    """The factor of a dense P for a problem with sparse rows: the same, stored sparsely."""
    other: Any = object.__new__(FactoredMatrix)
    dense: Any = factor
    other.P, other.scaled = sparse.csr_array(dense.P), sparse.csr_array(dense.scaled)
    other.scale, other.L, other.definite = factor.scale, None, False
    other.nearly_convex = factor.nearly_convex
    return other


def _rows(name: str, value: Any, n: int, xp: Any) -> Any:
    rows = xp.zeros((0, n)) if value is None else real_array(name, value, 2)
    if xp is not np and isinstance(rows, np.ndarray):
        rows = xp.asarray(rows)
    if rows.shape[1] != n:
        raise InputError(f"{name} has shape {rows.shape}: it must have {n} columns")
    return _finite(name, rows)


def power_of_two(size: np.ndarray) -> np.ndarray:
    """Nearest powers of two; scaling with them does not round."""
    xp = namespace(size)
    return xp.exp2(xp.round(xp.log2(size)))


def _bound(name: str, value: ArrayLike | None, n: int, missing: float, xp: Any) -> Any:
    if value is None:
        return xp.full(n, missing)
    bound = real_array(name, value)
    if bound.ndim == 0:
        bound = xp.full(n, float(bound))
    bound = _shaped(name, bound, (n,), xp)
    given = bound
    bound = xp.where(xp.abs(bound) >= LIMITS.infinite, xp.copysign(xp.inf, bound), bound)
    wrong = xp.isnan(bound) | (bound == -missing)
    if bool(wrong.any()):
        i = int(wrong.argmax())
        infinite = f", and from {LIMITS.infinite:.0e} on one counts as infinite"
        raise InputError(
            f"{name}[{i}] is {given[i]}: it must be a number or {missing}"
            f"{infinite if bool(xp.isfinite(given[i])) else ''}"
        )
    return bound


def _shaped(name: str, value: ArrayLike, shape: tuple[int, ...], xp: Any) -> Any:
    array = real_array(name, value)
    if is_sparse(array):
        raise InputError(f"{name} is sparse: vectors must be dense")
    if isinstance(array, np.ndarray):
        array = xp.asarray(array)
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}: it must be {shape}")
    return array


def _finite(name: str, array: Any) -> Any:
    if is_sparse(array):
        if not np.isfinite(array.data).all():
            raise InputError(f"{name} has entries that are not finite")
        return array
    xp = namespace(array)
    if xp is not np and array.size:
        # One pass without a mask: a sum of absolute values is finite if its terms are.
        good = bool(xp.isfinite(xp.abs(array).max()))
    else:
        good = bool(xp.isfinite(array).all())
    if not good:
        i = tuple(int(k) for k in xp.argwhere(~xp.isfinite(array))[0])
        raise InputError(f"{name}{list(i)} is {array[i]}: every entry must be finite")
    return array


def real_array(name: str, value: Any, dimensions: int | None = None) -> Any:
    """The value as doubles, stored as it is; `InputError` where it holds no real numbers."""
    unmasked(name, value)
    if hasattr(value, "__cuda_array_interface__"):
        return _device_array(name, value, dimensions)
    if is_sparse(value):
        if value.dtype.kind not in "biuf":
            raise InputError(f"{name} is not an array of real numbers: {value.dtype}")
        value = sparse.csr_array(value, dtype=float)
        if not value.has_canonical_format:
            value = value.copy()  # it may share its arrays with the caller's
            value.sum_duplicates()
        return value
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"its entries are of type {array.dtype}")
        array = array.astype(float, copy=False)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is not an array of real numbers: {error}") from None
    if dimensions is not None and array.ndim != dimensions:
        raise InputError(f"{name} has {array.ndim} dimensions: it must have {dimensions}")
    return array


def _device_array(name: str, value: Any, dimensions: int | None) -> Any:
    module = cupy()
    array = module.asarray(value)
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name} is not an array of real numbers: {array.dtype}")
    if dimensions is not None and array.ndim != dimensions:
        raise InputError(f"{name} has {array.ndim} dimensions: it must have {dimensions}")
    return array.astype(float, copy=False)
