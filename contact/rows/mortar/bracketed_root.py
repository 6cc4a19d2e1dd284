"""Roots of functions of one variable, many at once, each held in a bracket."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Newton steps before bisection alone decides, and all steps: 64 halvings reach the last digit.
NEWTON, STEPS = 16, 80


def bracketed_root(function: Callable[[Array], tuple[Array, Array]], count: int) -> Array:
    """Roots in [0, 1] of functions whose signs at 0 and 1 differ, by safeguarded Newton steps.

    Each step keeps the part of the bracket where the sign changes, so what is returned is the place
    of a sign change to the last digit, whatever the functions. Where the signs at 0 and 1 are the
    same, up to rounding of a root at an end, that end is found.

    Parameters
    ----------
    function : callable s -> (value, derivative)
        All arrays of shape (count,).
    count : int

    Returns
    -------
    ndarray, shape (count,)

    References
    ----------
    W. H. Press et al., Numerical Recipes, 3rd ed., Cambridge University Press 2007, section 9.4.

    Examples
    --------
    >>> goal = np.array([0.25, 0.49])
    >>> bracketed_root(lambda s: (s**2 - goal, 2 * s), 2).round(12).tolist()
    [0.5, 0.7]
    """
    low, high, s = np.zeros(count), np.ones(count), np.full(count, 0.5)
    at_low, at_high = function(low)[0], function(high)[0]
    found = np.zeros(count, dtype=bool)
    for step in range(STEPS):
        value, slope = function(s)
        below = value * np.sign(at_low) > 0
        low, high = np.where(below, s, low), np.where(below, high, s)
        newton = s - value / np.where(slope == 0, 1.0, slope)
        inside = (newton >= low) & (newton <= high) & (slope != 0) & (step < NEWTON)
        new = np.where(inside, newton, 0.5 * (low + high))
        # What is found stays, so that a root does not depend on those computed together with it.
        new = np.where(found | (value == 0), s, new)
        found |= np.abs(new - s) <= 2.0 * np.spacing(1.0)
        s = new
        if found.all():
            break
    nearer = np.where(np.abs(at_low) <= np.abs(at_high), 0.0, 1.0)
    return np.where(at_low * at_high > 0, nearer, s)
