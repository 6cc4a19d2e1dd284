"""Errors of this package; each message names the argument, what was found, and what to do."""

from __future__ import annotations

from typing import Any

import numpy as np


class GpuError(Exception):
    """Base class of every error raised on purpose by `gpu`; copies and pickles keep all of it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), self.args, self.__dict__)


def _restored(kind: type[GpuError], args: tuple[Any, ...], state: dict[str, Any]) -> GpuError:
    """Without the constructor, which asks for more than the message."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


class InputError(GpuError, ValueError):
    """An argument is malformed."""


class NotSupported(GpuError, NotImplementedError):
    """A valid request that this version cannot serve yet."""


class MissingDependency(GpuError, ImportError):
    """An optional package is needed and not installed."""


class NotConverged(GpuError):
    """No answer within the tolerance; nothing is returned.

    Attributes
    ----------
    eigenvalues, eigenvectors : array or None
        Of an eigenvalue problem: what did converge.
    """

    def __init__(self, message: str, *, eigenvalues: Any = None, eigenvectors: Any = None) -> None:
        super().__init__(message)
        self.eigenvalues, self.eigenvectors = eigenvalues, eigenvectors


class RiccatiError(GpuError, np.linalg.LinAlgError):
    """The Riccati equation has no stabilising solution.

    Attributes
    ----------
    eigenvalue : complex or None
        The mode on (or right of) the imaginary axis that no input moves or no cost sees.
    cause : str
        "not stabilisable", "not detectable", or "" where neither could be shown.
    """

    def __init__(self, message: str, *, eigenvalue: complex | None = None, cause: str = "") -> None:
        super().__init__(message)
        self.eigenvalue, self.cause = eigenvalue, cause


class Infeasible(GpuError):
    """No point satisfies the constraints.

    Attributes
    ----------
    certificate : array
        Farkas pair (y, z) in one vector, one entry an equality row and then one a row of G, with
        ``max (A'y + G'z)'x < y'b + min z'r``, the maximum over the box lb <= x <= ub and the
        minimum over h_low <= r <= h; zero when the box itself is empty.
    """

    def __init__(self, message: str, certificate: np.ndarray) -> None:
        super().__init__(message, certificate)  # both: pickle makes errors anew from these
        self.certificate = certificate

    def __str__(self) -> str:
        return str(self.args[0])


class Unbounded(GpuError):
    """The objective has no lower bound.

    Attributes
    ----------
    ray : numpy.ndarray
        Feasible direction v with ``P v = 0`` and ``q'v < 0``.
    """

    def __init__(self, message: str, ray: np.ndarray) -> None:
        super().__init__(message, ray)
        self.ray = ray

    def __str__(self) -> str:
        return str(self.args[0])
