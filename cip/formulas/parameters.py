"""Named parameters of formulas: variables whose values compiled code gets as arguments."""

from __future__ import annotations

import keyword
from collections.abc import Iterable, Mapping
from copy import deepcopy
from typing import Any, Self

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


class Parametrised:
    """What has named parameters: their values, and the same with others."""

    _kind = "function"
    _parameters: dict[str, float]

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the named parameters by names; a copy.

        Those of a solver are the parameters of its velocity, source, decay and boundary, in this
        order, where one name is one parameter.
        """
        return dict(self._parameters)

    def with_parameters(self, /, **values: float) -> Self:
        """The same formulas with other values of some parameters; nothing is compiled again.

        Parameters
        ----------
        **values : float
            New values by name; the other parameters keep theirs.

        Returns
        -------
        Velocity, Source or Solver
            As this one.

        Raises
        ------
        InputError
            A name that is none of the parameters, or a value that is not a finite number.

        Examples
        --------
        >>> from cip import Velocity
        >>> Velocity.from_expression("a + t", parameters={"a": 1}).with_parameters(a=2).parameters
        {'a': 2.0}
        """
        unknown = sorted(set(values) - set(self._parameters))
        if unknown:
            known = ", ".join(self._parameters) or "it has none"
            raise InputError(f"{unknown[0]}: no parameter of this {self._kind}; known: {known}")
        return self._with({**self._parameters, **checked(values)})

    def _with(self, values: dict[str, float]) -> Self:
        """The same with these values of all parameters."""
        new = self._copy()
        new._parameters = values
        return new

    def _copy(self) -> Self:
        """Another object with the same attributes."""
        new = object.__new__(type(self))
        new.__dict__.update(self.__dict__)
        return new

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        new = object.__new__(type(self))
        new.__dict__.update({name: deepcopy(value, memo) for name, value in self.__dict__.items()})
        return new


def require_held(names: Iterable[str], formulas: Iterable[Expression]) -> None:
    """Raise `InputError` for a parameter that no formula holds."""
    held = set(ordered(list(formulas)))
    unused = [name for name in names if parameter(name) not in held]
    if unused:
        raise InputError(f"parameters: no formula holds {unused[0]!r}; leave it out")
