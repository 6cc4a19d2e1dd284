"""Checked data of a quadratic program."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import issparse

from gpu.dense import cholesky
from gpu.errors import InputError, NotSupported

# Largest |P_ij - P_ji| / sqrt(P_ii P_jj) that is taken for rounding of whoever computed P.
ASYMMETRY = 1e-10


class QPFactor:
    """A symmetric positive definite matrix, checked, scaled and factored once.

    `solve_qp` takes it in place of `P`, so that a sequence of problems with one matrix pays for
    the checks and for the factorisation once.

    Parameters
    ----------
    P : (n, n) array_like
        The matrix; it is copied.

    Raises
    ------
    InputError
        If `P` is not square, finite, symmetric up to rounding and positive definite.
    NotSupported
        If `P` is sparse or a device array.

    Examples
    --------
    >>> import numpy as np
    >>> from gpu import QPFactor, solve_qp
    >>> factor = QPFactor(np.array([[2.0, 1.0], [1.0, 2.0]]))
    >>> [solve_qp(factor, [-load, load], lb=0.0).x.tolist() for load in (1.0, 2.0)]
    [[0.5, 0.0], [1.0, 0.0]]
    """

    def __init__(self, P: ArrayLike) -> None:
        matrix = _array("P", P, 2)
        n = len(matrix)
        if n == 0 or matrix.shape != (n, n):
            raise InputError(f"P has shape {matrix.shape}: it must be square and not empty")
        _finite("P", matrix)
        diagonal = matrix.diagonal()
        if np.any(diagonal <= 0.0):
            i = int(np.argmin(diagonal))
            raise InputError(
                f"P is not positive definite, P[{i}, {i}] = {diagonal[i]:.3g}; "
                "semidefinite matrices are not supported yet"
            )
        self.scale = 1.0 / power_of_two(np.sqrt(diagonal))
        self.P = np.array(matrix, order="C")
        if not np.array_equal(matrix, matrix.T):
            self.P = (matrix + matrix.T) / 2.0
            error = np.abs(self._scaled(matrix - self.P)).max()
            if error > ASYMMETRY:
                raise InputError(
                    f"P is not symmetric, |P - P'| reaches {2 * error:.1e} of its diagonal: "
                    "only x'Px matters, so pass (P + P.T) / 2 if that is what is meant"
                )
        self.scaled = self._scaled(self.P)
        try:
            self.L = cholesky(self.scaled.copy())
            pivot = float(np.min(self.L.diagonal()) ** 2)
        except np.linalg.LinAlgError:
            pivot = 0.0
        # Below this the rounding of the entries of P decides about definiteness.
        if pivot <= 10 * n * np.finfo(float).eps:
            raise InputError(
                "P is not positive definite to working precision; semidefinite matrices are not "
                "supported yet: add a small multiple of its diagonal"
            )

    def _scaled(self, M: np.ndarray) -> np.ndarray:
        scaled = M * self.scale
        scaled *= self.scale[:, None]
        return scaled


class Problem(NamedTuple):
    """Data of a quadratic program with bounds and equality rows."""

    factor: QPFactor
    q: np.ndarray
    A: np.ndarray
    b: np.ndarray
    lb: np.ndarray
    ub: np.ndarray


def check_problem(
    P: ArrayLike | QPFactor,
    q: ArrayLike,
    G: ArrayLike | None,
    h: ArrayLike | None,
    A: ArrayLike | None,
    b: ArrayLike | None,
    lb: ArrayLike | None,
    ub: ArrayLike | None,
    h_low: ArrayLike | None,
) -> Problem:
    """The arguments of `solve_qp` as arrays; `InputError` names what is wrong with them."""
    for name, value in {"G": G, "h": h, "h_low": h_low}.items():
        if value is not None:
            raise NotSupported(
                f"{name} is given: general inequality rows are not supported yet, only bounds "
                "lb, ub and equality rows A x = b"
            )
    factor = P if isinstance(P, QPFactor) else QPFactor(P)
    n = len(factor.P)
    q = _finite("q", _shaped("q", q, (n,)))
    if (A is None) != (b is None):
        raise InputError("A and b must be given together: one of them is None")
    rows = np.zeros((0, n)) if A is None else _array("A", A, 2)
    if rows.shape[1] != n:
        raise InputError(f"A has shape {rows.shape}: it must have {n} columns")
    right = np.zeros(0) if b is None else _shaped("b", b, (len(rows),))
    return Problem(
        factor,
        q,
        _finite("A", rows),
        _finite("b", right),
        _bound("lb", lb, n, -np.inf),
        _bound("ub", ub, n, np.inf),
    )


def power_of_two(size: np.ndarray) -> np.ndarray:
    """Nearest powers of two; scaling with them does not round."""
    return np.exp2(np.round(np.log2(size)))


def _bound(name: str, value: ArrayLike | None, n: int, missing: float) -> np.ndarray:
    if value is None:
        return np.full(n, missing)
    bound = _array(name, value)
    bound = np.full(n, float(bound)) if bound.ndim == 0 else _shaped(name, bound, (n,))
    wrong = np.isnan(bound) | (bound == -missing)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(f"{name}[{i}] is {bound[i]}: it must be a number or {missing}")
    return bound


def _shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    array = _array(name, value)
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}: it must be {shape}")
    return array


def _finite(name: str, array: np.ndarray) -> np.ndarray:
    if not np.isfinite(array).all():
        i = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{name}{list(i)} is {array[i]}: every entry must be finite")
    return array


def _array(name: str, value: Any, dimensions: int | None = None) -> np.ndarray:
    if hasattr(value, "__cuda_array_interface__"):
        raise NotSupported(f"{name} is a device array: only NumPy arrays are supported yet")
    if issparse(value):
        raise NotSupported(f"{name} is sparse, which is not supported yet: pass {name}.toarray()")
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
