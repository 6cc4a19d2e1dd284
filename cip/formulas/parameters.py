"""Named parameters of formulas: variables whose values compiled code gets as arguments."""

from __future__ import annotations

import keyword
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from cip.errors import InputError
from cip.formulas.expression import COORDINATES, RULES, Expression, ordered, variable
from cip.reals import real_number

# A parameter is the variable of its name with this before it, so no name can be that of a
# coordinate or of an unknown of the characteristics.
_PREFIX = "p_"
_TAKEN = {*COORDINATES, "x", "y", "z", "pi", "e", *RULES}


def parameter(name: str) -> Expression:
    """The node of the parameter of this name."""
    return variable(f"{_PREFIX}{name}")


def parameters_in(nodes: Iterable[Expression]) -> list[str]:
    """The variables of all parameters in some formulas, as code names them, in order."""
    found = {node.value for node in ordered(list(nodes)) if node.op == "variable"}
    return sorted(name for name in found if name.startswith(_PREFIX))


def bound(values: Mapping[str, float]) -> dict[str, np.float64]:
    """The values by the names that code uses; NumPy's numbers give infinity where Python's raise.

    Parameters
    ----------
    values : mapping
        From names to numbers.
    """
    return {f"{_PREFIX}{name}": np.float64(value) for name, value in values.items()}


def checked(values: Any) -> dict[str, float]:
    """The argument `parameters` as names and finite numbers.

    Raises
    ------
    InputError
        A name that a formula cannot hold or that has another meaning there; a value that is no
        finite number.
    """
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise InputError(f"parameters: expected numbers by names, got {values!r}")
    found = {}
    for name, value in values.items():
        if not (
            isinstance(name, str) and name.isascii() and name.isidentifier()
        ) or keyword.iskeyword(name):
            raise InputError(f"parameters: {name!r} is no name; take ASCII letters, digits and _")
        if name in _TAKEN:
            raise InputError(f"parameters: {name!r} has a meaning in formulas; take another name")
        number = real_number(value, f"parameters: {name!r}")
        if not np.isfinite(number):
            raise InputError(f"parameters: {name!r} must be finite, got {value!r}")
        found[name] = float(number)
    return found
