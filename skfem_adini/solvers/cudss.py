"""An interface to NVIDIA's cuDSS: one matrix on the device, its factors, and solutions."""

from __future__ import annotations

import ctypes
import os
import threading
import weakref
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_adini.errors import AdiniError
from skfem_adini.solvers.cudss_library import (
    CudssError,
    device_arrays,
    load_cudss,
    threading_layer,
)
from skfem_adini.solvers.upper_triangle import upper_triangle

Array = NDArray[np.float64]

# cuDSS's numbers (cudss_data_types.h of version 1.0; those of 0.x differ) and CUDA's data types.
_INT32, _FLOAT64 = 10, 1
_SYMMETRIC, _SPD = 1, 3
_UPPER, _ZERO_BASED, _COLUMN_MAJOR = 2, 0, 0
_REFINEMENTS, _DETERMINISTIC = 5, 24
_INFO = 0
ANALYSIS, FACTORISATION, SOLUTION = 0b11, 0b100, 0b11_1111_0000
# Corrections of a solution by its residual, as many as PARDISO makes. cuDSS makes none in its
# deterministic mode, and solves for one load at a time there.
_CORRECTIONS = 2


class CudssMatrix:
    """One symmetric matrix and its factors in the memory of a CUDA device.

    The memory is released with the object, also when its construction fails. Threads that share an
    object take turns. A copy or pickle factors again; a forked process cannot use the device.

    The binding is by ctypes because nvmath-python, which has one, needs a version of cuDSS before
    1.0, whose numbers differ.

    Parameters
    ----------
    A
        Symmetric sparse matrix, shape (n, n); its upper triangle is taken.
    definite
        Whether A is positive definite; else pivots of both signs are expected.
    deterministic
        Whether equal calls give equal bits on the same device. Loads are then solved for one by
        one, else together.

    Raises
    ------
    MissingDependency
        cuDSS, CuPy or a device is not there, or cuDSS has another major version.
    CudssError
        The factorisation fails; `CudssError.pivot` tells whether A is not definite.

    References
    ----------
    NVIDIA cuDSS 1.0 documentation, data types and functions.
    """

    def __init__(self, A: Any, definite: bool, deterministic: bool = True) -> None:
        self._given: tuple[Any, ...] = A, definite, deterministic
        self._A, self._deterministic = A, deterministic
        upper = upper_triangle(A)
        if upper.nnz >= 2**31:
            raise AdiniError(f"cuDSS: {upper.nnz} entries are too many for 32-bit indices")
        self._library, self._xp = load_cudss(), device_arrays()
        self._n, self._lock, self._process = A.shape[0], threading.Lock(), os.getpid()
        put = self._xp.asarray
        self._arrays = (
            put(upper.indptr.astype(np.int32)),
            put(upper.indices.astype(np.int32)),
            put(upper.data.astype(np.float64)),
        )
        with ExitStack() as opened:
            self._open(opened, definite)
            with ExitStack() as columns:
                b, x = self._columns(columns, 1)[1::2]
                for phase in (ANALYSIS, FACTORISATION):
                    self._execute(phase, x, b)
            self._check_pivots()
            weakref.finalize(self, _release, opened.pop_all(), self._process)

    def _run(self, phase: int, loads: Array, together: int) -> Array:
        """Return what a phase makes of loads (n, loads), so many at a time."""
        if os.getpid() != self._process:
            raise AdiniError("cuDSS: a forked process cannot use the device; factor in the child")
        count = loads.shape[1]
        x = np.empty((count, self._n))
        with self._lock, ExitStack() as columns:
            right, b_handle, left, x_handle = self._columns(columns, together)
            for i in range(0, count, together):
                part = slice(i, i + together)
                right[...] = self._xp.asarray(np.ascontiguousarray(loads[:, part].T))
                self._execute(phase, x_handle, b_handle)
                x[part] = self._on_host(left)
        return x.T

    @staticmethod
    def _on_host(array: Any) -> Any:
        return array.get() if hasattr(array, "get") else array

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the matrix: a copy factors it again."""
        return type(self), self._given

    def _open(self, opened: ExitStack, definite: bool) -> None:
        """Create the handles; `opened` destroys them in the reverse order."""
        self._handle = self._create(opened, "cudssCreate", "cudssDestroy")
        layer = threading_layer()
        if layer is not None:
            self._call("cudssSetThreadingLayer", self._handle, os.fsencode(layer))
        self._config = self._create(opened, "cudssConfigCreate", "cudssConfigDestroy")
        self._set(_REFINEMENTS, 0)
        self._set(_DETERMINISTIC, int(self._deterministic))
        self._data = ctypes.c_void_p()
        self._call("cudssDataCreate", self._handle, ctypes.byref(self._data))
        opened.callback(self._library.cudssDataDestroy, self._handle, self._data)
        indptr, indices, data = self._arrays
        n, nnz = ctypes.c_int64(self._n), ctypes.c_int64(len(data))
        pointers = (pointer(indptr), None, pointer(indices), pointer(data))
        types = (_INT32, _INT32, _FLOAT64, _SPD if definite else _SYMMETRIC, _UPPER, _ZERO_BASED)
        self._matrix = self._create(
            opened, "cudssMatrixCreateCsr", "cudssMatrixDestroy", n, n, nnz, *pointers, *types
        )

    def _columns(self, opened: ExitStack, count: int) -> tuple[Any, Any, Any, Any]:
        """Return two arrays of shape (count, n), each followed by its handle as (n, count)."""
        n, loads = ctypes.c_int64(self._n), ctypes.c_int64(count)
        result: list[Any] = []
        for _ in range(2):
            array = self._xp.zeros((count, self._n))
            layout = (n, loads, n, pointer(array), _FLOAT64, _COLUMN_MAJOR)
            handle = self._create(opened, "cudssMatrixCreateDn", "cudssMatrixDestroy", *layout)
            result += [array, handle]
        return result[0], result[1], result[2], result[3]

    def _create(self, opened: ExitStack, create: str, destroy: str, *data: Any) -> Any:
        handle = ctypes.c_void_p()
        self._call(create, ctypes.byref(handle), *data)
        opened.callback(getattr(self._library, destroy), handle)
        return handle

    def _set(self, key: int, value: int) -> None:
        number = ctypes.c_int(value)
        size = ctypes.c_size_t(ctypes.sizeof(number))
        self._call("cudssConfigSet", self._config, key, ctypes.byref(number), size)

    def _execute(self, phase: int, x: Any, b: Any) -> None:
        handles = self._config, self._data, self._matrix, x, b
        self._call("cudssExecute", self._handle, phase, *handles)

    def _check_pivots(self) -> None:
        info, written = ctypes.c_int(0), ctypes.c_size_t()
        out = ctypes.byref(info), ctypes.c_size_t(ctypes.sizeof(info)), ctypes.byref(written)
        self._call("cudssDataGet", self._handle, self._data, _INFO, *out)
        if info.value:
            raise CudssError("cudssExecute", info.value, pivot=True)

    def _call(self, name: str, *arguments: Any) -> None:
        status = int(getattr(self._library, name)(*arguments))
        if status:
            raise CudssError(name, status)


class Cudss(CudssMatrix):
    """Factors of a symmetric matrix on a CUDA device, for solutions; see `CudssMatrix`."""

    def solve(self, b: Array) -> Array:
        """Return the solution for one load (n,) or several (n, loads)."""
        loads = b.reshape(self._n, -1)
        if loads.shape[1] == 0:
            return np.zeros(b.shape)
        x = self._direct(loads)
        residual = loads - self._A @ x
        for _ in range(_CORRECTIONS):
            corrected = x + self._direct(residual)
            left = loads - self._A @ corrected
            falls = np.abs(left).max(axis=0) < np.abs(residual).max(axis=0)
            if not falls.any():
                break
            x, residual = np.where(falls, corrected, x), np.where(falls, left, residual)
        return np.ascontiguousarray(x).reshape(b.shape)

    def _direct(self, loads: Array) -> Array:
        """Solve for loads (n, loads) by the factors alone."""
        together = 1 if self._deterministic else loads.shape[1]
        return self._run(SOLUTION, loads, together)


def _release(opened: ExitStack, process: int) -> None:
    """Destroy the handles, unless a forked process, which has no device, collects the object."""
    if os.getpid() == process:
        opened.close()


def pointer(array: Any) -> Any:
    """Return the address of an array on the device."""
    interface = getattr(array, "__cuda_array_interface__", None) or array.__array_interface__
    return ctypes.c_void_p(interface["data"][0])
