"""cuBLAS called directly, without the checks that CuPy makes before a general product."""

from __future__ import annotations

from typing import Any

import numpy as np


class DeviceBlas:
    """The library and a handle that reads scalar factors, such as those at the addresses `ONE`,
    `MINUS` (of -1) and `ZERO`, from host memory; for a `with` block."""

    factors = np.array([1.0, -1.0, 0.0])

    def __enter__(self) -> tuple[Any, int]:
        from cupy.cuda import device
        from cupy_backends.cuda.libs import cublas

        self._library, self._handle = cublas, device.get_cublas_handle()
        self._mode = cublas.getPointerMode(self._handle)
        cublas.setPointerMode(self._handle, cublas.CUBLAS_POINTER_MODE_HOST)
        return cublas, self._handle

    def __exit__(self, *_: object) -> None:
        self._library.setPointerMode(self._handle, self._mode)


ONE, MINUS, ZERO = (DeviceBlas.factors.ctypes.data + 8 * i for i in range(3))
