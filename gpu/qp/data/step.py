"""An entry in the history of an active set."""

from __future__ import annotations

from typing import NamedTuple


class Step(NamedTuple):
    """One active-set step: how many variables were held, how many were found violated.

    Parameters
    ----------
    active : int
        Variables and rows that are held at a bound.
    violated : int
        Variables and rows that pass a bound, or whose multiplier has the wrong sign.

    Examples
    --------
    The last step of a solution violates nothing:

    >>> import numpy as np
    >>> from gpu import solve_qp
    >>> solve_qp(np.eye(2), [1.0, -1.0], lb=0.0).history[-1]
    Step(active=1, violated=0)
    """

    active: int
    violated: int
