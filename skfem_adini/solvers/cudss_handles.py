"""The handles of one matrix in cuDSS, and the calls that use them."""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import ExitStack, nullcontext, suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skfem_adini.errors import AdiniError, InputError
from skfem_adini.solvers.cudss_library import (
    CODES,
    device_arrays,
    failed,
    load_cudss,
    threading_layer,
)


class CudssHandles:
    """Handles of cuDSS for a matrix on the device; `opened` destroys them in the reverse order.
    `arrays` are row starts, columns (int32) and values (float64) of the upper triangle, or of all
    of a matrix whose kind is general, on the first of `devices` (None: the present one); `settings`
    map cuDSS's numbers to ctypes values."""

    def __init__(
        self, opened: ExitStack, arrays: Any, kind: int, settings: Any,
        devices: tuple[int, ...] | None = None,
    ) -> None:  # fmt: skip
        self.library, self.xp = load_cudss(), device_arrays()
        self._process, self._flag = os.getpid(), np.zeros(1, dtype=np.int32)
        self._device = on_device(self.xp, devices)
        self._kept: list[Any] = [arrays]  # objects that cuDSS refers to by address
        indptr, indices, data = arrays
        self.n = len(indptr) - 1
        create: str = "cudssCreate"
        numbers: tuple[Any, ...] = ()
        if devices is not None:
            create, numbers = "cudssCreateMg", (len(devices), _numbers(devices))
            count = ctypes.c_int(len(devices))
            settings = {**settings, CODES.devices: count, CODES.device_numbers: numbers[1]}
        self._handle = self.create(opened, create, "cudssDestroy", *numbers)
        layer = threading_layer()
        if layer is not None:
            self._call("cudssSetThreadingLayer", self._handle, os.fsencode(layer))
        self._config = self.create(opened, "cudssConfigCreate", "cudssConfigDestroy")
        for key, value in settings.items():
            self.configure(key, value)
        self._data = ctypes.c_void_p()
        self._call("cudssDataCreate", self._handle, ctypes.byref(self._data))
        opened.callback(self.library.cudssDataDestroy, self._handle, self._data)
        n, nnz = ctypes.c_int64(self.n), ctypes.c_int64(len(data))
        pointers = (pointer(indptr), None, pointer(indices), pointer(data))
        view = CODES.full if kind == CODES.general else CODES.upper
        types = CODES.int32, CODES.int32, CODES.float64, kind, view, CODES.zero_based
        self._matrix = self.create(
            opened, "cudssMatrixCreateCsr", "cudssMatrixDestroy", n, n, nnz, *pointers, *types
        )
        if devices is None:  # cuDSS does not support interrupts on several devices
            self.put(CODES.interrupt, self._flag)

    def here(self) -> None:
        """Raise an error in a forked process, which has no device."""
        if os.getpid() != self._process:
            raise AdiniError("cuDSS: a forked process cannot use the device; factor in the child")

    def release(self, opened: ExitStack) -> None:
        """Destroy the handles, unless in a forked process."""
        if os.getpid() == self._process:
            opened.close()

    @property
    def triangle(self) -> tuple[Any, Any, Any]:
        """Row starts, columns and values of the upper triangle, on the device."""
        starts, columns, values = self._kept[0]
        return starts, columns, values

    def configure(self, key: int, value: Any) -> None:
        """Change a setting of cuDSS to a number of ctypes."""
        size = ctypes.c_size_t(ctypes.sizeof(value))
        self._call("cudssConfigSet", self._config, key, ctypes.byref(value), size)

    def columns(self, opened: ExitStack, count: int) -> tuple[Any, Any, Any, Any]:
        """Return two arrays of shape (count, n), each followed by its handle as (n, count)."""
        result: list[Any] = []
        for _ in range(2):
            array = self.xp.zeros((count, self.n))
            result += [array, self.dense(opened, array)]
        return result[0], result[1], result[2], result[3]

    def dense(self, opened: ExitStack, array: Any) -> Any:
        """Return a handle of a row-major array as its transpose."""
        columns, rows = (ctypes.c_int64(size) for size in array.shape)
        layout = (rows, columns, rows, pointer(array), CODES.float64, CODES.column_major)
        return self.create(opened, "cudssMatrixCreateDn", "cudssMatrixDestroy", *layout)

    def create(self, opened: ExitStack, create: str, destroy: str, *data: Any) -> Any:
        """Return a new handle, which `opened` destroys, also if its creation returns an error."""
        handle = ctypes.c_void_p()
        try:
            self._call(create, ctypes.byref(handle), *data)
        finally:
            if handle.value:
                opened.callback(getattr(self.library, destroy), handle)
        return handle

    def put(self, key: int, array: Any) -> None:
        """Pass an array of the host, which is kept alive."""
        self._kept.append(array)
        size = ctypes.c_size_t(array.nbytes)
        self._call("cudssDataSet", self._handle, self._data, key, pointer(array), size)

    def get(self, key: int, out: Any) -> Any:
        """Return ctypes data after cuDSS has written into it."""
        room = ctypes.c_size_t(ctypes.sizeof(out)), ctypes.byref(ctypes.c_size_t())
        self._call("cudssDataGet", self._handle, self._data, key, ctypes.byref(out), *room)
        return out

    def set_values(self, data: Any) -> None:
        """Replace the values, for the same pattern."""
        self._call("cudssMatrixSetValues", self._matrix, pointer(data))
        self._kept[0] = (*self._kept[0][:2], data)

    def execute(self, phase: int, x: Any, b: Any, long: bool = False) -> None:
        """Run a phase; Ctrl-C ends a long one."""
        handles = self._config, self._data, self._matrix, x, b

        def work() -> None:
            with self._device:
                self._call("cudssExecute", self._handle, phase, *handles)

        if long and threading.current_thread() is threading.main_thread():
            in_a_thread(work, self._interrupt)
        else:
            work()

    def _interrupt(self, on: bool) -> None:
        """Set the number that cuDSS polls, to interrupt it."""
        self._flag[0] = on

    def _call(self, name: str, *arguments: Any) -> None:
        status = int(getattr(self.library, name)(*arguments))
        if status:
            raise failed(name, status)


def in_a_thread(work: Callable[[], None], interrupt: Callable[[bool], None]) -> None:
    """Run long work of a library so that Python handles signals meanwhile. At Ctrl-C the work is
    interrupted, and has ended when KeyboardInterrupt leaves this function."""
    result: Future[None] = Future()
    begin = threading.Event()
    dropped = False

    def whole() -> None:
        begin.wait()
        try:
            if not dropped:
                work()
            result.set_result(None)
        except BaseException as error:
            result.set_exception(error)

    try:
        threading.Thread(target=whole, daemon=True).start()
        begin.set()
        while not result.done():
            wait([result], 0.05)  # seconds: a signal just before a wait does not end it
        result.result()
    except KeyboardInterrupt:
        interrupt(True)
        dropped = not begin.is_set()
        begin.set()
        while not (dropped or result.done()):
            with suppress(KeyboardInterrupt):
                wait([result])
        interrupt(False)
        raise


def pointer(array: Any) -> Any:
    """Return the address of an array."""
    interface = getattr(array, "__cuda_array_interface__", None) or array.__array_interface__
    return ctypes.c_void_p(interface["data"][0])


def on_device(xp: Any, devices: tuple[int, ...] | None) -> Any:
    """Return the context in which CuPy works on the first of the devices, or on the present one."""
    if not hasattr(xp, "cuda"):
        return nullcontext()
    return xp.cuda.Device(*(devices or ())[:1])


def _numbers(devices: tuple[int, ...]) -> Any:
    return (ctypes.c_int * len(devices))(*devices)


def permutation(order: ArrayLike, n: int) -> NDArray[np.int32]:
    """Return an order in cuDSS's format."""
    given, seen = np.asarray(order), np.zeros(n, dtype=bool)
    if given.shape == (n,) and np.all((given >= 0) & (given < n)):
        numbers = np.ascontiguousarray(given, dtype=np.int32)
        seen[numbers] = np.equal(numbers, given)
    if not seen.all():
        raise InputError(f"order: expected the numbers 0 to {n - 1}, each once")
    return numbers
