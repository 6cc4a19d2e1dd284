"""Errors of this package; each message names the argument, what was found, and what to do."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

# How NumPy shows its numbers, alone or in a tuple; what is said is the number.
_NUMPY_SCALAR = re.compile(
    r"\bnp\.(?:(?:u?int|float|complex|c?longdouble|str_|bool)\d*\(([^()]*|\(.*?\))\)|(True|False)_)"
)


class GpuError(Exception):
    """Base class of every error raised on purpose by `gpu`; copies and pickles keep all of it.

    Catch it where any failure of the package is to be treated alike; its subclasses tell what to
    do.

    Examples
    --------
    >>> from gpu import GpuError, solve_qp
    >>> try:
    ...     solve_qp([[1.0]], [0.0], lb=2.0, ub=1.0)
    ... except GpuError as error:
    ...     print(type(error).__name__)
    Infeasible
    """

    def __str__(self) -> str:
        return _NUMPY_SCALAR.sub(r"\1\2", str(self.args[0]) if self.args else "")

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), self.args, self.__dict__)


def _restored(kind: type[GpuError], args: tuple[Any, ...], state: dict[str, Any]) -> GpuError:
    """Without the constructor, which asks for more than the message."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


class InputError(GpuError, ValueError):
    """An argument is malformed.

    Nothing has been computed. Mend the argument that the message begins with; it is a `ValueError`
    too.

    Examples
    --------
    >>> from gpu import solve_qp
    >>> solve_qp([[-1.0]], [0.0])
    Traceback (most recent call last):
        ...
    gpu.errors.InputError: P is not positive semidefinite, P[0, 0] = -1: ...
    """


class NotSupported(GpuError, NotImplementedError):
    """A valid request that this version cannot serve yet.

    The message names the form of the data, or the method, that is served.

    Examples
    --------
    Newton's method for a sparse model of more than 1500 states:

    >>> import numpy as np, scipy.sparse
    >>> from gpu import lqr
    >>> A = -scipy.sparse.eye_array(1600, format="csr")
    >>> lqr(A, np.ones((1600, 1)), 1.0, 1.0, method="newton")
    Traceback (most recent call last):
        ...
    gpu.errors.NotSupported: Newton-Kleinman needs a dense A, or at most 1500 states: here 1600
    """


class MissingDependency(GpuError, ImportError):
    """An optional package is needed and not installed.

    Run the line that the message ends with and repeat the call; it is an `ImportError` too.

    Examples
    --------
    An environment without qpsolvers:

    >>> from unittest.mock import patch
    >>> from gpu import register_qpsolvers
    >>> with patch.dict("sys.modules", {"qpsolvers": None}):
    ...     register_qpsolvers()
    Traceback (most recent call last):
        ...
    gpu.errors.MissingDependency: qpsolvers is not installed: pip install qpsolvers
    """


class NotConverged(GpuError):
    """No answer within the tolerance; nothing is returned.

    Change what the message names: a larger tolerance, more iterations, a larger space, a shift.

    Attributes
    ----------
    eigenvalues, eigenvectors : array or None
        Of an eigenvalue problem: what did converge, shapes (j,) and (n, j).

    Examples
    --------
    Three eigenvalues of order 1400 from a space of eight vectors, without a restart:

    >>> import numpy as np
    >>> from gpu import eigs
    >>> eigs(np.diag(np.arange(1.0, 1401.0)), k=3, maxiter=1, ncv=8)
    Traceback (most recent call last):
        ...
    gpu.errors.NotConverged: 0 of 3 eigenvalues converged in 1 restarts ... raise maxiter or ...
    """

    def __init__(self, message: str, *, eigenvalues: Any = None, eigenvectors: Any = None) -> None:
        super().__init__(message)
        self.eigenvalues, self.eigenvectors = eigenvalues, eigenvectors


class RiccatiError(GpuError, np.linalg.LinAlgError):
    """The Riccati equation has no stabilising solution.

    Give an input to the mode that the message names, or a weight in Q, or take it out of the model.

    Attributes
    ----------
    eigenvalue : complex or None
        The mode on (or right of) the imaginary axis that no input moves or no cost sees.
    cause : str
        "not stabilisable", "not detectable", or "" where neither could be shown.

    Examples
    --------
    A growing state that no input reaches:

    >>> from gpu import lqr
    >>> lqr([[1.0]], [[0.0]], [[1.0]], 1.0)
    Traceback (most recent call last):
        ...
    gpu.errors.RiccatiError: the mode 1 of A is not stabilisable: no input moves it; ...
    """

    def __init__(self, message: str, *, eigenvalue: complex | None = None, cause: str = "") -> None:
        super().__init__(message)
        self.eigenvalue, self.cause = eigenvalue, cause


class Infeasible(GpuError):
    """No point satisfies the constraints.

    The entries of `certificate` that are not zero name the rows that contradict each other: loosen
    one of them. In a control loop keep the last input, or soften a row with a slack variable.

    Attributes
    ----------
    certificate : numpy.ndarray, shape (m + l,)
        Farkas pair (y, z) in one vector, one entry an equality row and then one a row of G, with
        ``max (A'y + G'z)'x < y'b + min z'r``, the maximum over the box lb <= x <= ub and the
        minimum over h_low <= r <= h; zero when the box itself is empty.

    Examples
    --------
    Two numbers of at most 1 whose sum is to be 5:

    >>> import numpy as np
    >>> from gpu import Infeasible, solve_qp
    >>> try:
    ...     solve_qp(np.eye(2), [0.0, 0.0], A=[[1.0, 1.0]], b=[5.0], ub=1.0)
    ... except Infeasible as error:
    ...     y = error.certificate
    >>> bool(y[0] * (1.0 + 1.0) < y[0] * 5.0)  # the largest A x of the box, and b
    True
    """

    def __init__(self, message: str, certificate: np.ndarray) -> None:
        super().__init__(message, certificate)  # both: pickle makes errors anew from these
        self.certificate = certificate


class Unbounded(GpuError):
    """The objective has no lower bound.

    Bound the variables that are not zero in `ray`, or give them a positive entry in P.

    Attributes
    ----------
    ray : numpy.ndarray, shape (n,)
        Feasible direction v with ``P v = 0`` and ``q'v < 0``.

    Examples
    --------
    A linear objective that falls to the left:

    >>> from gpu import Unbounded, solve_qp
    >>> try:
    ...     solve_qp([[0.0]], [1.0], ub=1.0)
    ... except Unbounded as error:
    ...     print(error.ray < 0)
    [ True]
    """

    def __init__(self, message: str, ray: np.ndarray) -> None:
        super().__init__(message, ray)
        self.ray = ray
