"""Errors of the package, and those that it shares with the others."""

from __future__ import annotations

import numpy as np

from skfem_adini.ground.errors import (  # noqa: F401
    AdiniError,
    Infeasible,
    InputError,
    MissingDependency,
    NotConverged,
    NotSupported,
    Unbounded,
)

GpuError = AdiniError


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
