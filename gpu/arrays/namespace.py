"""The array module (NumPy or CuPy) of arguments, and copies to the host."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpu.errors import InputError, MissingDependency


def namespace(*values: Any) -> Any:
    """Return cupy if any of the values (arrays or sparse matrices) is on a device, else numpy.

    Raises
    ------
    InputError
        Host and device arrays are mixed.
    """
    on_device = [_of_cupy(value) for value in values if value is not None]
    if not any(on_device):
        return np
    on_host = [
        value
        for value, device in zip([v for v in values if v is not None], on_device, strict=True)
        if not device and getattr(value, "ndim", 0) > 0
    ]
    if on_host:
        raise InputError("arrays of NumPy and of CuPy are mixed: move all of them to one side")
    return cupy()


def cupy() -> Any:
    """Import cupy.

    Raises
    ------
    MissingDependency
    """
    try:
        import cupy as module
    except ImportError as error:
        raise MissingDependency(
            "the device needs CuPy: pip install 'skfem-adini[cuda12]' or 'skfem-adini[cuda13]'"
        ) from error
    return module


def _of_cupy(value: Any) -> bool:
    return type(value).__module__.partition(".")[0] in ("cupy", "cupyx")


def to_host(array: Any) -> np.ndarray:
    """Return the array as a NumPy array, copied from the device if it lies there."""
    return array.get() if _of_cupy(array) else np.array(array)
