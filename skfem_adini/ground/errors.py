"""The exceptions that the packages share: one class each, by the same name in all of them."""

from __future__ import annotations

import re
import sys
import warnings
from importlib import import_module
from typing import Any


class AdiniError(Exception):
    """Base class of every error raised on purpose; copies and pickles keep all of it.

    It is also named `ContactError`, `CipError` and `GpuError`. Catch it where any failure is to be
    treated alike; its subclasses tell what to do.

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
        # Plain numbers, without NumPy's names of their types.
        scalar = r"(?:u?int|float|complex|c?longdouble|str_|bool)\d*\(([^()]*|\(.*?\))\)"
        shown = str(self.args[0]) if self.args else ""
        return re.sub(rf"\bnp\.(?:{scalar}|(True|False)_)", r"\1\2", shown)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), self.args, self.__dict__)


def _restored(kind: type[AdiniError], args: tuple[Any, ...], state: dict[str, Any]) -> AdiniError:
    """Restore an error without its constructor, which requires more than the message."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


class InputError(AdiniError, ValueError):
    """An argument cannot be used; the message names it, what was found and what to do.

    Nothing has been computed. Mend the argument that the message begins with; it is a `ValueError`
    too, so that code which knows only the exceptions of Python catches it.

    Examples
    --------
    A two-dimensional profile on a line:

    >>> from cip import Grid, Solver
    >>> Solver(Grid((0, 1), 16), 1.0, profile="bicubic")
    Traceback (most recent call last):
        ...
    skfem_adini.ground.errors.InputError: profile: 'bicubic' is two-dimensional, the grid has 1
    """


class NotSupported(AdiniError, NotImplementedError):
    """A valid request that this version cannot serve.

    Use the other method, profile, backend or form of the data that the message names.

    Examples
    --------
    Newton's method for a sparse model of more than 1500 states:

    >>> import numpy as np, scipy.sparse
    >>> from gpu import lqr
    >>> A = -scipy.sparse.eye_array(1600, format="csr")
    >>> lqr(A, np.ones((1600, 1)), 1.0, 1.0, method="newton")
    Traceback (most recent call last):
        ...
    skfem_adini.ground.errors.NotSupported: Newton-Kleinman needs a dense A, or at most 1500 ...
    """


class MissingDependency(AdiniError, ImportError):
    """An optional package is needed and not installed; the message holds the line that installs it.

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
    skfem_adini.ground.errors.MissingDependency: qpsolvers is not installed: pip install qpsolvers
    """


class NotConverged(AdiniError, RuntimeError):
    """An iteration did not reach its tolerance; the message says how far it came.

    No result is returned, because it could not be certified. Change what the message names: the
    tolerance, the number of iterations, the method, the step.

    Attributes
    ----------
    history : tuple of Iteration
        Of a contact problem: one entry an iteration, as in `ContactResult.history`.
    eigenvalues, eigenvectors : array or None
        Of an eigenvalue problem: what did converge, shapes (j,) and (n, j).
    x, kkt : (n,) array and KKT, or None
        Of a quadratic program at its limit of time or steps: the best point and its residuals.

    Examples
    --------
    Three eigenvalues of order 1400 from a space of eight vectors, without a restart:

    >>> import numpy as np
    >>> from gpu import eigs
    >>> eigs(np.diag(np.arange(1.0, 1401.0)), k=3, maxiter=1, ncv=8)
    Traceback (most recent call last):
        ...
    skfem_adini.ground.errors.NotConverged: 0 of 3 eigenvalues converged in 1 restarts ...
    """

    def __init__(
        self,
        message: str,
        history: tuple[Any, ...] = (),
        *,
        eigenvalues: Any = None,
        eigenvectors: Any = None,
        x: Any = None,
        kkt: Any = None,
    ) -> None:
        super().__init__(message)
        self.history, self.eigenvalues, self.eigenvectors = history, eigenvalues, eigenvectors
        self.x, self.kkt = x, kkt


class Infeasible(AdiniError):
    """No point satisfies the constraints together.

    In a quadratic program the entries of `certificate` that are not zero name the rows that
    contradict each other: loosen one of them; in a control loop keep the last input, or soften a
    row with a slack variable. In a contact problem supports hold a contact point inside the
    obstacle: free that support, or move it or the obstacle; the message names the point.

    Attributes
    ----------
    certificate : numpy.ndarray, shape (m + l,), or None
        Of a quadratic program: Farkas pair (y, z) in one vector, one entry an equality row and then
        one a row of G, with ``max (A'y + G'z)'x < y'b + min z'r``, the maximum over the box
        lb <= x <= ub and the minimum over h_low <= r <= h; zero when the box itself is empty.

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

    def __init__(self, message: str, certificate: Any = None) -> None:
        super().__init__(message)
        self.certificate = certificate


class Unbounded(AdiniError):
    """The objective has no lower bound: nothing resists a direction in which it falls.

    In a quadratic program bound the variables that are not zero in `ray`, or give them a positive
    entry in P. A body that is not held: fix a displacement that this rigid motion changes, add
    friction or an obstacle that stops it, or turn the load that drives it away from the obstacle.

    Attributes
    ----------
    ray : numpy.ndarray, shape (n,)
        Feasible direction v with ``P v = 0`` and ``q'v < 0``; of a body its free rigid motion,
        shape (ndofs,), normalised to a largest entry of one, also named `mode`.

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

    def __init__(self, message: str, ray: Any) -> None:
        super().__init__(message)
        self.ray = ray

    @property
    def mode(self) -> Any:
        """The free rigid motion of a body."""
        return self.ray


class SolverError(AdiniError):
    """A library for sparse systems returned an error; the message names the call and its number.

    `status` is that number; `pivot` tells whether a pivot was zero, or not positive in a matrix
    declared as definite. Where factors do not fit into the memory of a device, `free` are its free
    bytes, and `hybrid` those with which hybrid memory would do, None if not even that.
    """

    def __init__(
        self,
        message: str,
        status: int,
        pivot: bool = False,
        free: int | None = None,
        hybrid: int | None = None,
    ) -> None:
        super().__init__(message)
        self.status, self.pivot, self.free, self.hybrid = status, pivot, free, hybrid


def optional(name: str, message: str) -> Any:
    """A module that need not be installed, or a `MissingDependency` with this message."""
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingDependency(message) from error


def warn(message: str, category: type[Warning]) -> None:
    """Issue a warning that points at the line which called one of our packages."""
    passed = {"skfem_adini", "contact", "cip", "gpu", "contextlib", "functools"}
    depth, frame = 2, sys._getframe(1)
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in passed:
        depth, frame = depth + 1, frame.f_back
    warnings.warn(message, category, stacklevel=depth)
