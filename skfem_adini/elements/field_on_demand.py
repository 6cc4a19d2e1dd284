"""Shape functions whose higher derivatives are computed when a form first uses them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.element import DiscreteField

Array = NDArray[np.float64]

# Orders of the derivatives by their places in a DiscreteField's tuple.
_ORDERS = {1: 1, 4: 2, 5: 3, 6: 4, 7: 5, 8: 6}
DERIVATIVE_NAMES = ("value", "grad", "hess", "grad3", "grad4", "grad5", "grad6")


def _derivative(order: int) -> property:
    """Return the attribute for the derivatives of one order."""

    def read(self: FieldOnDemand) -> Any:
        made = self.__dict__.get("made", {})
        if order not in made and "make" in self.__dict__:
            made[order] = self.__dict__["make"](order)
        return made.get(order)

    def write(self: FieldOnDemand, values: Any) -> None:
        if values is not None:
            self.__dict__.setdefault("made", {})[order] = values

    return property(read, write)


class FieldOnDemand(DiscreteField):
    """A shape function with its gradient; `make` computes higher derivatives when first used.
    Code that copies a whole field (by `astuple`: `skfem.ElementVector`, `basis.interpolate`,
    pickle) computes all orders up to `most`."""

    def __new__(
        cls, value: Array, grad: Array | None, most: int, make: Callable[[int], Array]
    ) -> FieldOnDemand:
        """Make the field."""
        field: FieldOnDemand = super().__new__(cls, value=value, grad=grad)
        field.__dict__.setdefault("made", {})
        field.__dict__.update(most=most, make=make)
        return field

    def __array_finalize__(self, obj: Any) -> None:
        # scikit-fem's method would read, and so compute, every derivative of the original.
        if isinstance(obj, FieldOnDemand):
            self.__dict__.update(obj.__dict__)
        else:
            super().__array_finalize__(obj)

    def __repr__(self) -> str:
        return repr(DiscreteField(*self.astuple))

    def get(self, n: int) -> Any:
        """Return entry n of the tuple, None for derivatives beyond `most`."""
        if _ORDERS.get(n, 0) > self.__dict__.get("most", max(_ORDERS.values())):
            return None
        return super().get(n)

    def zeros(self) -> FieldOnDemand:
        """Return the same field with all entries zero."""
        most = self.__dict__.get("most", max(_ORDERS.values()))
        gradient = None if self.get(1) is None else np.zeros_like(self.get(1))
        read = self._zero
        return FieldOnDemand(np.zeros_like(np.asarray(self)), gradient, most, read)

    def _zero(self, order: int) -> Array:
        return np.zeros_like(getattr(self, DERIVATIVE_NAMES[order]))

    grad = _derivative(1)
    hess = _derivative(2)
    grad3 = _derivative(3)
    grad4 = _derivative(4)
    grad5 = _derivative(5)
    grad6 = _derivative(6)


def existing_parts(field: DiscreteField) -> list[Array | None]:
    """Return the tuple of a field, with None for derivatives that have not been used yet."""
    others = range(1, max(_ORDERS) + 1)
    if not isinstance(field, FieldOnDemand):
        return [np.asarray(field), *(field.get(n) for n in others)]
    made = field.__dict__["made"]
    return [np.asarray(field), *(made.get(_ORDERS.get(n)) for n in others)]
