"""Objects that can be copied and pickled, with their functions if pickle supports these."""

from __future__ import annotations

import pickle
import weakref
from copy import copy, deepcopy
from dataclasses import dataclass
from typing import Any, ClassVar, NoReturn, Self

import numpy as np

from contact.errors import InputError


class Portable:
    """Base of classes that pickle without cached values and unpicklable functions. A copy shares
    everything with the original; a deep copy shares functions only."""

    _ANEW: ClassVar[tuple[str, ...]] = ()  # attributes that are computed if missing
    _KEPT: ClassVar[tuple[str, ...]] = ()  # values of functions that may be dropped
    _FUNCTIONS: ClassVar[tuple[str, ...]] = ()  # attributes with the caller's functions

    def __getstate__(self) -> dict[str, Any]:
        for name in self._KEPT:
            getattr(self, name)
        state = {name: value for name, value in vars(self).items() if name not in self._ANEW}
        return state | {name: carried(state[name]) for name in self._FUNCTIONS if name in state}

    def __copy__(self) -> Self:
        other = type(self).__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        other = type(self).__new__(type(self))
        memo[id(self)] = other
        kept = {name: value for name, value in vars(self).items() if name not in self._ANEW}
        other.__dict__.update(deepcopy(kept, memo))
        return other


@dataclass(frozen=True)
class LostFunction:
    """Placeholder of an unpicklable function, its `name`; calling it raises an `InputError`."""

    name: str

    def __call__(self, *_: Any) -> NoReturn:
        """Raise an `InputError`."""
        raise InputError(
            f"{self.name} stayed in the process that it was made in, because pickle carries no "
            "functions without a name that can be imported: define it at the top of a module, or "
            "give it again"
        )


class Origin:
    """Where a result comes from: a weak reference to its problem, whose factors it may use, and the
    problem as it was, `posed`, without factors; `slide` has the projections of a step of finite
    sliding. Pickles and deep copies keep only whether it slid."""

    def __init__(self, problem: Any = None, slide: Any = None, slides: bool = False) -> None:
        self.slide, self.slides = slide, slides or slide is not None
        self._problem, self.posed = None, None
        if problem is not None:
            self._problem, self.posed = weakref.ref(problem), copy(problem)
            vars(self.posed).pop("_condensed", None)

    @property
    def problem(self) -> Any:
        """The problem, if it still exists, or as it was."""
        return (self._problem() if self._problem else None) or self.posed

    def __reduce__(self) -> tuple[Any, ...]:
        return Origin, (None, None, self.slides)


def carried(value: Any) -> Any:
    """The value, with each unpicklable function replaced by a `LostFunction`."""
    if isinstance(value, np.ndarray | str | int | float | None):
        return value
    if type(value) in (list, tuple):
        return type(value)(carried(part) for part in value)
    try:
        pickle.dumps(value)
    except Exception:  # errors of any type, depending on the contents
        return LostFunction(repr(value))
    return value


class PortableBasis:
    """A Basis for pickle: its arguments instead of its much larger tables. Bodies that share one
    Basis share one of these, and so one Basis after unpickling."""

    def __init__(self, basis: Any) -> None:
        self.basis = basis

    def __deepcopy__(self, memo: dict[int, Any]) -> PortableBasis:
        return PortableBasis(deepcopy(self.basis, memo))

    def __reduce__(self) -> tuple[Any, ...]:
        basis = self.basis
        return _rebuilt, (basis.mesh, basis.elem, basis.mapping, basis.dofs, basis.X, basis.W)


def _rebuilt(mesh: Any, elem: Any, mapping: Any, dofs: Any, X: Any, W: Any) -> PortableBasis:
    from skfem import Basis

    return PortableBasis(Basis(mesh, elem, mapping=mapping, quadrature=(X, W), dofs=dofs))
