"""The two sides of each lateral direction: periodic, on rollers or held tangentially."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact.errors import InputError

Sides = tuple[tuple[int, ...] | None, ...]  # components fixed in each direction; None: periodic
_AXES = "xyz"


def read_sides(sides: Any, dim: int) -> Sides:
    """Components fixed on both sides of each lateral direction; None where they are periodic.
    They are the normal one alone (rollers) or all others, which transforms diagonalise."""
    lateral = dim - 1
    given = [sides] * lateral if sides == "periodic" or lateral == 1 else sides
    if isinstance(given, tuple | list) and lateral == 1 and isinstance(given[0], tuple | list):
        given = list(given[0])
    if not isinstance(given, tuple | list) or len(given) != lateral:
        raise InputError(f"sides={sides!r}: expected 'periodic' or {lateral} entries, a direction "
                         "each, such as ('periodic', 'y')")  # fmt: skip
    found: list[tuple[int, ...] | None] = []
    for axis, entry in enumerate(given):
        others = tuple(c for c in range(dim) if c != axis)
        names = "".join(_AXES[c] for c in others)
        if entry == "periodic":
            found.append(None)
        elif entry == _AXES[axis]:
            found.append((axis,))
        elif isinstance(entry, str) and "".join(sorted(entry)) == names:
            found.append(others)
        else:
            raise InputError(
                f"sides={sides!r}: transforms diagonalise sides across {_AXES[axis]} that are "
                f"'periodic', on rollers ({_AXES[axis]!r}: no normal displacement, no shear) or "
                f"held tangentially ({names!r}), not {entry!r}; LayeredBlock in the plane and "
                "ElasticBody take any"
            )
    return tuple(found)


def odd_unknowns(sides: Sides, kinds: NDArray[np.int64]) -> list[NDArray[np.bool_] | None]:
    """For each direction the unknowns of a node that are odd about its sides; None: periodic.
    The kinds (r,) of the unknowns are those of `dof_kinds`; components alternate."""
    component = np.arange(kinds.size) % (len(sides) + 1)
    return [
        None if fixed is None
        else np.isin(component, fixed) ^ ((kinds == axis) | ((kinds == -2) & (axis < 2)))
        for axis, fixed in enumerate(sides)
    ]  # fmt: skip


def adrift(sides: Sides, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Components of a translation that neither the top nor a side holds, shape (dim,)."""
    loose = ~held
    for fixed in sides:
        loose[list(fixed or ())] = False
    return loose
