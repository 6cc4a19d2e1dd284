"""What one support of a body prescribes while all others are at rest."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError

Array = NDArray[np.float64]


def motion_of_support(held: Any, boundary: Any, components: Any, value: Any) -> Array:
    """Displacement of all dofs that a support on a boundary would prescribe by a value.

    Parameters
    ----------
    held : Solid
    boundary, components, value
        As for `ElasticBody.fix`.

    Raises
    ------
    InputError
        The body is not fixed there, or the value contradicts another support.
    """
    at_rest = copy(held)
    at_rest._supports = []
    at_rest.fix(boundary, components, value)  # checks the value
    moved = at_rest._supports
    for place, c, *_ in moved:
        if not any(c == d and np.array_equal(place, f) for f, d, *_ in held._supports):
            raise InputError(
                f"move: the body is not fixed on boundary {boundary!r} in component "
                f"{'xyz'[c]}; fix it first, with body.fix({boundary!r}, ...)"
            )
    at_rest._couplings = tuple(each.at_rest() for each in held._couplings)
    at_rest._supports = [
        next(
            ((f, c, m[2], *how) for m in moved if m[1] == c and np.array_equal(m[0], f)),
            (f, c, _still, *how),
        )
        for f, c, _, *how in held._supports
    ]
    for derived in ("constraint", "prescribed"):
        at_rest.__dict__.pop(derived, None)
    found: Array = at_rest.constraint[1]
    return found


def _still(x: Array) -> Array:
    return np.zeros(x.shape[1:])
