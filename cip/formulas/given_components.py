"""The components of a velocity that is given by numbers, arrays or callables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.expression import raised
from cip.formulas.formula import Formula, Orders
from cip.grid import Grid
from cip.reals import own_array, real_number

_ORDERS: tuple[Orders, ...] = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0))


def given_components(c: Any) -> list[Any]:
    """The components of a velocity given by numbers, arrays, callables or a sequence of them.

    Arrays are copied.
    """
    if isinstance(c, bool | int | float | np.number) or (isinstance(c, np.ndarray) and not c.ndim):
        return [real_number(c, "c")]
    if isinstance(c, np.ndarray):
        values = own_array(c, "c")
        return [values] if values.ndim == 1 or values.ndim != len(values) + 1 else list(values)
    if isinstance(c, Sequence):
        if len(c) > 3 and all(np.ndim(part) == 0 and not callable(part) for part in c):
            return [own_array(c, "c")]
        if not 1 <= len(c) <= 3:
            raise InputError(f"c: expected 1 to 3 components, got {len(c)}")
        return [
            part if callable(part) or isinstance(part, str) else _part(part, f"c{q + 1}")
            for q, part in enumerate(c)
        ]
    raise InputError(f"c: expected a callable or arrays, got {type(c).__name__}")


def _part(value: Any, name: str) -> Any:
    """A component as a number or as an array of its own."""
    values = own_array(value, name)
    return values if values.ndim else real_number(value, name)


def formulas_by_values(
    c: Any, jacobian: Any, hessian: Any, steady: bool, grid: Grid
) -> tuple[Formula, ...]:
    """The components of a callable of which only values (and given derivatives) are used."""
    dim = grid.dim

    def part(q: int) -> Callable[..., Any]:
        def values(*point: Any) -> Any:
            result = c(*point)
            parts = (result,) if dim == 1 and np.ndim(result) <= np.ndim(point[0]) else result
            if len(parts) != dim:
                raise InputError(f"c: returned {len(parts)} components, expected {dim}")
            return parts[q]

        return values

    def entry(function: Callable[..., Any], *place: int) -> Callable[..., Any]:
        def values(*point: Any) -> Any:
            result = function(*point)
            if dim == 1 and np.ndim(result) <= np.ndim(point[0]):
                return result
            for q in place:
                result = result[q]
            return result

        return values

    hint = "; a velocity that depends on t is Velocity(c, steady=False)" if steady else ""
    formulas = []
    for q in range(dim):
        known: dict[Orders, Callable[..., Any]] = {}
        for k in range(dim):
            if jacobian is not None:
                known[_ORDERS[k]] = entry(jacobian, q, k)
            for l in range(k, dim):
                if hessian is not None:
                    known[raised(_ORDERS[k], l)] = entry(hessian, q, k, l)
        name, time = f"c{q + 1}", not steady
        formulas.append(Formula.by_values(part(q), dim, name, time, known, hint))
        formulas[-1].check_pointwise(grid.bounds, name, time)
    return tuple(formulas)
