"""The output of a solver: the problem, its unknowns, and how they were computed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contact.laws.iteration import Iteration
from contact.result.contact_system import ContactSystem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class ContactState:
    """The primary data of a result, which a file stores and a certificate checks.

    Attributes
    ----------
    system, u, mu, t, method, history, motion, tol, slack
        See `ContactResult`, which derives everything else from them.
    """

    system: ContactSystem
    u: Array
    mu: Array
    t: Array
    method: str
    history: tuple[Iteration, ...]
    motion: Array | None = None
    tol: float | None = None
    slack: float = 0.0
