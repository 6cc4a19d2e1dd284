"""The check of arguments that are arrays of finite numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from skfem_adini.errors import InputError


def finite_numbers(name: str, value: Any, shape: tuple[int, ...], complex_too: bool = False) -> Any:
    """Return finite numbers of the given shape in double precision, complex ones if
    `complex_too`."""
    kinds = "real or complex" if complex_too else "real"
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name}: expected {kinds} numbers of shape {shape}: {error}") from error
    if array.shape != shape or array.dtype.kind not in ("iufc" if complex_too else "iuf"):
        raise InputError(
            f"{name}: expected finite {kinds} numbers of shape {shape}, got {array.dtype} of shape "
            f"{array.shape}"
        )
    bad = ~np.isfinite(array)
    if bad.any():
        place = tuple(np.argwhere(bad)[0].tolist())
        raise InputError(
            f"{name}: {bad.sum()} of {array.size} entries are NaN or infinite (first: "
            f"{array[place]} at {place}); expected finite {kinds} numbers"
        )
    return array.astype(complex if array.dtype.kind == "c" else float)
