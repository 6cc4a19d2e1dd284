"""Velocities traced from a callable of all components."""

from __future__ import annotations

from typing import Any

import numpy as np

from cip.formulas.expression import COORDINATES, traced
from cip.formulas.formula import Formula, agree
from cip.formulas.pointwise_check import Box


def traced_velocity(c: Any, box: Box, time: bool) -> tuple[Formula, ...] | None:
    """The components that a callable computes; None if it is not plain arithmetic.

    Parameters
    ----------
    c : object
    box : Box
        Where the formulas and the callable are compared.
    time : bool
        Whether the callable takes t last.
    """
    if not callable(c):
        return None
    dim = len(box)
    names = [*COORDINATES[:dim], *(["t"] if time else [])]
    found = []
    for q in range(dim):

        def part(*point: Any, q: int = q) -> Any:
            result = c(*point)
            if isinstance(result, tuple | list | np.ndarray) and np.ndim(result) == 1:
                if len(result) != dim:
                    raise TypeError("wrong number of components")
                return result[q]
            if dim > 1:
                raise TypeError("one component only")
            return result

        expression = traced(part, names)
        if expression is None:
            return None
        found.append(expression)
    if not agree(found, c, box, time):
        return None
    return tuple(Formula(expression, dim) for expression in found)
