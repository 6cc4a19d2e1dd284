"""The named parameters of a solver: those of its velocity, source, decay and data on walls."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cip.errors import InputError
from cip.formulas.parameters import Parametrised


def parameters_of(velocity: Any, source: Any, decay: Any, boundary: Any) -> dict[str, float]:
    """The values of all parameters, in order.

    Parameters
    ----------
    velocity, source, decay, boundary
        Arguments of the solver.

    Raises
    ------
    InputError
        Two values for one name: code takes one name for one parameter.
    """
    found: dict[str, float] = {}
    first: dict[str, str] = {}
    functions = {"velocity": velocity, "source": source, "decay": decay, "boundary": boundary}
    for label, function in functions.items():
        parts = function.values() if isinstance(function, Mapping) else [function]
        for part in parts:
            own = part.parameters if isinstance(part, Parametrised) else {}
            for name, value in own.items():
                if found.setdefault(name, value) != value:
                    raise InputError(
                        f"{label}: its parameter {name!r} is {value:.6g}, that of {first[name]} "
                        f"{found[name]:.6g}; one name is one parameter: rename one of them"
                    )
                first.setdefault(name, label)
    return found


def with_values(function: Any, values: Mapping[str, float]) -> Any:
    """An argument of a solver with other values of those parameters that it has."""
    if isinstance(function, Mapping):
        return {wall: with_values(part, values) for wall, part in function.items()}
    if not isinstance(function, Parametrised):
        return function
    own = {name: values[name] for name in function.parameters if name in values}
    return function.with_parameters(**own) if own else function
