"""Vectors and matrices of real numbers; imaginary parts are refused, not dropped."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from skfem_adini.errors import InputError

Array = NDArray[np.float64]


def real_array(name: str, value: Any) -> Array:
    """Return an array of float64; complex numbers must have no imaginary part."""
    array = np.asarray(value)
    if array.dtype.kind not in "biufc":
        try:
            array = array.astype(np.float64)
        except (TypeError, ValueError):
            kind = f"{type(value).__name__} of the type {array.dtype}"
            raise InputError(f"{name}: expected an array of numbers, got {kind}") from None
    if array.dtype.kind == "c":
        _check_real(name, array)
        array = array.real
    return np.asarray(array, dtype=np.float64)


def real_matrix(name: str, value: Any) -> Any:
    """Return a sparse matrix of float64 by rows; see `real_array`."""
    matrix: Any = value
    if not sparse.issparse(value):
        dense = real_array(name, value)
        if dense.ndim != 2:
            raise InputError(f"{name}: expected a matrix, got shape {dense.shape}")
        return sparse.csr_array(dense)
    if matrix.dtype.kind not in "biufc":
        raise InputError(f"{name}: expected numbers, got the type {matrix.dtype}")
    if matrix.dtype.kind == "c":
        _check_real(name, matrix.tocsr().data)
        matrix = matrix.real
    return sparse.csr_array(matrix, dtype=np.float64)


def _check_real(name: str, values: Any) -> None:
    if not (values.imag == 0).all():
        raise InputError(
            f"{name}: expected real numbers, got complex ones; solve for the real and the "
            "imaginary part one by one"
        )
