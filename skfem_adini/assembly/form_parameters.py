"""The parameters ``w`` of forms in fast assembly, which detect the use of varying fields."""

from __future__ import annotations

import cmath
from collections.abc import Mapping
from numbers import Number
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from skfem.assembly.form.form import FormExtraParams
from skfem.element import DiscreteField

from skfem_adini.errors import InputError, NotSupported
from skfem_adini.ground.arguments import array_of

Array = NDArray[Any]


class FormParameters(FormExtraParams):
    """The parameters ``w`` of a form: constants can be read, all others raise `NotSupported`.
    The others are the coordinates ``x``, the size ``h``, ``idx`` and fields that vary inside a
    cell; their use is recorded, in case the form catches the exception."""

    def __init__(self, constant: Mapping[str, Any], withheld: set[str]) -> None:
        super().__init__(constant)
        self._withheld = withheld
        self._used: set[str] = set()

    @property
    def _refused(self) -> NotSupported | None:
        """The error that names the withheld parameters that the form has used, or None."""
        names = ", ".join(f"w.{name}" for name in sorted(self._used))
        return NotSupported(f"the form uses {names}") if names else None

    def _refuse(self, name: str) -> NoReturn:
        self._used.add(name)
        raise NotSupported(f"the form uses {name}")

    def __getattr__(self, name: str) -> Any:
        if name in self.__dict__.get("_withheld", ()):
            self._refuse(name)
        return super().__getattr__(name)

    def __missing__(self, name: Any) -> Any:
        if name in self._withheld:
            self._refuse(name)
        raise KeyError(name)

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or name in self._withheld

    def get(self, name: Any, default: Any = None) -> Any:
        """Return a parameter or the default."""
        if name in self._withheld:
            self._refuse(name)
        return super().get(name, default)

    def _refuse_all(self, *_: Any, **__: Any) -> NoReturn:
        self._refuse("items()")

    # Methods that return all parameters at once, or change them, are refused.
    __iter__ = __len__ = __eq__ = __or__ = __ror__ = __setitem__ = _refuse_all
    keys = values = items = copy = pop = popitem = update = setdefault = clear = _refuse_all
    __hash__ = None  # type: ignore[assignment]


def checked(name: str, value: Any, cells: int, points: int, dofs: int) -> Any:
    """Return a parameter of a form, as a number, a tuple or an array with at least two axes. None
    stands for a vector of dofs, which is to be interpolated. One number a cell, or a
    `DiscreteField` with one point, is repeated at all points, as in scikit-fem."""
    if isinstance(value, tuple):
        return value
    if isinstance(value, Number):
        if not cmath.isfinite(complex(value)):  # type: ignore[call-overload]
            raise InputError(f"{name}: expected a finite number, got {value!r}")
        return value
    if not isinstance(value, np.ndarray) or value.ndim == 0 or value.dtype.kind not in "biufc":
        raise InputError(
            f"{name}: expected a number, an array of numbers over (..., {cells} cells, {points} "
            f"points), or a vector of {dofs} dofs, got {value!r}"
        )
    parts = value.astuple if isinstance(value, DiscreteField) else (array_of(name, value),)
    if not all(np.isfinite(part).all() for part in parts if part is not None):
        raise InputError(f"{name}: the field holds NaN or infinity")
    if value.ndim == 1:
        if len(value) == dofs and not isinstance(value, DiscreteField):
            return None
        if len(value) == cells:
            return np.broadcast_to(np.asarray(value)[:, None], (cells, points))
        raise InputError(
            f"{name}: expected {cells} numbers, one for each cell, or {dofs} dofs, got {len(value)}"
        )
    # Axes of constant tensors have up to 36 entries (6 x 6 moduli); longer arrays are fields.
    tensor = value.shape[-2] == 1 or max(value.shape) <= 36
    field = value.shape[-2] == cells and value.shape[-1] in (1, points)
    if not (field or (tensor and not isinstance(value, DiscreteField))):
        raise InputError(
            f"{name}: expected an array over (..., cells, points) with {cells} cells and 1 or "
            f"{points} quadrature points, got shape {value.shape}"
        )
    if isinstance(value, DiscreteField) and value.shape[-1] == 1 != points:
        return wide_field(value, points)
    return value


def wide_field(value: DiscreteField, points: int) -> DiscreteField:
    """Return a field that has one point in each cell with its values at all points."""
    parts = (part if part is None else np.asarray(part) for part in value.astuple)
    return DiscreteField(
        *(None if p is None else np.broadcast_to(p, (*p.shape[:-1], points)) for p in parts)
    )


def constant_parts(value: Array, cells: int) -> list[Array | None] | None:
    """Return a field (..., cells, points) and its derivatives if constant in every cell, else
    None."""
    parts = value.astuple if isinstance(value, DiscreteField) else (np.asarray(value),)
    for part in parts:
        if part is None:
            continue
        fits = part.ndim > 1 and part.shape[-2] == cells and part.dtype.itemsize <= 16
        if not fits:
            return None
        if part.strides[-1] and not (part == part[..., :1]).all():
            return None
    return list(parts)


def words_of(part: Array) -> NDArray[np.uint64]:
    """Return the bits of a field that is constant in each cell, shape (cells, words)."""
    rows = np.moveaxis(part[..., 0], -1, 0).reshape(part.shape[-2], -1)
    wide = np.complex128 if part.dtype.kind == "c" else np.float64
    return np.ascontiguousarray(rows, dtype=wide).view(np.uint64)
