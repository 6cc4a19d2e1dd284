"""Arrays of NumPy and CuPy: their module, copies to the host, and factors of symmetric matrices.

NumPy and SciPy each bring a BLAS. If calls alternate between the two, their thread pools wait for
each other, which costs more than a product with a matrix of a thousand rows: so dense algebra uses
the BLAS and LAPACK of SciPy.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf, dtrtrs, spotrf, strtrs

from skfem_adini.ground.errors import InputError, optional


def namespace(*values: Any) -> Any:
    """CuPy if one of the values (arrays or sparse matrices) is on a device, else NumPy;
    `InputError` where arrays of the host and of a device are mixed."""
    devices = [on_device(value) for value in values]
    if not any(devices):
        return np
    for value, device in zip(values, devices, strict=True):
        if not device and getattr(value, "ndim", 0) > 0:
            raise InputError("arrays of NumPy and of CuPy are mixed: move all of them to one side")
    return cupy()


def on_device(value: Any) -> bool:
    """Whether an array or a sparse matrix is one of CuPy."""
    return type(value).__module__.partition(".")[0] in ("cupy", "cupyx")


def cores() -> int:
    """Cores that this process may use."""
    known = getattr(os, "sched_getaffinity", None)
    return len(known(0)) if known else os.cpu_count() or 1


def cupy() -> Any:
    """The module, or a `MissingDependency`."""
    return optional(
        "cupy", "the device needs CuPy: pip install 'skfem-adini[cuda12]' or 'skfem-adini[cuda13]'"
    )


def host(array: Any) -> Any:
    """The array in host memory; the same object if it is there."""
    return array.get() if hasattr(array, "get") else np.asarray(array)


def to_host(array: Any) -> np.ndarray:
    """A new array in host memory."""
    return array.get() if on_device(array) else np.array(array)


def cholesky(A: Any) -> Any:
    """Lower factor of a symmetric column-major A of the host, which is overwritten, or
    `LinAlgError` if a pivot is not positive. What is above the diagonal is undefined."""
    if not A.size:
        return A
    factor = dpotrf if A.dtype == np.float64 else spotrf
    L, minor = factor(A, lower=1, clean=0, overwrite_a=1)
    if minor:
        raise np.linalg.LinAlgError(f"leading minor {minor} is not positive")
    return L


def lower_solve(L: Any, B: Any, transposed: bool = False, overwrite: bool = False) -> Any:
    """Solve ``L X = B`` or ``L^T X = B`` on the host for a vector or a matrix B."""
    if not B.size:
        return B
    if L.dtype == np.float32:
        B = strtrs(L, B.astype(np.float32), lower=1, trans=int(transposed), overwrite_b=True)[0]
        return B.astype(np.float64)
    if B.ndim == 1:
        return dtrtrs(L, B, lower=1, trans=int(transposed), overwrite_b=overwrite)[0]
    return dtrsm(1.0, L, B, side=0, lower=1, trans_a=int(transposed), overwrite_b=overwrite)
